#include "tests/virtual_machine/friction.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>

#include "tests/virtual_machine/require.h"

namespace servotwin::virtual_machine {
namespace {

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;

using Rate = std::array<double, kMaxElements>;

int sign(double v) noexcept { return (v > 0.0) - (v < 0.0); }

double force_of(const NoFriction&, double, double, const FrictionState&, Rate&) noexcept {
  return 0.0;
}

double force_of(const SaturatedCoulomb& m, double v, double, const FrictionState& s,
                Rate&) noexcept {
  return s.mode[0] == 0 ? m.coulomb * v / m.velocity_limit : s.mode[0] * m.coulomb;
}

double force_of(const StickCoulomb& m, double v, double applied, const FrictionState& s,
                Rate&) noexcept {
  return s.mode[0] == 0 ? applied : s.mode[0] * m.level.at(v);
}

double force_of(const DirectedStribeck& m, double v, double applied, const FrictionState& s,
                Rate&) noexcept {
  if (s.mode[0] == 0) return applied;
  return s.mode[0] > 0 ? m.plus.at(v) + m.viscous_plus * v : -m.minus.at(v) + m.viscous_minus * v;
}

/// `ratio`: of level and viscous friction to those of the model.
double force_of_bristles(const LuGre& m, double ratio, double v, int mode, double z,
                         double& rate) noexcept {
  rate = v - mode * v * z * m.sigma0 / (ratio * m.level.at(v));  // mode v = |v|
  return m.sigma0 * z + m.sigma1 * rate + ratio * m.sigma2 * v;
}

double force_of(const LuGre& m, double v, double, const FrictionState& s, Rate& rate) noexcept {
  return force_of_bristles(m, 1.0, v, s.mode[0], s.z[0], rate[0]);
}

double force_of(const CoveredLuGre& m, double v, double, const FrictionState& s,
                Rate& rate) noexcept {
  const double ratio = s.mode[0] < 0 ? m.closing_ratio : 1.0;
  return force_of_bristles(m.drive, 1.0, v, s.mode[0], s.z[0], rate[0]) +
         force_of_bristles(m.cover, ratio, v, s.mode[0], s.z[1], rate[1]);
}

double force_of(const Gms& m, double v, double, const FrictionState& s, Rate& rate) noexcept {
  const double level = m.level.at(v);
  double total = 0.0;
  for (std::size_t i = 0; i < m.stiffness.size(); ++i) {
    const int mode = s.mode[i];
    rate[i] =
        mode == 0 ? m.stiffness[i] * v : mode * m.attraction * (m.share[i] - mode * s.z[i] / level);
    total += s.z[i];
  }
  return total;
}

/// -1, 0 or 1: where on its curve the saturated friction is.
int branch(const SaturatedCoulomb& m, double v) noexcept {
  return std::abs(v) <= m.velocity_limit ? 0 : sign(v);
}

/// The forces that set a body at rest in motion, towards minus and plus; none for friction that
/// does not stick.
struct Breakaway {
  double minus = 0.0;
  double plus = 0.0;

