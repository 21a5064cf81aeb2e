// What the rigid body does not explain of a measured torque, force or current, and why
// (docs/theory.md 10.1). Works without a command: a test rig that is driven by its displacement.
//
//   T = m a + F_c sat(v / v_l) + B v + sum_i c_i f_i(motion; shapes_i)
//
// The baseline is the rigid body with Coulomb and viscous friction. Effects of the catalogue that
// act on the body are added one by one while they earn their place on blocks of time that their
// coefficients were not fitted to (blocked_regression.h), Bonferroni over the candidates. Play is
// sought by its plateau after reversals (plateau.h). The hold-out decides nothing; gains are
// measured on it. Rows at rest are left out: static friction may be anything there.
//
// Units: the torque in its recorded unit, with its recorded sign; m or rad, s. Any thread.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/diagnose.h"
#include "diagnosis/plateau.h"
#include "identification/recording/segments.h"

namespace servotwin {

struct TorqueEvidence {
  std::string test;
  double statistic = 0.0, p = kAbsent;
};

/// One line of what is periodic in position, in the torque and in the tracking error.
struct Harmonic {
  double period = 0.0;              ///< [m | rad]
  double amplitude = 0.0;           ///< of the torque
  double tracking_error = kAbsent;  ///< amplitude that the loop lets through [m | rad]
};

struct TorqueCause {
  std::string id;                                          ///< of the contract
  std::vector<std::pair<std::string, double>> parameters;  ///< keys of the contract
  std::vector<Harmonic> harmonics;                         ///< of cogging
  std::vector<TorqueEvidence> evidence;
  double confidence = 0.0;
  std::vector<std::string> ambiguous_with;
  Gain gain;  ///< on the hold-out, in the unit of the torque
};

struct TorqueDiagnosis {
  std::string axis, unit;
  bool rotary = false;
  bool commanded = true;  ///< false: there was no command
  /// The record counts the torque against the position: a positive one drives backwards.
  bool opposite = false;
  double mass = 0.0, coulomb = 0.0, viscous = 0.0;  ///< of the baseline
  double training_to_s = 0.0;
  double baseline_rms = kAbsent, extended_rms = kAbsent;  ///< on the hold-out
  std::vector<TorqueCause> causes;
  std::vector<TorqueCause> suspected;  ///< below kNamed and without a rival: no answer
  Plateau plateau;
  std::vector<std::string> steps;  ///< what was tried, for people
  /// The hold-out: time [s], position, torque, and what the two models leave of it.
  Eigen::VectorXd time, position, torque, left_before, left_after;
};

/// Where this axis has position and torque and no command, its position takes the place of the
/// command; true if so.
[[nodiscard]] bool without_command(Recording& recording, std::string_view axis);

/// Whether any segment has a torque.
[[nodiscard]] bool has_torque(const SegmentedAxis& axis);

/// Throws std::runtime_error where there is too little motion with torque. `commanded` false: what
/// the segments have as command is no command.
[[nodiscard]] TorqueDiagnosis diagnose_torque(const SegmentedAxis& axis,
                                              const DiagnoseOptions& options = {},
                                              bool commanded = true);

/// What the torque names is neither suspected any more nor beyond what the recording shows.
void heed(const TorqueDiagnosis& torque, Diagnosis& diagnosis);

/// "n", "nm", "a", "v" or "percent": the unit of the torque at the end of a key.
[[nodiscard]] std::string key_of_unit(const std::string& unit);

}  // namespace servotwin
