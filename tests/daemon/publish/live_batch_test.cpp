// Batches of live cycles: nothing is lost in them, whatever the rate.
#include "daemon/publish/live_batch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <random>

#include "daemon/publish/live_feed.h"
#include "daemon/web/live_json.h"

namespace servotwin::daemon {
namespace {

MachinePrediction cycle(std::uint64_t sequence, int axes, double measured) {
  MachinePrediction out;
  out.sequence = sequence;
  out.time_ns = static_cast<std::int64_t>(sequence) * 1'000'000;
  out.axis_count = axes;
  for (int i = 0; i < axes; ++i) {
    AxisPrediction& axis = out.axes[static_cast<std::size_t>(i)];
    axis.command = static_cast<double>(sequence) + i;
    axis.measured_error = measured;
    axis.model_version = 3;
    axis.state = AxisState::kPredicting;
  }
  return out;
}

TEST(LiveBatch, AtOneKilohertzAPointIsACycle) {
  LiveBatcher batcher(1e-3, 2);
  std::vector<LiveBatch> batches;
  for (std::uint64_t k = 100; k < 300; ++k) {
    if (auto batch = batcher.add(cycle(k, 2, 1e-6 * static_cast<double>(k))))
      batches.push_back(*batch);
  }
  ASSERT_EQ(batches.size(), 4U);
  EXPECT_TRUE(batches[0].after_gap);
  EXPECT_FALSE(batches[1].after_gap);
  std::uint64_t next = 100;
  for (const LiveBatch& batch : batches) {
    EXPECT_EQ(batch.first_sequence, next);
    EXPECT_EQ(batch.first_time_ns, static_cast<std::int64_t>(next) * 1'000'000);
    EXPECT_EQ(batch.cycles_per_point, 1);
    EXPECT_EQ(batch.point_s, 1e-3);
    ASSERT_EQ(batch.axes[1].command.value.size(), 50U);
    EXPECT_TRUE(batch.axes[1].command.least.empty());
    for (const double command : batch.axes[1].command.value)
      EXPECT_EQ(command, static_cast<double>(next++) + 1);
    EXPECT_EQ(batch.axes[0].model_version, 3);
  }
}

// The peak of a single cycle appears in the minimum or maximum of its point.
TEST(LiveBatch, BeyondThatNoPeakIsLost) {
  constexpr int kAxes = 32;
  constexpr double kFast_s = 0.25e-3;
  std::mt19937_64 rng{3};
  std::uniform_real_distribution<double> error(-1.0, 1.0);
  LiveBatcher batcher(kFast_s, kAxes);
  std::vector<double> in;
  double points = 0;
  for (std::uint64_t k = 0; k < 4000; ++k) {
    in.push_back(error(rng));
    const auto batch = batcher.add(cycle(k, kAxes, in.back()));
    if (!batch) continue;
    const LiveSeries& series = batch->axes[31].measured;
    const auto per_point = static_cast<std::size_t>(batch->cycles_per_point);
    EXPECT_NEAR(batch->point_s, kFast_s * batch->cycles_per_point, 1e-15);
    for (std::size_t i = 0; i < series.value.size(); ++i) {
      const auto begin =
          in.begin() + static_cast<std::ptrdiff_t>(batch->first_sequence + i * per_point);
      const auto end = begin + static_cast<std::ptrdiff_t>(per_point);
      ASSERT_EQ(series.least[i], *std::min_element(begin, end));
      ASSERT_EQ(series.greatest[i], *std::max_element(begin, end));
      ASSERT_EQ(series.value[i], *(end - 1));
    }
    points += kAxes * static_cast<double>(series.value.size());
  }
  EXPECT_LE(points, LiveBatcher::kMaxPointsPerSecond * 1.001);  // of one second
  EXPECT_GT(points, 0.9 * LiveBatcher::kMaxPointsPerSecond);
}

TEST(LiveBatch, EndsWhereACycleIsMissing) {
  LiveBatcher batcher(1e-3, 1);
  for (std::uint64_t k = 0; k < 10; ++k) EXPECT_FALSE(batcher.add(cycle(k, 1, 0.0)));
  const auto before = batcher.add(cycle(12, 1, 0.0));
  ASSERT_TRUE(before);
  EXPECT_EQ(before->axes[0].command.value.size(), 10U);
  const auto after = batcher.flush();
  ASSERT_TRUE(after);
  EXPECT_TRUE(after->after_gap);
  EXPECT_EQ(after->first_sequence, 12U);
  EXPECT_FALSE(batcher.flush());
  EXPECT_FALSE(batcher.add(cycle(13, 1, 0.0)));
  EXPECT_FALSE(batcher.flush()->after_gap);
}

TEST(LiveJson, IsJsonWithNullWhereThereIsNoNumber) {
  LiveBatcher batcher(1e-3, 1);
  batcher.add(cycle(7, 1, 1.25e-6));
  const auto batch = nlohmann::json::parse(batch_json(*batcher.flush()));
  EXPECT_EQ(batch["schema"], "servotwin.live/1");
  EXPECT_EQ(batch["first_sequence"], 7);
  EXPECT_EQ(batch["axes"][0]["measured"][0], 1.25e-6);
  EXPECT_TRUE(batch["axes"][0]["predicted"][0].is_null());
  EXPECT_TRUE(batch["contour"][0].is_null());
  EXPECT_EQ(batch["axes"][0]["state"], "predicting");
}

TEST(LiveFeed, FiguresAreOfWhatCameSinceTheStatusBefore) {
  LiveFeed feed(1e-3, 1);
  feed.add(cycle(0, 1, 3e-6));
  feed.add(cycle(1, 1, -4e-6));
  feed.add(MachineStatus{});
  LiveFeed::News news = feed.take();
  ASSERT_TRUE(news.status);
  EXPECT_DOUBLE_EQ(news.status->axes[0].measured.rms, std::sqrt(12.5) * 1e-6);
  EXPECT_EQ(news.status->axes[0].measured.max, 4e-6);
  EXPECT_TRUE(std::isnan(news.status->axes[0].residual.rms));
  ASSERT_EQ(news.batches.size(), 1U);
  feed.add(MachineStatus{});
  news = feed.take();
  EXPECT_TRUE(std::isnan(news.status->axes[0].measured.rms));
  EXPECT_TRUE(news.batches.empty());
}

TEST(LiveFeed, WhatNobodyTakesIsDroppedAndCounted) {
  LiveFeed feed(1e-3, 1);
  constexpr std::size_t kBatches = LiveFeed::kMaxWaitingBatches + 5;
  for (std::uint64_t k = 0; k < 50 * kBatches; ++k) feed.add(cycle(k, 1, 0.0));
  const LiveFeed::News news = feed.take();
  EXPECT_EQ(news.batches.size(), LiveFeed::kMaxWaitingBatches);
  EXPECT_EQ(news.dropped, 5U);
  EXPECT_EQ(news.batches.front().first_sequence, 50U * 5U);
  EXPECT_EQ(feed.take().dropped, 5U);
}

}  // namespace
}  // namespace servotwin::daemon
