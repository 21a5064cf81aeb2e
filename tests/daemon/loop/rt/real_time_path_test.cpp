// The real-time path allocates nothing, takes no lock and throws nothing: the real loop, run while
// all of that is forbidden, from every kind of source, with everything that can happen to it.
#include <gtest/gtest.h>
#include <unistd.h>

#include <functional>
#include <memory>
#include <mutex>
#include <numbers>
#include <thread>

#include "daemon/input/can_prediction.h"
#include "daemon/input/can_source.h"
#include "daemon/loop/live_offsets.h"
#include "daemon/loop/real_time_loop.h"
#include "drivers/can/can_encoder.h"
#include "drivers/can/can_udp.h"
#include "tests/daemon/loop/rt/forbid_heap.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

/// Forbids heap and locks from when a frame is received until the next one is asked for.
class ForbiddingSource final : public FrameSource {
 public:
  explicit ForbiddingSource(FrameSource& inner) : inner_(inner) {}
  Received receive(MachineFrame& frame, double timeout_s) noexcept override {
    forbid_heap_and_locks(false);
    const Received received = inner_.receive(frame, timeout_s);
    forbid_heap_and_locks(received != Received::kEnd);
    return received;
  }
  std::uint32_t send(const MachineOffset& offset, std::int64_t until_ns) noexcept override {
    return inner_.send(offset, until_ns);
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return inner_.age_ns(); }

 private:
  FrameSource& inner_;
};

/// A loop with the workers' ends of its rings, which a thread empties as the publisher and the
/// recorder do.
class Running {
 public:
  explicit Running(std::size_t axes)
      : models(axes),
        loop(kCycle_s, models, predictions, rows, wake_up,
             axes < 3 ? std::vector<std::vector<std::size_t>>{}
                      : std::vector<std::vector<std::size_t>>{{0, 1, 2}}) {}

  Violations run(FrameSource& source) {
    const Violations before = violations();
    ForbiddingSource forbidding(source);
    loop.run(forbidding, stop);
    forbid_heap_and_locks(false);
    const Violations after = violations();
    return {after.heap - before.heap, after.locks - before.locks};
  }

  std::vector<LatestValue<TwinInForce>> models;
  Ring<MachinePrediction> predictions{256};
  Ring<CycleRow> rows{256};
  WakeUp wake_up;
  RealTimeLoop loop;
  std::atomic<bool> stop{false};
  std::jthread workers{[this](const std::stop_token& its_stop) {
    MachinePrediction prediction;
    CycleRow row;
    while (!its_stop.stop_requested()) {
      wake_up.wait(10);
      while (predictions.pop(prediction)) {
      }
      while (rows.pop(row)) {
      }
    }
  }};
};

TwinInForce in_force(const Model& model, int version) {
  return {Twin(model), version, 1e-6, settling_cycles(model)};
}

/// A machine with all faults: lost cycles, jumps, repeats, values that are not finite, and changing
/// models.
class Eventful final : public FrameSource {
 public:
  Eventful(std::vector<LatestValue<TwinInForce>>& models, std::uint64_t count)
      : models_(models), count_(count) {
    Model delayed = drive(25.0);
    Effect delay = make_effect<TimeDelay>();
    delay.shape[0] = 0.0073;
    delayed.effects.push_back(delay);
    Model pushed = drive(20.0);
    pushed.effects.push_back(make_effect<CrossCouplingByMotion>());
    pushed.effects.back().coefficient[0] = -0.1;
    twins_ = {in_force(drive(15.0), 1), in_force(delayed, 2), in_force(drive(30.0, 5.0), 3),
              in_force(pushed, 4), in_force(pushed, 5)};
    for (std::size_t i : {3U, 4U}) twins_[i].by_motion = true;
  }
  Received receive(MachineFrame& frame, double) noexcept override {
    if (k_ >= count_) return Received::kEnd;
    ++k_;
    if (k_ % 5000 == 1) {
      const std::size_t axis = k_ / 5000 % models_.size();
      TwinInForce next = twins_[k_ / 5000 % twins_.size()];
      if (next.by_motion) next.neighbour = static_cast<int>((axis + 1) % models_.size());
      models_[axis].publish(next);
    }
    if (k_ % 7001 == 0) sequence_ += 13;
    if (k_ % 9001 == 0) sequence_ = 1;
    if (k_ % 3001 != 0) ++sequence_;
    frame.sequence = sequence_;
    frame.time_ns = static_cast<std::int64_t>(k_) * 1'000'000;
    if (k_ % 4001 == 0) frame.time_ns += 500'000'000;
    frame.axis_count = k_ % 6007 == 0 ? 99 : static_cast<int>(models_.size());
    frame.ahead_count = static_cast<int>(k_ % (kMaxLookAhead + 1));
    for (std::size_t i = 0; i < models_.size(); ++i) {
      const double t = static_cast<double>(k_) * kCycle_s;
      frame.axes[i] = {command_at(t), command_at(t - 0.002), 1.0};
      for (std::size_t a = 0; a < kMaxLookAhead; ++a) {
        frame.ahead[i][a] = command_at(t + static_cast<double>(a + 1) * kCycle_s);
      }
    }
    if (k_ % 1009 == 0) frame.axes[0].command = kAbsent;
    if (k_ % 1013 == 0) frame.axes[0].actual = INFINITY;
    if (k_ % 8009 == 0) frame.axes[0].command = 1e308;
    return Received::kFrame;
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 1000; }

