#include "ilc/gate.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <sstream>

#include "tests/ilc/gate_promises.h"

namespace servotwin {
namespace {

constexpr std::int64_t kCycle_ns = 1'000'000;
constexpr GateLimits kLimits{.peak = 20e-6,
                             .rate = 2e-3,
                             .bandwidth_hz = 50.0,
                             .ramp_s = 0.05,
                             .validity_s = 0.01,
                             .model_age_s = 3600.0,
                             .live = true};

GateRequest good(std::int64_t cycle, double offset) {
  GateRequest request;
  request.now_ns = cycle * kCycle_ns;
  request.offset = offset;
  request.expires_ns = request.now_ns + 1'000'000'000;
  request.model_validated = true;
  request.model_validated_ns = 0;
  request.axis_state_matches = true;
  return request;
}

/// A gate through which a constant offset passes unchanged.
Gate open_gate(double offset, std::int64_t& cycle) {
  Gate gate(kLimits);
  for (cycle = 0; cycle < 200; ++cycle) (void)gate.pass(good(cycle, offset));
  return gate;
}

TEST(Gate, PassesAPermittedRequestUnchangedOnceItIsFadedIn) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  const GateOutput out = gate.pass(good(cycle, 5e-6));
  EXPECT_EQ(out.refusal, Refusal::kNone);
  EXPECT_TRUE(out.send);
  EXPECT_DOUBLE_EQ(out.offset, 5e-6);
  EXPECT_EQ(out.expires_ns, cycle * kCycle_ns + 10'000'000);
}

TEST(Gate, FadesInLinearlyWithinTheRamp) {
  Gate gate(kLimits);
  for (std::int64_t cycle = 0; cycle <= 50; ++cycle) {
    const GateOutput out = gate.pass(good(cycle, 5e-6));
    EXPECT_NEAR(out.offset, 5e-6 * static_cast<double>(cycle) / 50.0, 1e-18) << cycle;
  }
}

TEST(Gate, FollowsASineWithinItsLimits) {
  Gate gate(kLimits);
  const double omega = 2.0 * std::numbers::pi * 10.0;
  for (std::int64_t cycle = 0; cycle < 500; ++cycle) {
    const double offset = 15e-6 * std::sin(omega * 1e-3 * static_cast<double>(cycle));
    const GateOutput out = gate.pass(good(cycle, offset));
    ASSERT_EQ(out.refusal, Refusal::kNone) << cycle;
    if (cycle > 50) {
      ASSERT_NEAR(out.offset, offset, 1e-18) << cycle;
    }
  }
}

TEST(Gate, DryRunIsTheDefaultAndSendsNothing) {
  GateLimits limits = kLimits;
  limits.live = GateLimits{}.live;
  Gate gate(limits);
  for (std::int64_t cycle = 0; cycle < 100; ++cycle) {
    const GateOutput out = gate.pass(good(cycle, 5e-6));
    EXPECT_FALSE(out.send);
    if (cycle == 99) {
      EXPECT_DOUBLE_EQ(out.offset, 5e-6);  // computed all the same
    }
  }
}

struct GateCase {
  Refusal refusal;
  void (*spoil)(GateRequest&);
};

std::ostream& operator<<(std::ostream& out, const GateCase& one) {
  return out << name_of(one.refusal);
}

class GateRefuses : public testing::TestWithParam<GateCase> {};

TEST_P(GateRefuses, ByNameAndFadesOut) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  double last = 5e-6;
  for (int i = 0; i < 60; ++i, ++cycle) {
    GateRequest request = good(cycle, 5e-6);
    GetParam().spoil(request);
    const GateOutput out = gate.pass(request);
    ASSERT_EQ(out.refusal, GetParam().refusal) << name_of(out.refusal);
    ASSERT_LE(out.offset, last);
    last = out.offset;
  }
  EXPECT_EQ(last, 0.0);
  EXPECT_EQ(gate.count(GetParam().refusal), 60U);
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

INSTANTIATE_TEST_SUITE_P(
    EachReason, GateRefuses,
    testing::Values(
        GateCase{Refusal::kModelNotValidated, [](GateRequest& r) { r.model_validated = false; }},
        GateCase{Refusal::kModelStale,
                 [](GateRequest& r) { r.model_validated_ns = r.now_ns - 3601'000'000'000; }},
        GateCase{Refusal::kModelStale, [](GateRequest& r) { r.model_validated_ns = r.now_ns + 1; }},
        GateCase{Refusal::kOtherAxisState, [](GateRequest& r) { r.axis_state_matches = false; }},
        GateCase{Refusal::kNotFinite, [](GateRequest& r) { r.offset = kNan; }},
        GateCase{Refusal::kNotFinite, [](GateRequest& r) { r.offset = -kInfinity; }},
        GateCase{Refusal::kExpired, [](GateRequest& r) { r.expires_ns = r.now_ns - 1; }},
        GateCase{Refusal::kPeak, [](GateRequest& r) { r.offset = 20.1e-6; }}));

TEST(Gate, RefusesAStepAboveTheRate) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  EXPECT_EQ(gate.pass(good(cycle, 5e-6 + 2.1e-6)).refusal, Refusal::kRate);
  EXPECT_EQ(gate.count(Refusal::kRate), 1U);
}

TEST(Gate, RefusesWhatNoSignalOfItsBandwidthAndPeakCanDo) {
  // 450 Hz of 1 um: within peak and rate, but curved more than (2 pi 50 Hz)^2 20 um = 1.97 m/s^2.
  std::int64_t cycle = 0;
  Gate gate = open_gate(0.0, cycle);
  int refused = 0;
  for (int i = 0; i < 100; ++i, ++cycle) {
    const double offset = 1e-6 * std::sin(2.0 * std::numbers::pi * 450.0 * 1e-3 * i);
    refused += gate.pass(good(cycle, offset)).refusal == Refusal::kBandwidth ? 1 : 0;
  }
  EXPECT_GT(refused, 50);
}

TEST(Gate, HoldsWhatIsOutWhereTheClockStands) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  const GateOutput out = gate.pass(good(cycle - 1, 5e-6));
  EXPECT_EQ(out.refusal, Refusal::kTimeStands);
  EXPECT_DOUBLE_EQ(out.offset, 5e-6);
  EXPECT_EQ(out.expires_ns, (cycle - 1) * kCycle_ns + 10'000'000) << "the validity is not renewed";
}

// When a program ends, the offset has faded out and no offset is valid beyond the end.
TEST(Gate, FadesARequestOutBeforeItExpires) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  const std::int64_t end = cycle + 1000;
  for (; cycle <= end; ++cycle) {
    GateRequest request = good(cycle, 5e-6);
    request.expires_ns = end * kCycle_ns;
    const GateOutput out = gate.pass(request);
    ASSERT_EQ(out.refusal, Refusal::kNone) << cycle;
    ASSERT_NEAR(out.offset, 5e-6 * std::min(1.0, static_cast<double>(end - cycle) / 50.0), 1e-18)
        << cycle;
    ASSERT_EQ(out.expires_ns, std::min(cycle + 10, end) * kCycle_ns);
  }
  GateRequest late = good(cycle, 5e-6);
  late.expires_ns = end * kCycle_ns;
  const GateOutput out = gate.pass(late);
  EXPECT_EQ(out.refusal, Refusal::kExpired);
  EXPECT_EQ(out.offset, 0.0);
  EXPECT_EQ(out.expires_ns, late.now_ns + 10'000'000) << "nothing is no longer the request's";
}

