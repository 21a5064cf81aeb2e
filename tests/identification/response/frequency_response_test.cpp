// Frequency responses of systems whose response is a closed form, and their scatter.
#include "identification/response/frequency_response.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <stdexcept>

#include "identification/response/response_modes.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using Complex = std::complex<double>;
using Eigen::ArrayXd;
using Eigen::Index;
using testing::HasSubstr;

constexpr double kSampleTime_s = 1e-3;

/// y_k = 1.5 y_(k-1) - 0.8 y_(k-2) + 0.2 u_k + 0.1 u_(k-1)
ArrayXd filtered(const ArrayXd& u) {
  ArrayXd y(u.size());
  for (Index k = 0; k < u.size(); ++k) {
    y(k) = 0.2 * u(k) + (k > 0 ? 0.1 * u(k - 1) + 1.5 * y(k - 1) : 0.0) -
           (k > 1 ? 0.8 * y(k - 2) : 0.0);
  }
  return y;
}
Complex filter_at(double hz) {
  const Complex q = std::polar(1.0, -kTwoPi * hz * kSampleTime_s);
  return (0.2 + 0.1 * q) / (1.0 - 1.5 * q + 0.8 * q * q);
}

ArrayXd noise(Index n, double deviation, std::mt19937_64& random) {
  std::normal_distribution<double> normal(0.0, deviation);
  ArrayXd out(n);
  for (double& x : out) x = normal(random);
  return out;
}

/// Mean of |G - truth|^2 / (2 deviation^2) over the significant frequencies from 5 Hz on.
template <class Truth>
double misfit(const FrequencyResponse& found, std::size_t channel, const Truth& truth) {
  double sum = 0.0;
  const std::vector<Index> places = found.significant(channel, 5.0, 495.0);
  for (const Index i : places) {
    const ResponseChannel& c = found.channels[channel];
    sum += std::norm(c.response(i) - truth(found.frequency_hz(i))) /
           (2.0 * c.deviation(i) * c.deviation(i));
  }
  return sum / static_cast<double>(places.size());
}

TEST(FrequencyResponse, HasTheNumbersOfScipy) {
  // scipy 1.10.1: csd / welch and coherence with hann, nperseg 500, noverlap 250, detrend constant.
  struct Known {
    Index line;
    Complex response;
    double coherence;
  };
  const std::vector<Known> known{
      {1, {1.22509320561052, -0.0335080484729157}, 0.803765382798177},
      {17, {1.30927461077033, 0.163936450066351}, 0.865529798040547},
      {60, {-0.493581417814507, -1.21274893739416}, 0.825352020679308},
      {99, {-0.0534323897693098, -0.153204598580504}, 0.187566095878244},
      {180, {-0.108560339661711, -0.0599614304748275}, 0.0704712273820412},
      {248, {0.00637885863249155, 0.0328417772030714}, 0.00315435101050902},
  };
  std::uint64_t x = 12345;
  const auto uniform = [&x](Index n) {
    ArrayXd out(n);
    for (double& value : out) {
      x = (1103515245u * x + 12345u) % (1u << 31);
      value = static_cast<double>(x) / (1u << 30) - 1.0;
    }
    return out;
  };
  const ArrayXd u = uniform(4000), e = uniform(4000);
  const std::vector<ResponseRecord> records{{{u}, filtered(u) + 0.5 * e + 3.0, {}}};
  const FrequencyResponse found = frequency_response(records, kSampleTime_s, {.window_s = 0.5});
  EXPECT_EQ(found.windows, 15);
  for (const Known& k : known) {
    EXPECT_DOUBLE_EQ(found.frequency_hz(k.line - 1), 2.0 * static_cast<double>(k.line));
    EXPECT_LT(std::abs(found.channels[0].response(k.line - 1) - k.response), 1e-12);
    EXPECT_NEAR(found.channels[0].coherence(k.line - 1), k.coherence, 1e-12);
    EXPECT_NEAR(found.coherence(k.line - 1), k.coherence, 1e-12);
  }
}

