// A drive behind the real-time loop, as docs/decisions/0011 has it, and everything that can happen
// between the two: frames that are lost, a daemon that is paused, killed and started again, clocks
// that are set, a bus that refuses, a person who disarms, another model. The truth is what the
// motor feels: the drive's own offset, cycle by cycle of the drive. Nothing here asks the gate.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <memory>
#include <numbers>
#include <vector>

#include "daemon/loop/live_offsets.h"
#include "daemon/loop/real_time_loop.h"

namespace servotwin::daemon {

/// The drive's side: it holds an offset for `validity_s` after it came, and ramps it to 0 within
/// `ramp_s` if it is not renewed.
class OffsetDrive {
 public:
  OffsetDrive(double cycle_s, double validity_s, double ramp_s)
      : held_cycles_(std::lround(validity_s / cycle_s)), ramp_cycles_(ramp_s / cycle_s) {}

  void receive(double offset) {
    waiting_ = offset;
    has_ = true;
  }
  /// One cycle of the drive. Returns the offset that the motor feels in it.
  double cycle() {
    ramping_ = false;
    if (has_) {
      offset_ = waiting_;
      since_ = 0;
      has_ = false;
    } else if (++since_ > held_cycles_) {
      if (since_ == held_cycles_ + 1) step_ = std::abs(offset_) / ramp_cycles_;
      offset_ -= std::clamp(offset_, -step_, step_);
      ramping_ = true;
    }
    return offset_;
  }
  /// Whether this cycle's change was the drive's own ramp.
  [[nodiscard]] bool ramping() const { return ramping_; }

 private:
  long held_cycles_;
  double ramp_cycles_;
  double offset_ = 0.0, waiting_ = 0.0, step_ = 0.0;
  long since_ = 0;
  bool has_ = false, ramping_ = false;
};

class OffsetWorld {
 public:
  static constexpr double kCycle_s = 1e-3;
  static constexpr double kPeak = 2e-4, kRate = 0.006;
  // The program repeats so fast that the next run could begin while the drive still ramps.
  static constexpr int kRows = 120, kDwell = 20, kPeriod = kRows + kDwell;

  enum class Event : std::uint8_t {
    kLose,        ///< the next frames do not come
    kPause,       ///< the daemon stands still, and then finds all frames of that time at once
    kRestart,     ///< the daemon is killed, and started again after this time
    kFrameClock,  ///< the clock of the machine's stamps is set
    kHostClock,   ///< the wall clock of the daemon's host is set: the age of frames is wrong
    kRefuse,      ///< the bus takes none of the next offsets
    kDisarm,      ///< a person disarms, and arms again after this time
    kModel,       ///< another model comes into force
    kDelay,       ///< the daemon answers the next frames late, every second one by a whole cycle
  };
  static constexpr int kEvents = 9;

  static constexpr double kValidity_s = 0.02;

  /// `in_command`: whether the command of the drive's frames has the offset in it. `timeout_s`: the
  /// drive holds an offset for as long; kValidity_s or longer.
  explicit OffsetWorld(bool in_command, double timeout_s = kValidity_s)
      : in_command_(in_command), timeout_s_(timeout_s) {
    start();
  }

  /// `size`: cycles (for clocks: cycles by which they are set).
  void happens(Event event, int size) {
    switch (event) {
      case Event::kLose:
        lost_ = size;
        break;
      case Event::kPause:
        paused_ = size;
        break;
      case Event::kRestart:
        loop_.reset();
        inbox_.clear();
        on_time_ = false;
        dead_ = size;
        break;
      case Event::kFrameClock:
        frame_clock_ns_ += size * kCycle_ns;
        break;
      case Event::kHostClock:
        host_clock_ns_ += size * kCycle_ns;
        on_time_ = false;
        break;
      case Event::kRefuse:
        refused_ = size;
        break;
      case Event::kDisarm:
        hand_over_->armed = false;
        disarmed_ = size;
        break;
      case Event::kModel:
        if (loop_) models_[0].publish({Twin(model_), ++version_, 1e-6, settling_cycles(model_)});
        break;
      case Event::kDelay:
        delayed_ = size;
        break;
    }
  }

