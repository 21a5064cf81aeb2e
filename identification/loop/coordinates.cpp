#include "identification/loop/coordinates.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "identification/least_squares/chart.h"

namespace servotwin {

namespace {

// alpha, beta, log omega, log zeta, gamma, delta
constexpr int kModeCoordinates = 6;
constexpr double kMaxDampingOfMode = 0.95;

using ErrorCoefficients = std::array<double, kMaxOrder>;

/// Of s^power in s^n + a1 s^(n-1) + .. + an, power < n.
double of_power(int order, const Loop& loop, int power) {
  return loop.denominator[static_cast<std::size_t>(order - 1 - power)];
}

/// The numerator of a loop with this denominator and these error coefficients: it is their series
/// times the denominator, up to s^(n-1), in which the leading 1 has no part.
void set_numerator(int order, const ErrorCoefficients& k, Loop& loop) {
  for (int m = 0; m < order; ++m) {
    double sum = 0.0;
    for (int j = 0; j <= m; ++j)
      sum += k[static_cast<std::size_t>(j)] * of_power(order, loop, m - j);
    loop.numerator[static_cast<std::size_t>(order - 1 - m)] = sum;
  }
}

ErrorCoefficients error_coefficients(int order, const Loop& loop) {
  ErrorCoefficients k{};
  for (int m = 0; m < order; ++m) {
    double left = loop.numerator[static_cast<std::size_t>(order - 1 - m)];
    for (int j = 0; j < m; ++j)
      left -= k[static_cast<std::size_t>(j)] * of_power(order, loop, m - j);
    k[static_cast<std::size_t>(m)] = left / of_power(order, loop, 0);
  }
  return k;
}

}  // namespace

Coordinates::Coordinates(const Structure& structure, const Model& start, double length_scale,
                         Held held)
    : structure_(structure),
      template_(start),
      length_scale_(length_scale),
      held_(std::move(held)),
      axes_(shape_axes(structure.effects, length_scale)) {
  for (std::size_t i = 0; i < structure.effects.size(); ++i) {
    // A limit takes away all of the torque beyond it. Left free, the share would trade with the
    // limit and the viscous friction, and the model would be wrong in larger moves.
    if (limits_motor(structure.effects[i])) {
      template_.effects[i].coefficient[0] = 1.0;
      continue;
    }
    const auto coefficients = coefficients_of(structure.effects[i]);
    for (std::size_t c = 0; c < coefficients.size(); ++c) {
      if (told_from_loop(coefficients[c], structure.order) || structure.every_coefficient)
        slots_.push_back({i, c});
    }
  }
  numerators_ = structure.order - (structure.matched_feedforward ? 1 : 0);
}

Eigen::VectorXd Coordinates::of(const Model& model) const {
  std::vector<double> x;
  const ErrorCoefficients k = error_coefficients(structure_.order, model.loop);
  for (int i = 0; i < numerators_; ++i) x.push_back(k[place_of(i)]);
  for (const Slot& slot : slots_)
    x.push_back(model.effects[slot.effect].coefficient[slot.coefficient] / unit_of(slot, model));
  for (double q : chart_of(Chart::kStable, structure_.order, model.loop.denominator, {}))
    x.push_back(q);
  std::size_t axis = 0;
  for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
    for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p)
      x.push_back(axes_[axis++].coordinate(model.effects[i].shape[p]));
  }
  for (const Mode& m : model.loop.modes)
    x.insert(x.end(), {m.alpha, m.beta, std::log(m.omega), std::log(m.zeta), m.gamma, m.delta});
  if (structure_.moving) {
    for (const Mode& m : model.loop.modes) x.insert(x.end(), {m.slope, m.curve, m.zeta_slope});
  }
  return Eigen::Map<Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size()));
}