TEST(FrequencyResponse, ScattersAsItSays) {
  std::mt19937_64 random(3);
  double sum = 0.0;
  constexpr int kTrials = 20;
  for (int i = 0; i < kTrials; ++i) {
    // Three segments, as of a recording with gaps.
    std::vector<ResponseRecord> records;
    for (const Index n : {4000, 2500, 6000}) {
      const ArrayXd u = noise(n, 1.0, random);
      records.push_back({{u}, filtered(u) + noise(n, 0.3, random), {}});
    }
    sum += misfit(frequency_response(records, kSampleTime_s, {.window_s = 0.25}), 0, filter_at);
  }
  // 20 x 123 frequencies, half of them independent: 3 % of scatter.
  EXPECT_NEAR(sum / kTrials, 1.0, 0.12);
}

TEST(FrequencyResponse, CoherenceIsTheShareOfTheOutput) {
  std::mt19937_64 random(5);
  const ArrayXd u = noise(200000, 1.0, random);
  const std::vector<ResponseRecord> records{{{u}, filtered(u) + noise(200000, 0.5, random), {}}};
  const FrequencyResponse found = frequency_response(records, kSampleTime_s, {.window_s = 1.0});
  // 399 windows by halves; the squared correlation of neighbours is 1/36.
  EXPECT_NEAR(found.averages, 399.0 / (1.0 + 2.0 / 36.0), 0.1);
  for (Index i = 1; i < found.frequency_hz.size(); ++i) {
    const double power = std::norm(filter_at(found.frequency_hz(i)));
    const double truth = power / (power + 0.25);
    // Bendat and Piersol: sd of gamma^2 is sqrt(2 gamma^2) (1 - gamma^2) / sqrt(n).
    const double sd = std::sqrt(2.0 * truth) * (1.0 - truth) / std::sqrt(found.averages);
    EXPECT_NEAR(found.coherence(i), truth, 5.0 * sd + 1e-3) << found.frequency_hz(i);
  }
}

TEST(FrequencyResponse, NothingIsSignificantByMoreThanChance) {
  std::mt19937_64 random(7);
  double significant = 0.0, all = 0.0;
  for (int i = 0; i < 20; ++i) {
    const std::vector<ResponseRecord> records{
        {{noise(8000, 1.0, random)}, noise(8000, 1.0, random), {}}};
    const FrequencyResponse found = frequency_response(records, kSampleTime_s, {.window_s = 0.5});
    significant += static_cast<double>(found.channels[0].significant.count());
    all += static_cast<double>(found.frequency_hz.size());
  }
  EXPECT_GT(significant / all, 0.003);  // kChanceOfSignificance is 0.01
  EXPECT_LT(significant / all, 0.02);
}

/// u = gain (r - y), y = filter u + v: feedback brings v into u.
struct ClosedLoop {
  ArrayXd r, u, y;
};
ClosedLoop closed_loop(Index n, double disturbance, std::mt19937_64& random) {
  ClosedLoop out{noise(n, 1.0, random), ArrayXd(n), ArrayXd(n)};
  const ArrayXd v = noise(n, disturbance, random);
  double x1 = 0.0, x2 = 0.0, u1 = 0.0;  // of the filter, one and two samples ago
  constexpr double kGain = 0.3;
  for (Index k = 0; k < n; ++k) {
    // y = x + v, x = 0.2 u + known, u = gain (r - y)
    const double known = 1.5 * x1 - 0.8 * x2 + 0.1 * u1;
    out.u(k) = kGain * (out.r(k) - known - v(k)) / (1.0 + 0.2 * kGain);
    const double x = known + 0.2 * out.u(k);
    out.y(k) = x + v(k);
    x2 = x1;
    x1 = x;
    u1 = out.u(k);
  }
  return out;
}

TEST(FrequencyResponse, OfAClosedLoopNeedsTheCommandAsInstrument) {
  std::mt19937_64 random(9);
  const ClosedLoop loop = closed_loop(60000, 1.0, random);
  const std::vector<ResponseRecord> biased{{{loop.u}, loop.y, {}}};
  const std::vector<ResponseRecord> right{{{loop.u}, loop.y, {loop.r}}};
  const SpectralOptions options{.window_s = 0.25};
  EXPECT_GT(misfit(frequency_response(biased, kSampleTime_s, options), 0, filter_at), 20.0);
  EXPECT_NEAR(misfit(frequency_response(right, kSampleTime_s, options), 0, filter_at), 1.0, 0.45);
}

