#include "diagnosis/evidence/command_lag.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "twin/two_pi.h"

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr double kHz = 2.0, kAmplitude = 0.01, kLag_s = 0.006;

/// A sine of 2 Hz that is followed with a constant velocity lag and this error at a right angle.
Segment sine_with_lag(double beside) {
  Segment s;
  s.sample_time_s = 1e-4;
  s.command.resize(5000);  // a whole period
  s.actual.resize(5000);
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    const double phase = kTwoPi * kHz * s.sample_time_s * static_cast<double>(k);
    s.command(k) = kAmplitude * std::sin(phase);
    const double velocity = kAmplitude * kTwoPi * kHz * std::cos(phase);
    s.actual(k) = s.command(k) - kLag_s * velocity - beside * std::sin(phase);
  }
  return s;
}

TEST(CommandLag, OfADriveThatOnlyLagsIsAllOfItsError) {
  const CommandLag lag = command_lag(std::vector{sine_with_lag(0.0)});
  EXPECT_NEAR(lag.time_s, kLag_s, 1e-7);
  EXPECT_GT(lag.share, 0.99999);
  EXPECT_NEAR(lag.tracking_rms, kLag_s * kAmplitude * kTwoPi * kHz / std::sqrt(2.0), 2e-7)
      << "two samples of 5000, where the axis is fastest, have no velocity";
  const std::string words = lag_text(lag, "X", false);
  EXPECT_THAT(
      words,
      HasSubstr("The tracking error of axis X is 533 um RMS on held-out motion; 99.9 % of its "
                "square is a lag of 6 ms behind the command"));
  EXPECT_THAT(words, HasSubstr("without full velocity feed-forward: this is no fault"));
}

// The error at a right angle is as large as the lag: half of the square.
TEST(CommandLag, IsTheShareOfTheSquareThatFollowsTheVelocity) {
  const double lag_error = kLag_s * kAmplitude * kTwoPi * kHz;
  const CommandLag half = command_lag(std::vector{sine_with_lag(lag_error)});
  EXPECT_NEAR(half.share, 0.5, 1e-3);
  const CommandLag little = command_lag(std::vector{sine_with_lag(3.0 * lag_error)});
  EXPECT_NEAR(little.share, 0.1, 1e-3);
  EXPECT_THAT(lag_text(little, "X", true), HasSubstr("urad RMS on held-out motion."));
  EXPECT_THAT(lag_text(little, "X", true), Not(HasSubstr("lag")));
}

TEST(CommandLag, IsNotKnownWhereNothingIsRecorded) {
  EXPECT_TRUE(std::isnan(command_lag({}).tracking_rms));
  EXPECT_EQ(lag_text({}, "X", false), "");
}

}  // namespace
}  // namespace servotwin
