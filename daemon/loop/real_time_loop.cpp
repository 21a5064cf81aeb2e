#include "daemon/loop/real_time_loop.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

static_assert(std::is_trivially_copyable_v<TwinInForce> &&
              std::is_trivially_copyable_v<MachineFrame> &&
              std::is_trivially_copyable_v<MachinePrediction>);

// Timeout of receive(), after which the loop checks whether it has to stop.
constexpr double kFrameTimeout_s = 0.1;
// A frame that seems older than this, or younger than none, was on its way while a clock was set:
// its age is unknown.
constexpr std::int64_t kMaxAge_ns = 60'000'000'000;
// Time stamps from a PC clock jitter by parts of a cycle; lost cycles show in the sequence numbers.
constexpr std::int64_t kTimeToleranceCycles = 2;

void count(std::atomic<std::uint64_t>& counter, std::uint64_t by = 1) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
}

}  // namespace

int settling_cycles(const Model& model) {
  const auto roots = roots_of(model.loop);
  double slowest = -roots[0].real();
  for (int i = 1; i < model.loop.order; ++i)
    slowest = std::min(slowest, -roots[static_cast<std::size_t>(i)].real());
  if (const Effect* two_mass = two_mass_of(model)) {
    const TwoMassParameters axis = two_mass_parameters(*two_mass);
    slowest = std::min(slowest, axis.zeta * axis.omega);
  }
  const double settling_s = std::log(100.0) / slowest + model.command_delay_s();
  return static_cast<int>(std::min(std::ceil(settling_s / model.sample_time_s), 1e9));
}

void AxisLoop::take(const TwinInForce& model) noexcept {
  next_ = model;
  catching_up_ = true;
  next_run_ = 0;
  // One less than the history holds, because the next command is added before the first is read.
  next_fed_ = count_ >= kHistory ? count_ - kHistory + 1 : 0;
}

void AxisLoop::forget() noexcept {
  count_ = run_ = sane_ = calm_ = 0;
  last_ = {};
  if (catching_up_) next_fed_ = next_run_ = 0;
}

bool AxisLoop::settled() const noexcept {
  const auto needed = static_cast<std::uint64_t>(in_force_.settling_cycles);
  // What a jump of some metres leaves must fall below what an encoder shows: 1 % four times.
  constexpr std::uint64_t kTimesAfterJump = 4;
  return in_force_.version != 0 && run_ > needed && sane_ > kTimesAfterJump * needed;
}

void AxisLoop::note_acting(std::span<const AxisLoop> all) noexcept {
  if (!by_motion()) return;
  const AxisLoop& acting = all[static_cast<std::size_t>(in_force_.neighbour)];
  const bool settled = acting.settled();
  const bool waits = acting.in_force_.version != 0 && !settled;
  calm_ = waits || settled != moved_by_motion_ ? 0 : calm_ + 1;
  moved_by_motion_ = settled;
}

SeenAxis AxisLoop::seen_then(std::uint64_t ago) const noexcept {
  if (ago == 0) return seen();
  SeenAxis out;
  const std::uint64_t kept = std::min<std::uint64_t>(count_, kHistory);
  for (std::size_t i = 0; i < out.last.command.size() && ago + i < kept; ++i)
    out.last.command[i] = history_[(count_ - 1 - ago - i) % kHistory];
  const double acceleration = ago < kept ? accelerations_[(count_ - 1 - ago) % kHistory] : kAbsent;
  if (std::isfinite(acceleration)) {
    out.model = &in_force_;
    out.last.predict(acceleration);
  }
  return out;
}

double AxisLoop::catch_up(std::span<const AxisLoop> all) noexcept {
  double error = kAbsent;
  for (int fed = 0; fed < kCatchUpCycles && next_fed_ < count_; ++fed, ++next_fed_) {
    const double command = history_[next_fed_ % kHistory];
    if (next_run_ == 0) {
      next_.twin.start(command);
      error = command - next_.twin.position();
    } else {
      const std::uint64_t ago = count_ - 1 - next_fed_;
      error = next_.twin.follow(command, acting_on(next_, [&](int axis) {
                                  return all[static_cast<std::size_t>(axis)].seen_then(ago);
                                }));
    }
    ++next_run_;
  }
  if (next_fed_ < count_) return kAbsent;
  in_force_ = next_;
  run_ = next_run_;
  catching_up_ = false;
  return error;
}