TEST(FrequencyResponse, AnInstrumentThatIsNoneTellsNothing) {
  // The disturbance alone moves this loop: input and output hang together as -1 / controller, which
  // any instrument would find.
  std::mt19937_64 random(11);
  const ClosedLoop loop = closed_loop(30000, 50.0, random);
  const std::vector<ResponseRecord> records{{{loop.u}, loop.y, {noise(30000, 1.0, random)}}};
  const FrequencyResponse found = frequency_response(records, kSampleTime_s, {.window_s = 0.25});
  EXPECT_LT(found.channels[0].significant.count(), 7);  // 1.2 by chance
}

TEST(FrequencyResponse, TellsTwoInputsApart) {
  std::mt19937_64 random(13);
  const Index n = 40000;
  const ArrayXd u1 = noise(n, 1.0, random), u2 = 0.8 * u1 + noise(n, 0.6, random);
  const ArrayXd y = filtered(u1) + noise(n, 0.2, random);
  const SpectralOptions options{.window_s = 0.25};
  // Alone the second input seems to move the axis, for it goes with the first.
  const std::vector<ResponseRecord> alone{{{u2}, y, {}}};
  EXPECT_GT(frequency_response(alone, kSampleTime_s, options).channels[0].significant.count(), 100);
  const std::vector<ResponseRecord> both{{{u1, u2}, y, {}}};
  const FrequencyResponse found = frequency_response(both, kSampleTime_s, options);
  EXPECT_NEAR(misfit(found, 0, filter_at), 1.0, 0.45);
  EXPECT_LT(found.channels[1].significant.count(), 7);
  double sum = 0.0;
  for (Index i = 1; i < found.frequency_hz.size(); ++i) {
    const ResponseChannel& c = found.channels[1];
    sum += std::norm(c.response(i)) / (2.0 * c.deviation(i) * c.deviation(i));
    EXPECT_GE(found.coherence(i) + 1e-9, c.coherence(i));
  }
  EXPECT_NEAR(sum / static_cast<double>(found.frequency_hz.size() - 1), 1.0, 0.45);
  // Two identical inputs cannot be separated.
  const std::vector<ResponseRecord> one{{{u1, 2.0 * u1}, y, {}}};
  EXPECT_EQ(frequency_response(one, kSampleTime_s, options).channels[0].significant.count(), 0);
}

TEST(FrequencyResponse, OfPositionsIsThatOfTheirDifferences) {
  std::mt19937_64 random(15);
  ArrayXd u = noise(20000, 1.0, random);
  for (Index k = 1; k < u.size(); ++k) u(k) += u(k - 1);  // far from rest
  const std::vector<ResponseRecord> records{{{u}, filtered(u) + noise(u.size(), 0.3, random), {}}};
  const FrequencyResponse found =
      frequency_response(records, kSampleTime_s, {.window_s = 0.25, .differenced = true});
  EXPECT_NEAR(misfit(found, 0, filter_at), 1.0, 0.45);
}

TEST(FrequencyResponse, AStrongLineLeaksAndIsNoExcitationElsewhere) {
  // A slow sine that every window sees at nearly one phase, and an output that is no linear answer:
  // coherent at all low harmonics.
  ArrayXd u(20000), y(20000);
  for (Index k = 0; k < u.size(); ++k) {
    u(k) = std::sin(kTwoPi * 1.0003 * kSampleTime_s * static_cast<double>(k));
    y(k) = u(k) * u(k) * u(k) + std::abs(u(k));
  }
  const std::vector<ResponseRecord> records{{{u}, y, {}}};
  const FittedResponse found = fit_response(records, kSampleTime_s);
  EXPECT_GT((found.response.coherence.segment(8, 60) > 0.8).count(), 15);
  EXPECT_TRUE(found.response.significant(0, 4.0, 500.0).empty());
  EXPECT_FALSE(found.fit);
  EXPECT_THAT(found.declined, HasSubstr("frequencies have significant coherence"));
}

