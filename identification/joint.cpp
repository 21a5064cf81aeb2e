#include "identification/joint.h"

#include <algorithm>

#include "identification/chart.h"

namespace servotwin {

namespace {

/// Start values of all shapes: those of the effect at `place` on a grid about the catalogue's, the
/// others as they are.
std::vector<std::vector<double>> shape_grid(const Structure& structure, std::size_t place,
                                            const std::vector<double>& others) {
  constexpr std::size_t kGridded = 3;  // the first shapes of an effect are its main ones
  std::vector<std::vector<double>> grid{{}};
  std::size_t other = 0;
  for (std::size_t i = 0; i < structure.effects.size(); ++i) {
    std::size_t index = 0;
    for (const Parameter& p : shapes_of(structure.effects[i])) {
      std::vector<double> values{p.start};
      if (i != place) {
        values = {others[other++]};
      } else if (index < kGridded && p.lower > 0.0) {
        values = {0.3 * p.start, p.start, std::min(3.0 * p.start, p.upper)};
      }
      ++index;
      std::vector<std::vector<double>> longer;
      for (const auto& begun : grid) {
        for (double value : values) {
          longer.push_back(begun);
          longer.back().push_back(value);
        }
      }
      grid = std::move(longer);
    }
  }
  return grid;
}

}  // namespace

std::vector<std::size_t> friction_kinds() {
  return {kind_of<CoulombFriction>(), kind_of<Dahl>(), kind_of<Presliding>(),
          kind_of<ModifiedStribeck>(), kind_of<LuGre>()};
}

std::optional<JointFit> joint_fit(const std::vector<Segment>& segments, const Structure& structure,
                                  const PoleSearchOptions& options, double encoder_step,
                                  bool polish) {
  std::vector<Signals> signals;
  for (const Segment& s : segments) signals.push_back(signals_of(s));
  const auto kinds = friction_kinds();
  const auto friction = std::find_if(
      structure.effects.begin(), structure.effects.end(),
      [&](std::size_t kind) { return std::find(kinds.begin(), kinds.end(), kind) != kinds.end(); });
  const auto place = static_cast<std::size_t>(friction - structure.effects.begin());

  // Step 1.
  Structure simple = structure;
  if (friction != structure.effects.end()) simple.effects[place] = kind_of<CoulombFriction>();
  const Projection rough(signals, simple);
  auto fit = pole_search(rough, options);
  if (!fit) return std::nullopt;

  const Projection data(std::move(signals), structure);
  if (simple.effects != structure.effects) {
    // Step 2.
    std::vector<double> others;
    std::size_t shape = 0;
    for (std::size_t i = 0; i < simple.effects.size(); ++i) {
      for (std::size_t p = 0; p < shapes_of(simple.effects[i]).size(); ++p, ++shape) {
        if (i != place) others.push_back(fit->point.shapes[shape]);
      }
    }
    std::vector<std::pair<double, Point>> tried;
    const Projection coarse = thinned(data, 4e-3);
    for (std::vector<double>& shapes : shape_grid(structure, place, others)) {
      Point point{fit->point.denominator, std::move(shapes)};
      const double cost = coarse.solve(point).cost;
      tried.emplace_back(cost, std::move(point));
    }
    std::sort(tried.begin(), tried.end(),
              [](const auto& l, const auto& r) { return l.first < r.first; });
    // Step 3.
    PoleSearchOptions joint = options;
    for (std::size_t i = 0; i < tried.size() && i < 4; ++i) joint.from.push_back(tried[i].second);
    const int before = fit->evaluations + static_cast<int>(tried.size());
    fit = pole_search(data, joint);
    if (!fit) return std::nullopt;
    fit->evaluations += before;
  }

  JointFit out;
  out.fit = *fit;
  out.projected = data.model_of(fit->point, fit->solution.linear);
  out.model = out.projected;
  out.condition_number = condition_number(data, fit->point);
  if (polish) {
    if (auto polished = output_error(segments, structure, out.projected, {encoder_step})) {
      out.model = polished->model;
      out.covariance = polished->covariance;
      out.linear = structure.order + structure.coefficient_count();
      return out;
    }
  }
  out.covariance = covariance(data, *fit);
  out.linear = fit->solution.linear.size();
  return out;
}

}  // namespace servotwin