void AxisLoop::note(double command) noexcept {
  bad_sample_ = !std::isfinite(command);
  if (bad_sample_) return forget();
  history_[count_ % kHistory] = command;
  accelerations_[count_ % kHistory] = kAbsent;
  last_.add(command);
  sane_ = last_.sane() ? sane_ + 1 : 0;
  ++count_;
}

AxisPrediction AxisLoop::predict(std::span<const AxisLoop> all) noexcept {
  AxisPrediction out;
  if (bad_sample_) {
    out.state = AxisState::kBadSample;
    out.model_version = in_force_.version;
    return out;
  }
  const double command = history_[(count_ - 1) % kHistory];
  double error = kAbsent;
  if (in_force_.version != 0) {
    if (count_ == 1) {
      in_force_.twin.start(command);
      error = command - in_force_.twin.position();
      run_ = 1;
    } else {
      error = in_force_.twin.follow(command, acting_on(in_force_, [&](int axis) {
                                      return all[static_cast<std::size_t>(axis)].seen();
                                    }));
      ++run_;
    }
    last_.predict(in_force_.twin.acceleration());
    note_acting(all);
  }
  if (catching_up_) {
    if (const double newer = catch_up(all); !catching_up_) error = newer;
  }
  if (in_force_.version == 0) return out;
  out.model_version = in_force_.version;
  if (!std::isfinite(
          error)) {  // the command was too large; the twin starts again with the next one
    forget();
    out.state = AxisState::kBadSample;
    return out;
  }
  last_.predict(in_force_.twin.acceleration());
  accelerations_[(count_ - 1) % kHistory] = last_.acceleration;
  out.predicted_error = error;
  out.standard_deviation = in_force_.standard_deviation;
  const auto needed = static_cast<std::uint64_t>(in_force_.settling_cycles);
  const bool known = run_ > needed && (!by_motion() || calm_ > needed);
  out.state = known ? AxisState::kPredicting : AxisState::kSettling;
  return out;
}

RealTimeLoop::RealTimeLoop(double cycle_s, std::span<LatestValue<TwinInForce>> models,
                           Ring<MachinePrediction>& predictions, Ring<CycleRow>& rows,
                           const WakeUp& publisher,
                           const std::vector<std::vector<std::size_t>>& paths)
    : cycle_ns_(std::llround(cycle_s * 1e9)),
      models_(models),
      predictions_(predictions),
      rows_(rows),
      publisher_(publisher),
      axes_(models.size()),
      seen_(models.size()),
      ahead_(models.size()) {
  if (models.empty() || models.size() > kMaxAxes || cycle_ns_ <= 0) {
    throw std::invalid_argument("a loop needs a cycle and 1 to " + std::to_string(kMaxAxes) +
                                " axes");
  }
  const auto there = [&](std::size_t axis) { return axis < models_.size(); };
  for (const std::vector<std::size_t>& path : paths) {
    if (path.size() < 2 || path.size() > kMaxPathAxes ||
        !std::all_of(path.begin(), path.end(), there)) {
      throw std::invalid_argument("a path has 2 to " + std::to_string(kMaxPathAxes) +
                                  " of the machine's axes");
    }
    paths_.emplace_back(path);
  }
}

void RealTimeLoop::give_back(LiveOffsets& offsets, Ring<DatedOffset>& said) noexcept {
  offsets_ = &offsets;
  said_ = &said;
}

