// A model as text for people: frequencies in Hz, standard deviations beside the values, errors in
// um.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/statistics/text.h"
#include "identification/model/model_file.h"

namespace servotwin::cli {

/// "order 2: coulomb_friction, gravity_offset".
[[nodiscard]] std::string structure_text(int order, const std::vector<std::size_t>& kinds,
                                         int modes = 0, bool moving = false);
[[nodiscard]] std::string structure_text(const Model& model);

/// Whether the scatter of the noise is most of what the values are uncertain by. Otherwise effects
/// that the model does not have shift them further than any standard deviation says.
[[nodiscard]] bool scatter_decides(const ModelRecord& record) noexcept;

/// Poles, numerator and effects, one line each; with standard deviations where scatter_decides().
[[nodiscard]] std::vector<std::string> parameter_lines(const ModelRecord& record);
/// Errors on training and held-out data, noise floor and condition number, one line each.
/// kNone for a live model: its times are those of the daemon.
enum class Times { kOfRecording, kNone };
[[nodiscard]] std::vector<std::string> fit_lines(const ModelRecord& record, Times times);

/// "1.532 um RMS  9.87 um MAX".
[[nodiscard]] std::string figures_text(const ErrorFigures& figures, bool rotary);
/// "2.31 N RMS left of a scatter of 45.2 N (5 %)".
[[nodiscard]] std::string torque_error_text(double rms, double scatter, const std::string& unit);
/// "-40.9 to 6.9 Nm, RMS 23.1 Nm".
[[nodiscard]] std::string torque_range_text(const Eigen::ArrayXd& torque, const std::string& unit);
/// "0.029 um RMS (0.028 to 0.031)", or "not known".
[[nodiscard]] std::string noise_floor_text(const RmsEstimate& floor, bool rotary);

}  // namespace servotwin::cli
