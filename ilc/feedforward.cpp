#include "ilc/feedforward.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "ilc/transfer.h"
#include "twin/hold.h"
#include "twin/neighbour.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

/// Those parts of an effect that transfer_of takes into T are not forces here.
bool in_transfer(const Effect& effect, const Parameter& coefficient) {
  return effect.kind == kind_of<FeedforwardMismatch>() ||
         (adds_poles(effect.kind) &&
          (coefficient.name == "spring" || coefficient.name == "damper")) ||
         (!coefficient.with_free_loop && coefficient.name == kViscous.name);
}

/// The model without the effects that are not linear in the command.
Model linear_part(const Model& model) {
  Model out = model;
  const Transfer linear = transfer_of(model);
  out.loop = linear.loop;
  std::erase_if(out.effects, [&](const Effect& effect) {
    return identity_of(effect.kind).acts != Acts::kCommandDelay && !adds_poles(effect.kind) &&
           !acts_on_axis(effect.kind) && !(linear.two_masses && is_friction_law(effect.kind));
  });
  for (Effect& effect : out.effects) {
    if (acts_on_axis(effect.kind)) effect = without_play(effect);
    if (!is_friction_law(effect.kind) && !adds_poles(effect.kind)) continue;
    std::size_t k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      if (!in_transfer(effect, p)) effect.coefficient[k] = 0.0;
      ++k;
    }
  }
  return out;
}

}  // namespace

CommandedEffects commanded_effects(const Model& model, const Segment& segment) {
  const Eigen::Index n = segment.size();
  const double h = segment.sample_time_s;
  const Spline motion = Spline::through(segment.command, h);
  const Eigen::ArrayXd neighbour = neighbour_acceleration(segment, false),
                       neighbour_motion = neighbour_acceleration(segment, true);
  CommandedEffects out{Eigen::ArrayXd::Zero(n), Eigen::ArrayXd::Zero(n), Eigen::ArrayXd::Zero(n)};
  const Effect* two_mass = two_mass_of(model);
  const double friction_share =
      two_mass != nullptr ? two_mass_parameters(*two_mass).friction_share : 0.0;
  // Effects that change friction come after the friction law.
  std::vector<Effect> effects = model.effects;
  std::stable_partition(effects.begin(), effects.end(),
                        [](const Effect& e) { return is_friction_law(e.kind); });
  Eigen::ArrayXd friction = Eigen::ArrayXd::Constant(n, kNoLaw);
  for (const Effect& effect : effects) {
    const Acts acts = identity_of(effect.kind).acts;
    if (!acts_along_motion(acts)) continue;
    EffectMemory<double> memory;
    start_memory<double>(effect.kind, effect.shape.data(), memory);
    double load_share = 0.0;
    if (acts == Acts::kForce && two_mass != nullptr && acts_on(effect.kind) != ActsOn::kMotor)
      load_share = acts_on(effect.kind) == ActsOn::kBoth ? friction_share : 1.0;
    Eigen::ArrayXd& sum = acts == Acts::kForce ? out.force : out.reading;
    std::array<double, kMaxCoefficients> unit{};
    for (Eigen::Index k = 0; k < n; ++k) {
      Motion m;
      m.step_s = h;
      m.position = segment.command(k);
      m.velocity = motion.first(k);
      m.displacement = k > 0 ? segment.command(k) - segment.command(k - 1) : 0.0;
      m.command_velocity = motion.first(k);
      m.command_acceleration = m.acceleration = m.demand = motion.second(k);
      m.time_s = segment.start_s + h * static_cast<double>(k);
      if (neighbour.size() > 0) m.neighbour_acceleration = neighbour(k);
      if (neighbour_motion.size() > 0) m.neighbour_motion_acceleration = neighbour_motion(k);
      if (segment.in_cut.size() > 0) m.in_cut = segment.in_cut(k);
      m.friction = friction(k);
      unit_forces<double>(effect.kind, effect.shape.data(), memory, m, unit.data());
      if (is_friction_law(effect.kind)) friction(k) = friction_of(effect, unit.data());
      std::size_t c = 0;
      for (const Parameter& p : coefficients_of(effect.kind)) {
        if (!in_transfer(effect, p)) {
          const double part = effect.coefficient[c] * unit[c];
          sum(k) += (1.0 - load_share) * part;
          out.load_force(k) += load_share * part;
        }
        ++c;
      }
    }
  }
  return out;
}

double harmless_bandwidth(LearningLaw law, std::span<const Transfer> models, double h) {
  // With z = L T_i: |1 - q z|^2 <= b^2 for q from 0 to where it is b^2, and q falls with f/f_c.
  constexpr double kMaxGrowthOfSquaredError =
      kMaxErrorRatioAtAnyFrequency * kMaxErrorRatioAtAnyFrequency - 1.0;
  law.bandwidth_hz = std::numeric_limits<double>::infinity();
  double most = kMaxBandwidthOfNyquist * 0.5 / h;
  for (const double f : frequencies_hz(h)) {
    const double omega = 2.0 * std::numbers::pi * f;
    const std::complex<double> l = law.l(omega);
    for (const Transfer& t : models) {
      const std::complex<double> z = l * t.at(omega);
      const double square = std::norm(z);
      const double q =
          (z.real() + std::sqrt(z.real() * z.real() + kMaxGrowthOfSquaredError * square)) / square;
      if (q < 1.0) most = std::min(most, f / std::pow(1.0 / q - 1.0, 0.25));
    }
  }
  return most;
}

ContractionCurve left_by_feedforward(const LearningLaw& law, std::span<const Transfer> models,
                                     double h) {
  ContractionCurve out;
  out.frequency_hz = frequencies_hz(h);
  const Eigen::ArrayXd omega = 2.0 * std::numbers::pi * out.frequency_hz;
  const Eigen::ArrayXcd applied = law.q(omega).cast<std::complex<double>>() * law.l(omega);
  const auto left = [&](const Transfer& t) -> Eigen::ArrayXd {
    return (1.0 - applied * omega.unaryExpr([&](double w) { return t.at(w); })).abs();
  };
  out.of_model = left(law.model);
  out.worst = out.of_model;
  for (const Transfer& t : models) out.worst = out.worst.max(left(t));
  return out;
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
  Eigen::ArrayXd out =
      filter.filtered(simulate(linear_part(model), commanded) - effects.reading, learned) +
      filter.filtered(effects.force, disturbed);
  if (!transfer.two_masses) return out;
  const Eigen::ArrayXcd by_load =
      learned * filter.omega().unaryExpr([&](double w) { return transfer.load_compliance_at(w); });
  return out + filter.filtered(effects.load_force, by_load);
}

}  // namespace servotwin
