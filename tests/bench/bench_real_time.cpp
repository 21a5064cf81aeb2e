// The real-time loop's wake-up and work, with and without identification and diagnosis beside it.
//
//   bench_real_time [SECONDS] [HZ] [CPU]
//
// One virtual machine with one axis, its cycles on a timer; the loop, the recorder and the two
// workers as in daemon/service.cpp, at the priorities that are permitted. Prints both histograms as
// quantiles: "wake" from the moment the cycle was due to the loop running, "work" from there to the
// end of its cycle. Load from outside is the caller's (tests/bench/real_time).
//
// Of wakes later than a millisecond it says whose they are: how long the thread was ready and
// waited for a processor that another thread had (the kernel's count, run_delay of
// Documentation/scheduler/sched-stats). The rest of the time its timer had not yet come: the
// processor itself was away, or deaf to it.
#include <fcntl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "daemon/between/clock.h"
#include "daemon/diagnose/diagnosis_worker.h"
#include "daemon/identify/identification_worker.h"
#include "daemon/loop/real_time_loop.h"
#include "daemon/loop/scheduling.h"
#include "daemon/record/recorder.h"
#include "tests/bench/record.h"

namespace {

using namespace servotwin;

/// How long the calling thread has been ready and not running [ns].
class RunDelay {
 public:
  RunDelay() : file_(open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC)) {}
  RunDelay(const RunDelay&) = delete;
  RunDelay& operator=(const RunDelay&) = delete;
  ~RunDelay() {
    if (file_ >= 0) close(file_);
  }
  /// -1: this kernel does not count it.
  [[nodiscard]] std::int64_t ns() const {
    char text[96] = {};
    if (file_ < 0 || pread(file_, text, sizeof text - 1, 0) <= 0) return -1;
    long long running = 0, waiting = -1;
    return std::sscanf(text, "%lld %lld", &running, &waiting) == 2 ? waiting : -1;
  }

 private:
  int file_;
};

struct LateWake {
  std::int64_t late_ns, waited_ns;
};

/// A record that repeats, on a timer.
class TimedSource final : public daemon::FrameSource {
 public:
  TimedSource(const Segment& record, double seconds, double hz)
      : record_(record), cycles_(static_cast<std::uint64_t>(seconds * hz)), hz_(hz) {}