  /// -1, 0 or 1: which way a body at rest goes under this force.
  [[nodiscard]] int direction(double applied) const noexcept {
    return (applied > plus) - (applied < minus);
  }
};

std::optional<Breakaway> breakaway_of(const Friction& friction) noexcept {
  if (const auto* stick = std::get_if<StickCoulomb>(&friction)) {
    return Breakaway{-stick->level.at(0.0), stick->level.at(0.0)};
  }
  if (const auto* directed = std::get_if<DirectedStribeck>(&friction)) {
    return Breakaway{-directed->minus.at(0.0), directed->plus.at(0.0)};
  }
  return std::nullopt;
}

bool has_bristles(const Friction& friction) noexcept {
  return std::holds_alternative<LuGre>(friction) || std::holds_alternative<CoveredLuGre>(friction);
}

bool slips(const Gms& m, std::size_t i, double v, const FrictionState& s, double level) noexcept {
  return v != 0.0 && s.z[i] * sign(v) >= m.share[i] * level;
}

void require_level(const Level& level, const std::string& name) {
  require_at_least_zero(level.coulomb, name + ".coulomb");
  require_at_least_zero(level.breakaway, name + ".breakaway");
  require_positive(level.stribeck_velocity, name + ".stribeck_velocity");
  require_positive(level.exponent, name + ".exponent");
}

void require_lugre(const LuGre& m, const std::string& name) {
  require_level(m.level, name);
  require_positive(std::min(m.level.coulomb, m.level.breakaway), name + ".level");
  require_positive(m.sigma0, name + ".sigma0");
  require_at_least_zero(m.sigma1, name + ".sigma1");
  require_at_least_zero(m.sigma2, name + ".sigma2");
}

}  // namespace

double Level::at(double velocity) const noexcept {
  if (breakaway == coulomb) return coulomb;
  const double r = std::abs(velocity) / stribeck_velocity;
  const double power = exponent == 1.0 ? r : exponent == 2.0 ? r * r : std::pow(r, exponent);
  return coulomb + (breakaway - coulomb) * std::exp(-power);
}

void check(const Friction& friction) {
  std::visit(Overloaded{
                 [](const NoFriction&) {},
                 [](const SaturatedCoulomb& m) {
                   require_at_least_zero(m.coulomb, "saturated_coulomb.coulomb");
                   require_positive(m.velocity_limit, "saturated_coulomb.velocity_limit");
                 },
                 [](const StickCoulomb& m) { require_level(m.level, "stick_coulomb"); },
                 [](const DirectedStribeck& m) {
                   require_level(m.plus, "directed_stribeck.plus");
                   require_level(m.minus, "directed_stribeck.minus");
                   require_at_least_zero(m.viscous_plus, "directed_stribeck.viscous_plus");
                   require_at_least_zero(m.viscous_minus, "directed_stribeck.viscous_minus");
                 },
                 [](const LuGre& m) { require_lugre(m, "lugre"); },
                 [](const CoveredLuGre& m) {
                   require_lugre(m.drive, "covered_lugre.drive");
                   require_lugre(m.cover, "covered_lugre.cover");
                   require_positive(m.closing_ratio, "covered_lugre.closing_ratio");
                 },
                 [](const Gms& m) {
                   require_level(m.level, "gms");
                   require_positive(std::min(m.level.coulomb, m.level.breakaway), "gms.level");
                   require_positive(m.attraction, "gms.attraction");
                   if (m.stiffness.empty() || m.stiffness.size() > kMaxElements ||
                       m.share.size() != m.stiffness.size()) {
                     throw std::invalid_argument(
                         "gms: " + std::to_string(m.stiffness.size()) + " stiffnesses and " +
                         std::to_string(m.share.size()) + " shares, must be as many, 1 to " +
                         std::to_string(kMaxElements));
                   }
                   for (const double k : m.stiffness) require_positive(k, "gms.stiffness");
                   for (const double a : m.share) require_positive(a, "gms.share");
                   const double sum = std::accumulate(m.share.begin(), m.share.end(), 0.0);
                   if (std::abs(sum - 1.0) > 1e-9) {
                     throw std::invalid_argument("gms.share: the sum is " + std::to_string(sum) +
                                                 ", must be 1");
                   }
                 },
             },
             friction);
}

bool sticks(const Friction& friction) noexcept { return breakaway_of(friction).has_value(); }

int state_size(const Friction& friction) noexcept {
  if (const auto* gms = std::get_if<Gms>(&friction)) return static_cast<int>(gms->stiffness.size());
  if (std::holds_alternative<CoveredLuGre>(friction)) return 2;
  return std::holds_alternative<LuGre>(friction) ? 1 : 0;
}

// std::visit throws only for a variant without a value, which no Friction is.
// NOLINTNEXTLINE(bugprone-exception-escape)
double force(const Friction& friction, double velocity, double applied, const FrictionState& state,
             Rate& rate) noexcept {
  return std::visit([&](const auto& m) { return force_of(m, velocity, applied, state, rate); },
                    friction);
}

bool mode_holds(const Friction& friction, double velocity, double applied,
                const FrictionState& state) noexcept {
  if (const auto* saturated = std::get_if<SaturatedCoulomb>(&friction)) {
    return branch(*saturated, velocity) == state.mode[0];
  }
  if (has_bristles(friction)) return velocity == 0.0 || sign(velocity) == state.mode[0];
  if (const auto breakaway = breakaway_of(friction)) {
    return state.mode[0] == 0 ? breakaway->direction(applied) == 0
                              : state.mode[0] * velocity >= 0.0;
  }
  if (const auto* gms = std::get_if<Gms>(&friction)) {
    const double level = gms->level.at(velocity);
    for (std::size_t i = 0; i < gms->stiffness.size(); ++i) {
      if (state.mode[i] == 0 ? slips(*gms, i, velocity, state, level)
                             : state.mode[i] * velocity < 0.0) {
        return false;
      }
    }
  }
  return true;
}

void switch_mode(const Friction& friction, double applied, double& velocity,
                 FrictionState& state) noexcept {
  if (const auto* saturated = std::get_if<SaturatedCoulomb>(&friction)) {
    state.mode[0] = branch(*saturated, velocity);
  }
  if (has_bristles(friction)) state.mode[0] = sign(velocity);
  if (const auto breakaway = breakaway_of(friction)) {
    velocity = 0.0;  // it stops, or breaks away from rest
    state.mode[0] = breakaway->direction(applied);
  }
  if (const auto* gms = std::get_if<Gms>(&friction)) {
    const double level = gms->level.at(velocity);
    for (std::size_t i = 0; i < gms->stiffness.size(); ++i) {
      if (state.mode[i] * velocity < 0.0) state.mode[i] = 0;
      if (state.mode[i] == 0 && slips(*gms, i, velocity, state, level))
        state.mode[i] = sign(velocity);
    }
  }
}

Gms gms_with_curve(double level, double breakaway_distance, double steepness, int elements) {
  require_positive(level, "gms.level");
  require_positive(breakaway_distance, "gms.breakaway_distance");
  require_positive(steepness - 1.0, "gms.steepness - 1");
  if (elements < 1 || elements > kMaxElements) {
    throw std::invalid_argument("gms: " + std::to_string(elements) + " elements, must be 1 to " +
                                std::to_string(kMaxElements));
  }
  // Nodes lie closer where the curve is steep; an element yields at its node and takes the bend
  // there.
  const auto node = [&](int j) {
    const double t = static_cast<double>(j) / elements;
    return t * t;
  };
  const auto curve = [&](double x) { return 1.0 - std::pow(1.0 - x, steepness); };
  const auto slope = [&](int j) {
    if (j > elements) return 0.0;
    return (curve(node(j)) - curve(node(j - 1))) / (node(j) - node(j - 1));
  };
  Gms gms;
  gms.level = {.coulomb = level, .breakaway = level};
  for (int j = 1; j <= elements; ++j) {
    const double bend = slope(j) - slope(j + 1);
    gms.stiffness.push_back(bend * level / breakaway_distance);
    gms.share.push_back(bend * node(j));
  }
  return gms;
}

}  // namespace servotwin::virtual_machine