TEST(Gate, AppliesAPartOfARequestThatIsShorterThanTheRamp) {
  Gate gate(kLimits);
  for (std::int64_t cycle = 0; cycle < 200; ++cycle) {
    GateRequest request = good(cycle, 5e-6);
    request.expires_ns = request.now_ns + 10 * kCycle_ns;
    const GateOutput out = gate.pass(request);
    EXPECT_NEAR(out.offset, 5e-6 * std::min<double>(10.0, static_cast<double>(cycle)) / 50.0,
                1e-18);
  }
}

// The active offset keeps its validity, and needs it to fade out.
TEST(Gate, RefusesAnEndThatIsNearerThanTheFade) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  const std::int64_t from = cycle;
  for (; cycle < from + 50; ++cycle) {
    GateRequest request = good(cycle, 5e-6);
    request.expires_ns = (from + 45) * kCycle_ns;
    const GateOutput out = gate.pass(request);
    ASSERT_EQ(out.refusal, cycle <= from + 45 ? Refusal::kEndsTooSoon : Refusal::kExpired);
    ASSERT_NEAR(out.offset, 5e-6 * static_cast<double>(from + 49 - cycle) / 50.0, 1e-18);
  }
}

// A rate limit that makes the fade-out slower than the ramp.
TEST(Gate, RefusesAnEndThatIsNearerThanTheRateAllows) {
  GateLimits limits = kLimits;
  limits.rate = 0.1e-3;
  Gate gate(limits);
  GatePromises promises(limits);
  const auto pass = [&](const GateRequest& request) {
    const GateOutput out = gate.pass(request);
    const char* broken = promises.broken(request, out);
    EXPECT_EQ(broken, nullptr) << broken << " at " << request.now_ns;
    return out;
  };
  std::int64_t cycle = 0;
  for (; cycle < 300; ++cycle) (void)pass(good(cycle, 15e-6));
  for (; cycle < 360; ++cycle) {
    GateRequest request = good(cycle, 15e-6);
    request.axis_state_matches = false;
    (void)pass(request);
  }
  GateRequest request = good(cycle, 15e-6);
  request.expires_ns = request.now_ns + 20 * kCycle_ns;  // 2 um could go in that time
  const GateOutput out = pass(request);
  EXPECT_EQ(out.refusal, Refusal::kEndsTooSoon);
  EXPECT_NEAR(out.offset, 15e-6 - 61 * 0.1e-6, 1e-12);
}

TEST(Gate, StartsFromNothingAfterTheDriveHasDroppedTheOffset) {
  std::int64_t cycle = 0;
  Gate gate = open_gate(5e-6, cycle);
  EXPECT_EQ(gate.pass(good(cycle + 11, 5e-6)).offset, 0.0);
  EXPECT_NEAR(gate.pass(good(cycle + 12, 5e-6)).offset, 5e-6 / 50.0, 1e-18);
}

