#include "diagnosis/gain.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/bootstrap.h"
#include "diagnosis/search.h"
#include "identification/identify.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kSettle_s = 0.5;  // from a start at rest into whatever moves

double root_mean(const std::vector<double>& pieces, const std::vector<std::size_t>& places) {
  double sum = 0.0;
  for (const std::size_t i : places) sum += pieces[i];
  return std::sqrt(sum / static_cast<double>(places.size()));
}

}  // namespace

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

double tracking_rms(const Model& model, const std::vector<Segment>& segments) {
  double sum = 0.0, count = 0.0;
  for (Segment s : segments) {
    // The state in which the encoder found the machine is not that of a repaired one.
    s.actual.resize(0);
    const Eigen::ArrayXd error = simulate(model, s);
    const Eigen::Index settled =
        std::max(s.lead, static_cast<Eigen::Index>(std::lround(kSettle_s / s.sample_time_s)));
    if (settled >= error.size()) continue;
    sum += error.tail(error.size() - settled).square().sum();
    count += static_cast<double>(error.size() - settled);
  }
  return count > 0.0 ? std::sqrt(sum / count) : kAbsent;
}

}  // namespace servotwin
