// A drive behind the real-time loop, as docs/decisions/0011 has it, and everything that can happen
// between the two: frames and offsets that are lost, a daemon that is paused, killed and started
// again, a host that sleeps, clocks that are set, a bus that refuses or is slow, a publisher that
// stands still, a person who disarms, another model. The truth is what the motor feels: the drive's
// own offset, cycle by cycle of the drive. Nothing here asks the gate.
//
// Drives are on a bus, where the loop sends, or on the network, where the publisher sends and the
// drive takes only what follows from what it has.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "daemon/loop/live_offsets.h"
#include "daemon/loop/real_time_loop.h"
#include "daemon/publish/offset_outlet.h"

namespace servotwin::daemon {

/// The drive's side: it holds an offset for `validity_s` after it came, and ramps it to 0 within
/// `ramp_s` if it is not renewed. It takes an offset that is at most `step` from the one it has.
class OffsetDrive {
 public:
  OffsetDrive(double cycle_s, double validity_s, double ramp_s, double step)
      : held_cycles_(std::lround(validity_s / cycle_s)),
        ramp_cycles_(ramp_s / cycle_s),
        most_step_(step) {}

  void receive(double offset) {
    waiting_ = offset;
    has_ = true;
  }
  /// An offset came that must not be applied.
  void drop() { since_ = std::max(since_, held_cycles_); }
  /// One cycle of the drive. Returns the offset that the motor feels in it.
  double cycle() {
    ramping_ = false;
    const bool came = std::exchange(has_, false);
    took_ = came && std::abs(waiting_ - offset_) <= most_step_;
    refused_ = came && !took_;
    if (took_) {
      offset_ = waiting_;
      since_ = 0;
    } else if (++since_ > held_cycles_) {
      if (since_ == held_cycles_ + 1) step_ = std::abs(offset_) / ramp_cycles_;
      offset_ -= std::clamp(offset_, -step_, step_);
      ramping_ = true;
    }
    return offset_;
  }
  /// Whether this cycle's change was the drive's own ramp.
  [[nodiscard]] bool ramping() const { return ramping_; }
  /// Whether an offset came in this cycle, and was taken or not.
  [[nodiscard]] bool took() const { return took_; }
  [[nodiscard]] bool refused() const { return refused_; }

 private:
  long held_cycles_;
  double ramp_cycles_, most_step_;
  double offset_ = 0.0, waiting_ = 0.0, step_ = 0.0;
  long since_ = 0;
  bool has_ = false, ramping_ = false, took_ = false, refused_ = false;
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
    kLoseOffset,  ///< the next offsets leave and do not come
    kSleep,       ///< the host sleeps, and gets nothing; odd sizes: its clocks stand still as well
    kPublisher,   ///< the publisher stands still, and then finds all offsets of that time at once
    kSlow,        ///< the next offsets are held up by parts of a cycle before or while they leave
  };
  static constexpr int kEvents = 13;

  /// Drives on a bus have the offset in the command of their frames or not.
  enum class Drive : std::uint8_t { kOnNetwork, kOnBus, kOnBusNotShown };
  static constexpr int kDrives = 3;
  static constexpr std::array kAllDrives{Drive::kOnNetwork, Drive::kOnBus, Drive::kOnBusNotShown};

  static constexpr double kValidity_s = 0.02;

  /// `timeout_s`: the drive holds an offset for as long; kValidity_s or longer.
  explicit OffsetWorld(Drive drive, double timeout_s = kValidity_s)
      : drive_is_(drive), timeout_s_(timeout_s) {
    start();
  }

