// Prints the predictions of the daemon of a machine, one line per servo cycle, and reports when
// predictions stop and when the daemon has stopped.
//
//   subscriber MACHINE [DOMAIN [SILENCE_S]]
// SILENCE_S (0.1) is the requested deadline of the predictions: a longer silence is reported. It
// must not be shorter than the machine's cycle, which is the deadline that the daemon offers.
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <stdexcept>
#include <string>

#include "drivers/dds/dds.h"

namespace {

using namespace servotwin;
using Clock = std::chrono::steady_clock;

constexpr double kMicro = 1e-6;

volatile std::sig_atomic_t asked_to_stop = 0;

void print(const MachinePrediction& prediction, const MachineStatus& status) {
  std::string line = "cycle " + std::to_string(prediction.sequence) + ":";
  char text[100];
  for (int i = 0; i < prediction.axis_count; ++i) {
    const auto axis = static_cast<std::size_t>(i);
    const std::string name =
        axis < status.axes.size() ? status.axes[axis].name : "axis " + std::to_string(i + 1);
    const bool rotary = axis < status.axes.size() && status.axes[axis].rotary;
    std::snprintf(text, sizeof text, " %s %.3f %s,", name.c_str(),
                  prediction.axes[axis].predicted_error / kMicro, rotary ? "urad" : "um");
    line += text;
  }
  std::snprintf(text, sizeof text, " contour %.3f um", prediction.contour_error / kMicro);
  std::puts((line + text).c_str());
}

void listen(const DdsPlace& place, double silence_s) {
  const DdsNode node(place);
  DdsReader<MachinePrediction> predictions(node, silence_s);
  DdsReader<MachineStatus> statuses(node);
  MachinePrediction prediction;
  MachineStatus status;
  Clock::time_point last = Clock::now();
  enum { kNothingYet, kSpeaks, kSilent, kGone } daemon = kNothingYet;
  while (asked_to_stop == 0) {
    const bool came = predictions.receive(prediction, silence_s);
    while (statuses.receive(status, 0.0)) {
    }
    if (came) {
      const auto now = Clock::now();
      if (daemon == kSilent || daemon == kGone) {
        std::printf("again after %.3f s\n", std::chrono::duration<double>(now - last).count());
      }
      print(prediction, status);
      last = now;
      daemon = kSpeaks;
    } else if (daemon == kSpeaks && predictions.deadline_missed()) {
      std::printf("silent: no prediction for more than %.3g s\n", silence_s);
      daemon = kSilent;
    }
    if ((daemon == kSpeaks || daemon == kSilent) && !predictions.matched()) {
      std::puts("gone: no daemon is there");
      daemon = kGone;
    }
    std::fflush(stdout);
  }
}

/// A complete word as a number.
template <class Number>
Number number_in(const char* word, const char* name, const char* rule) {
  Number value{};
  const char* end = word + std::strlen(word);
  const auto read = std::from_chars(word, end, value);
  if (read.ec == std::errc{} && read.ptr == end) return value;
  throw std::invalid_argument(std::string(name) + " = '" + word + "': must be " + rule);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    std::fputs("usage: subscriber MACHINE [DOMAIN [SILENCE_S]]\n", stderr);
    return 2;
  }
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { asked_to_stop = 1; });
  try {
    const auto domain =
        argc > 2 ? number_in<std::uint32_t>(argv[2], "DOMAIN", "a whole number from 0 to 230") : 0;
    const double silence_s =
        argc > 3 ? number_in<double>(argv[3], "SILENCE_S", "a number above 0") : 0.1;
    if (!(silence_s > 0.0)) throw std::invalid_argument("SILENCE_S must be a number above 0");
    listen({argv[1], domain, ""}, silence_s);
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "subscriber: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "subscriber: %s\n", error.what());
    return 1;
  }
  return 0;
}