void RealTimeLoop::run(FrameSource& source, const std::atomic<bool>& stop) noexcept {
  // relaxed: the flag orders nothing; whoever sets it joins this thread.
  while (!stop.load(std::memory_order_relaxed)) {
    const Received received = source.receive(frame_, kFrameTimeout_s);
    count(counters_.turns);
    if (received == Received::kEnd) return;
    if (received == Received::kNothing) continue;
    const std::int64_t begin = steady_ns();
    std::int64_t age = source.age_ns();
    if (age > kMaxAge_ns || age < -kMaxAge_ns) age = 0;
    counters_.wake.add(age);
    prediction_.due_ns = begin - age;
    if (const MachineOffset* offset = on_frame(frame_, {begin, age})) {
      if (const std::uint32_t axes = source.send(*offset, offsets_->leaves_until_ns()))
        offsets_->not_sent(axes);
      offsets_->has_left(steady_ns());
    }
    if (predicted_) source.tell(prediction_);
    const std::int64_t taken = steady_ns() - begin;
    counters_.work.add(taken);
    if (taken > cycle_ns_) count(counters_.overruns);
  }
}

RealTimeLoop::Order RealTimeLoop::order_of(const MachineFrame& frame) noexcept {
  const std::uint64_t last = last_sequence_;
  const std::int64_t last_time = last_time_ns_;
  if (first_) {
    first_ = false;
  } else if (frame.sequence == last) {
    count(counters_.repeated);
    return Order::kRepeats;
  } else if (frame.sequence < last) {
    count(counters_.time_jumps);
  } else if (frame.sequence > last + 1) {
    count(counters_.lost, frame.sequence - last - 1);
  } else {
    const std::int64_t step = between_ns(last_time, frame.time_ns);
    last_sequence_ = frame.sequence;
    last_time_ns_ = frame.time_ns;
    if (step >= 0 && step <= (1 + kTimeToleranceCycles) * cycle_ns_) return Order::kFollows;
    count(counters_.time_jumps);
    return Order::kAfterGap;
  }
  last_sequence_ = frame.sequence;
  last_time_ns_ = frame.time_ns;
  return Order::kAfterGap;
}

void RealTimeLoop::add_contour(Path& path, const MachineFrame& frame, Order order) noexcept {
  const auto ahead = static_cast<std::size_t>(prediction_.ahead_count);
  PathPoint command{}, predicted{}, measured{};
  for (std::size_t i = 0; i < path.axes.size(); ++i) {
    const std::size_t axis = path.axes[i];
    command[i] = offsets_ != nullptr ? offsets_->nominal(axis) : frame.axes[axis].command;
    predicted[i] = frame.axes[axis].command - prediction_.axes[axis].predicted_error;
    measured[i] = frame.axes[axis].actual;
    for (std::size_t k = 0; k < ahead; ++k) path_ahead_[k][i] = frame.ahead[axis][k];
  }
  if (order == Order::kAfterGap) path.contour.forget();
  path.contour.move(command);
  const auto keep_farthest = [&](double& farthest, const PathPoint& point) {
    const double error = path.contour.of(point, {path_ahead_.data(), ahead});
    if (std::isnan(farthest) || std::abs(error) > std::abs(farthest)) farthest = error;
  };
  keep_farthest(prediction_.contour_error, predicted);
  keep_farthest(prediction_.measured_contour_error, measured);
}

