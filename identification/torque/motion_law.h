// The test motion that friction is measured with: ramps of steady velocity to and fro across an
// observation band, a rest after each.
//
//   v_i  = sum_j a_j i^j,  i = 1..N                    the speeds, dense where friction bends
//   x_i  = q_i + m v_i,    q_i = band_i / 2            where a ramp turns, on both sides of the
//   centre |x_i| - band_i / 2 >= v_i^2 / 2a                   so that it is at v_i throughout the
//   band T    = sum of (D / v + v / a) + rest               D: length of a ramp
//
// Every speed goes up, then down; two ramps that meet turn at the wider of their two points, so
// that each crosses its whole band. The velocity of a ramp is a symmetric trapezoid. Slow speeds
// take nearly all the time: a narrow band for them is what saves it.
//
// SI units. Errors: std::invalid_argument with the field, its value and the rule. Any thread.
// Source: Giberti, La Mura, Raineri, Tarabini 2019, section 3.3, eq. 4 to 6.
#pragma once

#include <limits>
#include <span>
#include <vector>

namespace servotwin {

struct MotionLawPlan {
  std::vector<double> velocities;  ///< the speeds v_i [m/s], > 0
  std::vector<double> bands;       ///< of each speed [m], > 0
  double settle_s = 0.2;           ///< m, >= v / 2a; at speed m - v / 2a before the band
  double acceleration = 1.0;       ///< a [m/s^2], > 0
  double rest_s = 1.0;             ///< after every ramp, >= 0
  double centre = 0.0;             ///< of the bands [m]
  double travel = std::numeric_limits<double>::infinity();  ///< limit of the way there is [m]
};

struct MotionRamp {
  double velocity = 0.0;      ///< signed [m/s]
  double band = 0.0;          ///< [m]
  double from = 0.0;          ///< [m]
  double to = 0.0;            ///< [m]
  double start_s = 0.0;       ///< leaves `from`
  double end_s = 0.0;         ///< rests at `to`
  double band_begin_s = 0.0;  ///< enters its band, at `velocity`
  double band_end_s = 0.0;    ///< leaves it
};

/// v_i for i = 1..count; coefficients a_0, a_1, ... [m/s].
[[nodiscard]] std::vector<double> polynomial_velocities(std::span<const double> coefficients,
                                                        int count);

class MotionLaw {
 public:
  explicit MotionLaw(const MotionLawPlan& plan);

  /// Up and down for every speed, in the order of the plan.
  [[nodiscard]] const std::vector<MotionRamp>& ramps() const { return ramps_; }
  /// With the last rest.
  [[nodiscard]] double duration_s() const { return ramps_.back().end_s + rest_s_; }
  /// The same speeds with the widest of the bands for all.
  [[nodiscard]] double single_band_duration_s() const { return single_band_duration_s_; }
  [[nodiscard]] double low() const;   ///< [m]
  [[nodiscard]] double high() const;  ///< [m]
  /// The commanded position [m]; before the start and after the end it rests.
  [[nodiscard]] double at(double time_s) const;

 private:
  std::vector<MotionRamp> ramps_;
  double acceleration_ = 0.0;
  double rest_s_ = 0.0;
  double single_band_duration_s_ = 0.0;
};

}  // namespace servotwin
