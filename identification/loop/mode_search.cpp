#include "identification/loop/mode_search.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "identification/least_squares/interruption.h"
#include "identification/response/response_modes.h"
#include "twin/linear_algebra.h"
#include "twin/two_pi.h"

namespace servotwin {

namespace {

constexpr double kMinMode_hz = 3.0, kShareOfNyquist = 0.8;
constexpr int kPerOctave = 8;
constexpr double kGridDamping[] = {0.01, 0.04, 0.15};
constexpr int kStarts = 3, kLoopStarts = 2;
constexpr double kMinLogFrequencyDistance = 0.15;  // least distance of two starts in log frequency
constexpr double kScreeningStep_s = 1e-3;          // step of the thinned data that are screened
constexpr double kLoopDamping = 0.5;               // a pair with more damping belongs to the loop

bool apart(const Mode& one, const Mode& other) {
  return std::abs(std::log(one.omega / other.omega)) > kMinLogFrequencyDistance;
}

/// Half the residual sum of squares when gamma and delta of the last mode are solved for as well.
double cost_with_last_mode(const Projection& data, const Point& point) {
  const auto at = data.linearise(point);
  const Eigen::MatrixXd by = at.jacobian.rightCols(2);
  const Eigen::VectorXd scale = by.colwise().norm().cwiseMax(1e-300);
  const Eigen::MatrixXd columns = by * scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd step = least_squares(columns, at.at.residual);
  return 0.5 * (at.at.residual - columns * step).squaredNorm();
}

/// Where the next mode may lie, the most promising first.
std::vector<Mode> candidates(const Projection& data, const Point& point) {
  const Projection coarse = thinned(data, kScreeningStep_s);
  const double nyquist_hz = 0.5 / coarse.segments().front().h;
  std::vector<std::pair<double, Mode>> tried;
  const double step = std::exp2(1.0 / kPerOctave);
  for (double hz = kMinMode_hz; hz < kShareOfNyquist * nyquist_hz; hz *= step) {
    throw_if_interrupted();
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
  for (const auto& one : tried) {
    const bool fresh = std::all_of(out.begin(), out.end(),
                                   [&](const Mode& other) { return apart(one.second, other); });
    if (fresh && std::isfinite(one.first)) out.push_back(one.second);
    if (out.size() >= kStarts) break;
  }
  return out;
}

/// What the frequency response from the command's velocity to the error shows, the clearest first.
struct Shown {
  std::vector<Mode> modes;
  std::optional<double> real;                     ///< [rad/s]
  std::optional<std::pair<double, double>> pair;  ///< omega, zeta of the loop's own
};
Shown shown_by_response(const Projection& data) {
  std::vector<ResponseRecord> records;
  for (const Signals& s : data.segments()) records.push_back({{s.command.first}, s.error, {}});
  ModeOptions options;
  options.order = kMaxPoles;  // surplus poles come out as not determined
  Shown out;
  for (const FittedPole& pole : poles_shown(records, data.segments().front().h, options)) {
    if (!pole.pair) {
      if (!out.real) out.real = pole.omega;
    } else if (pole.zeta < kLoopDamping) {
      out.modes.push_back({pole.omega, pole.zeta});
    } else if (!out.pair) {
      out.pair = {pole.omega, pole.zeta};
    }
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
  const auto search = [&](const PoleSearchOptions& start) {
    auto found = pole_search(out.data, start);
    if (!found) return;
    evaluations += found->evaluations;
    if (found->solution.cost >= least) return;
    least = found->solution.cost;
    out.fit = std::move(*found);
  };
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
    search(near);
    search(anew);
  }
  Shown shown = shown_by_response(out.data);
  // Only the mode that the fit lacks: a small mode among large ones is lost if all are refitted.
  const auto missing = std::find_if(shown.modes.begin(), shown.modes.end(), [&](const Mode& mode) {
    return std::all_of(fit.point.modes.begin(), fit.point.modes.end(),
                       [&](const Mode& other) { return apart(mode, other); });
  });
  if (missing != shown.modes.end()) {
    PoleSearchOptions near = options;
    near.from = {fit.point};
    near.from.front().modes.push_back(*missing);
    search(near);
  }
  // All modes of the response at once, with its pair for the loop, and from the grid: several modes
  // as strong as the loop itself are not found one by one.
  if (shown.modes.size() >= static_cast<std::size_t>(structure.modes)) {
    shown.modes.resize(static_cast<std::size_t>(structure.modes));
    if (shown.pair && (structure.order == 2 || shown.real)) {
      PoleSearchOptions together = options;
      const PoleSet loop{shown.real.value_or(0.0), shown.pair->first, shown.pair->second};
      together.from = {{denominator_of(loop, structure.order), fit.point.shapes, shown.modes}};
      search(together);
    }
    PoleSearchOptions anew = options;
    anew.from.clear();
    anew.shapes = fit.point.shapes;
    anew.modes = std::move(shown.modes);
    anew.starts = kLoopStarts;
    search(anew);
  }
  if (!(least < 1e300)) return std::nullopt;
  out.fit.evaluations = evaluations;
  return out;
}

}  // namespace servotwin
