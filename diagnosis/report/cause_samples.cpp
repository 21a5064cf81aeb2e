#include "diagnosis/report/cause_samples.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "diagnosis/statistics/regressor.h"
#include "identification/loop/projection.h"
#include "twin/low_pass.h"
#include "twin/sample.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kNotPlotted_s = 0.5;       // start of every segment, not plotted: transient
constexpr double kForceBandwidth_hz = 100;  // of forces reconstructed from the error
constexpr double kForgets_s = 1.0;          // time constant of the leaky integral of the error

/// The travel since the last reversal by more than `least`, and the direction since; NaN before the
/// first reversal.
struct Turns {
  Eigen::ArrayXd travel, direction;
};
Turns turns_of(const Eigen::ArrayXd& x, double least) {
  Turns out{Eigen::ArrayXd::Constant(x.size(), kAbsent),
            Eigen::ArrayXd::Constant(x.size(), kAbsent)};
  double direction = 0.0;
  bool turned = false;
  Eigen::Index extreme = 0, turn = 0;
  const auto put = [&](Eigen::Index k) {
    out.travel(k) = std::max(0.0, direction * (x(k) - x(turn)));
    out.direction(k) = direction;
  };
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    const double way = x(k) - x(extreme);
    if (direction == 0.0 ? std::abs(way) > least : direction * way < -least) {
      turned = direction != 0.0;
      direction = way > 0.0 ? 1.0 : -1.0;
      turn = extreme;
      extreme = k;
      // The samples since the reversal belong to the new direction already.
      for (Eigen::Index i = turn; turned && i < k; ++i) put(i);
    } else if (direction * way > 0.0) {
      extreme = k;
    }
    if (turned) put(k);
  }
  return out;
}

/// The contribution of an effect along a motion, sample by sample.
Eigen::ArrayXd along(const Effect& effect, const Signals& signals, const Spline& command) {
  EffectMemory<double> memory;
  start_memory(effect.kind, effect.shape.data(), memory);
  Eigen::ArrayXd out(signals.size());
  std::array<double, kMaxCoefficients> unit{};
  const std::size_t count = coefficients_of(effect.kind).size();
  Eigen::Index k = 0;
  for (const Motion& m : motion_along(signals, command, identity_of(effect.kind).acts)) {
    unit_forces<double>(effect.kind, effect.shape.data(), memory, m, unit.data());
    out(k) = 0.0;
    for (std::size_t i = 0; i < count; ++i) out(k) += effect.coefficient[i] * unit[i];
    ++k;
  }
  return out;
}

/// The disturbance force that would make this difference between two tracking errors.
Eigen::ArrayXd force_of(const Loop& loop, const Eigen::ArrayXd& difference, double h) {
  const Eigen::Index n = difference.size();
  const Eigen::ArrayXd e =
      zero_phase(butterworth(4, std::min(0.3, kForceBandwidth_hz * h)), difference);
  Eigen::ArrayXd out = Eigen::ArrayXd::Zero(n);
  double integral = 0.0;
  for (Eigen::Index k = 1; k + 1 < n; ++k) {
    const double first = (e(k + 1) - e(k - 1)) / (2.0 * h),
                 second = (e(k + 1) - 2.0 * e(k) + e(k - 1)) / (h * h);
    integral += h * (e(k) - integral / kForgets_s);
    out(k) = second + loop.denominator[0] * first + loop.denominator[1] * e(k) +
             (loop.order == 3 ? loop.denominator[2] * integral : 0.0);
  }
  return out;
}

}  // namespace

CauseSamples samples_of(const Diagnosis& diagnosis, const Cause& cause,
                        const std::vector<Segment>& segments, double scale) {
  CauseSamples out;
  const Model& with = diagnosis.extended.model;
  const Model& without = *cause.without;
  const Effect& effect = with.effects[cause.place];
  const Acts acts = identity_of(effect.kind).acts;
  Model loop = with;
  std::erase_if(loop.effects,
                [](const Effect& e) { return identity_of(e.kind).acts == Acts::kReading; });
  for (const Segment& s : segments) {
    const double h = s.sample_time_s;
    const auto skip = std::max<Eigen::Index>(s.lead, std::lround(kNotPlotted_s / h));
    if (s.size() < 2 * skip + 100) continue;
    const Eigen::ArrayXd error = s.command - s.actual, by_with = simulate(with, s),
                         by_without = simulate(without, s);
    Signals signals = signals_of(s);
    signals.loop_position = s.command - simulate(loop, s);
    set_motion(signals, signals.loop_position);
    const Spline command = Spline::through(signals.command.delayed(with.command_delay_s()), h);
    add_drive(with, signals);

    Eigen::ArrayXd measured, base, one = Eigen::ArrayXd::Zero(s.size());
    if (!acts_along_motion(acts)) {
      one = by_with, measured = error, base = by_without;
    } else if (acts == Acts::kReading) {
      one = along(effect, signals, command);
      measured = one - (error - by_with), base = one - (by_without - by_with);
    } else {
      for (const Effect& e : with.effects) {
        if (&e == &effect || (is_friction(effect.kind) && is_friction(e.kind)))
          one += along(e, signals, command);
      }
      measured = one + force_of(with.loop, error - by_with, h);
      base = one + force_of(with.loop, by_without - by_with, h);
    }
    const ResidualStretch stretch{s.command, error - by_with, h, s.start_s};
    out.stretch_with.push_back(stretch);
    out.stretch_without.push_back({s.command, error - by_without, h, s.start_s});
    // Effects depend on the position of the axis and not on its command.
    const Variables v = variables_of({signals.position, stretch.residual, h, s.start_s});
    const Turns turns = turns_of(signals.position, 0.01 * scale);
    for (Eigen::Index k = skip; k + skip < s.size(); ++k) {
      if (!std::isfinite(v.velocity(k)) || !std::isfinite(v.acceleration(k))) continue;
      out.velocity.push_back(v.velocity(k));
      out.fastest = std::max(out.fastest, std::abs(v.velocity(k)));
      out.acceleration.push_back(v.acceleration(k));
      out.neighbour.push_back(signals.neighbour_motion_acceleration.size() > 0
                                  ? signals.neighbour_motion_acceleration(k)
                                  : kAbsent);
      out.position.push_back(v.position(k));
      out.time.push_back(v.time(k));
      out.travel.push_back(turns.travel(k));
      out.direction.push_back(turns.direction(k));
      out.since_rest.push_back(v.since_rest_s(k));
      out.measured.push_back(measured(k));
      out.without.push_back(base(k));
      out.with.push_back(one(k));
      out.left_without.push_back(error(k) - by_without(k));
      out.left_with.push_back(error(k) - by_with(k));
    }
  }
  return out;
}

}  // namespace servotwin
