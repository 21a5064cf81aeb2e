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

#include "diagnosis/search/diagnose.h"
#include "diagnosis/torque/plateau.h"
#include "diagnosis/torque/torque_lag.h"
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

/// What keeps a cause from being named.
enum class TorqueDoubt {
  kNone,
  kConfidence,  ///< its confidence is below kMinConfidenceToName, and it has no rival
  kGain,        ///< its gain on held-out data may be zero, or cannot be measured there
  kParameters,  ///< a parameter is not finite or not possible
  kPosition     ///< the position names another cause, which does the same in the torque
};

struct TorqueCause {
  std::string id;                                          ///< of the contract
  std::vector<std::pair<std::string, double>> parameters;  ///< keys of the contract
  std::vector<Harmonic> harmonics;                         ///< of cogging
  std::vector<TorqueEvidence> evidence;
  double confidence = 0.0;  ///< hit rate of causes with this gain x certainty of the tests
  std::vector<std::string> ambiguous_with;
  Gain gain;  ///< on the hold-out, in the unit of the torque
  TorqueDoubt doubt = TorqueDoubt::kNone;
  std::string same_by_position;  ///< with TorqueDoubt::kPosition: that cause
};

struct TorqueDiagnosis {
  std::string axis, unit;
  bool rotary = false;
  bool commanded = true;  ///< false: the recording has no position command
  TorqueLag lag;          ///< of the recorded torque, which was put in time
  /// Up to which torque and motion are compared, and up to which they would be without noise
  /// (torque_band.h).
  double bandwidth_hz = 0.0, widest_hz = 0.0;
  /// The recorded torque has the opposite sign to the position: a positive one drives backwards.
  bool opposite = false;
  double mass = 0.0, coulomb = 0.0, viscous = 0.0;  ///< of the baseline; 0: not shown
  bool mass_shown = false;                          ///< that there is a mass is significant
  /// Friction and constant force together, with the recorded sign, of an axis that moves in one
  /// direction, which does not separate them; 0 otherwise.
  double constant = 0.0;
  /// Of a load that swings with a rotary axis: its largest torque, and the angle where it acts.
  double gravity = 0.0, gravity_at_rad = 0.0;
  /// The axis moves in one direction in the training data, and in the other one later.
  bool held_out_turns = false;
  double training_to_s = 0.0;
  double baseline_rms = kAbsent, extended_rms = kAbsent;  ///< on the hold-out
  double noise_rms = kAbsent;  ///< white part of the residual of the extended model there
  std::vector<TorqueCause> causes;
  /// Not named, for the reason in `doubt`. Those with a doubtful gain or impossible parameters are
  /// not part of the extended model.
  std::vector<TorqueCause> suspected;
  Plateau plateau;
  std::vector<std::string> steps;  ///< of the search, as text
  /// The hold-out: time [s], position, torque, and the residuals of baseline and extended model.
  Eigen::VectorXd time, position, torque, left_before, left_after;
};

/// Where this axis has position and torque but no command, copies the position to the command and
/// returns true.
[[nodiscard]] bool without_command(Recording& recording, std::string_view axis);

/// The torque diagnosis of an axis. `commanded` false: the command of the segments is a copy of the
/// position (see without_command). Throws std::runtime_error where there is too little motion with
/// torque.
[[nodiscard]] TorqueDiagnosis diagnose_torque(const SegmentedAxis& axis,
                                              const DiagnoseOptions& options = {},
                                              bool commanded = true);

/// Whether the named causes explain the torque: at most a third of the RMS of the rigid body is
/// left, or little more than the white noise.
[[nodiscard]] bool explained(const TorqueDiagnosis& torque);

/// Brings the two diagnoses of one recording together. What the torque cannot tell from a cause
/// that the position names is suspected only; what it then names is removed from the suspected and
/// from the not observable causes of the position.
void heed(TorqueDiagnosis& torque, Diagnosis& diagnosis);

/// The suffix of JSON keys for this torque unit: "n", "nm", "a", "v" or "percent".
[[nodiscard]] std::string key_of_unit(const std::string& unit);

}  // namespace servotwin
