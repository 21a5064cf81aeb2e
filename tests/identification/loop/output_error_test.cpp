// Leave-one-block-out models by one step, against refits in free simulation.
#include "identification/loop/output_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "identification/loop/identify.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

/// An axis with presliding friction that moves back and forth by various distances.
Segment recorded(const Model& model, double noise_m) {
  Segment s;
  s.sample_time_s = model.sample_time_s;
  s.command.resize(8000);
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    const double t = s.sample_time_s * static_cast<double>(k);
    s.command(k) = 0.02 * std::sin(2.0 * std::numbers::pi * 0.4 * t) * std::min(1.0, t) +
                   0.003 * std::sin(2.0 * std::numbers::pi * 1.7 * t) * std::min(1.0, t);
  }
  const Eigen::ArrayXd error = simulate(model, s);
  std::mt19937_64 rng{11};
  std::normal_distribution<double> noise(0.0, noise_m);
  s.actual = s.command - error;
  for (double& value : s.actual) value += noise(rng);
  return s;
}

TEST(LeftOut, OneStepGainsMostOfWhatARefitToTheOtherBlocksGains) {
  constexpr double kNoise_m = 3e-7;
  constexpr int kBlocks = 4;
  Model truth;
  truth.sample_time_s = 1e-3;
  truth.loop.order = 3;
  truth.loop.denominator = {200.0, 15000.0, 400000.0};
  truth.loop.numerator = {0.6, 90.0, 2000.0};
  Effect friction = make_effect<Presliding>();
  friction.coefficient[0] = 0.3;
  truth.effects = {friction};
  ASSERT_EQ(why_invalid(truth), "");
  const std::vector<Segment> all{recorded(truth, kNoise_m)};
  Structure structure;
  structure.effects = {friction.kind};
  const OutputErrorOptions exact{0.0, 40, 1e-12};
  const auto fit = output_error(all, structure, truth, exact);
  ASSERT_TRUE(fit);

  std::vector<std::vector<Segment>> blocks;
  for (int b = 0; b < kBlocks; ++b) blocks.push_back(cut(all, 2.0 * b, 2.0 * (b + 1) - 1e-9));
  const std::vector<Model> models = left_out(blocks, structure, fit->model, 0.0);
  ASSERT_EQ(models.size(), blocks.size());
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    std::vector<Segment> rest;
    for (std::size_t other = 0; other < blocks.size(); ++other) {
      if (other != b) rest.push_back(blocks[other].front());
    }
    const auto refit = output_error(rest, structure, fit->model, exact);
    ASSERT_TRUE(refit);
    const auto cost = [&](const Model& model) {
      double sum = 0.0;
      for (const Segment& s : rest) {
        const Eigen::Index count = s.size() - starting_state_samples(fit->model, s);
        sum += (s.command - s.actual - simulate(model, s)).tail(count).square().sum();
      }
      return sum;
    };
    const double before = cost(fit->model), gained = before - cost(refit->model);
    EXPECT_GT(gained, 1e-5 * before) << "the block has something to say";
    EXPECT_GT(before - cost(models[b]), 0.5 * gained) << b;
  }
}

// Friction is held a tenth too high: the loop is fitted beside it.
TEST(OutputError, AnEffectThatIsHeldStaysToTheLastBit) {
  Model truth;
  truth.sample_time_s = 1e-3;
  truth.loop.order = 3;
  truth.loop.denominator = {200.0, 15000.0, 400000.0};
  truth.loop.numerator = {0.6, 90.0, 2000.0};
  Effect friction = make_effect<Presliding>(), ripple = make_effect<Cogging>();
  friction.coefficient[0] = 0.3;
  ripple.coefficient[0] = 0.05;
  truth.effects = {friction, ripple};
  const std::vector<Segment> all{recorded(truth, 3e-7)};
  Structure structure;
  structure.effects = {friction.kind, ripple.kind};
  Model off = truth;
  off.loop.numerator[1] = 95.0;
  off.effects[0].coefficient[0] = 0.33;
  off.effects[1].coefficient[0] = 0.0;
  OutputErrorOptions options;
  options.held.effects = {0};
  const auto fit = output_error(all, structure, off, options);
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->model.effects[0].coefficient, off.effects[0].coefficient);
  EXPECT_EQ(fit->model.effects[0].shape, off.effects[0].shape);
  EXPECT_NEAR(fit->model.effects[1].coefficient[0], 0.05, 0.01);
  EXPECT_NE(fit->model.loop.numerator[1], 95.0);
  options.held = {};
  const auto free = output_error(all, structure, off, options);
  ASSERT_TRUE(free);
  EXPECT_NEAR(free->model.effects[0].coefficient[0], 0.3, 0.003);
  EXPECT_LT(2.0 * free->minus_log_likelihood, 2.0 * fit->minus_log_likelihood - 100.0);
}

TEST(LeftOut, ABlockWithoutSamplesAndAnInvalidModelChangeNothing) {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop.denominator = {200.0, 15000.0, 400000.0};
  model.loop.numerator = {0.6, 90.0, 2000.0};
  const Segment s = recorded(model, 3e-7);
  Model off = model;
  off.loop.numerator[0] = 0.65;
  const std::vector<Model> models = left_out({{s}, {}}, {}, off, 0.0);
  ASSERT_EQ(models.size(), 2U);
  EXPECT_NEAR(models[1].loop.numerator[0], 0.6, 0.01) << "from the block that has samples";
  EXPECT_EQ(models[0].loop.numerator[0], 0.65) << "there is no other block";
  Model unstable = model;
  unstable.loop.denominator[0] = -1.0;
  EXPECT_EQ(left_out({{s}}, {}, unstable, 0.0).front().loop.denominator[0], -1.0);
}

}  // namespace
}  // namespace servotwin
