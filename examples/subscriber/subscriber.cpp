// Prints what the daemon of a machine predicts, one line per servo cycle, and says when it falls
// silent and when it is gone.
//
//   subscriber MACHINE [DOMAIN [SILENCE_S]]
//
// SILENCE_S (0.1) is asked for as the deadline of the predictions: a silence that is longer is
// told. It must not be shorter than the machine's cycle, which the daemon offers.
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "drivers/dds.h"

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
    std::snprintf(text, sizeof text, " %s %.3f um,", name.c_str(),
                  prediction.axes[axis].predicted_error / kMicro);
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

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    std::fputs("usage: subscriber MACHINE [DOMAIN [SILENCE_S]]\n", stderr);
    return 2;
  }
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { asked_to_stop = 1; });
  try {
    const auto domain = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 0);
    const double silence_s = argc > 3 ? std::atof(argv[3]) : 0.1;
    if (!(silence_s > 0.0)) throw std::invalid_argument("SILENCE_S must be a number above 0");
    listen({argv[1], domain, ""}, silence_s);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "subscriber: %s\n", error.what());
    return 1;
  }
  return 0;
}