Model Coordinates::model(const double* x) const {
  Model out = template_;
  const double* poles = x + numerators_ + slots_.size();
  if (!held_.drive) {
    out.loop.denominator = denominator_at(Chart::kStable, structure_.order, poles);
    set_numerator(structure_.order, coefficients_at(x), out.loop);
  }
  x += numerators_;
  for (const Slot& slot : slots_) {
    const double value = *x++ * unit_of(slot, out);
    const Parameter p = parameter_of(slot);
    if (!holds(slot.effect))
      out.effects[slot.effect].coefficient[slot.coefficient] = std::clamp(value, p.lower, p.upper);
  }
  x = poles + structure_.order;
  std::size_t axis = 0;
  for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
    for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p, ++axis, ++x)
      if (!holds(i, p)) out.effects[i].shape[p] = axes_[axis].value(*x);
  }
  if (held_.drive) return out;
  for (Mode& m : out.loop.modes) {
    m = {std::exp(x[2]), std::exp(x[3]), x[0], x[1], x[4], x[5], m.slope, m.curve, m.zeta_slope};
    x += kModeCoordinates;
  }
  for (Mode& m : out.loop.modes) {
    if (!structure_.moving) break;
    m.slope = *x++;
    m.curve = *x++;
    m.zeta_slope = *x++;
  }
  return out;
}

Parameter Coordinates::parameter_of(const Slot& slot) const {
  return stretched(coefficients_of(structure_.effects[slot.effect])[slot.coefficient],
                   length_scale_);
}

bool Coordinates::is_relative(const Slot& slot) const {
  return parameter_of(slot).unit == "m/s^2" && !holds(slot.effect);
}

double Coordinates::unit_of(const Slot& slot, const Model& model) const {
  return is_relative(slot) ? model.loop.denominator[static_cast<std::size_t>(structure_.order - 1)]
                           : 1.0;
}

std::array<double, kMaxOrder> Coordinates::coefficients_at(const double* x) const {
  ErrorCoefficients out{};
  for (int i = 0; i < numerators_; ++i) out[place_of(i)] = x[i];
  return out;
}

std::pair<double, double> Coordinates::bounds(Eigen::Index i) const {
  const auto k = static_cast<std::size_t>(i) - static_cast<std::size_t>(numerators_);
  if (i < numerators_) return {-1e300, 1e300};
  if (k < slots_.size()) {
    const Parameter p = parameter_of(slots_[k]);
    const double unit = unit_of(slots_[k], template_);
    return {p.lower / unit, p.upper / unit};
  }
  const auto shape = k - slots_.size();
  if (shape < static_cast<std::size_t>(structure_.order)) return {-1e300, 1e300};
  const std::size_t at = shape - static_cast<std::size_t>(structure_.order);
  if (at < axes_.size()) return {axes_[at].lower, axes_[at].upper};
  const auto of_modes = at - axes_.size();
  if (of_modes >=
      static_cast<std::size_t>(kModeCoordinates) * static_cast<std::size_t>(structure_.modes))
    return {-kMaxModeTravel, kMaxModeTravel};
  if (of_modes % kModeCoordinates == 3) return {-1e300, std::log(kMaxDampingOfMode)};
  return {-1e300, 1e300};
}

bool Coordinates::holds(std::size_t effect) const {
  return std::find(held_.effects.begin(), held_.effects.end(), effect) != held_.effects.end();
}

bool Coordinates::holds(std::size_t effect, std::size_t shape) const {
  return holds(effect) || (held_.drive && acts_on_axis(structure_.effects[effect]) &&
                           shape != TwoMassLoadEncoder::kFrictionShareAt);
}

std::vector<std::size_t> Coordinates::free() const {
  std::vector<bool> free(static_cast<std::size_t>(numerators_), !held_.drive);
  for (const Slot& slot : slots_) free.push_back(!holds(slot.effect));
  free.resize(free.size() + static_cast<std::size_t>(structure_.order), !held_.drive);
  for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
    for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p)
      free.push_back(!holds(i, p));
  }
  free.resize(static_cast<std::size_t>(of(template_).size()), !held_.drive);
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < free.size(); ++i) {
    if (free[i]) out.push_back(i);
  }
  return out;
}

