// The published rigs: what they record at steady speed is the printed friction.
#include "tests/virtual_machine/friction_rigs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

namespace servotwin::virtual_machine {
namespace {

double stribeck(double fc, double fs, double vs, double delta, double speed) {
  return fc + (fs - fc) * std::exp(-std::pow(speed / vs, delta));
}

/// Table 1 of the drive chain, written out once more.
double printed_drive_chain(double v) {
  return v > 0.0 ? stribeck(611.18, 944.2, 0.0065, 1.26, v) + 1904.2 * v
                 : -stribeck(750.9, 1049.2, 0.0074, 1.26, -v) + 2565.0 * v;
}

/// Table 1 of the cover rig.
double printed_drive(double v) {
  return std::copysign(stribeck(163.0, 200.0, 2.53e-3, 1.0, std::abs(v)), v) + 530.0 * v;
}
double printed_cover(double v) {
  return std::copysign(stribeck(106.0, 49.6, 5.30e-4, 1.0, std::abs(v)), v) + 86.2 * v;
}

struct Steady {
  double force = 0.0;    ///< mean motor force [N]
  double slowest = 1e9;  ///< of the true speed [m/s]
  double fastest = 0.0;
};

/// What was recorded between two times.
Steady steady(const AxisRecord& r, double transmission, double from, double to) {
  Steady s;
  const auto first = static_cast<Eigen::Index>(std::ceil(from / r.sample_time));
  const auto last = static_cast<Eigen::Index>(std::floor(to / r.sample_time));
  for (Eigen::Index i = first; i <= last; ++i) {
    s.force += r.torque[i] / transmission;
    s.slowest = std::min(s.slowest, std::abs(r.true_velocity[i]));
    s.fastest = std::max(s.fastest, std::abs(r.true_velocity[i]));
  }
  s.force /= static_cast<double>(last - first + 1);
  return s;
}

/// A ramp up and one down at this speed over `band`, from 40 % to 98 % of their cruise.
std::array<Steady, 2> drive_chain_at(const Axis& axis, double speed, double band) {
  const std::vector<double> speeds{speed}, bands{band};
  const VelocityRamps motion = drive_chain_motion(speeds, bands, 0.2, 1.0);
  const AxisRecord r = record(axis, motion.command(), motion.duration());
  const double ramp = (band + 0.4 * speed) / speed + speed;  // q / V + V / a
  std::array<Steady, 2> out;
  for (const int i : {0, 1}) {
    const double start = 1.0 + i * (ramp + 1.0);
    out[static_cast<std::size_t>(i)] =
        steady(r, axis.transmission, start + 0.4 * ramp, start + 0.98 * ramp - speed);
  }
  return out;
}

TEST(DriveChain, NeedsThePrintedForceAtEverySteadySpeed) {
  Axis axis = drive_chain_axis(0.0);
  // Shorter bands than the paper's where they take minutes.
  for (const auto& [speed, band] : std::vector<std::array<double, 2>>{
           {2.43e-5, 1e-4}, {2.788e-4, 5e-4}, {1.86e-3, 3e-3}, {5e-3, 1e-2}, {5.072e-2, 1e-2}}) {
    SCOPED_TRACE(speed);
    const auto [up, down] = drive_chain_at(axis, speed, band);
    // The drive's own encoder, 38 nm, shakes the axis; friction falls with velocity, so that the
    // mean is not quite the force at the mean velocity.
    EXPECT_NEAR(up.force, printed_drive_chain(speed), 1e-3 * printed_drive_chain(speed));
    EXPECT_NEAR(down.force, printed_drive_chain(-speed), -1e-3 * printed_drive_chain(-speed));
    for (const Steady& ramp : {up, down}) {
      EXPECT_GT(ramp.slowest, 0.0);  // no stick-slip
      EXPECT_LT(ramp.fastest - ramp.slowest, 5e-5);
    }
  }
}

TEST(DriveChain, SticksAndSlipsBelowTheGainOfRouth) {
  // Steepest at (v / vs)^delta = (delta - 1) / delta.
  const double ratio = 0.26 / 1.26;
  const double speed = 0.0065 * std::pow(ratio, 1.0 / 1.26);
  const double slope = (944.2 - 611.18) * 1.26 * ratio / speed * std::exp(-ratio) - 1904.2;
  Axis axis = drive_chain_axis(0.0);
  axis.drive.encoder_step = 0.0;
  const double kp = axis.drive.position_gain;
  const double reset = axis.drive.integral_gain / axis.drive.velocity_gain;
  const double limit = slope + axis.body.mass * kp * reset / (kp + reset);
  EXPECT_NEAR(limit, 38e3, 1e3);
  const auto with_gain = [&](double velocity_gain) {
    axis.drive.velocity_gain = velocity_gain;
    axis.drive.integral_gain = reset * velocity_gain;
    const Steady up = drive_chain_at(axis, speed, 1e-2)[0];
    return up.fastest - up.slowest;
  };
  EXPECT_GT(with_gain(0.92 * limit), 0.5 * speed);
  EXPECT_LT(with_gain(1.08 * limit), 0.01 * speed);
}

TEST(DriveChain, TheMotionCrossesEveryBandAtItsSpeedInBothDirections) {
  const std::vector<double> speeds{1e-3, 4e-3, 2e-2}, bands{2e-3, 5e-3, 1e-2};
  const VelocityRamps motion = drive_chain_motion(speeds, bands, 0.1, 0.5);
  std::vector<int> up(3), down(3);
  for (double t = 0.0; t < motion.duration(); t += 1e-3) {
    const Setpoint s = motion.at(t);
    ASSERT_LE(std::abs(s.acceleration), 0.5);
    for (std::size_t i = 0; i < 3; ++i) {
      if (std::abs(s.position) > bands[i] / 2.0) continue;
      up[i] += s.velocity == speeds[i];
      down[i] += s.velocity == -speeds[i];
    }
  }
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(up[i], 1e3 * bands[i] / speeds[i], 1.0);
    EXPECT_NEAR(down[i], 1e3 * bands[i] / speeds[i], 1.0);
  }
  EXPECT_EQ(motion.end().velocity, 0.0);
  EXPECT_THROW(drive_chain_motion(speeds, std::vector<double>{1e-3, 1e-3}), std::invalid_argument);
}

TEST(DriveChain, RecordsThePapersExperiment) {
  const std::vector<double> speeds = drive_chain_velocities(), bands = drive_chain_bands();
  ASSERT_EQ(speeds.size(), 51U);
  ASSERT_EQ(bands.size(), 51U);
  EXPECT_NEAR(speeds.front(), 0.0243e-3, 1e-12);
  EXPECT_NEAR(speeds.back(), 50.7193e-3, 1e-12);
  EXPECT_EQ(bands[2], 2e-3);
  EXPECT_EQ(bands[3], 5e-3);
  EXPECT_EQ(bands[5], 5e-3);
  EXPECT_EQ(bands[6], 10e-3);
  // Every eighth from the eleventh on, which take no minutes: within the band the mean force is
  // the printed one, and the noise is as requested.
  std::vector<double> fast, their_bands;
  for (std::size_t i = 10; i < 51; i += 8) {
    fast.push_back(speeds[i]);
    their_bands.push_back(bands[i]);
  }
  const AxisRecord r = drive_chain_record(fast, their_bands, 0.05);
  const AxisRecord quiet = drive_chain_record(fast, their_bands, 0.0);
  const double transmission = 0.040 / (2.0 * std::numbers::pi);
  EXPECT_NEAR(std::sqrt((r.torque - quiet.torque).square().mean()), 0.05, 0.002);
  for (const double speed : fast) {
    for (const double v : {speed, -speed}) {
      double sum = 0.0;
      int count = 0;
      for (Eigen::Index i = 1; i < r.torque.size(); ++i) {
        const double commanded = (r.command[i] - r.command[i - 1]) / r.sample_time;
        if (std::abs(commanded - v) > 1e-9 || std::abs(r.actual[i]) > 5e-3) continue;
        sum += quiet.torque[i] / transmission;
        ++count;
      }
      ASSERT_GT(count, 40) << v;
      EXPECT_NEAR(sum / count, printed_drive_chain(v), 4e-3 * std::abs(printed_drive_chain(v)))
          << v;
    }
  }
}

TEST(CoverRig, NeedsThePrintedTorqueAtEverySteadySpeed) {
  for (const double ratio : {1.0, 1.25}) {
    for (const bool covered : {false, true}) {
      Axis axis = cover_rig_axis(covered, 0.0, ratio);
      EXPECT_NEAR(axis.transmission, 0.032 / (2.0 * std::numbers::pi), 1e-15);
      for (const double v : {0.4, 0.05, 0.002}) {
        VelocityRamps motion;
        const double seconds = std::max(0.6, 2e-3 / v);
        for (const double velocity : {v, -v}) {
          motion.accelerate_to(velocity, 10.0);
          motion.hold(seconds);
          motion.accelerate_to(0.0, 10.0);
          motion.hold(0.2);
        }
        const AxisRecord r = record(axis, motion.command(), motion.duration());
        const double again = seconds + 2.0 * v / 10.0 + 0.2;
        const double opening = printed_drive(v) + (covered ? printed_cover(v) : 0.0);
        const double closing = printed_drive(-v) + (covered ? ratio * printed_cover(-v) : 0.0);
        EXPECT_NEAR(steady(r, axis.transmission, 0.5 * seconds, 0.95 * seconds).force, opening,
                    2e-3 * opening)
            << v << (covered ? " covered" : " bare");
        EXPECT_NEAR(
            steady(r, axis.transmission, again + 0.5 * seconds, again + 0.95 * seconds).force,
            closing, -2e-3 * closing)
            << v << (covered ? " covered" : " bare");
      }
    }
  }
}

TEST(CoverRig, TheCoverTakesAlmostFortyPercent) {
  // The paper's figure at steady speed, out of its own table.
  const CoveredLuGre friction = cover_rig_friction();
  for (const double v : {0.005, 0.05, 0.2}) {
    const double share = steady_force(friction.cover, v) / steady_force(friction, v);
    EXPECT_NEAR(share, printed_cover(v) / (printed_drive(v) + printed_cover(v)), 1e-12);
    EXPECT_GT(share, 0.3);
    EXPECT_LT(share, 0.4);
  }
}

TEST(CoverRig, RunsThePapersReversingSequence) {
  constexpr double kSlowest = 0.05, kFastest = 0.4;
  const VelocityRamps motion = cover_rig_motion(7, kSlowest, kFastest, 10);
  std::vector<double> levels;  // the velocities that are held
  double held = 0.0, lowest = 0.0, highest = 0.0;
  Setpoint last = motion.at(0.0);
  for (double t = 0.0; t < motion.duration(); t += 1e-4) {
    const Setpoint s = motion.at(t);
    lowest = std::min(lowest, s.position);
    highest = std::max(highest, s.position);
    ASSERT_TRUE(s.acceleration == 0.0 || std::abs(std::abs(s.acceleration) - 10.0) < 1e-12);
    held = s.velocity == last.velocity ? held + 1e-4 : 0.0;
    if (held > 0.05 && (levels.empty() || levels.back() != s.velocity))
      levels.push_back(s.velocity);
    last = s;
  }
  EXPECT_GE(lowest, -1e-9);
  EXPECT_NEAR(highest, 0.36, 1e-6);
  ASSERT_EQ(levels.size(), 1U + 10U * 8U);
  for (std::size_t stroke = 0; stroke < 20; ++stroke) {
    const double* v = &levels[1 + 4 * stroke];
    EXPECT_GE(std::abs(v[1]), kSlowest);
    EXPECT_LE(std::abs(v[1]), kFastest);
    EXPECT_EQ(v[1] > 0.0, stroke % 2 == 0);
    EXPECT_EQ(v[0], v[1] / 2.0);
    EXPECT_EQ(v[2], v[0]);
    EXPECT_EQ(v[3], 0.0);
  }
  EXPECT_NEAR(cover_rig_motion(7, 1e-4, 5e-3, 1).at(1e9).position, 0.0, 1e-12);
  EXPECT_NE(cover_rig_motion(8, kSlowest, kFastest, 10).duration(), motion.duration());
  EXPECT_THROW(cover_rig_motion(7, 0.4, 0.05, 1), std::invalid_argument);
  EXPECT_THROW(cover_rig_motion(7, 0.05, 4.0, 1), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin::virtual_machine
