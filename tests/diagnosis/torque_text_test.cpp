#include "diagnosis/report/torque_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace servotwin {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;

/// Of an axis whose rigid body leaves 1 Nm of a torque between 1 and 5 Nm.
TorqueDiagnosis of_pendulum() {
  TorqueDiagnosis out;
  out.axis = "A";
  out.unit = "Nm";
  out.rotary = true;
  out.baseline_rms = out.extended_rms = 1.0;
  out.torque = Eigen::Vector4d(1.0, 5.0, 1.0, 5.0);
  return out;
}

std::string first_line_of(const TorqueDiagnosis& torque) { return torque_lines(torque, false)[0]; }

TEST(TorqueVerdict, SaysOfHowMuchTorqueTheRigidBodyLeavesIt) {
  EXPECT_THAT(first_line_of(of_pendulum()),
              EndsWith("on held-out motion is 1 Nm RMS of a scatter of 2"));
}

TEST(TorqueVerdict, GivesTheNoiseBesideARestThatIsNotExplained) {
  TorqueDiagnosis torque = of_pendulum();
  torque.causes.resize(1);
  torque.causes[0].id = "cogging";
  torque.extended_rms = 0.8;
  torque.noise_rms = 0.05;
  EXPECT_THAT(first_line_of(torque), EndsWith("; the rest is not explained (noise 0.05 Nm)"));
  torque.extended_rms = 0.06;
  EXPECT_THAT(first_line_of(torque), Not(HasSubstr("noise")));
}

TEST(TorqueVerdict, OfARotaryAxisSpeaksOfInertia) {
  TorqueDiagnosis torque = of_pendulum();
  torque.mass = 0.5;
  torque.mass_shown = true;
  EXPECT_THAT(torque_lines(torque, false)[1], HasSubstr("rigid body: inertia 0.5 Nm s^2/rad"));
  EXPECT_THAT(in_short(torque, "there is no command")[0],
              HasSubstr("inertia, friction and weight"));
  torque.rotary = false;
  EXPECT_THAT(torque_lines(torque, false)[1], HasSubstr("rigid body: mass 0.5 Nm s^2/m"));
}

}  // namespace
}  // namespace servotwin
