#include "daemon/loop/live_offsets.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

std::int64_t ns_of(double seconds) noexcept { return std::llround(1e9 * seconds); }

double squared(double value) noexcept { return value * value; }

// Of two cycles each command deviates from its row by up to the tolerance.
constexpr double kToleranceOverTwoCycles = 2.0;

}  // namespace

std::int64_t Lateness::of(std::int64_t age_ns, std::int64_t now_ns) noexcept {
  constexpr std::int64_t kNone = std::numeric_limits<std::int64_t>::max();
  const auto learn = [&](std::int64_t constant) {
    constant_ = constant;
    last_on_time_ns_ = now_ns;
    late_windows_ = 0;
  };
  if (constant_ == kNone || between_ns(constant_, age_ns) <= 0) {
    learn(age_ns);
  } else if (const std::int64_t late = between_ns(constant_, age_ns); late < on_time_ns_) {
    const std::int64_t passed_ns =
        std::clamp<std::int64_t>(now_ns - last_on_time_ns_, 0, kWindow_ns);
    learn(constant_ + std::min(late, passed_ns * kDrift_ns_per_s / 1'000'000'000));
  }
  least_ = std::min(least_, age_ns);
  if (now_ns - window_began_ns_ > kWindow_ns) {
    if (last_on_time_ns_ < window_began_ns_) {
      ++late_windows_;
      if (between_ns(constant_, least_) > kClockWasSet_ns || late_windows_ >= kWindowsOfLateness)
        learn(least_);
    }
    window_began_ns_ = now_ns;
    least_ = kNone;
  }
  return std::max<std::int64_t>(0, between_ns(constant_, age_ns));
}

LiveOffsets::LiveOffsets(OffsetRules rules, OffsetHandOver& hand_over)
    : rules_(std::move(rules)),
      hand_over_(hand_over),
      // The transient of the fade-in is taken to decay within another ramp.
      counts_after_(std::lround(2.0 * rules_.ramp_s / rules_.cycle_s)),
      matcher_(rules_.match_tolerance),
      cycle_ns_(ns_of(rules_.cycle_s)),
      // The drive counts its own cycles. Half of one is the tolerance of stamps.
      held_ns_(ns_of(rules_.validity_s + 0.5 * rules_.cycle_s)),
      surely_gone_ns_(ns_of(std::max(rules_.validity_s, rules_.drive_timeout_s) +
                            rules_.drive_ramp_s + 2.0 * rules_.cycle_s)),
      sent_(static_cast<std::size_t>(rules_.delay_cycles) + 1) {
  for (const GateLimits& limits : rules_.limits) gates_.emplace_back(limits);
  gates_before_ = gates_;
  path_.reserve(kMaxAxes);
}

const MachineFrame& LiveOffsets::seen(const MachineFrame& frame, bool follows) noexcept {
  gap_ = !follows;
  if (gap_) {  // the drive has kept its last offset
    const MachineOffset last = sent_[newest_];
    std::fill(sent_.begin(), sent_.end(), last);
  }
  const auto ago = static_cast<std::size_t>(rules_.delay_cycles) - 1;
  const MachineOffset& applied = sent_[(newest_ + sent_.size() - ago) % sent_.size()];
  added_before_ = added_;
  bool any = false;
  for (std::size_t i = 0; i < gates_.size(); ++i) {
    const AxisOffset& one = applied.axes[i];
    added_[i] = one.send ? one.offset : 0.0;
    nominal_[i] = frame.axes[i].command - (rules_.in_command ? added_[i] : 0.0);
    any = any || added_[i] != 0.0;
  }
  if (rules_.in_command || !any) return frame;
  seen_ = frame;
  for (std::size_t i = 0; i < gates_.size(); ++i) {
    seen_.axes[i].command += added_[i];
    for (int k = 0; k < seen_.ahead_count; ++k)
      seen_.ahead[i][static_cast<std::size_t>(k)] += added_[i];
  }
  return seen_;
}

void LiveOffsets::take_plan(std::int64_t now_ns) noexcept {
  if (const OffsetPlan* const* fresh = hand_over_.plans.fresh(); fresh != nullptr) {
    next_ = *fresh;
    next_ns_ = now_ns;
  }
  // A new plan restarts the matcher, and a program that has begun would not be recognised before
  // its next start. A plan that only renews the validation can wait for that; one that may withdraw
  // a correction cannot.
  if (next_ == nullptr || (next_->renewed && matcher_.follows())) return;
  plan_ = std::exchange(next_, nullptr);
  plan_ns_ = next_ns_;
  if (!plan_->renewed) barred_.reset();
  std::array<const CommandedPath*, ProgramMatcher::kMaxPrograms> programs{};
  const std::size_t count = std::min(plan_->programs.size(), programs.size());
  for (std::size_t i = 0; i < count; ++i) programs[i] = &plan_->programs[i]->program;
  matcher_.watch({programs.data(), count});
  // release: pairs with the acquire of the worker, who frees the plans before this one.
  hand_over_.in_use.store(plan_->generation, std::memory_order_release);
}

void LiveOffsets::begin(Eigen::Index row, const LearnedProgram& learned, const MachineFrame& frame,
                        std::int64_t now_ns) noexcept {
  run_ = Run();
  run_.learned = &learned;
  // relaxed: the flag orders nothing.
  run_.live = rules_.live && hand_over_.armed.load(std::memory_order_relaxed);
  run_.row = row;
  const double left_s =
      static_cast<double>(learned.program.rows() - row + rules_.delay_cycles) * rules_.cycle_s;
  run_.ends_ns = gate_ns_ + ns_of(left_s + 2.0 * rules_.ramp_s);
  run_.validated_ns = between_ns(between_ns(learned.validated_ns, plan_->wall_ns), plan_ns_);
  run_.seen.learned = learned.number;
  run_.seen.live = run_.live;
  path_.clear();
  for (std::size_t n = 0; n < learned.axes.size(); ++n) {
    if (!learned.axes[n].rotary) path_.push_back(n);
  }
  if (learned.contour_before.size() == 0) path_.clear();
  if (!path_.empty()) contour_ = ContourError(static_cast<int>(path_.size()));
  phase_ = Phase::kRunning;
  // Nothing of an earlier run is left in the gates: no offset is active.
  for (std::size_t i = 0; i < gates_.size(); ++i) gates_[i] = Gate(rules_.limits[i]);
  const std::int64_t before_ns = now_ns - cycle_ns_;
  renewed_ = renewed_before_ = {before_ns, before_ns, frame.sequence, frame.time_ns};
  unanswered_ = 0;
  counted_row_ = row;
  counted_sequence_ = frame.sequence;
}

void LiveOffsets::end(RunEnd end, int axis, Refusal refusal) noexcept {
  if (phase_ != Phase::kRunning) return;
  run_.seen.end = end;
  run_.seen.axis = axis;
  run_.seen.refusal = static_cast<std::uint8_t>(refusal);
  run_.seen.at_s = static_cast<double>(run_.row) * rules_.cycle_s;
  if (end == RunEnd::kResidual || end == RunEnd::kContour || end == RunEnd::kRefused)
    barred_ = run_.learned->number;
  hand_over_.runs.push(run_.seen);
  phase_ = Phase::kFading;
}

void LiveOffsets::watch_residuals(const MachinePrediction& prediction) noexcept {
  const CommandedPath& program = run_.learned->program;
  for (std::size_t n = 0; n < program.axes.size(); ++n) {
    const AxisPrediction& axis = prediction.axes[program.axes[n]];
    // A missing encoder value (NaN) counts as outside: the state of the machine is unknown.
    const double band = std::max(rules_.residual_band * axis.standard_deviation,
                                 kBandOverHoldoutMax * run_.learned->holdout_max[n]);
    const bool within = std::abs(axis.residual) <= band;
    run_.outside[n] = within ? 0 : run_.outside[n] + 1;
    if (run_.outside[n] >= kCyclesOutsideToEnd)
      return end(RunEnd::kResidual, static_cast<int>(program.axes[n]));
  }
}

void LiveOffsets::measure(const MachineFrame& frame) noexcept {
  const LearnedProgram& learned = *run_.learned;
  const bool counts = ++run_.rows > counts_after_;
  if (counts) {
    ++run_.seen.cycles;
    for (std::size_t n = 0; n < learned.axes.size(); ++n) {
      const std::size_t axis = learned.program.axes[n];
      RunSquares& squares = run_.seen.axes[n];
      squares.measured += squared(nominal_[axis] - frame.axes[axis].actual);
      squares.before += squared(learned.error_before[n](run_.row));
      squares.after += squared(learned.error_after[n](run_.row));
    }
  }
  if (!path_.empty()) measure_contour(frame, counts);
}

void LiveOffsets::measure_contour(const MachineFrame& frame, bool counts) noexcept {
  const LearnedProgram& learned = *run_.learned;
  const Eigen::Index known = learned.program.rows() - 1 - run_.row;
  const auto ahead = static_cast<std::size_t>(
      std::min<Eigen::Index>(known, static_cast<Eigen::Index>(ahead_.size())));
  PathPoint command{}, actual{};
  for (std::size_t i = 0; i < path_.size(); ++i) {
    const std::size_t axis = learned.program.axes[path_[i]];
    command[i] = nominal_[axis];
    actual[i] = frame.axes[axis].actual;
    for (std::size_t k = 0; k < ahead; ++k)
      ahead_[k][i] = learned.program.command[path_[i]](run_.row + 1 + static_cast<Eigen::Index>(k));
  }
  contour_.move(command);
  const double measured = squared(contour_.of(actual, {ahead_.data(), ahead}));
  if (!counts || !std::isfinite(measured)) return;
  const double before = squared(learned.contour_before(run_.row));
  RunSquares& squares = run_.seen.contour;
  squares.measured += measured;
  squares.before += before;
  squares.after += squared(learned.contour_after(run_.row));
  run_.window_measured += (measured - run_.window_measured) / kContourWindowCycles;
  run_.window_before += (before - run_.window_before) / kContourWindowCycles;
  // Where the path error is small even without a correction, its RMS over the whole path is the
  // limit.
  const double allowed = std::max(run_.window_before, squared(learned.contour_size_before.rms));
  if (run_.live && run_.window_measured > allowed) end(RunEnd::kContour);
}

void LiveOffsets::ask_gates(const MachineFrame& frame, const MachinePrediction& prediction,
                            std::int64_t now_ns) noexcept {
  const LearnedProgram& learned = *run_.learned;
  const Eigen::Index ahead = run_.row + rules_.delay_cycles;
  for (std::size_t n = 0; n < learned.axes.size(); ++n) {
    const std::size_t axis = learned.program.axes[n];
    const AxisPrediction& predicted = prediction.axes[axis];
    GateRequest request;
    request.now_ns = gate_ns_;
    request.offset = ahead < learned.program.rows() ? learned.offset[n](ahead) : 0.0;
    request.expires_ns = run_.ends_ns;
    request.model_validated =
        true;  // a model in force has been judged (daemon/identify/promotion.h)
    request.model_validated_ns = gate_ns_ - between_ns(run_.validated_ns, now_ns);
    request.axis_state_matches = phase_ == Phase::kRunning &&
                                 predicted.state == AxisState::kPredicting &&
                                 predicted.model_version == learned.axes[n].model_version;
    const GateOutput out = gates_[axis].pass(request);
    // Stamps from outside may have any value: they wrap around instead of overflowing.
    const std::int64_t expires_ns = between_ns(gate_ns_ - out.expires_ns, frame.time_ns);
    offset_.axes[axis] = {out.offset, expires_ns, out.send && run_.live,
                          static_cast<std::uint32_t>(out.refusal)};
    if (out.refusal != Refusal::kNone) end(RunEnd::kRefused, static_cast<int>(axis), out.refusal);
  }
}

void LiveOffsets::go_on(const MachineFrame& frame, const MachinePrediction& prediction,
                        std::int64_t now_ns, std::int64_t due_ns) noexcept {
  gate_ns_ += cycle_ns_;
  gates_before_ = gates_;
  ask_gates(frame, prediction, now_ns);
  renewed_before_ = std::exchange(renewed_, {now_ns, due_ns, frame.sequence, frame.time_ns});
  left_ns_ = now_ns;
  unanswered_ = 0;
  const auto is_out = [](const AxisOffset& axis) { return axis.offset != 0.0; };
  const bool out = std::any_of(offset_.axes.begin(), offset_.axes.end(), is_out);
  if (phase_ == Phase::kFading && !out) phase_ = Phase::kNone;
}

/// Whether the drive may have dropped the offset by now. `due_ns`: when this cycle of the drive
/// began. What was sent came in the cycle in which renewed_.due_ns was. The clocks of this host may
/// have stood still, as those of a virtual machine; those of the frames have not, unless they were
/// set. Where sequence numbers go back, nothing is known.
bool LiveOffsets::drive_has_dropped(const MachineFrame& frame, std::int64_t now_ns,
                                    std::int64_t due_ns) const noexcept {
  return due_ns - renewed_.due_ns > held_ns_ || now_ns - renewed_.now_ns > held_ns_ + cycle_ns_ ||
         unanswered_ * cycle_ns_ > held_ns_ || frame.sequence < renewed_.sequence ||
         frame.sequence - renewed_.sequence >
             static_cast<std::uint64_t>(held_ns_) / static_cast<std::uint64_t>(cycle_ns_) ||
         between_ns(renewed_.time_ns, frame.time_ns) > held_ns_;
}

LiveOffsets::Shown LiveOffsets::shown_by(const MachineFrame& frame, std::size_t n) const noexcept {
  const CommandedPath& program = run_.learned->program;
  const std::size_t axis = program.axes[n];
  const double shown = frame.axes[axis].command - program.command[n](*counted_row_);
  if (std::abs(shown - added_[axis]) <= rules_.match_tolerance) return Shown::kSent;
  // A drive that has not got the offset still has the one that it showed in the cycle before, or
  // has begun to ramp that out.
  const double had = added_before_[axis];
  const double step =
      std::abs(had) * std::min(1.0, rules_.cycle_s / std::max(rules_.drive_ramp_s, rules_.cycle_s));
  const double less = had - std::clamp(had, -step, step);
  const double off = kToleranceOverTwoCycles * rules_.match_tolerance;
  return shown >= std::min(had, less) - off && shown <= std::max(had, less) + off ? Shown::kEarlier
                                                                                  : Shown::kNeither;
}

/// Whether a drive does not have the offset that was sent, as far as the command of its frames
/// shows. Where the commands leave the program they show it no longer.
bool LiveOffsets::not_delivered(const MachineFrame& frame) noexcept {
  if (!rules_.in_command || !run_.live || !counted_row_) return false;
  const CommandedPath& program = run_.learned->program;
  const std::uint64_t cycles = frame.sequence - counted_sequence_;
  counted_sequence_ = frame.sequence;
  // Fewer than a drive holds an offset for. After its last row a machine stands.
  counted_row_ = std::min(*counted_row_ + static_cast<Eigen::Index>(cycles), program.rows() - 1);
  bool missing = false, explained = true;
  for (std::size_t n = 0; n < program.axes.size(); ++n) {
    const Shown shown = shown_by(frame, n);
    missing = missing || shown != Shown::kSent;
    explained = explained && shown != Shown::kNeither;
  }
  if (missing && !explained && cycles == 1) {
    counted_row_.reset();
    return false;
  }
  return missing;
}

/// Whether an offset did not leave in time, as the publisher has reported since the last call, or
/// because it stands still.
/// Its run may be over by then, and the drive still has what came before.
bool LiveOffsets::interrupted(std::int64_t now_ns) noexcept {
  // relaxed: the number orders no other data.
  const std::uint64_t stream = hand_over_.interrupted.load(std::memory_order_relaxed);
  const bool lost = !std::exchange(handed_over_, true) && hand_over_.by_publisher;
  if (stream < stream_ && !lost) return false;
  ++stream_;
  silent_until_ns_ = now_ns + surely_gone_ns_;
  return true;
}

/// An answer now would come in a later cycle of the drive than it is meant for, or would be the
/// second one in a cycle. Where the clock of the frames' age was set, what has waited still shows:
/// it comes after a pause, and all at once.
bool LiveOffsets::too_late(std::int64_t now_ns, std::int64_t due_ns) const noexcept {
  const std::int64_t since_ns = now_ns - came_ns_;  // the frame before
  return now_ns - due_ns > cycle_ns_ / 2 || since_ns < cycle_ns_ / 2 || since_ns > held_ns_ ||
         (phase_ != Phase::kNone && due_ns - left_ns_ < cycle_ns_ / 2);
}

/// What the drive has is not known any more: silence until it has nothing. A drive that listens to
/// DDS is told so; one on CAN gets no frame.
void LiveOffsets::withdraw(const MachineFrame& frame, RunEnd why, std::int64_t since_ns) noexcept {
  end(why);
  phase_ = Phase::kNone;
  matched_ = false;
  matcher_.forget();
  silent_until_ns_ = since_ns + surely_gone_ns_;
  for (std::size_t i = 0; i < gates_.size(); ++i) gates_[i] = Gate(rules_.limits[i]);
  std::fill(sent_.begin(), sent_.end(), MachineOffset());
  for (AxisOffset& axis : offset_.axes) {
    axis.expires_ns = frame.time_ns;
    axis.refusal = static_cast<std::uint32_t>(Refusal::kTimeStands);
  }
}

/// Where the commands are in a program: begins a run, moves it on, ends it.
void LiveOffsets::follow_program(const MachineFrame& frame, std::int64_t now_ns,
                                 bool late) noexcept {
  if (gap_) matcher_.forget();
  const std::optional<ProgramMatcher::Match> match = matcher_.see({nominal_.data(), gates_.size()});
  if (phase_ == Phase::kRunning) {
    const bool last = run_.row + 1 == run_.learned->program.rows();
    if (gap_) {
      end(RunEnd::kGap);
    } else if (!match) {
      end(last ? RunEnd::kFinished : RunEnd::kLeft);
    } else {
      run_.row = match->row;
      // relaxed: the flag orders nothing.
      if (run_.live && !hand_over_.armed.load(std::memory_order_relaxed)) end(RunEnd::kDisarmed);
    }
  } else if (phase_ == Phase::kNone && match && !matched_ && !late && now_ns >= silent_until_ns_) {
    const LearnedProgram& learned = *plan_->programs[match->program];
    if (learned.number != barred_) begin(match->row, learned, frame, now_ns);
  }
  matched_ = match.has_value();
}

const MachineOffset* LiveOffsets::answer(const MachineFrame& frame,
                                         const MachinePrediction& prediction,
                                         const Arrival& arrival) noexcept {
  offset_ = MachineOffset();
  offset_.sequence = frame.sequence;
  offset_.time_ns = frame.time_ns;
  offset_.axis_count = frame.axis_count;
  if (std::exchange(first_, false)) silent_until_ns_ = arrival.now_ns + surely_gone_ns_;
  const std::int64_t due_ns = arrival.now_ns - lateness_.of(arrival.age_ns, arrival.now_ns);
  const bool late = too_late(arrival.now_ns, due_ns);
  came_ns_ = arrival.now_ns;
  leaves_until_ns_ = due_ns + cycle_ns_ / 2;
  const bool cut = interrupted(arrival.now_ns);
  answer_stream_ = 0;
  if (phase_ != Phase::kNone) {
    const bool dropped = drive_has_dropped(frame, arrival.now_ns, due_ns);
    if (dropped || cut || not_delivered(frame)) {
      // What was not delivered is known only now, and may be on its way until now.
      withdraw(frame, dropped ? RunEnd::kGap : RunEnd::kNotDelivered,
               dropped && !cut ? renewed_.now_ns : arrival.now_ns);
      // It takes away only, whenever it comes.
      leaves_until_ns_ = arrival.now_ns + held_ns_;
      // relaxed: for the thread that stops the service; orders no data.
      hand_over_.active.store(false, std::memory_order_relaxed);
      return &offset_;
    }
  }
  if (phase_ == Phase::kNone) take_plan(arrival.now_ns);
  follow_program(frame, arrival.now_ns, late);
  // The offset with which a run ends belongs to it.
  if (phase_ != Phase::kNone && run_.live && hand_over_.by_publisher) answer_stream_ = stream_;
  if (phase_ == Phase::kRunning) {
    watch_residuals(prediction);
    measure(frame);
  }

  const bool answers = phase_ != Phase::kNone && !late;
  if (answers) {
    go_on(frame, prediction, arrival.now_ns, due_ns);
  } else if (phase_ != Phase::kNone) {
    ++unanswered_;
    if (phase_ == Phase::kRunning) gate_ns_ += cycle_ns_;  // the program moves on all the same
  }
  const MachineOffset before = sent_[newest_];
  newest_ = (newest_ + 1) % sent_.size();
  sent_[newest_] = late ? before : offset_;
  hand_over_.active.store(phase_ != Phase::kNone && run_.live, std::memory_order_relaxed);
  return answers ? &offset_ : nullptr;
}

void LiveOffsets::not_sent(std::uint32_t axes) noexcept {
  for (std::size_t i = 0; i < gates_.size(); ++i) {
    if ((axes >> i & 1U) == 0) continue;
    gates_[i] = gates_before_[i];
    const std::size_t before = (newest_ + sent_.size() - 1) % sent_.size();
    sent_[newest_].axes[i] = sent_[before].axes[i];
    // The drive that has waited longest decides.
    renewed_ = renewed_before_;
  }
}

}  // namespace servotwin::daemon
