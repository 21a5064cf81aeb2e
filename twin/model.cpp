#include "twin/model.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

template <class... Parts>
std::string say(const Parts&... parts) {
  std::ostringstream out;
  out.precision(9);
  (out << ... << parts);
  return out.str();
}

// Beyond every drive, and well within what the discretisation calculates with: a number outside is
// damage or a slip of the keyboard.
constexpr double kMinSampleTime_s = 1e-6;
constexpr double kMaxSampleTime_s = 1.0;
constexpr double kMinRate_rad_s = 1e-6;  // of a pole or a mode
constexpr double kMaxRate_rad_s = 1e9;
constexpr double kMaxModeNumerator = 1e30;  // of any of its units

bool within(double value, double lower, double upper) { return lower <= value && value <= upper; }

std::string outside(std::string_view effect, const Parameter& given, double value,
                    double length_scale) {
  const Parameter parameter = stretched(given, length_scale);
  if (std::isfinite(value) && value >= parameter.lower && value <= parameter.upper) return {};
  // Its unit is that of the model file: a model does not tell whether it is rotary.
  return say(parameter.name, " of ", effect, " = ", value, " is outside ", parameter.lower, " .. ",
             parameter.upper);
}

}  // namespace

std::string why_invalid(const Model& model) { return why_invalid(model, kLargestLengthScale); }

std::string why_invalid(const Model& model, double length_scale) {
  if (!(model.sample_time_s > 0.0))
    return say("sample_time_s = ", model.sample_time_s, " must be positive");
  if (!within(model.sample_time_s, kMinSampleTime_s, kMaxSampleTime_s))
    return say("sample_time_s = ", model.sample_time_s, " s is outside ", kMinSampleTime_s, " .. ",
               kMaxSampleTime_s);
  const Loop& loop = model.loop;
  if (loop.order != 2 && loop.order != 3)
    return say("loop.order = ", loop.order, " must be 2 or 3");
  for (int i = 0; i < loop.order; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (!std::isfinite(loop.denominator[k])) return say("loop.denominator[", i, "] is not finite");
    if (!std::isfinite(loop.numerator[k]))
      return say("loop.tracking_error_numerator[", i, "] is not finite");
    const double most = std::pow(kMaxRate_rad_s, i + 1);
    if (std::abs(loop.denominator[k]) > most)
      return say("loop.denominator[", i, "] = ", loop.denominator[k], " is more than ", most);
    if (std::abs(loop.numerator[k]) > most)
      return say("loop.tracking_error_numerator[", i, "] = ", loop.numerator[k], " is outside +-",
                 most);
  }
  if (!stable(loop))
    return "loop.denominator: the loop is unstable (a pole is not left of the imaginary axis)";
  const double product = loop.denominator[static_cast<std::size_t>(loop.order) - 1];
  if (const double least = std::pow(kMinRate_rad_s, loop.order); product < least)
    return say("loop.denominator[", loop.order - 1, "] = ", product, " is less than ", least);
  if (loop.modes.size() > kMaxModes)
    return say("loop.modes: ", loop.modes.size(), " are more than ", kMaxModes);
  for (std::size_t i = 0; i < loop.modes.size(); ++i) {
    const Mode& mode = loop.modes[i];
    if (!(mode.omega > 0.0 && std::isfinite(mode.omega)))
      return say("loop.modes[", i, "].natural_frequency = ", mode.omega, " rad/s must be positive");
    if (!within(mode.omega, kMinRate_rad_s, kMaxRate_rad_s))
      return say("loop.modes[", i, "].natural_frequency = ", mode.omega, " rad/s is outside ",
                 kMinRate_rad_s, " .. ", kMaxRate_rad_s);
    if (!(mode.zeta > 0.0 && mode.zeta < 1.0))
      return say("loop.modes[", i, "].damping_ratio = ", mode.zeta, " must lie between 0 and 1");
    for (const double value : {mode.alpha, mode.beta, mode.gamma, mode.delta}) {
      if (!std::isfinite(value)) return say("loop.modes[", i, "]: a numerator is not finite");
      if (std::abs(value) > kMaxModeNumerator)
        return say("loop.modes[", i, "]: the numerator ", value, " is outside +-",
                   kMaxModeNumerator);
    }
    for (const double value : {mode.slope, mode.curve, mode.zeta_slope}) {
      if (!(std::abs(value) <= kMaxModeTravel))
        return say("loop.modes[", i, "]: log_frequency_slope = ", mode.slope,
                   ", log_frequency_curve = ", mode.curve,
                   " and log_damping_slope = ", mode.zeta_slope, " must lie within +-",
                   kMaxModeTravel);
    }
    if (mode.moves() && !(loop.travel.to > loop.travel.from))
      return say("loop.modes[", i, "] moves with position, but loop.travel goes from ",
                 loop.travel.from, " to ", loop.travel.to, ": its end must lie beyond its start");
  }
  if (model.effects.size() > static_cast<std::size_t>(kMaxEffects)) {
    return say("effects: ", model.effects.size(), " are more than ", kMaxEffects);
  }
  for (const Effect& effect : model.effects) {
    if (effect.kind >= kEffectKinds)
      return say("effects: kind ", effect.kind, " is not in the catalogue");
    const auto id = identity_of(effect.kind).id;
    std::size_t i = 0;
    for (const Parameter& shape : shapes_of(effect.kind)) {
      if (auto why = outside(id, shape, effect.shape[i++], length_scale); !why.empty()) return why;
    }
    i = 0;
    for (const Parameter& coefficient : coefficients_of(effect.kind)) {
      if (auto why = outside(id, coefficient, effect.coefficient[i++], length_scale); !why.empty())
        return why;
    }
  }
  if (std::count_if(model.effects.begin(), model.effects.end(),
                    [](const Effect& effect) { return couples(effect.kind); }) > 1)
    return "effects: more than one of cross_coupling and cross_coupling_by_motion: one other axis "
           "acts on an axis";
  const Effect* axis = two_mass_of(model);
  if (axis != nullptr) {
    const auto id = identity_of(axis->kind).id;
    for (const Effect& effect : model.effects) {
      if (acts_on_axis(effect.kind) && &effect != axis)
        return say("effects: ", identity_of(effect.kind).id, " beside ", id,
                   ": an axis has one of them");
    }
    if (std::count_if(model.effects.begin(), model.effects.end(), [](const Effect& effect) {
          return is_friction(effect.kind);
        }) > static_cast<std::ptrdiff_t>(kMaxFrictions))
      return say("effects: more than ", kMaxFrictions, " of friction beside ", id,
                 ", which acts on two masses");
    if (!loop.modes.empty())
      return say("loop.modes: ", loop.modes.size(), " beside ", id,
                 ": the two masses are the mode; the loop must be the rigid axis'");
    if (!stable(loop, two_mass_parameters(*axis)))
      return say(id, ": the loop is unstable with this spring");
  }
  // A thousandth of a cycle for the rounding of the quotient.
  const double cycles = model.command_delay_s() / model.sample_time_s;
  if (cycles > kMaxDelayCycles + 1e-3) {
    return say("delay_s of time_delay = ", model.command_delay_s(), " s is ", cycles,
               " cycles of sample_time_s = ", model.sample_time_s, " s, more than ",
               kMaxDelayCycles, "; take a sample time of at least ",
               model.command_delay_s() / kMaxDelayCycles, " s");
  }
  return {};
}

}  // namespace servotwin
