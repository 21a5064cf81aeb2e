#include "diagnosis/search/gain.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "diagnosis/search/search.h"
#include "diagnosis/statistics/bootstrap.h"
#include "identification/loop/identify.h"
#include "twin/hold.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// The simulation starts at rest even in the middle of a motion; the transient is over by then.
constexpr double kNotCounted_s = 0.5;

double root_mean(const std::vector<double>& pieces, const std::vector<std::size_t>& places) {
  double sum = 0.0;
  for (const std::size_t i : places) sum += pieces[i];
  return std::sqrt(sum / static_cast<double>(places.size()));
}

/// The component across the path of a unit error of this axis, 0..1; 0 at rest. First order in the
/// error, with the other axis exactly on its command.
Eigen::ArrayXd across_path(const Segment& s) {
  // Share of the largest path speed below which the axes count as at rest.
  constexpr double kMaxRestSpeedShare = 0.01;
  const Eigen::ArrayXd own = Spline::through(s.command, s.sample_time_s).first,
                       other = Spline::through(s.neighbour, s.sample_time_s).first;
  const Eigen::ArrayXd speed = (own.square() + other.square()).sqrt();
  const double rest = kMaxRestSpeedShare * speed.maxCoeff();
  return (speed > rest).select(other.abs() / speed.max(1e-300), 0.0);
}

/// RMS of the simulated tracking error, and of its component across the path.
std::pair<double, double> simulated_rms(const Model& model, const std::vector<Segment>& segments) {
  double tracking = 0.0, contour = 0.0, count = 0.0, count_in_plane = 0.0;
  for (Segment s : segments) {
    // The recorded position would set the starting state, which a repaired machine does not share.
    s.actual.resize(0);
    const Eigen::ArrayXd error = simulate(model, s);
    const Eigen::Index settled =
        std::max(s.lead, static_cast<Eigen::Index>(std::lround(kNotCounted_s / s.sample_time_s)));
    if (settled >= error.size()) continue;
    const Eigen::Index n = error.size() - settled;
    tracking += error.tail(n).square().sum();
    count += static_cast<double>(n);
    if (!s.in_plane || s.neighbour.size() != s.size()) continue;
    const Eigen::ArrayXd across = across_path(s).tail(n);
    contour += (across * error.tail(n)).square().sum();
    count_in_plane += (across > 0.0).cast<double>().sum();
  }
  return {count > 0.0 ? std::sqrt(tracking / count) : kAbsent,
          count_in_plane > 0.0 ? std::sqrt(contour / count_in_plane) : kAbsent};
}

}  // namespace

bool worth_a_repair(const Gain& gain) {
  constexpr double kMinWorth = 0.02;
  const bool path = std::isfinite(gain.contour_repaired);
  const double now = path ? gain.contour_now : gain.tracking_now,
               then = path ? gain.contour_repaired : gain.tracking_repaired;
  return then < (1.0 - kMinWorth) * now;
}

double worth_of(const Gain& gain) {
  return std::isfinite(gain.before) ? gain.before * gain.before - gain.after * gain.after : 0.0;
}

Gain gain_of(const Model& without, const Model& with, const std::vector<Segment>& holdout) {
  const std::vector<double> before = left_by(without, holdout), after = left_by(with, holdout);
  Gain gain;
  gain.before = judge(without, holdout).rms;
  gain.after = judge(with, holdout).rms;
  if (before.size() < 4) return gain;
  // How much of the recording is rest is no chance: motion and rest are resampled separately. Else
  // the interval of a recording with one move would hold the gain of a recording without one.
  std::vector<std::vector<std::size_t>> strata(2);
  const std::vector<bool> moves = moving(holdout);
  for (std::size_t i = 0; i < before.size(); ++i) strata[moves[i] ? 1 : 0].push_back(i);
  const auto differences = bootstrap(strata, [&](const std::vector<std::size_t>& places) {
    return root_mean(before, places) - root_mean(after, places);
  });
  gain.low = differences[static_cast<std::size_t>(0.025 * kResamples)];
  gain.high = differences[static_cast<std::size_t>(0.975 * kResamples)];
  return gain;
}

void judge_repair(const Model& now, const Model& repaired, const std::vector<Segment>& segments,
                  Gain& gain) {
  std::tie(gain.tracking_now, gain.contour_now) = simulated_rms(now, segments);
  std::tie(gain.tracking_repaired, gain.contour_repaired) = simulated_rms(repaired, segments);
}

}  // namespace servotwin