TEST(Gate, WithoutPositiveLimitsLetsNothingThrough) {
  for (const double bad : {0.0, -1.0, 1e-310, kNan, kInfinity}) {
    for (int field = 0; field < 6; ++field) {
      GateLimits limits = kLimits;
      (field == 0   ? limits.peak
       : field == 1 ? limits.rate
       : field == 2 ? limits.bandwidth_hz
       : field == 3 ? limits.ramp_s
       : field == 4 ? limits.validity_s
                    : limits.model_age_s) = bad;
      Gate gate(limits);
      for (std::int64_t cycle = 0; cycle < 100; ++cycle) {
        const GateOutput out = gate.pass(good(cycle, 5e-6));
        ASSERT_EQ(out.refusal, Refusal::kNoLimits);
        ASSERT_EQ(out.offset, 0.0);
        ASSERT_FALSE(out.send);
      }
    }
  }
}

/// Arbitrary requests, often close to permitted ones, so that outputs are not always zero.
class Fuzz {
 public:
  explicit Fuzz(unsigned seed) : random_(seed) {}

  GateRequest next() {
    now_ns_ = time();
    GateRequest request;
    request.now_ns = now_ns_;
    request.offset = offset();
    request.expires_ns = expiry();
    request.model_validated = !one_in(50);
    request.model_validated_ns = one_in(50) ? stamp() : now_ns_;
    request.axis_state_matches = !one_in(50);
    return request;
  }

 private:
  bool one_in(unsigned n) { return random_() % n == 0; }
  double uniform(double a, double b) { return std::uniform_real_distribution<>(a, b)(random_); }
  std::int64_t stamp() {
    switch (random_() % 4) {
      case 0:
        return std::numeric_limits<std::int64_t>::min();
      case 1:
        return std::numeric_limits<std::int64_t>::max();
      default:
        return static_cast<std::int64_t>(random_());
    }
  }
  std::int64_t time() {
    if (one_in(20'000)) return stamp();
    // Back to times in which steps can be small, after an extreme one.
    if (now_ns_ > (std::int64_t{1} << 60) || now_ns_ < -(std::int64_t{1} << 60)) return 0;
    const std::int64_t step =
        one_in(100) ? static_cast<std::int64_t>(uniform(-2e7, 2e7)) : kCycle_ns;
    return now_ns_ + step;
  }
  /// Of a program that ends some time, followed by the next one; sometimes sooner than it was.
  std::int64_t expiry() {
    if (one_in(100)) return stamp();
    if (ends_ns_ < now_ns_ || one_in(100))
      ends_ns_ = now_ns_ / 2 > std::numeric_limits<std::int64_t>::max() / 4
                     ? now_ns_
                     : now_ns_ + static_cast<std::int64_t>(uniform(0.0, 3e8));
    return ends_ns_;
  }
  double offset() {
    if (one_in(200)) {
      constexpr double kOdd[] = {kNan, kInfinity, -kInfinity, 1e308, -1e308, 5e-324, 0.0};
      return kOdd[random_() % std::size(kOdd)];
    }
    if (one_in(100)) return uniform(-1e-3, 1e-3);
    value_ += uniform(-1e-6, 1e-6);
    if (std::abs(value_) > 25e-6) value_ *= 0.5;
    return value_;
  }

  std::mt19937_64 random_;
  std::int64_t now_ns_ = 0, ends_ns_ = 0;
  double value_ = 0.0;
};

TEST(GateInvariant, NoInputMakesAnOutputThatBreaksAPromise) {
  // Many gates, because one that has seen the end of time waits for it; every other one with a rate
  // that makes fades slower than the ramp.
  std::array<std::uint64_t, kRefusals> counts{};
  int nonzero = 0;
  for (unsigned seed = 0; seed < 1000; ++seed) {
    Fuzz fuzz(seed);
    GateLimits limits = kLimits;
    if (seed % 2 == 1) limits.rate = 0.3e-3;
    Gate gate(limits);
    GatePromises promises(limits);
    for (int i = 0; i < 1000; ++i) {
      const GateRequest request = fuzz.next();
      const GateOutput out = gate.pass(request);
      const char* broken = promises.broken(request, out);
      ASSERT_EQ(broken, nullptr) << broken << ": seed " << seed << ", input " << i << ", offset "
                                 << request.offset << ", out " << out.offset;
      nonzero += out.offset != 0.0 ? 1 : 0;
    }
    for (std::size_t r = 0; r < kRefusals; ++r) counts[r] += gate.count(static_cast<Refusal>(r));
  }
  EXPECT_GT(nonzero, 100'000) << "the invariant must be tried with offsets that are out";
  for (std::size_t r = 0; r < kRefusals; ++r) {
    const auto refusal = static_cast<Refusal>(r);
    EXPECT_EQ(counts[r] > 0, refusal != Refusal::kNoLimits) << name_of(refusal);
  }
}

}  // namespace
}  // namespace servotwin
