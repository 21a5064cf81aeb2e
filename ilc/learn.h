// Learns what to command instead, trial by trial, on a plant that need not be a real one.
//
//   r_j = x_r + u_j,   e_j = x_r - x_j,   u_(j+1) = (1 - Q) u_f + Q (u_j + L e_j)
//
// The serial architecture: the correction is added to the command, errors are taken against the
// original one. The plant is any function from commands to positions: the twins with all their
// effects (`on_twins`), or a machine. Q and L are those of a law that may be used
// (ilc/learning_law.h). u_f is what the model says without a trial (ilc/feedforward.h): what Q
// takes from learning it leaves to the model, at reversals above all; 0 if none is wanted.
//
// Aim: the tracking error of every axis by itself; or the contour error, shared by the axes
// (cross-coupled): then e is what is across the path, C - P of its nearest point, and the lag
// along the path is left to itself, which takes far smaller corrections.
//
// The correction is 0 at both ends, rises within `ramp_s`, and obeys the limits in every trial. The
// best trial is kept, which is that of the smallest error of the aim, but none that leaves the path
// worse than no correction; `patience` trials in a row
// that are worse than the best end it: friction is not linear, and too much bandwidth lets small
// errors grow after a while.
//
// SI units. Errors: std::invalid_argument where a law must not be used (why_refused), or axes are
// not of one length. Any thread; allocates; the same input gives the same result.
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
  Segment path;  ///< its command; `actual` is not used
  LearningLaw law;
  double reversal_bandwidth_hz = 0.0;  ///< 0: one bandwidth everywhere
  CorrectionLimits limits;
  /// Bandwidth of u_f; 0: there is none. Not with the norm-optimal law, which weighs all of u.
  double basis_bandwidth_hz = 0.0;
};

enum class Aim { kTracking, kContour };

struct LearnOptions {
  Aim aim = Aim::kTracking;
  int trials = 10;                ///< after the one without correction
  int patience = 2;               ///< trials in a row that may be worse than the best
  double ramp_s = 0.05;           ///< at both ends
  bool feedforward_only = false;  ///< one trial, of u_f alone
};

struct ErrorSize {
  double rms = 0.0, max = 0.0;
};
[[nodiscard]] ErrorSize size_of(const Eigen::ArrayXd& error);

struct Trial {
  std::vector<ErrorSize> axis;  ///< tracking [m | rad]
  ErrorSize contour;            ///< of the linear axes, if they are two or more [m]
  ErrorSize turned;             ///< of the rotary axes [rad]
};

enum class Ending { kAllTrials, kGrew };

struct LearnedAxis {
  Eigen::ArrayXd correction;                 ///< u
  Eigen::ArrayXd error_before, error_after;  ///< x_r - x
  double beyond_bandwidth_rms = 0.0;         ///< of error_after: (1 - Q) of it
  /// Of the samples that move, where a limit binds, and where the peak does: of the trial that is
  /// kept, or of the last if none is.
  double at_limit_share = 0.0, at_peak_share = 0.0;
};

struct Learned {
  std::vector<Trial> trials;  ///< the first without correction
  std::size_t best = 0;
  Ending ending = Ending::kAllTrials;
  std::vector<LearnedAxis> axes;
  std::optional<ProgramError> before, after;  ///< with two linear axes or more
};

/// From the commands of all axes to the positions that are read.
using Plant = std::function<std::vector<Eigen::ArrayXd>(const std::vector<Eigen::ArrayXd>&)>;

/// The full twins of these axes, from rest.
[[nodiscard]] Plant on_twins(const std::vector<LearnAxis>& axes);

[[nodiscard]] Learned learn(const std::vector<LearnAxis>& axes, const Plant& plant,
                            const LearnOptions& options = {});

/// Why no trial is kept (best is 0), in a sentence with the limits that were reached.
[[nodiscard]] std::string why_none_is_kept(const Learned& learned,
                                           const std::vector<LearnAxis>& axes);

}  // namespace servotwin
