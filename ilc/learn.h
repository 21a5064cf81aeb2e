// Iterative learning control: learns a correction of the command, trial by trial, on a simulated or
// a real plant.
//
//   r_j = x_r + u_j,   e_j = x_r - x_j,   u_(j+1) = (1 - Q) u_f + Q (u_j + L e_j)
//
// Serial architecture (Bristow, Tharayil and Alleyne 2006): the correction is added to the command,
// and errors are taken against the original command. The plant is any function from commands to
// positions: the twins with all their effects (`on_twins`), or a machine. Q and L are those of a
// permitted law (ilc/learning_law.h). u_f is the correction by the model without a trial
// (ilc/feedforward.h), 0 if none is wanted; it supplies the frequencies that Q removes from
// learning, which matters most at reversals.
//
// The aim is the tracking error of every axis by itself, or the contour error shared by the axes
// (cross-coupled). Then e is the error across the path, C - P with C the nearest point of the path,
// and the lag along the path is not corrected, which takes far smaller corrections.
//
// The correction is 0 at both ends, rises within `ramp_s`, and obeys the limits in every trial. The
// best trial is kept: that with the smallest error of the aim, and none whose path is worse than
// without correction. `patience` trials in a row that are worse than the best end the iteration:
// friction is not linear, and with too much bandwidth small errors grow after some trials.
//
// A load with friction is at times free on its spring and at times held. With two masses the trials
// are therefore made twice, with the law of both masses and with that of their rigid loop, and the
// better correction is kept.
//
// SI units. Errors: std::invalid_argument if a law is not permitted (why_refused) or axes differ in
// length. Any thread; allocates; the same input gives the same result. Source: docs/theory.md 13.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "ilc/learning_law.h"
#include "ilc/limits.h"
#include "twin/program_error.h"
#include "twin/sample.h"

namespace servotwin {

struct LearnAxis {
  std::string name;
  bool rotary = false;
  Model model;
  Segment path;  ///< the command; `actual` is not used
  /// The place of the axis whose acceleration acts on this one (find_neighbours).
  std::optional<std::size_t> neighbour;
  LearningLaw law;
  double reversal_bandwidth_hz = 0.0;  ///< bandwidth at reversals; 0: the same everywhere
  CorrectionLimits limits;
  /// Bandwidth of u_f [Hz]; 0: no u_f. Must be 0 with the norm-optimal law, which weighs all of u.
  double basis_bandwidth_hz = 0.0;
};

enum class Aim { kTracking, kContour };

struct LearnOptions {
  Aim aim = Aim::kTracking;
  int trials = 10;                ///< at most, after the one without correction
  int patience = 2;               ///< trials in a row that may be worse than the best
  double ramp_s = 0.05;           ///< rise time at both ends [s]
  bool feedforward_only = false;  ///< one trial, with u_f alone
  /// Of axes of two masses: also with the law of the rigid loop, whose convergence on the axis is
  /// not known; its better correction is kept. Not for corrections that go to a drive unseen.
  bool rigid_law_too = false;
};

struct ErrorSize {
  double rms = 0.0, max = 0.0;
};
[[nodiscard]] ErrorSize size_of(const Eigen::ArrayXd& error);

struct Trial {
  std::vector<ErrorSize> axis;  ///< tracking error of each axis [m | rad]
  ErrorSize contour;            ///< contour error of two or more linear axes [m]
  ErrorSize turned;             ///< angular error of the rotary axes [rad]
};

enum class Ending { kAllTrials, kGrew };

struct LearnedAxis {
  Eigen::ArrayXd correction;                 ///< u [m | rad]
  Eigen::ArrayXd error_before, error_after;  ///< x_r - x [m | rad]
  double beyond_bandwidth_rms = 0.0;         ///< RMS of (1 - Q) error_after [m | rad]
  /// Share of the samples in motion at which any limit is active, and at which the peak is: in the
  /// trial that is kept, or in the last one if none is.
  double at_limit_share = 0.0, at_peak_share = 0.0;
};

struct Learned {
  std::vector<Trial> trials;  ///< the first is without correction
  std::size_t best = 0;
  Ending ending = Ending::kAllTrials;
  std::vector<LearnedAxis> axes;
  bool two_masses = false;                    ///< an axis has two masses
  bool by_rigid_law = false;                  ///< their law without the spring was better
  std::optional<ProgramError> before, after;  ///< with two linear axes or more
};

/// For every axis whose model contains the acceleration of another one: that axis, its path and,
/// where the model needs it, its motion as its own model predicts it. It
/// is the one that is named, of `named` one per axis, or the first other one. Returns the places of
/// those whose other axis is not there: their twins lack what it does.
std::vector<std::size_t> find_neighbours(std::vector<LearnAxis>& axes,
                                         const std::vector<std::string>& named);

/// From the commands of all axes to their readings; one array per axis.
using Plant = std::function<std::vector<Eigen::ArrayXd>(const std::vector<Eigen::ArrayXd>&)>;

/// The full twins of these axes, from rest.
[[nodiscard]] Plant on_twins(const std::vector<LearnAxis>& axes);

[[nodiscard]] Learned learn(const std::vector<LearnAxis>& axes, const Plant& plant,
                            const LearnOptions& options = {});

/// That the other axis of an axis is not among them, as a sentence.
[[nodiscard]] std::string without_neighbour(const std::string& axis, const std::string& named);

/// Why no trial is kept (best is 0): a sentence that names the limits that were reached.
[[nodiscard]] std::string why_none_is_kept(const Learned& learned,
                                           const std::vector<LearnAxis>& axes);

}  // namespace servotwin
