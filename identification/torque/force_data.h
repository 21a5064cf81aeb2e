// Motor force beside the motion that it caused: what a force fit compares (force_fit.h).
//
// From a recording, by parallel filtering: the position is filtered with zero phase (Butterworth of
// fourth order at 2.5 times the bandwidth) and differentiated by central differences; then the
// force and every column of the model go through one and the same low-pass (Chebyshev of eighth
// order, 0.05 dB, zero phase) and are thinned. The relation between them stays what it was, and
// what lies above the bandwidth is compared by nobody. With 40 Hz at 1 kHz these are the filters
// with which the figures of the EMPS benchmark are published (Janot, Gautier, Brunot 2019).
//
// Units: m or rad, s; the force in whatever unit it was recorded in. Errors: std::runtime_error.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/effect.h"
#include "twin/low_pass.h"
#include "twin/sample.h"

namespace servotwin {

class ForceData {
 public:
  /// Every stretch of the segments that has a torque. `bandwidth_hz` 0: nothing is filtered, and
  /// the motion between samples is that of a cubic spline, in `substeps` steps.
  static ForceData of_motion(const std::vector<Segment>& segments, double bandwidth_hz = 40.0,
                             int substeps = 1);
  /// The mean force at constant velocities.
  static ForceData of_velocities(const Eigen::ArrayXd& velocity, const Eigen::ArrayXd& force);
  /// Force over displacement from a relaxed start, at rising displacements.
  static ForceData of_virgin_curve(const Eigen::ArrayXd& displacement, const Eigen::ArrayXd& force);

  struct Stretch {
    std::vector<Motion> motion;
    double start_s = 0.0;
    int substeps = 1;  ///< the k-th of `acceleration` and `force` is at motion[k * substeps]
    Eigen::ArrayXd acceleration, force;
  };
  [[nodiscard]] const std::vector<Stretch>& stretches() const { return stretches_; }

  /// What is compared, and how far apart in time.
  [[nodiscard]] const Eigen::VectorXd& force() const { return force_; }
  [[nodiscard]] const Eigen::VectorXd& acceleration() const { return acceleration_; }
  /// When, in the recording [s].
  [[nodiscard]] const Eigen::VectorXd& time() const { return time_; }
  /// The least speed within what each row's filters see of the motion.
  [[nodiscard]] const Eigen::VectorXd& least_speed() const { return least_speed_; }
  [[nodiscard]] Eigen::Index rows() const { return force_.size(); }
  [[nodiscard]] double step_s() const { return step_s_; }

  /// A column of one stretch, one value per sample of it, as it is compared.
  [[nodiscard]] Eigen::VectorXd compared(const Eigen::ArrayXd& samples) const;

 private:
  void finish();
  [[nodiscard]] Eigen::VectorXd slowest_of(const Stretch& stretch, Eigen::Index rows) const;

  std::vector<Stretch> stretches_;
  LowPass comparison_;  // empty: none
  Eigen::Index border_ = 0;
  Eigen::Index thinning_ = 1;
  double step_s_ = 0.0;
  Eigen::VectorXd force_, acceleration_, least_speed_, time_;
};

}  // namespace servotwin
