// The model file, `servotwin.model/1` (JSON; docs/files.md). Reads back to the same predictions,
// bit for bit.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "identification/model/motor_torque.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/noise_floor.h"
#include "twin/loop_covariance.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// Measured minus predicted tracking error [m | rad].
struct ErrorFigures {
  double rms = kAbsent;
  double max = kAbsent;
  /// The RMS of the same at the motor, about its mean: of two masses whose motor has an encoder of
  /// its own.
  double motor_rms = kAbsent;
};

/// Standard deviations of an effect's parameters, in the order of the effect; NaN where not
/// estimated.
struct EffectDeviations {
  std::array<double, kMaxShapes> shape{};
  std::array<double, kMaxCoefficients> coefficient{};
};

/// A model of one axis with where it comes from and how well it predicts.
struct ModelRecord {
  std::string axis;
  bool rotary = false;
  int version = 0;      ///< counted by the store; 0 outside of one
  int parent = 0;       ///< version it replaced; 0 for none
  std::string created;  ///< ISO 8601, UTC
  Model model;
  std::array<double, kMaxOrder> denominator_deviation{};  ///< standard deviations
  std::array<double, kMaxOrder> numerator_deviation{};
  PoleSet pole_deviation;                           ///< of the first label of the poles
  std::vector<Mode> mode_deviations;                ///< one per mode
  std::vector<EffectDeviations> effect_deviations;  ///< one per effect
  std::optional<LoopCovariance> loop_covariance;    ///< nothing where not estimated
  std::optional<MotorTorque> torque;                ///< nothing where it was not recorded

  std::string method;              ///< pole-search | full-ls | joint | diagnosis
  ErrorFigures training, holdout;  ///< free simulation; holdout on data the fit has not seen
  RmsEstimate noise_floor;
  double condition_number = kAbsent;  ///< of the regressors in mm and s, as the thesis prints it
  double time_taken_s = kAbsent;

  std::string neighbour;  ///< the axis whose acceleration acts on this one; empty: none, or the
                          ///< other axis of the recording
  std::string source;     ///< recording
  double from_s = 0.0, to_s = 0.0, training_to_s = 0.0;
  long rows = 0;
  MotionRange motion;  ///< all of it, the hold-out too; NaN in files from before it was kept
  std::vector<std::string>
      excitation;  ///< what is not excited and what motion would excite it; empty: all is
};

/// Whether the acceleration of the axis of this name acts on the axis of the model.
[[nodiscard]] inline bool pushed_by(const ModelRecord& record, const std::string& axis) {
  return coupling_of(record.model) != nullptr &&
         (record.neighbour.empty() || record.neighbour == axis);
}

inline constexpr std::string_view kModelSchema = "servotwin.model/1";

[[nodiscard]] nlohmann::json to_json(const ModelRecord& record);
/// Throws std::runtime_error naming the field, the value and the rule.
[[nodiscard]] ModelRecord model_from_json(const nlohmann::json& json);

/// Throws std::runtime_error: file, and field or position.
[[nodiscard]] ModelRecord read_model(const std::filesystem::path& path);

}  // namespace servotwin
