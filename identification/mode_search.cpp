#include "identification/mode_search.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace servotwin {

namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kSlowest_hz = 3.0, kShareOfNyquist = 0.8;
constexpr int kPerOctave = 8;
constexpr double kGridDamping[] = {0.01, 0.04, 0.15};
constexpr int kStarts = 3, kLoopStarts = 2;
constexpr double kApart = 0.15;  // of a start's frequency from the others', relative
constexpr double kScreened_s = 1e-3;

/// Half the sum of squares that is left with gamma and delta of the last mode solved for as well.
double cost_with_last_mode(const Projection& data, const Point& point) {
  const auto at = data.linearise(point);
  const Eigen::MatrixXd by = at.jacobian.rightCols(2);
  const Eigen::VectorXd scale = by.colwise().norm().cwiseMax(1e-300);
  const Eigen::MatrixXd columns = by * scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd step = columns.colPivHouseholderQr().solve(at.at.residual);
  return 0.5 * (at.at.residual - columns * step).squaredNorm();
}

/// Where the next mode may lie, the most promising first.
std::vector<Mode> candidates(const Projection& data, const Point& point) {
  const Projection coarse = thinned(data, kScreened_s);
  const double nyquist_hz = 0.5 / coarse.segments().front().h;
  std::vector<std::pair<double, Mode>> tried;
  const double step = std::exp2(1.0 / kPerOctave);
  for (double hz = kSlowest_hz; hz < kShareOfNyquist * nyquist_hz; hz *= step) {
    std::pair<double, Mode> best{1e300, {}};
    for (const double zeta : kGridDamping) {
      Point with = point;
      with.modes.push_back({kTwoPi * hz, zeta});
      const double cost = cost_with_last_mode(coarse, with);
      if (cost < best.first) best = {cost, with.modes.back()};
    }
    tried.push_back(best);
  }
  std::sort(tried.begin(), tried.end(),
            [](const auto& l, const auto& r) { return l.first < r.first; });
  std::vector<Mode> out;
  for (const auto& [cost, mode] : tried) {
    const bool fresh = std::all_of(out.begin(), out.end(), [&](const Mode& other) {
      return std::abs(std::log(mode.omega / other.omega)) > kApart;
    });
    if (fresh && std::isfinite(cost)) out.push_back(mode);
    if (out.size() >= kStarts) break;
  }
  return out;
}

}  // namespace

std::optional<ModeFit> with_one_more_mode(const Projection& data, const PoleFit& fit,
                                          const PoleSearchOptions& options) {
  Structure structure = data.structure();
  if (static_cast<std::size_t>(structure.modes) >= kMaxModes) return std::nullopt;
  ++structure.modes;
  ModeFit out{Projection(data.segments(), structure, data.has_free_response()), {}};
  double least = 1e300;
  int evaluations = fit.evaluations;
  for (const Mode& mode : candidates(out.data, fit.point)) {
    // From the loop as it is, and from the grid: without the mode, the loop may have taken its
    // place.
    PoleSearchOptions near = options, anew = options;
    near.from = {fit.point};
    near.from.front().modes.push_back(mode);
    anew.from.clear();
    anew.shapes = fit.point.shapes;
    anew.modes = near.from.front().modes;
    anew.starts = kLoopStarts;
    for (const PoleSearchOptions& start : {near, anew}) {
      auto found = pole_search(out.data, start);
      if (!found) continue;
      evaluations += found->evaluations;
      if (found->solution.cost >= least) continue;
      least = found->solution.cost;
      out.fit = std::move(*found);
    }
  }
  if (!(least < 1e300)) return std::nullopt;
  out.fit.evaluations = evaluations;
  return out;
}

}  // namespace servotwin
