// The Bode plot of a frequency response: which points are drawn and which are left out.
#include "diagnosis/report/bode.h"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

namespace servotwin {
namespace {

/// White noise through a delay of 40 samples at 1 kHz, and noise of the output.
FrequencyResponse delayed(double noise) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Eigen::ArrayXd u(20000), y(20000);
  for (double& x : u) x = normal(random);
  for (Eigen::Index k = 0; k < y.size(); ++k)
    y(k) = (noise < 1e3 && k >= 40 ? u(k - 40) : 0.0) + noise * normal(random);
  return frequency_response(std::vector<ResponseRecord>{{{u}, y, {}}}, 1e-3, {.window_s = 1.0});
}

TEST(Bode, ThePhaseHasNoJumpsAndTheModelLiesOnIt) {
  const FrequencyResponse measured = delayed(0.05);
  ModelledResponse model{"model", {}, {}};
  for (double hz = 200.0; hz < 400.0; hz += 1.0) {
    model.frequency_hz.push_back(hz);
    model.response.push_back(measured.channels[0].response(static_cast<Eigen::Index>(hz) - 1));
  }
  // A model that begins at a frequency where the measured phase has passed many revolutions.
  const std::vector<PlotPanel> panels = bode_panels(measured, {"u"}, "y", {model});
  ASSERT_EQ(panels.size(), 3u);
  EXPECT_EQ(panels[0].title, "u to y");
  ASSERT_EQ(panels[1].series.size(), 2u);
  const PlotSeries& phase = panels[1].series[0];
  EXPECT_NEAR(phase.y[398], -360.0 * 0.04 * 399.0, 15.0);
  EXPECT_NEAR(panels[1].series[1].y[10], phase.y[209], 1.0);
  // Decibels, and a band of 1.96 standard deviations: 10 % are 0.87 dB.
  const double size = std::abs(measured.channels[0].response(50));
  EXPECT_NEAR(panels[0].series[0].y[50], 20.0 * std::log10(size), 1e-9);
  EXPECT_NEAR(panels[0].series[0].error[50],
              8.685889638 * 1.96 * measured.channels[0].deviation(50) / size, 1e-6);
}

TEST(Bode, OfSeveralInputsEveryModelHasTheColourOfItsInput) {
  FrequencyResponse measured = delayed(0.05);
  measured.channels.push_back(measured.channels[0]);
  measured.channels[0].significant.setConstant(false);
  const ModelledResponse one{"one, fit", {10.0, 20.0}, {1.0, 2.0}}, other{"", {10.0}, {3.0}};
  const std::vector<PlotPanel> panels = bode_panels(measured, {"one", "other"}, "y", {one, other});
  ASSERT_EQ(panels.size(), 3u);
  // The first input has no significant response: its model is drawn all the same.
  const auto& series = panels[0].series;
  ASSERT_EQ(series.size(), 3u);
  EXPECT_EQ(series[0].name, "other");
  EXPECT_EQ(series[1].name, "one, fit");
  EXPECT_EQ(series[1].colour, plot_colour(0));
  EXPECT_EQ(series[2].colour, plot_colour(1));
  EXPECT_EQ(series[0].colour, series[2].colour);
  EXPECT_FALSE(series[0].dashed);
  EXPECT_TRUE(series[1].dashed && series[2].dashed);
  // No measured response is significant, and there is no model.
  EXPECT_EQ(bode_panels({}, {"one", "other"}, "y", {one, other})[0].series.size(), 2u);
}

TEST(Bode, WhatSaysNothingIsNotDrawn) {
  const std::vector<PlotPanel> panels = bode_panels(delayed(1e3), {"u"}, "y");
  ASSERT_EQ(panels.size(), 1u);
  EXPECT_EQ(panels[0].title, "coherence");
}

}  // namespace
}  // namespace servotwin
