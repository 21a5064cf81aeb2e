#include "diagnosis/search/unexplained.h"

#include <algorithm>
#include <array>

#include "diagnosis/search/search.h"
#include "diagnosis/search/variation.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/loop/identify.h"
#include "identification/recording/signals.h"

namespace servotwin {

namespace {

// RMS with the term over RMS without it, on the halves that it was not fitted to: 5 % better is the
// least for which a term without an explanation is added.
constexpr double kMaxRmsRatioToAddTable = 0.95;

double sum(const std::vector<double>& values) {
  double out = 0.0;
  for (const double value : values) out += value;
  return out;
}

/// The range of the variable over which a table of this kind is defined.
std::pair<double, double> range_of(std::size_t kind, const std::vector<Segment>& segments) {
  double low = 1e300, high = -1e300;
  for (const Segment& s : segments) {
    const Spline command = Spline::through(s.command, s.sample_time_s);
    const Eigen::ArrayXd& regressor = kind == kind_of<UnexplainedOverPosition>()   ? s.command
                                      : kind == kind_of<UnexplainedOverVelocity>() ? command.first
                                                                                   : command.second;
    low = std::min(low, regressor.minCoeff());
    high = std::max(high, regressor.maxCoeff());
  }
  return {low, high};
}

Change table(std::size_t kind, double low, double high) {
  Effect effect;
  effect.kind = kind;
  effect.shape = {low, high};
  Change out;
  out.kind = kind;
  for (const Parameter& p : coefficients_of(kind))
    out.quantities.push_back({std::string(p.name), std::string(p.unit), 0.0, 1e-6, false});
  out.apply = [effect](Model& m, std::span<const double> v) {
    m.effects.push_back(effect);
    std::copy(v.begin(), v.end(), m.effects.back().coefficient.begin());
  };
  return out;
}

}  // namespace

std::optional<Model> with_unexplained(const Model& model, const std::vector<Segment>& training) {
  if (model.effects.size() >= kMaxEffects) return std::nullopt;
  auto halves = split(training, 0.5);
  if (halves.first.empty() || halves.second.empty()) return std::nullopt;
  halves.second = with_lead_in(halves.second, training);
  std::vector<double> before = left_by(model, halves.second);
  for (const double piece : left_by(model, halves.first)) before.push_back(piece);
  std::optional<Change> best;
  double least = kMaxRmsRatioToAddTable * kMaxRmsRatioToAddTable * sum(before);
  for (const std::size_t kind :
       {kind_of<UnexplainedOverPosition>(), kind_of<UnexplainedOverVelocity>(),
        kind_of<UnexplainedOverAcceleration>()}) {
    const auto [low, high] = range_of(kind, training);
    if (!(high > low)) continue;
    const Change change = table(kind, low, high);
    std::vector<double> after;
    for (const auto& [fitted, judged] :
         {std::pair{&halves.first, &halves.second}, std::pair{&halves.second, &halves.first}}) {
      const Variation variation(model, *fitted);
      Varied v;
      v.add(change);
      if (!variation.fit(v)) continue;
      for (const double piece : left_by(v.of(model), *judged)) after.push_back(piece);
    }
    if (after.size() != before.size() || sum(after) >= least ||
        paired_z(before, after) < kMinBlockZ)
      continue;
    least = sum(after), best = change;
  }
  if (!best) return std::nullopt;
  const Variation variation(model, training);
  Varied v;
  v.add(*best);
  if (!variation.fit(v)) return std::nullopt;
  return v.of(model);
}

}  // namespace servotwin
