#include "ilc/feedforward.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "twin/hold.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

constexpr double kFirst_hz = 0.1, kRatio = 1.015;  // frequencies that are looked at
constexpr double kMostOfNyquist = 0.8;
constexpr double kLeastQ = 0.1;  // what Q lets pass where every correction is wrong

/// The model without what is not linear in the command.
Model linear_part(const Model& model) {
  Model out = model;
  const Transfer linear = transfer_of(model);
  out.loop = linear.loop;
  std::erase_if(out.effects, [](const Effect& effect) {
    return identity_of(effect.kind).acts != Acts::kCommandDelay &&
           effect.kind != kind_of<Compliance>();
  });
  return out;
}

/// Those parts of an effect that transfer_of takes into T are not forces here.
bool linear(const Effect& effect, const Parameter& coefficient) {
  return effect.kind == kind_of<FeedforwardMismatch>() || effect.kind == kind_of<Compliance>() ||
         (!coefficient.with_free_loop && coefficient.name == kViscous.name);
}

}  // namespace

CommandedEffects commanded_effects(const Model& model, const Segment& segment) {
  const Eigen::Index n = segment.size();
  const double h = segment.sample_time_s;
  const Spline motion = Spline::through(segment.command, h);
  const Eigen::ArrayXd neighbour = segment.neighbour.size() == n
                                       ? Spline::through(segment.neighbour, h).second
                                       : Eigen::ArrayXd();
  CommandedEffects out{Eigen::ArrayXd::Zero(n), Eigen::ArrayXd::Zero(n)};
  for (const Effect& effect : model.effects) {
    const Acts acts = identity_of(effect.kind).acts;
    if (acts == Acts::kCommandDelay) continue;
    EffectMemory<double> memory;
    start_memory<double>(effect.kind, effect.shape.data(), memory);
    Eigen::ArrayXd& sum = acts == Acts::kForce ? out.force : out.reading;
    std::array<double, kMaxCoefficients> unit{};
    for (Eigen::Index k = 0; k < n; ++k) {
      Motion m;
      m.step_s = h;
      m.position = segment.command(k);
      m.velocity = motion.first(k);
      m.displacement = k > 0 ? segment.command(k) - segment.command(k - 1) : 0.0;
      m.command_velocity = motion.first(k);
      m.command_acceleration = m.demand = motion.second(k);
      m.time_s = segment.start_s + h * static_cast<double>(k);
      if (neighbour.size() > 0) m.neighbour_acceleration = neighbour(k);
      if (segment.in_cut.size() > 0) m.in_cut = segment.in_cut(k);
      unit_forces<double>(effect.kind, effect.shape.data(), memory, m, unit.data());
      std::size_t c = 0;
      for (const Parameter& p : coefficients_of(effect.kind)) {
        if (!linear(effect, p)) sum(k) += effect.coefficient[c] * unit[c];
        ++c;
      }
    }
  }
  return out;
}

double harmless_bandwidth(LearningLaw law, std::span<const Transfer> models, double h) {
  // Q moves L T_i towards 0 along a straight line: it is harmless while L T_i is within the circle
  // about 1, or Q keeps it so: |1 - q z|^2 <= 1 where q |z|^2 <= 2 Re z.
  law.bandwidth_hz = std::numeric_limits<double>::infinity();
  const double nyquist_hz = 0.5 / h;
  double most = kMostOfNyquist * nyquist_hz;
  for (double f = kFirst_hz; f < nyquist_hz; f *= kRatio) {
    const double omega = 2.0 * std::numbers::pi * f;
    const std::complex<double> l = law.l(omega);
    for (const Transfer& t : models) {
      const std::complex<double> z = l * t.at(omega);
      const double q = 2.0 * z.real() / std::norm(z);
      if (q >= 1.0) continue;
      // 1 / (1 + (f/f_c)^4) = q; where nothing is harmless, a tenth of an error is let be.
      most = std::min(most, f / std::pow(1.0 / std::max(q, kLeastQ) - 1.0, 0.25));
    }
  }
  return most;
}

Eigen::ArrayXd feedforward(const Model& model, const LearningLaw& law, const Segment& segment,
                           ZeroPhase& filter) {
  const Eigen::ArrayXcd learned =
      law.l(filter.omega()) * law.q(filter.omega()).cast<std::complex<double>>();
  const Transfer transfer = transfer_of(model);
  const Eigen::ArrayXcd disturbed =
      learned * filter.omega().unaryExpr([&](double w) { return transfer.compliance_at(w); });
  Segment commanded = segment;
  commanded.actual.resize(0);
  const CommandedEffects effects = commanded_effects(model, segment);
  return filter.filtered(simulate(linear_part(model), commanded) - effects.reading, learned) +
         filter.filtered(effects.force, disturbed);
}

}  // namespace servotwin
