// Two sources whose clocks differ, joined by the real daemon: how well, how late, what is lost.
//
//   bench_clocks SERVOTWIND SECONDS PPM [INTERFACE [CYCLE_S]]
//
// Commands come over DDS in this cycle (0.001 s) by a clock that is an hour ahead and gains PPM
// microseconds a second on this host's, the encoder in CAN over UDP, or on INTERFACE, 0.37 ms later
// and in the same cycle of this host. The encoder stands where the command is at the same moment,
// so that what the daemon records as their difference, over the speed, is the error of the
// alignment. Prints one JSON object; "commands_alone" is the same daemon with the commands only,
// right afterwards.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "drivers/recordings/recording_file.h"
#include "tests/support/free_port.h"
#include "tests/support/process.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/two_clock_machine.h"

namespace {

using namespace servotwin;
using test::TwoClockMachine;

constexpr std::uint32_t kDomain = 91;
constexpr double kSlowest = 0.1;  // [m/s]: below, the quantum of the encoder counts

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return kAbsent;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// From the moment of a command to its prediction at a subscriber [us].
class Latencies {
 public:
  Latencies(const DdsNode& node, const TwoClockMachine& machine)
      : predictions_(node), machine_(machine) {
    thread_ = std::jthread([this](const std::stop_token& stop) {
      MachinePrediction prediction;
      while (!stop.stop_requested()) {
        if (!predictions_.receive(prediction, 0.1)) continue;
        us_.push_back(
            1e-3 * static_cast<double>(daemon::steady_ns() - machine_.due_ns(prediction.sequence)));
      }
    });
  }
  std::vector<double> take() {
    thread_.request_stop();
    thread_.join();
    return us_;
  }

 private:
  DdsReader<MachinePrediction> predictions_;
  const TwoClockMachine& machine_;
  std::vector<double> us_;
  std::jthread thread_;
};

nlohmann::json run(const std::string& servotwind, double seconds, double ppm,
                   const std::string& interface, const std::string& cycle_s, bool joined) {
  const test::TemporaryDirectory directory;
  const int port = test::free_port();
  const auto map_file = directory.file("map.toml", TwoClockMachine::map_with(cycle_s));
  const std::string listen = "127.0.0.1:" + std::to_string(port),
                    kind = interface.empty() ? "udp" : "can",
                    source = interface.empty()
                                 ? "[source.udp]\nmap = \"map.toml\"\nlisten = \"" + listen + "\"\n"
                                 : "[source.can]\nmap = \"map.toml\"\ninterfaces = [\"" +
                                       interface + "\"]\n";
  const auto config = directory.file(
      "m.toml", "[machine]\nname = \"clocks\"\ncycle_s = " + cycle_s +
                    "\n[[axis]]\nname = \"X\"\n"
                    "source = \"dds\"\n" +
                    (joined ? "encoder = \"" + kind + "\"\n" + source : std::string()) +
                    "[dds]\ndomain = " + std::to_string(kDomain) + "\n[store]\ndirectory = \"" +
                    (directory.path() / "store").string() + "\"\n[http]\nlisten = \"none\"\n");
  test::Process daemon({servotwind, "--config", config.string()});
  DdsPlace place;
  place.domain = kDomain;
  place.machine = "clocks";
  const DdsNode node(place);
  TwoClockMachine machine(node, load_can_map(map_file, Mapped::kChannels),
                          interface.empty() ? "udp:" + listen : interface, 1e-6 * ppm);
  Latencies latencies(node, machine);
  if (!machine.wait_for_daemon(10.0)) throw std::runtime_error("no daemon: " + daemon.said());
  machine.run(seconds);
  const std::vector<double> late_us = latencies.take();
  daemon.end(SIGTERM);

  std::vector<double> errors_us;
  std::size_t rows = 0, absent = 0;
  double first_s = kAbsent;
  std::set<std::filesystem::path> files;  // by name, and so by time
  for (const auto& file :
       std::filesystem::directory_iterator(directory.path() / "store/recordings/clocks"))
    files.insert(file.path());
  for (const auto& file : files) {
    const Recording recording = read_recording(file);
    const AxisRecord& axis = recording.axes[0];
    for (std::size_t i = 1; i + 1 < axis.command.size(); ++i) {
      ++rows;
      const double speed = (axis.command[i + 1] - axis.command[i - 1]) /
                           (recording.time[i + 1] - recording.time[i - 1]);
      if (std::isfinite(axis.actual[i])) {
        first_s = std::fmin(first_s, recording.time[i] - recording.time.front());
        if (std::abs(speed) > kSlowest)
          errors_us.push_back(1e6 * (axis.actual[i] - axis.command[i]) / speed);
      } else if (std::isfinite(first_s)) {
        ++absent;
      }
    }
  }
  const double middle = quantile(errors_us, 0.5);
  std::vector<double> off;
  for (const double one : errors_us) off.push_back(std::abs(one - middle));
  const std::string clock_line =
      daemon.said().substr(std::min(daemon.said().find("the clock of"), daemon.said().size()));
  return {{"cycles", rows},
          {"cycles_without_encoder_after_the_first", absent},
          {"alignment_us",
           {{"median", middle},
            {"p95_about_it", quantile(off, 0.95)},
            {"max_about_it", quantile(off, 1.0)}}},
          {"prediction_us", {{"p50", quantile(late_us, 0.5)}, {"p99", quantile(late_us, 0.99)}}},
          {"sent_late", machine.late()},
          {"encoder_sent_late_us", 1e6 * machine.encoder_late_s()},
          {"said", clock_line.substr(0, clock_line.find('\n'))}};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4 || argc > 6) {
    std::fprintf(stderr, "usage: bench_clocks SERVOTWIND SECONDS PPM [INTERFACE [CYCLE_S]]\n");
    return 2;
  }
  try {
    const double seconds = std::atof(argv[2]), ppm = std::atof(argv[3]);
    const std::string interface = argc > 4 ? argv[4] : "", cycle_s = argc > 5 ? argv[5] : "0.001";
    nlohmann::json out{{"joined", run(argv[1], seconds, ppm, interface, cycle_s, true)},
                       {"commands_alone", run(argv[1], seconds, ppm, interface, cycle_s, false)}};
    out["commands_alone"].erase("alignment_us");
    out["commands_alone"].erase("said");
    std::printf("%s\n", out.dump(2).c_str());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_clocks: %s\n", error.what());
    return 1;
  }
}
