// Motor force and the motion it caused, filtered for a force fit (force_fit.h).
//
// From a recording, by parallel filtering: the position is filtered with zero phase (Butterworth of
// fourth order at 2.5 times the bandwidth) and differentiated by central differences. Then the
// force and every column of the model go through the same low-pass (Chebyshev of eighth order, 0.05
// dB, zero phase) and are thinned. The relation between them does not change, and nothing above the
// bandwidth is compared. With 40 Hz at 1 kHz these are the filters of the published figures of the
// EMPS benchmark (Janot, Gautier and Brunot 2019; docs/theory.md 9.1).
//
// Units: m or rad, s; the force in its recorded unit. Errors: std::runtime_error. Allocates. Any
// thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/effect.h"
#include "twin/low_pass.h"
#include "twin/sample.h"

namespace servotwin {

class ForceData {
 public:
  /// From every stretch of the segments that has a torque. With `bandwidth_hz` 0 nothing is
  /// filtered, and the motion between samples is that of a cubic spline, in `substeps` steps.
  static ForceData of_motion(const std::vector<Segment>& segments, double bandwidth_hz = 40.0,
                             int substeps = 1);
  /// From the mean force at constant velocities; both arrays of one length.
  static ForceData of_velocities(const Eigen::ArrayXd& velocity, const Eigen::ArrayXd& force);
  /// From force over displacement of a first travel from rest; displacements rise.
  static ForceData of_virgin_curve(const Eigen::ArrayXd& displacement, const Eigen::ArrayXd& force);

  struct Stretch {
    std::vector<Motion> motion;
    double start_s = 0.0;
    int substeps = 1;  ///< the k-th of `acceleration` and `force` is at motion[k * substeps]
    Eigen::ArrayXd acceleration, force;
  };
  [[nodiscard]] const std::vector<Stretch>& stretches() const { return stretches_; }

  /// Filtered force, one value per row; rows are step_s() apart.
  [[nodiscard]] const Eigen::VectorXd& force() const { return force_; }
  [[nodiscard]] const Eigen::VectorXd& acceleration() const { return acceleration_; }
  /// Time of every row in the recording [s].
  [[nodiscard]] const Eigen::VectorXd& time() const { return time_; }
  /// The least speed within the span of the filters of every row [m/s | rad/s].
  [[nodiscard]] const Eigen::VectorXd& least_speed() const { return least_speed_; }
  [[nodiscard]] Eigen::Index rows() const { return force_.size(); }
  [[nodiscard]] double step_s() const { return step_s_; }
  /// As that of the segments (identification/recording/motion_range.h).
  [[nodiscard]] double length_scale() const { return length_scale_; }

  /// A column of one stretch (one value per sample) after the same filter, one value per row.
  [[nodiscard]] Eigen::VectorXd compared(const Eigen::ArrayXd& samples) const;

 private:
  void finish();
  [[nodiscard]] Eigen::VectorXd slowest_of(const Stretch& stretch, Eigen::Index rows) const;

  std::vector<Stretch> stretches_;
  LowPass comparison_;  // empty: none
  Eigen::Index border_ = 0;
  Eigen::Index thinning_ = 1;
  double step_s_ = 0.0;
  double length_scale_ = 1.0;
  Eigen::VectorXd force_, acceleration_, least_speed_, time_;
};

}  // namespace servotwin
