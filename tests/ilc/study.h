// The drive and the program of the reference experiment: the plant of the thesis's study (mm, Hz:
// poles 9.87, 31.31 at 0.44; Kp 75 1/s, no feed-forward) with presliding friction of 286 mm/s^2
// over 20 um, four moves of 10 mm back and forth at 0.6 ms; and the inexact model: 9.44, 30.0 at
// 0.50, Kp 74.
#pragma once

#include <numbers>

#include "ilc/learn.h"
#include "tests/virtual_machine/trajectory.h"

namespace servotwin::study {

inline constexpr double kStep_s = 0.6e-3;

inline Loop loop_of(double real_hz, double omega_hz, double zeta, double position_gain) {
  constexpr double kTwoPi = 2.0 * std::numbers::pi;
  Loop loop;
  loop.denominator = denominator_of({kTwoPi * real_hz, kTwoPi * omega_hz, zeta}, 3);
  // No feed-forward: only c2 = a3 / Kp separates the integrator from the position gain.
  loop.numerator = {1.0, loop.denominator[0], loop.denominator[2] / position_gain};
  return loop;
}

inline Model plant(double friction = 0.286) {
  Model model;
  model.sample_time_s = kStep_s;
  model.loop = loop_of(9.87, 31.31, 0.44, 75.0);
  Effect presliding = make_effect<Presliding>();
  presliding.shape[0] = 20e-6;
  presliding.shape[1] = 0.7;
  presliding.coefficient[0] = friction;
  if (friction > 0.0) model.effects = {presliding};
  return model;
}

inline Model mismatched(double friction = 0.286) {
  Model model = plant(friction);
  model.loop = loop_of(9.44, 30.0, 0.50, 74.0);
  return model;
}

inline Segment sampled(const virtual_machine::Trajectory& motion, double h) {
  const auto n = static_cast<Eigen::Index>(motion.duration() / h);
  Segment out;
  out.sample_time_s = h;
  out.command.resize(n);
  for (Eigen::Index k = 0; k < n; ++k)
    out.command(k) = motion.at(static_cast<double>(k) * h).position;
  return out;
}

inline Segment moves() {
  const virtual_machine::Limits limits{0.096, 1.5, 60.0};
  virtual_machine::Trajectory motion;
  motion.dwell(0.3);
  for (const double target : {0.01, 0.0, 0.01, 0.0}) {
    motion.move_to(target, limits);
    motion.dwell(0.05);
  }
  motion.dwell(0.6);
  return sampled(motion, kStep_s);
}

/// One axis of three circles of 10 mm at 100 mm/s: turns every 0.3 s, smooth in between.
inline Segment circles() {
  virtual_machine::Trajectory motion;
  motion.dwell(0.3);
  motion.arc(0.01, 0.0, 6.0 * std::numbers::pi, {0.1, 1.5, 60.0});
  motion.dwell(0.3);
  return sampled(motion, kStep_s);
}

/// An axis that learns with this model; the plant is another matter.
inline LearnAxis axis_of(const Model& model, double bandwidth_hz, const Segment& path = moves()) {
  LearnAxis axis;
  axis.name = "X";
  axis.model = model;
  axis.path = path;
  axis.law.model = transfer_of(model);
  axis.law.bandwidth_hz = bandwidth_hz;
  return axis;
}

/// The twin of `model` in front of an encoder with this step [m]; 0: exact.
inline Plant machine(const Model& model, const Segment& path, double encoder_step = 0.0) {
  LearnAxis axis = axis_of(model, 1.0, path);
  return [plant = on_twins({axis}), encoder_step](const std::vector<Eigen::ArrayXd>& commands) {
    std::vector<Eigen::ArrayXd> out = plant(commands);
    if (encoder_step > 0.0) out[0] = (out[0] / encoder_step).rint() * encoder_step;
    return out;
  };
}

/// RMS of every trial [um].
inline std::vector<double> rms_um(const Learned& learned) {
  std::vector<double> out;
  for (const Trial& trial : learned.trials) out.push_back(1e6 * trial.axis[0].rms);
  return out;
}

}  // namespace servotwin::study
