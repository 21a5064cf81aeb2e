// The simulation study of the thesis (section 3.6): a feed drive with P-PI control and GMS friction
// whose closed loop has known poles. The truth identification is measured against; shares no code
// with it.
//
//   x'' = alpha (Kp (x_r - x) - x') + beta q - (B/J) x' - d,     q' = Kp (x_r - x) - x'
//   d   = sum_i F_i,   dF_i = k_i dx within -L_i <= F_i <= L_i        (GMS of constant level)
//
// Closed-loop poles p = 9.87 Hz, w = 31.31 Hz, zeta = 0.44; Kp = 75 1/s; no feed-forward.
// Friction: 10 elements of the quartic virgin curve, shape 0.7, breakaway 20 um, level 286 mm/s^2
// (force over moved mass). Command: 0.2 s rest, jerk-limited moves to (-1)^(k+1) 11 k / 18 mm,
// k = 1..18, back to 0, 0.5 s rest, within 96 mm/s, 451 mm/s^2 and 38200 mm/s^3.
//
// Scheme: the linear part exactly, by matrix exponential, for a command that is cubic and a
// friction that is linear over each internal step; friction and motion are solved together, so that
// it is stable for any step. Steps between 25 us and 0.6 ms agree to 0.003 um RMS.
//
// Units here: mm and s, as in the thesis (the program itself is SI). Errors: std::invalid_argument.
// Any thread.
#pragma once

#include <Eigen/Core>

namespace servotwin {

/// One record of 10915 samples; all arrays have that length.
struct ThesisStudy {
  double sample_time_s = 0.6e-3;
  Eigen::ArrayXd command_mm;
  Eigen::ArrayXd actual_mm;       ///< exact, before any encoder
  Eigen::ArrayXd velocity;        ///< actual [mm/s]
  Eigen::ArrayXd friction_mm_s2;  ///< force over moved mass, positive against positive motion
};

/// The elements of the true friction: stiffness [1/s^2] and level [mm/s^2] per moved mass.
struct ThesisFriction {
  Eigen::ArrayXd stiffness;
  Eigen::ArrayXd level;
};

[[nodiscard]] ThesisFriction thesis_friction();

/// The study. `internal_step_s` must go into the sampling time a whole number of times.
[[nodiscard]] ThesisStudy thesis_study(double internal_step_s = 1e-4);

/// What an encoder of the given step reads: round(x / step) * step, halves to even; the samples
/// themselves if step is 0.
[[nodiscard]] Eigen::ArrayXd quantised(const Eigen::ArrayXd& samples, double step);

}  // namespace servotwin
