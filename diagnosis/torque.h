// Finds the causes of the part of a measured torque, force or current that a rigid body with
// friction does not explain (docs/theory.md 10.1). No position command is needed: a test rig may be
// driven by its displacement.
//
//   T = m a + F_c sat(v / v_l) + B v + sum_i c_i f_i(motion; shapes_i)
//
// The baseline is the rigid body with Coulomb and viscous friction. Effects of the catalogue that
// act on the body are added one by one. An effect is added only if it significantly lowers the
// error on blocks of time that its coefficients were not fitted to (blocked_regression.h), with a
// Bonferroni correction for the number of candidates. Backlash is detected by the plateau of the
// force after reversals (plateau.h). The hold-out is used for no decision; gains are measured on
// it. Rows at rest are excluded, since static friction can take any value there.
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

/// A test that a cause passed: its name, its statistic (z) and its one-sided p.
struct TorqueEvidence {
  std::string test;
  double statistic = 0.0, p = kAbsent;
};

/// One component of a ripple that is periodic in position: its amplitudes in the torque and in the
/// tracking error.
struct Harmonic {
  double period = 0.0;              ///< [m | rad]
  double amplitude = 0.0;           ///< of the torque, in its unit
  double tracking_error = kAbsent;  ///< amplitude of the same period [m | rad]
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
  bool commanded = true;  ///< false: the recording has no position command
  /// The recorded torque has the opposite sign to the position: a positive one drives backwards.
  bool opposite = false;
  double mass = 0.0, coulomb = 0.0, viscous = 0.0;  ///< of the baseline
  double training_to_s = 0.0;
  double baseline_rms = kAbsent, extended_rms = kAbsent;  ///< on the hold-out
  std::vector<TorqueCause> causes;
  std::vector<TorqueCause> suspected;  ///< confidence below kNamed and no rival: not named
  Plateau plateau;
  std::vector<std::string> steps;  ///< of the search, as text
  /// The hold-out: time [s], position, torque, and the residuals of baseline and extended model.
  Eigen::VectorXd time, position, torque, left_before, left_after;
};

/// Where this axis has position and torque but no command, copies the position to the command and
/// returns true.
[[nodiscard]] bool without_command(Recording& recording, std::string_view axis);

/// Whether any segment has a torque signal.
[[nodiscard]] bool has_torque(const SegmentedAxis& axis);

/// The torque diagnosis of an axis. `commanded` false: the command of the segments is a copy of the
/// position (see without_command). Throws std::runtime_error where there is too little motion with
/// torque.
[[nodiscard]] TorqueDiagnosis diagnose_torque(const SegmentedAxis& axis,
                                              const DiagnoseOptions& options = {},
                                              bool commanded = true);

/// Removes the causes that the torque names from the suspected and from the not observable ones.
void heed(const TorqueDiagnosis& torque, Diagnosis& diagnosis);

/// The suffix of JSON keys for this torque unit: "n", "nm", "a", "v" or "percent".
[[nodiscard]] std::string key_of_unit(const std::string& unit);

}  // namespace servotwin