std::vector<Model> Coordinates::directions(const double* x) const {
  std::vector<Model> out;
  const auto along = [&](const auto& set) {
    out.push_back(empty_like<double>(template_));
    set(out.back());
  };
  const Model here = model(x);
  const ErrorCoefficients k = coefficients_at(x);
  for (int i = 0; i < numerators_; ++i) {
    along([&](Model& d) {
      ErrorCoefficients one{};
      one[place_of(i)] = 1.0;
      d.loop.denominator = here.loop.denominator;
      set_numerator(structure_.order, one, d.loop);
      d.loop.denominator = {};
    });
  }
  x += numerators_;
  for (const Slot& slot : slots_) {
    along([&](Model& d) {
      d.effects[slot.effect].coefficient[slot.coefficient] = unit_of(slot, here);
    });
  }
  const double* of_slots = x;
  x += slots_.size();
  const Eigen::Matrix3d by_chart = chart_jacobian(Chart::kStable, structure_.order, x);
  for (int j = 0; j < structure_.order; ++j) {
    along([&](Model& d) {
      for (int i = 0; i < structure_.order; ++i)
        d.loop.denominator[static_cast<std::size_t>(i)] = by_chart(i, j);
      // What the gains do to the numerator and the forces at constant errors.
      set_numerator(structure_.order, k, d.loop);
      for (std::size_t i = 0; i < slots_.size(); ++i) {
        const Slot& slot = slots_[i];
        if (is_relative(slot))
          d.effects[slot.effect].coefficient[slot.coefficient] = of_slots[i] * unit_of(slot, d);
      }
    });
  }
  x += structure_.order;
  std::size_t axis = 0;
  for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
    for (std::size_t p = 0; p < shapes_of(structure_.effects[i]).size(); ++p, ++axis, ++x) {
      const double slope = axes_[axis].logarithmic ? axes_[axis].value(*x) : 1.0;
      along([&](Model& d) { d.effects[i].shape[p] = slope; });
    }
  }
  for (std::size_t m = 0; m < template_.loop.modes.size(); ++m, x += kModeCoordinates) {
    along([&](Model& d) { d.loop.modes[m].alpha = 1.0; });
    along([&](Model& d) { d.loop.modes[m].beta = 1.0; });
    along([&](Model& d) { d.loop.modes[m].omega = std::exp(x[2]); });
    along([&](Model& d) { d.loop.modes[m].zeta = std::exp(x[3]); });
    along([&](Model& d) { d.loop.modes[m].gamma = 1.0; });
    along([&](Model& d) { d.loop.modes[m].delta = 1.0; });
  }
  for (std::size_t m = 0; structure_.moving && m < template_.loop.modes.size(); ++m) {
    along([&](Model& d) { d.loop.modes[m].slope = 1.0; });
    along([&](Model& d) { d.loop.modes[m].curve = 1.0; });
    along([&](Model& d) { d.loop.modes[m].zeta_slope = 1.0; });
  }
  return out;
}

Eigen::MatrixXd Coordinates::parameters_by_coordinates(const Eigen::VectorXd& x) const {
  std::vector<double> all;
  const std::vector<Model> along = directions(x.data());
  for (const Model& d : along) {
    const auto order = static_cast<std::size_t>(structure_.order);
    all.insert(all.end(), d.loop.numerator.begin(), d.loop.numerator.begin() + structure_.order);
    for (const Slot& slot : slots_)
      all.push_back(d.effects[slot.effect].coefficient[slot.coefficient]);
    for (const Mode& m : d.loop.modes) all.insert(all.end(), {m.alpha, m.beta});
    for (std::size_t i = 0; i < order; ++i) all.push_back(d.loop.denominator[i]);
    for (const Effect& effect : d.effects) {
      for (std::size_t p = 0; p < shapes_of(effect.kind).size(); ++p)
        all.push_back(effect.shape[p]);
    }
    for (const Mode& m : d.loop.modes) all.insert(all.end(), {m.omega, m.zeta, m.gamma, m.delta});
    for (const Mode& m : d.loop.modes) {
      if (structure_.moving) all.insert(all.end(), {m.slope, m.curve, m.zeta_slope});
    }
  }
  const auto columns = static_cast<Eigen::Index>(along.size());
  return Eigen::Map<Eigen::MatrixXd>(all.data(), static_cast<Eigen::Index>(all.size()) / columns,
                                     columns);
}

}  // namespace servotwin
