#include "identification/loop/limit_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlopt.hpp>
#include <stdexcept>

#include "identification/least_squares/interruption.h"
#include "identification/loop/identify.h"
#include "identification/recording/signals.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kUnfitted = std::numeric_limits<double>::infinity();
// Limits that are tried, from this share of the largest demand on, with each of these parts of the
// viscous friction [1/s].
constexpr int kTriedLimits = 40;
constexpr double kLowestLimit = 0.2;
constexpr std::array kViscousParts{0.1, 1.0};
// Of the search from the best of them, by the logarithms of the shapes.
constexpr int kMaxSimulations = 250;
constexpr double kTolerance = 1e-4;  // of the RMS
// First steps of limit, reset rate or tracking time, and viscous friction.
constexpr std::array kFirstSteps{0.02, 0.7, 0.7};

/// The largest demand of the control in a simulation.
double largest_demand(const Model& model, const std::vector<Segment>& segments) {
  double most = 0.0;
  for (const Segment& s : segments) {
    Signals signals = signals_of(s);
    set_motion(signals, s.command - simulate(model, s));
    add_drive(model, signals);
    most = std::max(most, signals.demand.abs().maxCoeff());
  }
  return most;
}

/// The model with the limit as its last effect, by the logarithms of the limit's shapes.
struct Sought {
  Model model;
  const std::vector<Segment>& segments;

  double rms_at(const double* x) {
    std::array<double, kMaxShapes>& shape = model.effects.back().shape;
    for (std::size_t i = 0; i < kFirstSteps.size(); ++i) shape[i] = std::exp(x[i]);
    if (!why_invalid(model).empty()) return kUnfitted;
    const double rms = judge(model, segments).rms;
    return std::isfinite(rms) ? rms : kUnfitted;
  }
  static double cost(unsigned, const double* x, double*, void* given) {
    if (interruption().stop_requested()) throw nlopt::forced_stop();
    return std::min(static_cast<Sought*>(given)->rms_at(x), std::numeric_limits<double>::max());
  }
};

}  // namespace

LimitFit with_motor_limit(const Model& loop, std::size_t form,
                          const std::vector<Segment>& segments) {
  Sought sought{loop, segments};
  Effect limit;
  limit.kind = form;
  limit.coefficient[0] = 1.0;
  sought.model.effects.push_back(limit);
  std::vector<double> lower, upper;
  for (const Parameter& p : shapes_of(form)) {
    lower.push_back(std::log(p.lower));
    upper.push_back(std::log(p.upper));
  }
  const double most = largest_demand(loop, segments);
  std::vector<double> best;
  double least = kUnfitted;
  for (const double viscous : kViscousParts) {
    for (int i = 0; i < kTriedLimits; ++i) {
      throw_if_interrupted();
      const std::vector<double> x{
          std::log(most) + std::log(kLowestLimit) * (1.0 - static_cast<double>(i) / kTriedLimits),
          std::log(shapes_of(form)[1].start), std::log(viscous)};
      if (const double rms = sought.rms_at(x.data()); rms < least) best = x, least = rms;
    }
  }
  if (best.empty()) return {loop, kUnfitted};
  nlopt::opt optimizer(nlopt::LN_SBPLX, static_cast<unsigned>(best.size()));
  optimizer.set_lower_bounds(lower);
  optimizer.set_upper_bounds(upper);
  optimizer.set_initial_step(std::vector<double>(kFirstSteps.begin(), kFirstSteps.end()));
  optimizer.set_maxeval(kMaxSimulations);
  optimizer.set_min_objective(Sought::cost, &sought);
  optimizer.set_ftol_rel(kTolerance);
  std::vector<double> x = best;
  try {
    double found = 0.0;
    optimizer.optimize(x, found);
    if (found < least) best = x;
  } catch (const std::runtime_error&) {  // its steps have become too small: the best stays
  }
  throw_if_interrupted();
  const double rms = sought.rms_at(best.data());
  return {sought.model, rms};
}

}  // namespace servotwin
