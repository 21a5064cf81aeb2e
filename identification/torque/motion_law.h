// Test motion for measuring friction: ramps of constant velocity back and forth across an
// observation band, with a rest after each.
//
//   v_i  = sum_j a_j i^j,  i = 1..N       speeds, dense where the friction curve bends
//   x_i  = q_i + m v_i,    q_i = band_i / 2            end of a ramp, on both sides of the centre
//   |x_i| - band_i / 2 >= v_i^2 / 2a      so that the velocity is v_i throughout the band
//   T    = sum of (D / v + v / a) + rest  D: length of a ramp
//
// Each speed is run in the positive, then in the negative direction. Two consecutive ramps meet at
// the wider of their two end points, so that each crosses its whole band. The velocity of a ramp is
// a symmetric trapezoid. Slow speeds take nearly all the time; a narrow band for them shortens the
// test.
//
// SI units. Errors: std::invalid_argument with the field, its value and the rule. Allocates. Any
// thread. Source: Giberti, La Mura, Raineri and Tarabini 2019, section 3.3, eq. 4 to 6.
#pragma once

#include <limits>
#include <span>
#include <vector>

namespace servotwin {

struct MotionLawPlan {
  std::vector<double> velocities;  ///< the speeds v_i [m/s], > 0
  std::vector<double> bands;       ///< observation band of each speed [m], > 0
  double settle_s = 0.2;           ///< m, >= v / 2a; at speed for m - v / 2a before the band
  double acceleration = 1.0;       ///< a [m/s^2], > 0
  double rest_s = 1.0;             ///< after every ramp [s], >= 0
  double centre = 0.0;             ///< centre of the bands [m]
  double travel = std::numeric_limits<double>::infinity();  ///< available travel [m]
};

struct MotionRamp {
  double velocity = 0.0;      ///< signed [m/s]
  double band = 0.0;          ///< [m]
  double from = 0.0;          ///< [m]
  double to = 0.0;            ///< [m]
  double start_s = 0.0;       ///< leaves `from` [s]
  double end_s = 0.0;         ///< comes to rest at `to` [s]
  double band_begin_s = 0.0;  ///< enters its band, at `velocity` [s]
  double band_end_s = 0.0;    ///< leaves it [s]
};

/// v_i for i = 1..count; coefficients a_0, a_1, ... [m/s].
[[nodiscard]] std::vector<double> polynomial_velocities(std::span<const double> coefficients,
                                                        int count);

class MotionLaw {
 public:
  explicit MotionLaw(const MotionLawPlan& plan);

  /// Positive and negative direction of every speed, in the order of the plan.
  [[nodiscard]] const std::vector<MotionRamp>& ramps() const { return ramps_; }
  /// Including the last rest [s].
  [[nodiscard]] double duration_s() const { return ramps_.back().end_s + rest_s_; }
  /// Duration of the same speeds with the widest band for all [s].
  [[nodiscard]] double single_band_duration_s() const { return single_band_duration_s_; }
  [[nodiscard]] double low() const;   ///< lowest position [m]
  [[nodiscard]] double high() const;  ///< highest position [m]
  /// The commanded position [m]; constant before the start and after the end.
  [[nodiscard]] double at(double time_s) const;

 private:
  std::vector<MotionRamp> ramps_;
  double acceleration_ = 0.0;
  double rest_s_ = 0.0;
  double single_band_duration_s_ = 0.0;
};

}  // namespace servotwin
