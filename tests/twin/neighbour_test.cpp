// Two axes that push each other, predicted from their commands alone. The truth is the sinusoidal
// steady state of the pair of linear loops, in closed form.
#include "twin/neighbour.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <stdexcept>
#include <string>

#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using Complex = std::complex<double>;

constexpr double kH = 1e-3, kEnd_s = 10.0;

/// s^2 + a1 s + a2 without feed-forward, pushed by `ratio` times the other's acceleration.
Model axis(double hz, double zeta, double ratio) {
  Model model;
  model.sample_time_s = kH;
  const double w = kTwoPi * hz;
  model.loop.order = 2;
  model.loop.denominator = {2.0 * zeta * w, w * w, 0.0};
  model.loop.numerator = {1.0, 2.0 * zeta * w, 0.0};
  if (ratio != 0.0) {
    model.effects.push_back(make_effect<CrossCouplingByMotion>());
    model.effects.back().coefficient[0] = ratio;
  }
  return model;
}

struct Pair {
  std::array<double, 2> hz{12.0, 7.0}, zeta{0.5, 0.8}, ratio{}, command_hz{5.0, 3.0},
      amplitude{0.01, 0.02};

  [[nodiscard]] Model model(std::size_t i) const { return axis(hz[i], zeta[i], ratio[i]); }
  [[nodiscard]] Eigen::ArrayXd command(std::size_t i) const {
    const auto n = static_cast<Eigen::Index>(kEnd_s / kH);
    const Eigen::ArrayXd t = kH * Eigen::ArrayXd::LinSpaced(n, 0.0, static_cast<double>(n - 1));
    return amplitude[i] * (kTwoPi * command_hz[i] * t).sin();
  }
  /// The tracking errors once the start has decayed:
  ///   P_i e_i = s N_i x_ri + ratio_i s^2 (x_rj - e_j)
  [[nodiscard]] std::array<Eigen::ArrayXd, 2> truth() const {
    const auto n = static_cast<Eigen::Index>(kEnd_s / kH);
    std::array<Eigen::ArrayXd, 2> out{Eigen::ArrayXd::Zero(n), Eigen::ArrayXd::Zero(n)};
    for (std::size_t source = 0; source < 2; ++source) {
      const Complex s(0.0, kTwoPi * command_hz[source]);
      std::array<Complex, 2> p, by_command;
      for (std::size_t i = 0; i < 2; ++i) {
        const Loop loop = model(i).loop;
        p[i] = s * s + loop.denominator[0] * s + loop.denominator[1];
        by_command[i] =
            i == source ? s * (loop.numerator[0] * s + loop.numerator[1]) : ratio[i] * s * s;
      }
      const Complex q0 = ratio[0] * s * s, q1 = ratio[1] * s * s;
      const Complex determinant = p[0] * p[1] - q0 * q1;
      const std::array<Complex, 2> error{(p[1] * by_command[0] - q0 * by_command[1]) / determinant,
                                         (p[0] * by_command[1] - q1 * by_command[0]) / determinant};
      for (std::size_t i = 0; i < 2; ++i) {
        for (Eigen::Index k = 0; k < n; ++k)
          out[i](k) +=
              amplitude[source] * (error[i] * std::exp(s * (kH * static_cast<double>(k)))).imag();
      }
    }
    return out;
  }
  /// Of axis i, by its model and that of the other one, from the commands alone.
  [[nodiscard]] Eigen::ArrayXd predicted(std::size_t i) const {
    Segment segment;
    segment.sample_time_s = kH;
    segment.command = command(i);
    segment.neighbour = command(1 - i);
    predict_neighbour(segment, model(i), model(1 - i), ratio[1 - i] != 0.0);
    return simulate(model(i), segment);
  }
};

double rms_of_end(const Eigen::ArrayXd& x) {
  return std::sqrt(x.tail(x.size() / 2).square().mean());
}

TEST(Neighbour, ThatIsNotPushedBackMovesAsItsOwnModelSays) {
  Pair pair;
  pair.ratio = {0.3, 0.0};
  const Eigen::ArrayXd truth = pair.truth()[0];
  EXPECT_LT(rms_of_end(pair.predicted(0) - truth), 2e-4 * rms_of_end(truth));
  // By its command, which it lags, the force is another one.
  Segment by_command;
  by_command.sample_time_s = kH;
  by_command.command = pair.command(0);
  by_command.neighbour = pair.command(1);
  EXPECT_GT(rms_of_end(simulate(pair.model(0), by_command) - truth), 0.05 * rms_of_end(truth));
}

TEST(Neighbour, AxesThatPushEachOtherArePredictedTogether) {
  Pair pair;
  pair.ratio = {0.13, 0.04};
  // X vibrates at the frequency of the command of Y, where turns converge slowly.
  pair.zeta[0] = 0.03;
  pair.command_hz[1] = pair.hz[0];
  const auto truth = pair.truth();
  for (std::size_t i = 0; i < 2; ++i)
    EXPECT_LT(rms_of_end(pair.predicted(i) - truth[i]), 2e-4 * rms_of_end(truth[i])) << i;
}

TEST(Neighbour, AxesThatPushEachOtherTooStronglyAreRefused) {
  Pair pair;
  pair.hz = {12.0, 11.0};
  pair.zeta = {0.05, 0.05};
  pair.ratio = {0.2, 0.2};
  EXPECT_THROW((void)pair.predicted(0), std::invalid_argument);
}

TEST(Neighbour, AModelIsPushedByOneAxis) {
  Model model = axis(12.0, 0.5, 0.3);
  EXPECT_EQ(why_invalid(model), "");
  model.effects.push_back(make_effect<CrossCoupling>());
  EXPECT_NE(why_invalid(model).find("one other axis"), std::string::npos);
}

TEST(Neighbour, IsLeftAsItIsWithoutACommand) {
  Segment segment;
  segment.sample_time_s = kH;
  segment.command = Pair().command(0);
  predict_neighbour(segment, axis(12.0, 0.5, 0.3), axis(7.0, 0.8, 0.0), false);
  EXPECT_EQ(segment.neighbour_motion.size(), 0);
  EXPECT_EQ(neighbour_acceleration(segment, true).size(), 0);
}

// What is measured begins within a motion, and so does the prediction.
TEST(Neighbour, APredictionBeginsWithinTheMeasuredMotion) {
  Pair pair;
  pair.ratio = {0.3, 0.0};
  const auto truth = pair.truth();
  const Eigen::Index from = 2511, size = 3000;
  Segment segment;
  segment.start_s = kH * static_cast<double>(from);
  segment.sample_time_s = kH;
  segment.command = pair.command(0).segment(from, size);
  segment.actual = segment.command - truth[0].segment(from, size);
  segment.neighbour = pair.command(1).segment(from, size);
  const Eigen::ArrayXd moved = segment.neighbour - truth[1].segment(from, size);
  segment.neighbour_motion = moved;
  predict_neighbour(segment, pair.model(0), pair.model(1), false);
  constexpr double kSame = 5e-7;  // of an amplitude of 0.02
  EXPECT_LT((segment.neighbour_motion - moved).abs().maxCoeff(), kSame);
  EXPECT_LT((simulate(pair.model(0), segment) - truth[0].segment(from, size)).abs().maxCoeff(),
            kSame);
}

}  // namespace
}  // namespace servotwin
