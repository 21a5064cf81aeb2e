// The clocks here are made: what is true is how they were made.
#include "daemon/input/clock_line.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace servotwin::daemon {
namespace {

constexpr std::int64_t kMs_ns = 1'000'000, kSecond_ns = 1'000'000'000;

/// A clock that shows `start_ns` at the steady time 0 and gains `drift`, and a network that takes
/// 40 us and an exponential delay on top.
struct FarClock {
  std::int64_t start_ns = 0;
  double drift = 0.0;
  double jitter_ns = 30e3;
  std::mt19937 random{7};

  [[nodiscard]] std::int64_t at(std::int64_t steady) const {
    return start_ns + steady + std::llround(drift * static_cast<double>(steady));
  }
  /// Feeds frames of every millisecond from one steady time to another.
  void send(ClockLine& line, std::int64_t from_ns, std::int64_t to_ns) {
    std::exponential_distribution<double> late(1.0 / jitter_ns);
    for (std::int64_t t = from_ns; t < to_ns; t += kMs_ns)
      line.add(at(t), t + kTransport_ns + std::llround(late(random)));
  }
  static constexpr std::int64_t kTransport_ns = 40'000;
};

/// How far the line is from the truth at this steady time, beyond the least time of transport.
double error_us(const ClockLine& line, const FarClock& clock, std::int64_t steady) {
  return 1e-3 *
         static_cast<double>(line.steady_ns(clock.at(steady)) - steady - FarClock::kTransport_ns);
}

TEST(ClockLine, FindsADriftAndTheTimeUnderJitter) {
  for (const double drift : {50e-6, -50e-6, 0.0, 300e-6}) {
    FarClock clock{1'700'000'000 * kSecond_ns, drift};
    ClockLine line;
    clock.send(line, 0, 2 * kSecond_ns);
    EXPECT_FALSE(line.settled());
    clock.send(line, 2 * kSecond_ns, 4 * kSecond_ns);
    EXPECT_TRUE(line.settled());
    EXPECT_LT(std::abs(error_us(line, clock, 4 * kSecond_ns)), 5.0) << drift;
    clock.send(line, 4 * kSecond_ns, 60 * kSecond_ns);
    EXPECT_NEAR(line.drift(), -drift / (1.0 + drift), 0.3e-6);
    EXPECT_LT(std::abs(error_us(line, clock, 60 * kSecond_ns)), 2.0) << drift;
    EXPECT_EQ(line.restarts(), 0U);
  }
}

TEST(ClockLine, FollowsAQuartzThatWarmsUp) {
  // 20 ppm more within ten minutes, as a computer that was switched on.
  ClockLine line;
  FarClock clock;
  double worst_us = 0.0;
  std::int64_t shown = 0;
  std::exponential_distribution<double> late(1.0 / clock.jitter_ns);
  for (std::int64_t t = 0; t < 600 * kSecond_ns; t += kMs_ns) {
    shown += kMs_ns + std::llround(20e-6 * static_cast<double>(t) / 600e9 * 1e6);
    line.add(shown, t + FarClock::kTransport_ns + std::llround(late(clock.random)));
    if (line.settled())
      worst_us = std::max(worst_us, std::abs(1e-3 * static_cast<double>(line.steady_ns(shown) - t -
                                                                        FarClock::kTransport_ns)));
  }
  EXPECT_LT(worst_us, 15.0);
}

TEST(ClockLine, AClockThatIsSetBeginsANewLine) {
  for (const std::int64_t by : {50 * kMs_ns, -50 * kMs_ns, 3600 * kSecond_ns, -3600 * kSecond_ns,
                                2 * kMs_ns, -2 * kMs_ns, 4 * kMs_ns, -4 * kMs_ns}) {
    FarClock clock{0, 20e-6};
    ClockLine line;
    clock.send(line, 0, 10 * kSecond_ns);
    ASSERT_TRUE(line.settled());
    clock.start_ns += by;
    clock.send(line, 10 * kSecond_ns, 13 * kSecond_ns);
    EXPECT_FALSE(line.settled()) << by;
    EXPECT_EQ(line.restarts(), 1U) << by;
    clock.send(line, 13 * kSecond_ns, 21 * kSecond_ns);
    EXPECT_TRUE(line.settled()) << by;
    EXPECT_LT(std::abs(error_us(line, clock, 21 * kSecond_ns)), 4.0) << by;
  }
}

TEST(ClockLine, ANetworkThatStallsForAWhileMovesNothing) {
  FarClock clock{5, 50e-6};
  ClockLine line;
  clock.send(line, 0, 20 * kSecond_ns);
  // Nearly a second of frames comes at once, then all is as before.
  const std::int64_t end = 20 * kSecond_ns + 900 * kMs_ns;
  for (std::int64_t t = 20 * kSecond_ns; t < end; t += kMs_ns) line.add(clock.at(t), end);
  clock.send(line, end, 22 * kSecond_ns);
  EXPECT_EQ(line.restarts(), 0U);
  EXPECT_LT(std::abs(error_us(line, clock, 22 * kSecond_ns)), 3.0);
}

TEST(ClockLine, StampsMayHaveAnyValue) {
  ClockLine line;
  line.add(std::numeric_limits<std::int64_t>::max(), 0);
  line.add(std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max());
  line.add(0, std::numeric_limits<std::int64_t>::min());
  for (int i = 0; i < 10; ++i) line.add(i * 7'000'000'000'000'000'00LL, i);
  EXPECT_TRUE(std::isfinite(line.drift()));
  (void)line.steady_ns(std::numeric_limits<std::int64_t>::max());
  (void)line.steady_ns(std::numeric_limits<std::int64_t>::min());
}

}  // namespace
}  // namespace servotwin::daemon
