// A machine that has nothing but its CAN bus: where the daemon gets its programs from then, and
// what its corrections gain. Measured by the drive itself.
#pragma once

#include <cstdio>

#include "tests/daemon/corrected_drive.h"

namespace servotwin::test {

class CanAlone : public CorrectedDrive {
 protected:
  CanAlone() {
    peak_ = 1e-3;  // more than the drive lags
    keeps_cycle_ = true;
  }
  /// The path repeats until the daemon has recognised and learned it.
  void recognise(std::unique_ptr<CanBus> bus, const std::string& source, double cycle_s) {
    begin(std::move(bus), source, cycle_s, "learn");
    ASSERT_NE(daemon_, nullptr);
    const double before = run();
    const auto start = Clock::now();
    learns_while_it_runs("is recognised");
    if (HasFatalFailure()) return;
    std::printf("recognised and learned after %d more repetitions, %.1f s\n", runs_ - 1,
                std::chrono::duration<double>(Clock::now() - start).count());
    expect_gain(before);
  }
  /// A file of the path is dropped into the folder.
  void drop(std::unique_ptr<CanBus> bus, const std::string& source, double cycle_s) {
    begin(std::move(bus), source, cycle_s, "off");
    ASSERT_NE(daemon_, nullptr);
    const double before = run();
    const std::filesystem::path part = directory_.path() / "part.csv";
    std::ofstream(part) << table();
    std::filesystem::rename(part, folder() / "part.csv");
    learns_while_it_runs("program 'part' of");
    if (HasFatalFailure()) return;
    expect_gain(before);
  }
  /// The path is sent over HTTP.
  void send(std::unique_ptr<CanBus> bus, const std::string& source, double cycle_s) {
    begin(std::move(bus), source, cycle_s, "off");
    ASSERT_NE(daemon_, nullptr);
    const double before = run();
    const daemon::HttpAnswer answer = ask(*daemon_, "PUT", "/api/v1/programs/part", table());
    ASSERT_EQ(answer.status, 202) << answer.body;
    learns_while_it_runs("program 'part' of");
    if (HasFatalFailure()) return;
    expect_gain(before);
  }

 private:
  [[nodiscard]] std::filesystem::path folder() const { return directory_.path() / "parts"; }
  void begin(std::unique_ptr<CanBus> bus, const std::string& source, double cycle_s,
             const std::string& recognise) {
    std::filesystem::create_directory(folder());
    ilc_ = "programs = \"" + folder().string() + "\"\nrecognise = \"" + recognise + "\"\n";
    daemon_ = started(std::move(bus), source, cycle_s);
    for (int k = 0; daemon_ != nullptr && k < cycles(1.0); ++k) cycle(0.0);
  }
  /// The path as the controller would write it down.
  [[nodiscard]] std::string table() const {
    std::ostringstream out;
    out.precision(12);
    out << "time[s],X.command[mm]\n";
    for (int k = 0; k < cycles(kPath_s); ++k)
      out << cycle_s_ * k << "," << 1e3 * path_at(k) << "\n";
    return out.str();
  }
  /// The path and a rest. RMS of the tracking error during its second half [m], where a correction
  /// that has been recognised is in full: what the drive is asked for in a cycle is where it is at
  /// the end of it.
  double run() {
    double sum = 0.0;
    const int rows = cycles(kPath_s), half = rows / 2;
    for (int k = 0; k < rows; ++k) {
      cycle(path_at(k));
      if (k >= half) sum += (path_at(k) - actual_) * (path_at(k) - actual_);
    }
    for (int k = 0; k < cycles(1.0); ++k) cycle(0.0);
    ++runs_;
    return std::sqrt(sum / (rows - half));
  }
  void learns_while_it_runs(const std::string& said) {
    constexpr int kMostRuns = 12;
    const auto has_learned = [&] {
      const std::string& all = daemon_->said();
      return all.find(said) != std::string::npos && all.find("learned in") != std::string::npos;
    };
    while (!has_learned()) {
      ASSERT_LT(runs_, kMostRuns) << daemon_->said();
      run();
    }
    ASSERT_EQ(daemon_->said().find("nothing is sent"), std::string::npos) << daemon_->said();
  }
  /// Armed, the path is followed better by the drive, and the daemon says by how much.
  void expect_gain(double before) {
    ASSERT_EQ(arm(*daemon_).status, 200) << daemon_->said();
    constexpr int kMostRuns = 24;        // a run that a busy host held up is given up
    constexpr double kErrorShare = 0.1;  // that the correction may leave; it leaves 0.001 to 0.003
    double after = before;
    for (int runs = 0; runs < kMostRuns && after > kErrorShare * before; ++runs) after = run();
    const std::string said = daemon_->said();
    EXPECT_LT(after, kErrorShare * before) << said;
    const std::size_t at = said.find("sent; X RMS measured");
    ASSERT_NE(at, std::string::npos) << said;
    std::printf("tracking error of the drive %.1f um before, %.1f um corrected\n", 1e6 * before,
                1e6 * after);
    std::printf("the daemon: %s\n", said.substr(at, said.find('\n', at) - at).c_str());
    EXPECT_EQ(daemon_->end(SIGTERM), 0);
  }

  std::unique_ptr<Process> daemon_;
  int runs_ = 0;
};

}  // namespace servotwin::test