  /// `size`: cycles (for clocks: cycles by which they are set).
  void happens(Event event, int size) {
    kinks_allowed_ += kKinksOfADisturbance;
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
        for (DatedOffset offset; said_.pop(offset);) {
        }
        stalled_ = 0;
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
      case Event::kLoseOffset:
        lost_offsets_ = size;
        break;
      case Event::kSleep:
        asleep_ = size;
        clocks_stand_ = size % 2 == 1;
        inbox_.clear();
        break;
      case Event::kPublisher:
        stalled_ = size;
        wakes_at_ns_ = size % 10 * kCycle_ns / 10;
        break;
      case Event::kSlow:
        slow_ = size;
        break;
    }
  }

  /// One cycle of the drive. Returns what the motor felt wrong; null: nothing.
  const char* cycle() {
    arrive();
    const double before = felt_;
    felt_ = drive_.cycle();
    most_ = std::max(most_, std::abs(felt_));
    const char* wrong = judge(felt_ - before);
    speak();
    listen();
    ++now_;
    return wrong;
  }
  [[nodiscard]] double most() const { return most_; }
  [[nodiscard]] double felt() const { return felt_; }
  [[nodiscard]] bool active() const { return hand_over_->active; }

 private:
  static constexpr std::int64_t kCycle_ns = 1'000'000;
  static constexpr double kDriveRamp_s = 0.1, kRamp_s = 0.05;
  static constexpr double kBandwidth_Hz = 6.0;
  static constexpr double kRounding = 1.0 + 1e-9;
  // The program is followed exactly; an offset that differs by less from the one in the drive is
  // not seen to be missing.
  static constexpr double kMatch = 1e-8;
  // Fading in begins and ends, the limit of the rate begins and ends to act, fading out begins and
  // ends.
  static constexpr int kKinksOfARun = 6;
  // The limit of the rate begins and ends to act, fading out begins and ends.
  static constexpr int kKinksOfADisturbance = 4;
  // When the loop and the publisher have what came in this cycle.
  static constexpr std::int64_t kLoop_ns = 100'000, kPublisher_ns = 120'000;

  static double path_at(long k) {
    const long row = std::clamp<long>(k % kPeriod - kDwell, 0, kRows - 1);
    return 5e-4 * (1.0 - std::cos(2.0 * std::numbers::pi * static_cast<double>(row) / (kRows - 1)));
  }

  /// What the motor felt wrong in this cycle, in which its offset changed by `change`.
  const char* judge(double change) {
    const double bend = std::abs(change - std::exchange(change_, change));
    if (stale_) return "an offset that is older than its validity";
    if (std::abs(felt_) > kPeak * kRounding) return "more than the peak";
    if (drive_.refused() && !astray_) return "an offset that does not follow from the one before";
    // What the drive does by itself is its own: a straight line within its ramp.
    const double allowed = drive_.ramping() ? kPeak * kCycle_s / kDriveRamp_s : kRate * kCycle_s;
    if (std::abs(change) > allowed * kRounding + (in_command_ ? kMatch : 0.0))
      return "faster than the rate";
    return bends_too_often(bend, change) ? "beyond the bandwidth" : nullptr;
  }
  /// The curvature is that of a request within the bandwidth that is faded, except at the kinks of
  /// fades and limits, which are counted. Where the drive got no offset in a cycle, it holds the
  /// one before, and the signal has steps.
  bool bends_too_often(double bend, double change) {
    constexpr double kOmega = 2.0 * std::numbers::pi * kBandwidth_Hz;
    constexpr double kMaxBend =
        kOmega * kOmega * kPeak * kCycle_s * kCycle_s +
        2.0 * std::min(kRate, kOmega * kPeak) * kCycle_s * kCycle_s / kRamp_s;
    if (felt_ != 0.0 && felt_ == change) kinks_allowed_ += kKinksOfARun;
    if (felt_ != 0.0 && !drive_.took()) kinks_allowed_ += kKinksOfADisturbance;
    in_a_row_ = drive_.took() ? in_a_row_ + 1 : 0;
    if (in_a_row_ >= 3 && bend > kMaxBend * kRounding) ++kinks_;
    return kinks_ > kinks_allowed_;
  }

  /// A daemon that has just been started and armed.
  void start() {
    model_.sample_time_s = kCycle_s;
    model_.loop.order = 2;
    model_.loop.denominator = denominator_of({0.0, 2.0 * std::numbers::pi * 60.0, 0.7}, 2);
    model_.loop.numerator = {1.0, model_.loop.denominator[0], 0.0};
    OffsetRules rules;
    rules.cycle_s = kCycle_s;
    rules.limits = {{kPeak, kRate, kBandwidth_Hz, kRamp_s, kValidity_s, 1e6, true, kCycle_s}};
    rules.ramp_s = kRamp_s;
    rules.validity_s = kValidity_s;
    rules.drive_timeout_s = timeout_s_;
    rules.drive_ramp_s = kDriveRamp_s;
    rules.match_tolerance = kMatch;
    rules.residual_band = 8.0;
    rules.live = true;
    rules.in_command = in_command_;
    models_ = std::vector<LatestValue<TwinInForce>>(1);
    hand_over_ = std::make_unique<OffsetHandOver>(drive_is_ == Drive::kOnNetwork);
    loop_ = std::make_unique<RealTimeLoop>(kCycle_s, models_, predictions_, rows_, wake_up_);
    live_ = std::make_unique<LiveOffsets>(rules, *hand_over_);
    loop_->give_back(*live_, said_);
    outlet_ = std::make_unique<OffsetOutlet>(said_, *hand_over_);
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
      offset(k) = 0.97 * kPeak * std::pow(std::sin(std::numbers::pi * t), 2);
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
    } else if (dead_ == 0 && asleep_ == 0) {
      inbox_.push_back({frame, now_ * kCycle_ns});
    }
  }

  /// The daemon, if it runs.
  void listen() {
    if (dead_ > 0 && --dead_ == 0) start();
    if (disarmed_ > 0 && --disarmed_ == 0) hand_over_->armed = true;
    if (now_ % kPeriod == 0 && loop_) plan();
    if (asleep_ > 0) {
      --asleep_;
      if (clocks_stand_) stood_still_ns_ += kCycle_ns;
      return;
    }
    if (paused_ > 0) {
      --paused_;
      return;
    }
    if (!loop_) return;
    const bool wakes = stalled_ > 0 && --stalled_ == 0;
    if (wakes && wakes_at_ns_ < kLoop_ns) publish(wakes_at_ns_);
    answer();
    if (stalled_ == 0) publish(wakes ? std::max(wakes_at_ns_, kPublisher_ns) : kPublisher_ns);
  }

  /// The loop.
  void answer() {
    const std::int64_t now_ns = now_ * kCycle_ns;
    // A daemon that is late from its first frame on, by its clock, cannot know it.
    const bool delayed = delayed_ > 0 && on_time_;
    on_time_ = on_time_ || inbox_.size() == 1;
    // Every second answer comes in the next cycle, and the one that belongs there at its end.
    if (delayed && delayed_-- % 2 == 1) return;
    std::int64_t at_ns = std::max(now_ns + kLoop_ns, loop_busy_until_ns_);
    for (; !inbox_.empty() && at_ns < now_ns + kCycle_ns; inbox_.pop_front()) {
      const Waiting& next = inbox_.front();
      if (delayed && inbox_.size() == 1) at_ns = std::max(at_ns, now_ns + 900'000);
      const MachineOffset* answer =
          loop_->on_frame(next.frame, {steady(at_ns), at_ns - next.due_ns + host_clock_ns_});
      if (answer != nullptr) {
        if (drive_is_ != Drive::kOnNetwork && answer->axes[0].send)
          at_ns = send(*answer, at_ns, next.due_ns);
        live_->has_left(steady(at_ns));
      }
      at_ns += 10'000;
      loop_busy_until_ns_ = at_ns;
      for (MachinePrediction prediction; predictions_.pop(prediction);) {
      }
      for (CycleRow row; rows_.pop(row);) {
      }
      if (drive_is_ != Drive::kOnNetwork) {
        for (DatedOffset offset; said_.pop(offset);) {
        }
      }
      for (OffsetRun run; hand_over_->runs.pop(run);) {
      }
    }
  }

  /// The socket of the bus. Returns when the loop goes on.
  std::int64_t send(const MachineOffset& offset, std::int64_t at_ns, std::int64_t due_ns) {
    const auto [before_ns, meanwhile_ns] = held_up();
    if (refused_ > 0) {
      --refused_;
      live_->not_sent(1);
    } else if (steady(at_ns + before_ns) > live_->leaves_until_ns()) {
      live_->not_sent(1);
    } else {
      leaves(offset, at_ns + before_ns + meanwhile_ns, due_ns);
    }
    return at_ns + before_ns + meanwhile_ns;
  }

  /// The publisher, from this time of the cycle on.
  void publish(std::int64_t in_cycle_ns) {
    if (drive_is_ != Drive::kOnNetwork) return;
    std::int64_t at_ns = std::max(now_ * kCycle_ns + in_cycle_ns, publisher_busy_until_ns_);
    if (at_ns >= (now_ + 1) * kCycle_ns) return;
    // A name of its own: clang before 16 captures no structured binding.
    const HeldUp held = said_.waiting() > 0 ? held_up() : HeldUp();
    at_ns += held.before_ns;
    outlet_->send([&] { return steady(at_ns); },
                  [&](const MachineOffset& offset) {
                    if (refused_ > 0) {
                      --refused_;
                      return false;
                    }
                    at_ns += held.meanwhile_ns;
                    const auto frame_ns = static_cast<std::int64_t>(offset.sequence - 1);
                    leaves(offset, at_ns, frame_ns * kCycle_ns);
                    return true;
                  });
    publisher_busy_until_ns_ = at_ns;
  }

  struct HeldUp {
    std::int64_t before_ns = 0, meanwhile_ns = 0;
  };
  HeldUp held_up() {
    if (slow_ == 0) return {};
    const std::int64_t delay_ns = --slow_ * 61 % 100 * kCycle_ns / 100;
    return slow_ % 2 == 0 ? HeldUp{delay_ns, 0} : HeldUp{0, delay_ns};
  }

  void leaves(const MachineOffset& offset, std::int64_t at_ns, std::int64_t due_ns) {
    if (lost_offsets_ > 0) {
      --lost_offsets_;
      if (can_be_lost()) {
        astray_ = true;
        return;
      }
    }
    if (offset.axes[0].send && at_ns - due_ns > std::llround(1e9 * kValidity_s)) stale_ = true;
    on_the_way_.push_back({at_ns, offset.axes[0]});
  }
  /// Where a drive on a bus does not show its offset, or where an offset still fades out and the
  /// commands have left its program, nobody can see what is lost.
  [[nodiscard]] bool can_be_lost() const {
    const long row = now_ % kPeriod - kDwell;
    const bool shown = row < -1 || row > std::lround(kRamp_s / kCycle_s);
    return drive_is_ == Drive::kOnNetwork || (in_command_ && shown);
  }

  /// What comes before this cycle of the drive.
  void arrive() {
    if (felt_ == 0.0 && lost_offsets_ == 0 && !hand_over_->active && on_the_way_.empty())
      astray_ = false;
    for (; !on_the_way_.empty() && on_the_way_.front().at_ns < now_ * kCycle_ns;
         on_the_way_.pop_front()) {
      const AxisOffset& offset = on_the_way_.front().offset;
      if (offset.send) {
        drive_.receive(offset.offset);
      } else {
        drive_.drop();
      }
    }
  }

  /// The clock that the daemon reads.
  [[nodiscard]] std::int64_t steady(std::int64_t at_ns) const { return at_ns - stood_still_ns_; }

  struct Waiting {
    MachineFrame frame;
    std::int64_t due_ns;
  };
  struct OnTheWay {
    std::int64_t at_ns;
    AxisOffset offset;
  };
  Drive drive_is_;
  bool in_command_ = drive_is_ == Drive::kOnBus;
  double timeout_s_;
  Model model_;
  int version_ = 1;
  std::uint64_t plans_made_ = 0;
  std::vector<std::unique_ptr<OffsetPlan>> plans_;
  std::vector<LatestValue<TwinInForce>> models_;
  Ring<MachinePrediction> predictions_{16};
  Ring<CycleRow> rows_{16};
  Ring<DatedOffset> said_{64};
  WakeUp wake_up_;
  std::unique_ptr<OffsetHandOver> hand_over_;
  std::unique_ptr<LiveOffsets> live_;
  std::unique_ptr<RealTimeLoop> loop_;
  std::unique_ptr<OffsetOutlet> outlet_;
  // A reader on the network takes only what follows from what it has.
  OffsetDrive drive_{kCycle_s, timeout_s_, kDriveRamp_s,
                     drive_is_ == Drive::kOnNetwork ? kRate* kCycle_s* kRounding
                                                    : std::numeric_limits<double>::infinity()};
  std::deque<Waiting> inbox_;
  std::deque<OnTheWay> on_the_way_;
  long now_ = 0;
  std::int64_t frame_clock_ns_ = 0, host_clock_ns_ = 0, stood_still_ns_ = 0;
  std::int64_t loop_busy_until_ns_ = 0, publisher_busy_until_ns_ = 0, wakes_at_ns_ = 0;
  int lost_ = 0, paused_ = 0, dead_ = 0, refused_ = 0, disarmed_ = 0, delayed_ = 0;
  int lost_offsets_ = 0, asleep_ = 0, stalled_ = 0, slow_ = 0;
  double felt_ = 0.0, most_ = 0.0, change_ = 0.0;
  int in_a_row_ = 0;  // cycles, in each of which an offset was taken
  long kinks_ = 0, kinks_allowed_ = 0;
  bool astray_ = false;  // an offset was lost, and the drive may have another one than was sent
  bool stale_ = false;
  bool clocks_stand_ = false;  // while the host sleeps
  bool on_time_ = false;       // a frame was answered on time since the clocks are as they are
};

}  // namespace servotwin::daemon