  /// One cycle of the drive. Returns what the motor felt wrong; null: nothing.
  const char* cycle() {
    const double before = felt_;
    felt_ = drive_.cycle();
    most_ = std::max(most_, std::abs(felt_));
    const double change = std::abs(felt_ - before);
    const bool ramp = drive_.ramping();
    speak();
    listen();
    ++now_;
    if (stale_) return "an offset that is older than its validity";
    if (std::abs(felt_) > kPeak * kRounding) return "more than the peak";
    // What the drive does by itself is its own: a straight line within its ramp.
    const double allowed = ramp ? kPeak * kCycle_s / kDriveRamp_s : kRate * kCycle_s;
    return change > allowed * kRounding ? "faster than the rate" : nullptr;
  }
  [[nodiscard]] double most() const { return most_; }
  [[nodiscard]] double felt() const { return felt_; }
  [[nodiscard]] bool active() const { return hand_over_->active; }

 private:
  static constexpr std::int64_t kCycle_ns = 1'000'000;
  static constexpr double kDriveRamp_s = 0.1, kRamp_s = 0.05;
  static constexpr double kRounding = 1.0 + 1e-9;

  static double path_at(long k) {
    const long row = std::clamp<long>(k % kPeriod - kDwell, 0, kRows - 1);
    return 5e-4 * (1.0 - std::cos(2.0 * std::numbers::pi * static_cast<double>(row) / (kRows - 1)));
  }

  /// A daemon that has just been started and armed.
  void start() {
    model_.sample_time_s = kCycle_s;
    model_.loop.order = 2;
    model_.loop.denominator = denominator_of({0.0, 2.0 * std::numbers::pi * 60.0, 0.7}, 2);
    model_.loop.numerator = {1.0, model_.loop.denominator[0], 0.0};
    OffsetRules rules;
    rules.cycle_s = kCycle_s;
    rules.limits = {{kPeak, kRate, 40.0, kRamp_s, kValidity_s, 1e6, true, kCycle_s}};
    rules.ramp_s = kRamp_s;
    rules.validity_s = kValidity_s;
    rules.drive_timeout_s = timeout_s_;
    rules.drive_ramp_s = kDriveRamp_s;
    rules.match_tolerance = 2e-6;
    rules.residual_band = 8.0;
    rules.live = true;
    rules.in_command = in_command_;
    models_ = std::vector<LatestValue<TwinInForce>>(1);
    hand_over_ = std::make_unique<OffsetHandOver>();
    loop_ = std::make_unique<RealTimeLoop>(kCycle_s, models_, predictions_, rows_, wake_up_);
    live_ = std::make_unique<LiveOffsets>(rules, *hand_over_);
    loop_->give_back(*live_, said_);
    models_[0].publish({Twin(model_), version_, 1e-6, settling_cycles(model_)});
    hand_over_->armed = true;
    plan();
  }

  /// The program, learned with the model in force. A new plan: what was given up may begin again.
  void plan() {
    auto learned = std::make_shared<LearnedProgram>();
    learned->number = ++plans_made_;
    learned->program.axes = {0};
    Eigen::ArrayXd command(kRows), offset(kRows);
    for (Eigen::Index k = 0; k < kRows; ++k) {
      command(k) = path_at(kDwell + k);
      // As large as the limits allow, and 0 at the ends.
      const double t = static_cast<double>(k) / (kRows - 1);
      offset(k) = 0.97 * kPeak * std::sin(std::numbers::pi * t);
    }
    learned->program.command = {command};
    learned->holdout_rms = learned->holdout_max = {1e-3};
    learned->axes.resize(1);
    learned->axes[0].model_version = version_;
    learned->offset = {offset};
    learned->error_before = learned->error_after = {Eigen::ArrayXd::Zero(kRows)};
    plans_.push_back(std::make_unique<OffsetPlan>());
    plans_.back()->generation = plans_made_;
    plans_.back()->programs = {learned};
    hand_over_->plans.publish(plans_.back().get());
  }

