#include "cli/common/model_text.h"

#include <algorithm>
#include <cmath>

#include "cli/common/output.h"
#include "diagnosis/report/diagnosis_file.h"
#include "twin/effect.h"
#include "twin/shown_units.h"
#include "twin/two_pi.h"

namespace servotwin::cli {
namespace {

std::string with_deviation(double value, double sd, const std::string& unit) {
  std::string out = text("%.4g", value);
  if (std::isfinite(sd) && sd > 0.0) out += text(" +- %.2g", sd);
  if (unit != "1") out += " " + unit;
  return out;
}

std::string poles_line(const ModelRecord& record) {
  const Loop& loop = record.model.loop;
  const PoleSet poles = labels_of(loop).set[0];
  const PoleSet& sd = record.pole_deviation;
  std::string line;
  if (loop.order == 3) {
    line = "real " + with_deviation(poles.real / kTwoPi, sd.real / kTwoPi, "Hz") + ", ";
  }
  return line + "pair " + with_deviation(poles.omega / kTwoPi, sd.omega / kTwoPi, "Hz") +
         ", damping " + with_deviation(poles.zeta, sd.zeta, "1");
}

std::string numerator_line(const ModelRecord& record) {
  std::string line;
  for (int i = 0; i < record.model.loop.order; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const std::string unit = i == 0 ? "1" : i == 1 ? "1/s" : text("1/s^%d", i);
    line += text("%sc%d ", i == 0 ? "" : ", ", i) +
            with_deviation(record.model.loop.numerator[k], record.numerator_deviation[k], unit);
  }
  return line;
}

std::string mode_line(const ModelRecord& record, std::size_t i) {
  const Mode& mode = record.model.loop.modes[i];
  constexpr double kNone = kAbsent;
  const Mode sd = i < record.mode_deviations.size()
                      ? record.mode_deviations[i]
                      : Mode{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
  std::string moving;
  if (mode.moves()) {
    const Travel& travel = record.model.loop.travel;
    const char* unit = record.rotary ? "rad" : "m";
    moving = text(" at %g %s (%.4g Hz at %g, %.4g Hz at %g %s; slope ",
                  0.5 * (travel.from + travel.to), unit, omega_at(mode, -1.0) / kTwoPi, travel.from,
                  omega_at(mode, 1.0) / kTwoPi, travel.to, unit) +
             with_deviation(mode.slope, sd.slope, "1") + ", curve " +
             with_deviation(mode.curve, sd.curve, "1") + "; slope of the damping " +
             with_deviation(mode.zeta_slope, sd.zeta_slope, "1") + ")";
  }
  return "vibration " + with_deviation(mode.omega / kTwoPi, sd.omega / kTwoPi, "Hz") + moving +
         ", damping " + with_deviation(mode.zeta, sd.zeta, "1") + "; by the command alpha " +
         with_deviation(mode.alpha, sd.alpha, "1") + ", beta " +
         with_deviation(mode.beta, sd.beta, "1/s") + "; by friction gamma " +
         with_deviation(mode.gamma, sd.gamma, "s") + ", delta " +
         with_deviation(mode.delta, sd.delta, "1");
}

std::string effect_line(const Effect& effect, const EffectDeviations& sd, const Model& model,
                        bool rotary) {
  const Identity& identity = identity_of(effect.kind);
  if (identity.acts == Acts::kCommandDelay) {
    return text("%s %.2f", std::string(identity.id).c_str(), 1e3 * effect.shape[0]) +
           (std::isfinite(sd.shape[0]) && sd.shape[0] > 0.0 ? text(" +- %.2g", 1e3 * sd.shape[0])
                                                            : "") +
           " ms: " + std::string(identity.meaning);
  }
  std::string line(identity.id);
  const char* separator = "  ";
  const auto add = [&](const Parameter& parameter, double value, double deviation) {
    line += separator + std::string(parameter.name) + " " +
            with_deviation(value, deviation, unit_on_axis(parameter.unit, rotary));
    separator = ", ";
  };
  std::size_t k = 0;
  for (const Parameter& parameter : coefficients_of(effect.kind)) {
    // A coefficient that a free loop already contains is 0 and carries no information.
    if (parameter.with_free_loop || effect.coefficient[k] != 0.0) {
      add(parameter, effect.coefficient[k], sd.coefficient[k]);
    }
    ++k;
  }
  k = 0;
  for (const Parameter& parameter : shapes_of(effect.kind)) {
    if (means_something(effect, parameter, model)) add(parameter, effect.shape[k], sd.shape[k]);
    ++k;
  }
  return line;
}

/// "moved mass 95.1 kg", "inertia 0.2 kg m^2", or the torque per acceleration where its unit is
/// that of neither.
std::string mass_text(const MotorTorque& torque, bool rotary) {
  const double scale = std::abs(torque.by.scale);
  if (torque.unit == "N" && !rotary) return text("moved mass %.4g kg", scale);
  if (torque.unit == "Nm" && rotary) return text("inertia %.4g kg m^2", scale);
  return text("%.4g %s per %s", scale, torque.unit.c_str(), rotary ? "rad/s^2" : "m/s^2");
}

std::string torque_line(const MotorTorque& torque, bool rotary) {
  // Of the scatter, from which on it is printed: a weight, or friction of an axis that moves in one
  // direction.
  constexpr double kMinOffsetShare = 0.05;
  std::string out =
      std::isfinite(torque.holdout_rms)
          ? torque_error_text(torque.holdout_rms, torque.holdout_scatter, torque.unit) +
                " on held-out motion, from the command alone"
          : "not judged: none is recorded in the held-out motion";
  out += "; " + mass_text(torque, rotary);
  if (torque.by.scale < 0.0) out += ", counted against the motion";
  if (std::abs(torque.by.offset) > kMinOffsetShare * torque.holdout_scatter)
    out += text(", constant part %.3g %s", torque.by.offset, torque.unit.c_str());
  if (torque.at_limit_share > 0.0)
    out += text("; %.2g %% of its rows, which stand at one value, a limit, are left out",
                100.0 * torque.at_limit_share);
  if (!torque.fitted_together) out += "; fitted to the position alone";
  return out;
}

ModelRecord without_deviations(ModelRecord record) {
  record.numerator_deviation.fill(kAbsent);
  record.pole_deviation = {kAbsent, kAbsent, kAbsent};
  record.mode_deviations.clear();
  record.effect_deviations.clear();
  return record;
}

}  // namespace

bool scatter_decides(const ModelRecord& record) noexcept {
  // Noise is then a ninth of the squared residual and more.
  constexpr double kMaxRmsOverFloor = 3.0;
  return !(record.noise_floor.rms > 0.0 &&
           record.training.rms > kMaxRmsOverFloor * record.noise_floor.rms);
}

std::string structure_text(int order, const std::vector<std::size_t>& kinds, int modes,
                           bool moving) {
  std::string line = text("order %d", order);
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    line += (i == 0 ? ": " : ", ") + std::string(identity_of(kinds[i]).id);
  }
  if (modes > 0) line += text(", %d mode%s of vibration", modes, modes > 1 ? "s" : "");
  if (moving) line += modes > 1 ? " that move with position" : " that moves with position";
  return line;
}

std::string structure_text(const Model& model) {
  std::vector<std::size_t> kinds;
  for (const Effect& effect : model.effects) kinds.push_back(effect.kind);
  const auto& modes = model.loop.modes;
  return structure_text(
      model.loop.order, kinds, static_cast<int>(modes.size()),
      std::any_of(modes.begin(), modes.end(), [](const Mode& mode) { return mode.moves(); }));
}

std::string figures_text(const ErrorFigures& figures, bool rotary) {
  if (!std::isfinite(figures.rms)) return "not known";
  std::string out = text("%9.3f %s RMS %9.2f %s MAX", 1e6 * figures.rms, micro(rotary),
                         1e6 * figures.max, micro(rotary));
  if (std::isfinite(figures.motor_rms))
    out += text(", %.3f %s RMS at the motor", 1e6 * figures.motor_rms, micro(rotary));
  return out;
}

std::string torque_error_text(double rms, double scatter, const std::string& unit) {
  return text("%.3g %s RMS left of a scatter of %.3g %s (%.1f %%)", rms, unit.c_str(), scatter,
              unit.c_str(), 100.0 * rms / scatter);
}

std::string torque_range_text(const Eigen::ArrayXd& torque, const std::string& unit) {
  return text("%.4g to %.4g %s, RMS %.4g %s", torque.minCoeff(), torque.maxCoeff(), unit.c_str(),
              std::sqrt(torque.square().mean()), unit.c_str());
}

std::string noise_floor_text(const RmsEstimate& floor, bool rotary) {
  // A file may hold 0; a floor of 0 means that it could not be measured from the recording.
  if (!(std::isfinite(floor.rms) && floor.rms > 0.0)) return "not known";
  std::string out = text("%9.3f %s RMS", 1e6 * floor.rms, micro(rotary));
  if (std::isfinite(floor.low) && std::isfinite(floor.high))
    out += text(" (%.3f to %.3f)", 1e6 * floor.low, 1e6 * floor.high);
  return out;
}

std::vector<std::string> parameter_lines(const ModelRecord& whole) {
  const ModelRecord record = scatter_decides(whole) ? whole : without_deviations(whole);
  std::vector<std::string> lines;
  lines.push_back(
      "structure   " + structure_text(record.model) +
      (record.model.loop.order == 2 ? "  (no integral action)" : "  (integral action)"));
  lines.push_back("poles       " + poles_line(record));
  lines.push_back("numerator   " + numerator_line(record));
  for (std::size_t i = 0; i < record.model.loop.modes.size(); ++i)
    lines.push_back("mode        " + mode_line(record, i));
  for (std::size_t i = 0; i < record.model.effects.size(); ++i) {
    const EffectDeviations sd =
        i < record.effect_deviations.size() ? record.effect_deviations[i] : EffectDeviations{};
    lines.push_back("effect      " +
                    effect_line(record.model.effects[i], sd, record.model, record.rotary));
  }
  return lines;
}

std::vector<std::string> fit_lines(const ModelRecord& record, Times times) {
  const auto span = [&](double from_s, double to_s, const char* what) {
    return times == Times::kNone ? text("   (%s)", what)
                                 : text("   (%.2f to %.2f s, %s)", from_s, to_s, what);
  };
  std::vector<std::string> lines;
  lines.push_back("training    " + figures_text(record.training, record.rotary) +
                  span(record.from_s, record.training_to_s, "fitted"));
  lines.push_back("hold-out    " + figures_text(record.holdout, record.rotary) +
                  span(record.training_to_s, record.to_s, "not seen by the fit"));
  lines.push_back("noise floor " + noise_floor_text(record.noise_floor, record.rotary));
  if (record.torque) lines.push_back("torque      " + torque_line(*record.torque, record.rotary));
  if (std::isfinite(record.condition_number)) {
    lines.push_back(text("condition   %9.4g of the regressors (%s, s)", record.condition_number,
                         milli(record.rotary)));
  }
  return lines;
}

}  // namespace servotwin::cli
