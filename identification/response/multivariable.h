// Several inputs and several outputs at once, in the time domain: common poles, every channel's
// numerator by projection (thesis 5.4; docs/theory.md 15.3).
//
//   W^-1 y = W^-1 G(s) u,   G_ji(s) = d_ji + sum_k (c1_jik s + c0_jik) / (s^2 + 2 zeta_k omega_k s
//   + omega_k^2)   or   c_jik / (s + p_k)
//
// W is the diagonal matrix of output scales (thesis eq. 5.2), here the residual of each output:
// without it a torque in Nm would outweigh an error in um by a million. For given poles all
// coefficients, an offset of every output and the starting states are one least squares problem for
// all outputs, which is projected out; the poles are sought by Levenberg-Marquardt in log p, log
// omega, log zeta, so that every fit is stable. It starts from vector fitting of the frequency
// responses of all channels together. Inputs are exact cubics or straight lines between samples
// (twin/hold.h). For inputs that are Maxwell elements, the logarithms of their break distances are
// estimated together with the poles.
//
// An input that depends on the noise of the outputs, such as the torque of a closed loop, biases
// the fit. For a closed loop use commands and friction along the motion as inputs. Any thread.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <limits>
#include <vector>

#include "identification/response/vector_fitting.h"

namespace servotwin {

/// Unbroken and evenly sampled; all arrays of one length and finite.
struct MultivariableRecord {
  std::vector<Eigen::ArrayXd> inputs, outputs;
};

struct MultivariableInput {
  bool smooth = true;  ///< a smooth curve between its samples (a command), else straight lines
  /// Number of its source, 0.. without a gap: the elements of one friction are of one source.
  int source = 0;
  /// Above 0 the records have the position [m | rad] of an axis, and the input is the Maxwell
  /// element along it that slides after this distance (`friction_input`); where it is sought, this
  /// is the start.
  /// An element that does not slide is the position itself: at most a quarter of the travel.
  double break_distance = 0.0;
  bool rotary = false;  ///< whether that is an angle
};

struct MultivariableData {
  double sample_time_s = 0.0;
  std::vector<MultivariableInput> inputs;
  std::vector<MultivariableRecord> records;
};

struct MultivariableOptions {
  int order = 0;                ///< number of poles, 1..kMaxPoles; 0: by held-out error
  int most = 12;                ///< highest order tried
  double training_share = 0.7;  ///< the first part of every record; the rest is held out
  /// Estimate break distances, and use them if they reduce the residual of the validation data.
  bool seek_break_distances = true;
};

struct MultivariableTrial {
  int order = 0;
  /// Residual RMS of free simulation over the RMS of the output, geometric mean over the outputs,
  /// on the last third of the training data, which is not fitted for this.
  double left = 0.0;
  bool chosen = false;
};

/// Residuals with the given and with the estimated break distances.
struct BreakDistanceTrial {
  /// As MultivariableTrial::left, for the chosen order; NaN: not estimated.
  double left_given = std::numeric_limits<double>::quiet_NaN();
  double left_found = std::numeric_limits<double>::quiet_NaN();
  bool taken = false;  ///< the estimated distances are used
};

struct MultivariableFit {
  std::vector<FittedPole> poles;  ///< by frequency; `explains` is 0
  /// Per output one row per input: of every pole c, or c1 and c0; then d. In the units of the data.
  std::vector<Eigen::MatrixXd> coefficients;
  Eigen::ArrayXd scale;            ///< W, in the units of the outputs
  Eigen::ArrayXd training;         ///< residual RMS of every output on the training data,
  Eigen::ArrayXd holdout;          ///< and on the held-out data, in free simulation from the start
  Eigen::ArrayXd holdout_outputs;  ///< RMS of the outputs on the held-out data, about their mean
  /// RMS about the mean of the response of every output (rows) to each source alone (columns), on
  /// the held-out data. Contributions may cancel each other.
  Eigen::ArrayXXd parts;
  std::vector<MultivariableTrial> trials;
  /// One value per input [m | rad], 0 for an input that is no element; standard deviations of given
  /// distances are 0.
  std::vector<double> break_distances, break_deviations;
  BreakDistanceTrial distances;
  int evaluations = 0;

  [[nodiscard]] int order() const;  ///< number of poles
  [[nodiscard]] std::complex<double> at(std::size_t output, std::size_t input, double omega) const;
};

/// Response of every output to these inputs alone (`wanted`, one per input of the data) along a
/// record, from rest: rows x outputs, without the constants of the fit.
[[nodiscard]] Eigen::MatrixXd answer_of(const MultivariableFit& fit, const MultivariableData& data,
                                        const MultivariableRecord& record,
                                        const std::vector<bool>& wanted);

/// The fit as matrices: w' = a w + b u, y = c w + d u. The states are those of every output's own
/// poles in their order, of a pair its part w of the output and w' + 2 zeta omega w - c1 u, so that
/// there are order x outputs of them.
struct MultivariableMatrices {
  Eigen::MatrixXd a, b, c, d;
};
[[nodiscard]] MultivariableMatrices matrices_of(const MultivariableFit& fit);

/// The force of one Maxwell element along the measured position, which slides at +-1 after
/// `break_distance` from rest [m | rad]. Several of them, as inputs, are generalised Maxwell-slip
/// friction whose levels are estimated by projection.
[[nodiscard]] Eigen::ArrayXd friction_input(const Eigen::ArrayXd& position, double break_distance);

/// The longest break distance of an element along this input [m | rad]: a quarter of the travel
/// within the first part of every record, which the first fits use.
[[nodiscard]] double longest_break_distance(const MultivariableData& data, std::size_t input,
                                            const MultivariableOptions& options = {});

/// Throws std::runtime_error, one line, if the data are too short, an element does not slide, or no
/// fit is finite.
[[nodiscard]] MultivariableFit identify_multivariable(const MultivariableData& data,
                                                      const MultivariableOptions& options = {});

}  // namespace servotwin