  /// The drive's frame.
  void speak() {
    MachineFrame frame;
    frame.sequence = static_cast<std::uint64_t>(now_) + 1;
    frame.time_ns = now_ * kCycle_ns + frame_clock_ns_;
    frame.axis_count = 1;
    const double path = path_at(now_);
    frame.axes[0] = {in_command_ ? path + felt_ : path, path + felt_, kAbsent};
    if (lost_ > 0) {
      --lost_;
    } else if (dead_ == 0) {
      inbox_.push_back({frame, now_ * kCycle_ns});
    }
  }

  /// The daemon, if it runs.
  void listen() {
    if (dead_ > 0 && --dead_ == 0) start();
    if (disarmed_ > 0 && --disarmed_ == 0) hand_over_->armed = true;
    if (now_ % kPeriod == 0 && loop_) plan();
    if (paused_ > 0) {
      --paused_;
      return;
    }
    if (!loop_) return;
    // A daemon that is late from its first frame on, by its clock, cannot know it.
    const bool delayed = delayed_ > 0 && on_time_;
    on_time_ = on_time_ || inbox_.size() == 1;
    // Every second answer comes in the next cycle, and the one that belongs there at its end.
    if (delayed && delayed_-- % 2 == 1) return;
    std::int64_t at_ns = now_ * kCycle_ns + 100'000;
    for (; !inbox_.empty(); inbox_.pop_front(), at_ns += 10'000) {
      const Waiting& next = inbox_.front();
      if (delayed && inbox_.size() == 1) at_ns = now_ * kCycle_ns + 900'000;
      const MachineOffset* answer =
          loop_->on_frame(next.frame, {at_ns, at_ns - next.due_ns + host_clock_ns_});
      if (answer != nullptr && answer->axes[0].send) {
        if (refused_ > 0) {
          --refused_;
          live_->not_sent(1);
        } else {
          drive_.receive(answer->axes[0].offset);
          if (at_ns - next.due_ns > std::llround(1e9 * kValidity_s)) stale_ = true;
        }
      }
      for (MachinePrediction prediction; predictions_.pop(prediction);) {
      }
      for (CycleRow row; rows_.pop(row);) {
      }
      for (DatedOffset offset; said_.pop(offset);) {
      }
      for (OffsetRun run; hand_over_->runs.pop(run);) {
      }
    }
  }

  struct Waiting {
    MachineFrame frame;
    std::int64_t due_ns;
  };
  bool in_command_;
  double timeout_s_;
  Model model_;
  int version_ = 1;
  std::uint64_t plans_made_ = 0;
  std::vector<std::unique_ptr<OffsetPlan>> plans_;
  std::vector<LatestValue<TwinInForce>> models_;
  Ring<MachinePrediction> predictions_{16};
  Ring<CycleRow> rows_{16};
  Ring<DatedOffset> said_{16};
  WakeUp wake_up_;
  std::unique_ptr<OffsetHandOver> hand_over_;
  std::unique_ptr<LiveOffsets> live_;
  std::unique_ptr<RealTimeLoop> loop_;
  OffsetDrive drive_{kCycle_s, timeout_s_, kDriveRamp_s};
  std::deque<Waiting> inbox_;
  long now_ = 0;
  std::int64_t frame_clock_ns_ = 0, host_clock_ns_ = 0;
  int lost_ = 0, paused_ = 0, dead_ = 0, refused_ = 0, disarmed_ = 0, delayed_ = 0;
  double felt_ = 0.0, most_ = 0.0;
  bool stale_ = false;
  bool on_time_ = false;  // a frame was answered on time since the clocks are as they are
};

}  // namespace servotwin::daemon