void RealTimeLoop::look_ahead(const MachineFrame& frame) noexcept {
  const auto count = static_cast<std::size_t>(prediction_.ahead_count);
  if (count == 0) return;
  // Those that another axis acts on, and those that act by their motion, are stepped together.
  std::array<bool, kMaxAxes> together{};
  bool any = false;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const TwinInForce* model = axes_[i].predicting();
    if (model == nullptr || model->neighbour < 0) continue;
    any = together[i] = true;
    const auto acting = static_cast<std::size_t>(model->neighbour);
    if (model->by_motion && axes_[acting].predicting() != nullptr) together[acting] = true;
  }
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const TwinInForce* model = axes_[i].predicting();
    const std::span<double> errors(prediction_.ahead[i].data(), count);
    if (any) seen_[i] = axes_[i].seen();
    if (together[i]) {
      ahead_[i] = model->twin;
      seen_[i].twin = &ahead_[i];
    } else if (model != nullptr) {
      model->twin.predict({frame.ahead[i].data(), count}, errors);
    } else {
      std::fill(errors.begin(), errors.end(), kAbsent);
    }
  }
  for (std::size_t k = 0; any && k < count; ++k) {
    for (std::size_t i = 0; i < models_.size(); ++i) seen_[i].last.add(frame.ahead[i][k]);
    for (const bool by_motion : {false, true}) {
      for (std::size_t i = 0; i < models_.size(); ++i) {
        if (!together[i] || axes_[i].by_motion() != by_motion) continue;
        prediction_.ahead[i][k] = ahead_[i].follow(
            frame.ahead[i][k], acting_on(*axes_[i].predicting(), [&](int axis) -> const SeenAxis& {
              return seen_[static_cast<std::size_t>(axis)];
            }));
        seen_[i].last.predict(ahead_[i].acceleration());
      }
    }
  }
}

const MachineOffset* RealTimeLoop::on_frame(const MachineFrame& came,
                                            const Arrival& arrival) noexcept {
  predicted_ = false;
  count(counters_.frames);
  if (came.axis_count != static_cast<int>(models_.size())) {
    count(counters_.malformed);
    return nullptr;
  }
  const Order order = order_of(came);
  if (order == Order::kRepeats) return nullptr;
  const MachineFrame& frame =
      offsets_ != nullptr ? offsets_->seen(came, order == Order::kFollows) : came;

  prediction_.sequence = frame.sequence;
  prediction_.time_ns = frame.time_ns;
  prediction_.axis_count = frame.axis_count;
  prediction_.ahead_count = std::clamp(frame.ahead_count, 0, kMaxLookAhead);

  // First the prediction, from commands alone ...
  for (std::size_t i = 0; i < models_.size(); ++i) {
    AxisLoop& axis = axes_[i];
    if (order == Order::kAfterGap) axis.forget();
    if (const TwinInForce* newest = models_[i].fresh()) axis.take(*newest);
    axis.note(frame.axes[i].command);
  }
  std::array<bool, kMaxAxes> by_motion{};  // a newer model may come into force while it predicts
  for (std::size_t i = 0; i < models_.size(); ++i) by_motion[i] = axes_[i].by_motion();
  for (const bool now : {false, true}) {
    for (std::size_t i = 0; i < models_.size(); ++i) {
      if (by_motion[i] == now) prediction_.axes[i] = axes_[i].predict(axes_);
    }
  }
  look_ahead(frame);
  prediction_.contour_error = prediction_.measured_contour_error = kAbsent;
  for (Path& path : paths_) add_contour(path, frame, order);
  // ... then the measured values.
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const AxisSample& sample = frame.axes[i];
    AxisPrediction& axis = prediction_.axes[i];
    axis.command = sample.command;
    axis.measured_error = sample.command - sample.actual;  // NaN where there is no encoder value
    axis.residual = axis.measured_error - axis.predicted_error;
    row_.residuals[i] = {axis.state == AxisState::kPredicting ? axis.residual : kAbsent,
                         axis.standard_deviation, axis.model_version};
    if (axis.state == AxisState::kBadSample || std::isinf(sample.actual))
      count(counters_.not_finite);
  }
  const MachineOffset* offset =
      offsets_ != nullptr ? offsets_->answer(frame, prediction_, arrival) : nullptr;
  if (offset != nullptr && !said_->push({*offset, offsets_->leaves_until_ns(), offsets_->stream()}))
    offsets_->not_handed_over();
  predictions_.push(prediction_);
  predicted_ = true;
  publisher_.notify();

  row_.time_ns = frame.time_ns;
  row_.after_gap = order == Order::kAfterGap || row_dropped_;
  row_.axis_count = frame.axis_count;
  row_.axes = frame.axes;
  row_dropped_ = !rows_.push(row_);
  return offset;
}

}  // namespace servotwin::daemon