 private:
  std::vector<LatestValue<TwinInForce>>& models_;
  std::vector<TwinInForce> twins_;
  std::uint64_t count_, k_ = 0, sequence_ = 0;
};

constexpr Violations kNone{};

TEST(RealTimePath, AllocatesNothingAndTakesNoLockWhateverHappens) {
  Running running(8);
  Eventful machine(running.models, 100'000);
  EXPECT_EQ(running.run(machine), kNone);
  const LoopCounters& counters = running.loop.counters();
  EXPECT_EQ(counters.frames, 100'000U);
  for (const auto* counter : {&counters.lost, &counters.repeated, &counters.time_jumps,
                              &counters.malformed, &counters.not_finite}) {
    EXPECT_GT(*counter, 0U) << "the machine is not as eventful as it is meant to be";
  }
}

TEST(RealTimePath, AllocatesNothingWithARecordingReplayed) {
  Recording recording;
  recording.source = "made";
  AxisRecord axis;
  axis.name = "X";
  for (int i = 0; i < 3000; ++i) {
    recording.time.push_back(i * kCycle_s);
    axis.command.push_back(command_at(i * kCycle_s));
    axis.actual.push_back(command_at((i - 2) * kCycle_s));
  }
  recording.axes.push_back(axis);
  std::vector<Replay> recordings;
  recordings.emplace_back(recording, kCycle_s, 8);
  ReplaySource source(std::move(recordings), 0.0);
  Running running(1);
  running.models[0].publish(in_force(drive(), 1));
  EXPECT_EQ(running.run(source), kNone);
  EXPECT_EQ(running.loop.counters().frames, 3000U);
}

/// Two axes that stand, run a program, stand; every third time with a pause in it. In real time: an
/// offset is sent once per cycle. A host that pauses this thread makes frames late, and a program
/// that begins with a late frame is let pass: they repeat it until `enough`, 30 times at most.
class Repeating final : public FrameSource {
 public:
  Repeating(const CommandedPath& program, std::function<bool()> enough)
      : program_(program), enough_(std::move(enough)) {}
  Received receive(MachineFrame& frame, double) noexcept override {
    const Eigen::Index rows = program_.rows(), whole = rows + 500;
    const auto k = static_cast<Eigen::Index>(k_);
    if (k % (3 * whole) == 0 && (enough_() || k >= 30 * whole)) return Received::kEnd;
    Eigen::Index row = std::max<Eigen::Index>(k % whole - 250, 0);
    if (k / whole % 3 == 2) row = std::min<Eigen::Index>(row, rows / 2);
    row = std::min(row, rows - 1);
    std::this_thread::sleep_until(start_ + std::chrono::milliseconds(k_));
    frame.sequence = ++k_;
    frame.time_ns = static_cast<std::int64_t>(k_) * 1'000'000;
    frame.axis_count = 2;
    for (std::size_t i = 0; i < 2; ++i)
      frame.axes[i] = {program_.command[i](row), program_.command[i](row), kAbsent};
    return Received::kFrame;
  }
  std::uint32_t send(const MachineOffset& offset, std::int64_t /*until_ns*/) noexcept override {
    for (const AxisOffset& axis : offset.axes) sent_ = std::max(sent_, std::abs(axis.offset));
    return 0;
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 1000; }
  [[nodiscard]] double sent() const { return sent_; }

 private:
  const CommandedPath& program_;
  std::function<bool()> enough_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::uint64_t k_ = 0;
  double sent_ = 0.0;
};

TEST(RealTimePath, AllocatesNothingWhileCorrectionsAreGivenBack) {
  auto learned = std::make_shared<LearnedProgram>();
  constexpr Eigen::Index kRows = 2000;
  const Eigen::ArrayXd time = Eigen::ArrayXd::LinSpaced(kRows, 0.0, 1.0);
  const Eigen::ArrayXd bump = (std::numbers::pi * time).sin().square();
  learned->program.axes = {0, 1};
  for (const char* name : {"X", "Y"}) {
    const double bent = name[0] == 'X' ? 0.0 : 1.0;
    learned->program.command.emplace_back(0.01 * bump * (0.5 + bent * time));
    learned->axes.push_back({name, false, 1});
    learned->holdout_rms.push_back(0.0);
    learned->holdout_max.push_back(0.0);
    learned->offset.emplace_back(1e-4 * bump * (4.0 * std::numbers::pi * time).sin().square());
    learned->error_before.emplace_back(Eigen::ArrayXd::Constant(kRows, 1.0));
    learned->error_after.emplace_back(Eigen::ArrayXd::Zero(kRows));
  }
  learned->contour_before = learned->error_before[0];
  learned->contour_after = learned->error_after[0];
  learned->contour_size_before = {1.0, 1.0};
  OffsetRules rules;
  rules.cycle_s = kCycle_s;
  rules.limits.assign(2, GateLimits{1e-3, 0.1, 200.0, 0.1, 0.02, 604800.0, true});
  rules.ramp_s = 0.1;
  rules.validity_s = 0.02;
  rules.match_tolerance = 2e-6;
  rules.residual_band = 1e9;
  rules.live = true;
  OffsetHandOver hand_over;
  const OffsetPlan plan{1, 0, {learned}};
  hand_over.plans.publish(&plan);
  hand_over.armed = true;
  LiveOffsets offsets(rules, hand_over);
  Ring<DatedOffset> said(4096);

  Running running(2);
  for (auto& model : running.models) model.publish(in_force(drive(), 1));
  running.loop.give_back(offsets, said);
  Repeating machine(learned->program, [&] { return hand_over.runs.waiting() >= 3; });
  EXPECT_EQ(running.run(machine), kNone);
  EXPECT_GT(machine.sent(), 5e-5) << "offsets were given back";
  EXPECT_GE(hand_over.runs.waiting(), 3U);
}

TEST(RealTimePath, AllocatesNothingWithFramesFromTheNetwork) {
  const DdsNode node({"rt-" + std::to_string(getpid()), 92, ""});
  DdsSource source(node);
  DdsWriter<MachineFrame> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, 10.0));
  Running running(8);
  for (auto& model : running.models) model.publish(in_force(drive(), 1));
  constexpr std::uint64_t kFrames = 500;
  std::jthread machine([&] {
    MachineFrame frame;
    for (std::uint64_t k = 0; k < kFrames; ++k) {
      frame.sequence = k;
      frame.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
      frame.axis_count = 8;
      for (std::size_t i = 0; i < 8; ++i)
        frame.axes[i] = {command_at(static_cast<double>(k) * kCycle_s), 0.0, kAbsent};
      writer.write(frame);
      usleep(500);
    }
    while (running.loop.counters().frames == 0) usleep(1000);
    usleep(200'000);
    running.stop = true;
  });
  EXPECT_EQ(running.run(source), kNone);
  EXPECT_GT(running.loop.counters().frames, 0U);
}

/// Operations that this test must detect if the loop did them.
Violations seen(const std::function<void()>& action) {
  const Violations before = violations();
  {
    const ForbidHeap forbid;
    action();
  }
  const Violations after = violations();
  return {after.heap - before.heap, after.locks - before.locks};
}

// A bus allocates nothing even while a frame is received.
TEST(RealTimePath, ReceivingFromABusAllocatesNothing) {
  CheckedCanMap checked = check_can_map(
      "cycle_s = 0.001\n[[axis]]\nname = \"X\"\ncommand = {id = 1, start_bit = 0, length = 32, "
      "unit = "
      "\"nm\"}\nactual = {id = 2, start_bit = 0, length = 32, unit = \"nm\"}\n",
      "m.toml", "");
  ASSERT_TRUE(checked.problems.empty());
  auto listener = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", ""});
  CanUdp machine({"127.0.0.1:0", "127.0.0.1:" + std::to_string(listener->port())});
  const CanEncoder encoder(checked.map);
  // Complete cycles, one without its actual value, an unknown id, a frame that is too short.
  for (int k = 0; k < 100; ++k) {
    std::vector<CanFrame> frames{encoder.start(), encoder.frame(0)};
    if (k != 50) frames.push_back(encoder.frame(1));
    frames.push_back(encoder.frame(1));
    if (k == 60) frames.back().id = 0x700;
    if (k == 70) frames[1].length = 1;
    ASSERT_EQ(machine.send(frames), frames.size());
  }
  std::vector<std::unique_ptr<CanBus>> buses;
  buses.push_back(std::move(listener));
  CanSource source(std::move(checked.map), std::move(buses), Pacing::kByCount);
  MachineFrame frame;
  int cycles = 0;
  EXPECT_EQ(seen([&] {
              while (source.receive(frame, 0.05) == Received::kFrame) ++cycles;
            }),
            kNone);
  EXPECT_EQ(cycles, 100);
}

TEST(RealTimePath, TellingAPlcThePredictionsAllocatesNothing) {
  CheckedCanMap checked = check_can_map(
      "cycle_s = 0.001\nprediction_period_s = 0.001\n[[axis]]\nname = \"X\"\n"
      "command = {id = 1, start_bit = 0, length = 32, unit = \"nm\"}\n"
      "residual = {id = 2, start_bit = 0, length = 32, unit = \"nm\"}\n"
      "prediction_valid = {id = 2, start_bit = 32, length = 1}\n",
      "m.toml", "");
  ASSERT_TRUE(checked.problems.empty());
  auto plc = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", ""});
  std::vector<std::unique_ptr<CanBus>> buses;
  buses.push_back(std::make_unique<CanUdp>(
      CanUdpPlace{"127.0.0.1:0", "127.0.0.1:" + std::to_string(plc->port())}));
  CanPrediction teller(checked.map, 0, 1);
  MachinePrediction prediction;
  prediction.axis_count = 1;
  prediction.axes[0].state = AxisState::kPredicting;
  EXPECT_EQ(seen([&] {
              for (int k = 0; k < 50; ++k) {
                prediction.axes[0].residual = k % 10 == 0 ? kAbsent : 1e-9 * k;
                teller.tell(prediction, buses, 2 * CanPrediction::kQuiet_ns);
              }
            }),
            kNone);
  std::array<CanFrame, 64> frames;
  std::size_t heard = 0;
  while (const std::size_t count = plc->receive(frames, 0.05)) heard += count;
  EXPECT_EQ(heard, 50U);
}

// The guard detects every forbidden operation; otherwise the tests above prove nothing.
TEST(ForbidHeap, SeesEveryAllocationAndRelease) {
  EXPECT_EQ(seen([] {}), kNone);
  // Through a volatile pointer, so that no compiler may leave the pair out.
  EXPECT_GE(seen([] {
              void* volatile p = std::malloc(10);
              std::free(p);
            }).heap,
            2U);
  EXPECT_GE(seen([] {
              int* volatile p = new int(3);
              delete p;
            }).heap,
            2U);
  EXPECT_GE(seen([] {
              void* volatile p = std::calloc(1, 10);
              p = std::realloc(p, 20);
              std::free(p);
            }).heap,
            3U);
  EXPECT_GE(seen([] {
              struct alignas(64) Wide {
                char c[64];
              };
              Wide* volatile p = new Wide;
              delete p;
            }).heap,
            2U);
  EXPECT_GE(seen([] { std::string s(100, 'x'); }).heap, 2U);
  EXPECT_GE(seen([] {
              Eigen::VectorXd v = Eigen::VectorXd::Zero(100);
              v(0) = 1.0;
            }).heap,
            1U);
}

TEST(ForbidHeap, SeesAnExceptionThatIsCaughtAgain) {
  EXPECT_GE(seen([] {
              try {
                throw 3;
              } catch (int) {
              }
            }).heap,
            1U);
}

TEST(ForbidHeap, SeesLocks) {
  std::mutex mutex;
  EXPECT_GE(seen([&] { const std::lock_guard lock(mutex); }).locks, 1U);
}

/// A loop that does something forbidden after every frame.
class Disobedient final : public FrameSource {
 public:
  Disobedient(FrameSource& inner, std::function<void()> deed)
      : inner_(inner), deed_(std::move(deed)) {}
  Received receive(MachineFrame& frame, double timeout_s) noexcept override {
    return inner_.receive(frame, timeout_s);
  }
  // The loop asks for this after a frame was received, where all is forbidden.
  [[nodiscard]] std::int64_t age_ns() const noexcept override {
    deed_();
    return inner_.age_ns();
  }

 private:
  FrameSource& inner_;
  std::function<void()> deed_;
};

TEST(ForbidHeap, CatchesALoopThatAllocatesOrLocks) {
  std::mutex mutex;
  {
    Running running(2);
    Eventful machine(running.models, 100);
    Disobedient allocating(machine, [] {
      int* volatile p = new int(3);
      delete p;
    });
    EXPECT_GE(running.run(allocating).heap, 200U);
  }
  Running running(2);
  Eventful machine(running.models, 100);
  Disobedient locking(machine, [&] { const std::lock_guard lock(mutex); });
  EXPECT_GE(running.run(locking).locks, 100U);
}

TEST(ForbidHeap, LeavesOtherThreadsAlone) {
  const Violations before = violations();
  {
    std::atomic<bool> allocated{false};
    std::jthread other([&] {
      int* volatile p = new int(3);
      delete p;
      allocated = true;
    });
    const ForbidHeap forbid;
    while (!allocated) {
    }
    forbid_heap_and_locks(false);
    other.join();
  }
  EXPECT_EQ(violations(), before);
}

}  // namespace
}  // namespace servotwin::daemon
