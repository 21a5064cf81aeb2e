// Shared by the tests over DDS: a machine, and the directory of its daemon.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/store/store.h"
#include "drivers/dds/dds.h"
#include "tests/daemon/support.h"
#include "tests/support/process.h"

namespace servotwin::test {

/// Runs a command of the shell; throws with what it said if it fails.
inline void run(const std::string& command) {
  Process process({"sh", "-c", command});
  if (const int status = process.end(); status != 0) {
    throw std::runtime_error(command + ": " + process.said() + " (" + std::to_string(status) + ")");
  }
}

/// The command that cycle k of axis X has, and the frame of it.
inline double command_of(std::uint64_t k) {
  return daemon::command_at(static_cast<double>(k) * daemon::kCycle_s);
}

inline MachineFrame frame_of(std::uint64_t k) {
  MachineFrame frame;
  frame.sequence = k;
  frame.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
  frame.axis_count = 1;
  frame.axes[0].command = command_of(k);
  frame.axes[0].actual = frame.axes[0].command - 1e-6;
  return frame;
}

/// A store with a model of axis X in force, and the daemon's configuration beside it. `axis`: more
/// keys of the axis; `rest`: more sections.
class Home {
 public:
  Home(const DdsPlace& place, const Model& model, int strength = 0,
       const std::string& reason = "for this test",
       const std::string& rest = "[http]\nlisten = 'none'\n", const std::string& axis = "") {
    daemon::Store store(directory_.path() / "store", place.machine);
    ModelRecord record = daemon::record_of(model);
    store.promote(record, {"2026-01-31T12:00:00.000Z", "X", "model_promoted", reason, ""});
    std::ofstream(directory_.path() / "m.toml")
        << "[machine]\nname = '" << place.machine << "'\ncycle_s = 0.001\n[[axis]]\nname = 'X'\n"
        << axis << "[source.dds]\ndomain = " << place.domain << "\nstrength = " << strength
        << "\n[store]\ndirectory = '" << (directory_.path() / "store").string()
        << "'\n[real_time]\npriority = 0\n[diagnose]\nevery_s = 0\nfalse_alarm_days = 0\n"
        << rest;
  }
  [[nodiscard]] std::vector<std::string> daemon() const {
    return {"servotwind", "--config", directory_.path() / "m.toml"};
  }
  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const {
    return directory_.path() / name;
  }

 private:
  TemporaryDirectory directory_;
};

/// A machine of this process alone.
inline DdsPlace place_of(const std::string& name) {
  const auto id = static_cast<std::uint32_t>(getpid());
  return {name + "-" + std::to_string(id), 1 + id % 200, ""};
}

/// Sends frames until `done`, one per millisecond at most; the sequence number after the last one.
template <class Done>
std::uint64_t send_until(DdsWriter<MachineFrame>& frames, std::uint64_t k, const Done& done,
                         double timeout_s = kPatience_s) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!done()) {
    if (std::chrono::steady_clock::now() > until) {
      ADD_FAILURE() << "not done in " << timeout_s << " s";
      break;
    }
    frames.write(frame_of(k++));
    dds_sleepfor(DDS_MSECS(1));
  }
  return k;
}

}  // namespace servotwin::test