  daemon::Received receive(MachineFrame& frame, double) noexcept override {
    if (next_ == cycles_) return daemon::Received::kEnd;
    if (next_ == 0) start_ns_ = daemon::steady_ns();
    due_ns_ = start_ns_ + std::llround(1e9 * static_cast<double>(next_) / hz_);
    const timespec until{static_cast<time_t>(due_ns_ / 1'000'000'000),
                         static_cast<long>(due_ns_ % 1'000'000'000)};
    const std::int64_t waited_before = delay_.ns();
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != 0) {
    }
    const std::int64_t late_ns = daemon::steady_ns() - due_ns_;
    if (late_ns > 1'000'000) late_.push_back({late_ns, delay_.ns() - waited_before});
    const auto size = static_cast<std::uint64_t>(record_.command.size());
    const auto at = static_cast<Eigen::Index>(next_ % size);
    frame.sequence = next_ + next_ / size;  // a gap where the record begins again
    frame.time_ns = std::llround(1e9 * static_cast<double>(frame.sequence) / hz_);
    frame.axis_count = 1;
    frame.axes[0] = {record_.command(at), record_.actual(at), kAbsent};
    ++next_;
    return daemon::Received::kFrame;
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override {
    return daemon::steady_ns() - due_ns_;
  }
  [[nodiscard]] const std::vector<LateWake>& late() const { return late_; }

 private:
  const Segment& record_;
  RunDelay delay_;  // of the thread that makes it, which is the loop's
  std::vector<LateWake> late_;
  std::uint64_t cycles_, next_ = 0;
  double hz_;
  std::int64_t start_ns_ = 0, due_ns_ = 0;
};

void print(const char* what, const daemon::Histogram& histogram) {
  std::printf("  %-5s", what);
  for (const double q : {0.5, 0.99, 0.999, 0.9999})
    std::printf("  p%-6g %8.1f us", 100.0 * q, 1e6 * histogram.quantile_s(q));
  std::printf("  max %8.1f us\n", 1e6 * histogram.max_s());
}

void print(const std::vector<LateWake>& late) {
  if (late.empty()) return;
  const auto worst = std::max_element(
      late.begin(), late.end(), [](const auto& a, const auto& b) { return a.late_ns < b.late_ns; });
  const auto most = std::max_element(late.begin(), late.end(), [](const auto& a, const auto& b) {
    return a.waited_ns < b.waited_ns;
  });
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  std::printf(
      "  %zu wakes later than 1 ms: the worst %.0f us, of which %.0f us waiting for a "
      "processor; the longest wait %.0f us, of %.0f us\n",
      late.size(), us(worst->late_ns), us(worst->waited_ns), us(most->waited_ns),
      us(most->late_ns));
}

void measure(bool background, double seconds, double hz, int cpu, const Segment& record) {
  const MachineDescription machine{1.0 / hz, {{"X", false, ""}}};
  const std::filesystem::path place =
      std::filesystem::temp_directory_path() / ("bench_real_time-" + std::to_string(getpid()));
  {
    daemon::Store store(place, "bench");
    std::ostringstream said;
    daemon::EventLog events(store, said);
    std::vector<daemon::LatestValue<daemon::TwinInForce>> models(1);
    daemon::Ring<MachinePrediction> predictions(256);
    daemon::Ring<daemon::CycleRow> rows(8192);
    daemon::WakeUp predicted;
    daemon::MotionMemory memory(machine, 120.0);
    daemon::DiagnoseConfig diagnose;
    diagnose.every_s = 1.0;  // always due: it never rests
    diagnose.record_s = 10.0;
    daemon::ResidualWatch watch(machine, diagnose, events);
    daemon::Recorder recorder(machine, "bench", place, {.budget_mb = 100.0}, rows, memory, watch,
                              events);
    daemon::IdentifyConfig identify;
    identify.window_s = 2.0;
    daemon::IdentificationWorker identification(machine, identify, memory, store, events, models,
                                                [](const daemon::StoredModel&) {});
    daemon::DiagnosisWorker diagnosis(machine, diagnose, identify, memory, watch, store, events,
                                      [](const daemon::StoredDiagnosis&) {});
    const auto loop = std::make_unique<daemon::RealTimeLoop>(machine.cycle_s, models, predictions,
                                                             rows, predicted);
    (void)daemon::lock_memory();

    std::stop_source stop;
    diagnosis.give_up_with(stop.get_token());
    std::vector<std::thread> workers;
    workers.emplace_back([&] { recorder.run(stop.get_token()); });
    workers.emplace_back([&] {
      MachinePrediction prediction;
      while (!stop.stop_requested()) {
        predicted.wait(100);
        while (predictions.pop(prediction)) {
        }
      }
    });
    if (background) {
      workers.emplace_back([&] {
        (void)daemon::become_idle();
        identification.run(stop.get_token());
      });
      workers.emplace_back([&] {
        (void)daemon::become_idle();
        diagnosis.run(stop.get_token());
      });
    }
    std::string refused;
    std::vector<LateWake> late;
    std::thread real_time([&] {
      if (cpu >= 0) refused = daemon::keep_to({cpu});
      if (const std::string why = daemon::become_real_time(80); !why.empty()) refused = why;
      daemon::prefault_stack();
      TimedSource source(record, seconds, hz);
      const std::atomic<bool> never{false};
      loop->run(source, never);
      late = source.late();
    });
    real_time.join();
    stop.request_stop();
    // As the daemon does when it ends: what is idle beside stress-ng would not end in minutes.
    for (std::thread& worker : workers) daemon::restore_normal_priority(worker.native_handle());
    for (std::thread& worker : workers) worker.join();
    const daemon::LoopCounters& counters = loop->counters();
    std::size_t steps = 0, diagnoses = 0;
    for (const daemon::Event& event : store.events(100'000)) {
      steps += event.kind == "identification_step" ? 1U : 0U;
      diagnoses += event.kind == "diagnosis_begun" ? 1U : 0U;
    }
    std::printf("%s: %llu cycles, %llu overruns, %zu identifications, %zu diagnoses%s%s\n",
                background ? "with identification and diagnosis" : "alone",
                static_cast<unsigned long long>(counters.frames),
                static_cast<unsigned long long>(counters.overruns), steps, diagnoses,
                refused.empty() ? "" : "; ", refused.c_str());
    print("wake", counters.wake);
    print("work", counters.work);
    print(late);
    std::fflush(stdout);
  }
  std::filesystem::remove_all(place);
}

}  // namespace

// What escapes ends the benchmark with its message.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 30.0;
  const double hz = argc > 2 ? std::atof(argv[2]) : 1000.0;
  const int cpu = argc > 3 ? std::atoi(argv[3]) : -1;
  const servotwin::Segment record = servotwin::bench::production_record();
  for (const bool background : {false, true}) measure(background, seconds, hz, cpu, record);
}
