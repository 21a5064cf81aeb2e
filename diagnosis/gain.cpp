#include "diagnosis/gain.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "diagnosis/bootstrap.h"
#include "diagnosis/search.h"
#include "identification/loop/identify.h"
#include "twin/hold.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kSettle_s = 0.5;  // from a start at rest into whatever moves

double root_mean(const std::vector<double>& pieces, const std::vector<std::size_t>& places) {
  double sum = 0.0;
  for (const std::size_t i : places) sum += pieces[i];
  return std::sqrt(sum / static_cast<double>(places.size()));
}

/// How much of an error of this axis is across the path, per unit; 0 at rest. To first order in the
/// error, with the other axis on its command.
Eigen::ArrayXd across_path(const Segment& s) {
  constexpr double kAtRest = 0.01;  // of the largest speed along the path
  const Eigen::ArrayXd own = Spline::through(s.command, s.sample_time_s).first,
                       other = Spline::through(s.neighbour, s.sample_time_s).first;
  const Eigen::ArrayXd speed = (own.square() + other.square()).sqrt();
  const double rest = kAtRest * speed.maxCoeff();
  return (speed > rest).select(other.abs() / speed.max(1e-300), 0.0);
}

/// Of the tracking error, and of its part across the path.
std::pair<double, double> simulated_rms(const Model& model, const std::vector<Segment>& segments) {
  double tracking = 0.0, contour = 0.0, count = 0.0, count_in_plane = 0.0;
  for (Segment s : segments) {
    // The state in which the encoder found the machine is not that of a repaired one.
    s.actual.resize(0);
    const Eigen::ArrayXd error = simulate(model, s);
    const Eigen::Index settled =
        std::max(s.lead, static_cast<Eigen::Index>(std::lround(kSettle_s / s.sample_time_s)));
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

double worth_of(const Gain& gain) {
  return std::isfinite(gain.before) ? gain.before * gain.before - gain.after * gain.after : 0.0;
}

Gain gain_of(const Model& without, const Model& with, const std::vector<Segment>& holdout) {
  const std::vector<double> before = left_by(without, holdout), after = left_by(with, holdout);
  Gain gain;
  gain.before = judge(without, holdout).rms;
  gain.after = judge(with, holdout).rms;
  if (before.size() < 4) return gain;
  const auto differences = bootstrap(before.size(), [&](const std::vector<std::size_t>& places) {
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