TEST(FrequencyResponse, RefusesTooFewWindows) {
  std::mt19937_64 random(17);
  const ArrayXd u = noise(1000, 1.0, random);
  const std::vector<ResponseRecord> records{{{u}, u, {}}};
  const auto words = [&](double window_s) -> std::string {
    try {
      (void)frequency_response(records, kSampleTime_s, {.window_s = window_s});
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(words(0.5), HasSubstr("3 windows of 0.5 s give 2.9 independent averages"));
  EXPECT_THAT(words(2.0), HasSubstr("0 windows of 2 s"));
  EXPECT_THAT(words(0.01), HasSubstr("has 10 samples, it needs 16"));
  EXPECT_EQ(words(0.25), "");
}

/// x'' + 2 zeta w x' + w^2 x = w^2 u with u held between the samples: the exact step.
ArrayXd oscillator(const ArrayXd& u, double hz, double zeta, double h) {
  const double w = kTwoPi * hz, damped = w * std::sqrt(1.0 - zeta * zeta),
               decay = std::exp(-zeta * w * h);
  const double c = std::cos(damped * h), s = std::sin(damped * h);
  ArrayXd out(u.size());
  double x = 0.0, v = 0.0;
  for (Index k = 0; k < u.size(); ++k) {
    out(k) = x;
    const double from = x - u(k);  // of the rest position
    const double slope = (v + zeta * w * from) / damped;
    x = u(k) + decay * (from * c + slope * s);
    v = decay * (v * c - (w * w * from + zeta * w * v) / damped * s);
  }
  return out;
}

TEST(ResponseModes, AreThoseOfTheOscillators) {
  std::mt19937_64 random(19);
  const double h = 2.5e-4;
  std::vector<ResponseRecord> records;
  for (const Index n : {80000, 60000}) {
    const ArrayXd u = noise(n, 1.0, random);
    const ArrayXd y = oscillator(u, 45.0, 0.03, h) - 0.5 * oscillator(u, 110.0, 0.05, h);
    records.push_back({{u}, y + noise(n, 0.02, random), {}});
  }
  const std::vector<FittedPole> modes = poles_shown(records, h);
  ASSERT_GE(modes.size(), 2u);
  const bool first = modes[0].omega < modes[1].omega;
  const FittedPole& low = modes[first ? 0 : 1];
  const FittedPole& high = modes[first ? 1 : 0];
  EXPECT_NEAR(low.omega / kTwoPi, 45.0, 4.0 * low.omega_deviation / kTwoPi);
  EXPECT_NEAR(low.zeta, 0.03, 4.0 * low.zeta_deviation + 0.002);  // the windows widen it
  EXPECT_NEAR(high.omega / kTwoPi, 110.0, 4.0 * high.omega_deviation / kTwoPi);
  EXPECT_NEAR(high.zeta, 0.05, 4.0 * high.zeta_deviation + 0.002);
  EXPECT_LT(low.omega_deviation / kTwoPi, 0.2);
  EXPECT_LT(high.omega_deviation / kTwoPi, 0.5);
  EXPECT_GT(modes[1].explains, 0.05);
  for (std::size_t i = 2; i < modes.size(); ++i) EXPECT_LT(modes[i].explains, 0.01);
}

TEST(ResponseModes, AreNoneWithoutExcitation) {
  std::mt19937_64 random(21);
  const std::vector<ResponseRecord> records{
      {{noise(20000, 1.0, random)}, noise(20000, 1.0, random), {}}};
  EXPECT_TRUE(poles_shown(records, kSampleTime_s).empty());
  const FittedResponse found = fit_response(records, kSampleTime_s);
  EXPECT_NE(found.declined, "");
  // Frequencies that are significant by chance are isolated.
  EXPECT_TRUE(found.response.channels[0].significant.any());
  EXPECT_TRUE(found.fitted.empty());
}

}  // namespace
}  // namespace servotwin
