// /metrics: the format, by a strict reader, and what the figures say.
#include "daemon/web/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <regex>
#include <set>

#include "tests/daemon/prometheus_text.h"

namespace servotwin::daemon {
namespace {

MetricsInput an_input() {
  MetricsInput input;
  input.machine = "a \"quoted\\ name\nin two lines";
  input.version = "1.2.3";
  input.live.status.frames = 12345678901ULL;
  input.live.status.lost = 3;
  input.live.status.not_recording = "there is no room";
  input.description.axes = {{"X", false, ""}, {"Y", false, ""}};
  input.live.status.axes = {{"X", 17, 1.5e-6, "", 2, ""}, {"Y", 0, kAbsent, "", 0, ""}};
  input.live.axes = {{{2e-3, 3e-3}, {1e-3, 2e-3}, {4e-8, 5e-7}}, {}};
  input.alarms = {AlarmState::kRaised, AlarmState::kLearning};
  input.recordings_bytes = 4096;
  input.store_damaged = true;
  BusStatus up, down;
  up.name = "can0";
  up.frames = 7000;
  up.missing = 2;
  down.name = "can1";
  down.up = false;
  down.dropped = 5;
  input.live.status.buses = {up, down};
  return input;
}

double one(const std::map<std::string, PrometheusFamily>& all, const std::string& name,
           const std::map<std::string, std::string>& labels = {}) {
  for (const PrometheusSample& sample : all.at(name).samples) {
    if (sample.labels == labels) return sample.value;
  }
  ADD_FAILURE() << name << " has no such sample";
  return 0.0;
}

TEST(Metrics, AreWhatAStrictReaderAccepts) {
  Histogram wake, work, published;
  published.add(3'000);
  MetricsInput input = an_input();
  input.wake = &wake;
  input.work = &work;
  input.published = &published;
  const auto all = read_prometheus(metrics_text(input));
  EXPECT_GE(all.size(), 30U);
  for (const auto& [name, family] : all) {
    EXPECT_TRUE(name.starts_with("servotwin_")) << name;
    EXPECT_FALSE(family.help.empty()) << name;
    EXPECT_EQ(family.type == "counter", name.ends_with("_total")) << name;
    EXPECT_FALSE(family.samples.empty()) << name;
  }
  EXPECT_EQ(one(all, "servotwin_build_info", {{"machine", input.machine}, {"version", "1.2.3"}}),
            1);
  EXPECT_EQ(one(all, "servotwin_frames_total"), 12345678901.0);
  EXPECT_EQ(one(all, "servotwin_frames_lost_total"), 3);
  EXPECT_EQ(one(all, "servotwin_recording_stopped"), 1);
  EXPECT_EQ(one(all, "servotwin_model_version", {{"axis", "X"}}), 17);
  EXPECT_EQ(one(all, "servotwin_bus_frames_total", {{"bus", "can0"}}), 7000);
  EXPECT_EQ(one(all, "servotwin_bus_messages_missing_total", {{"bus", "can0"}}), 2);
  EXPECT_EQ(one(all, "servotwin_bus_frames_dropped_total", {{"bus", "can1"}}), 5);
  EXPECT_EQ(one(all, "servotwin_bus_up", {{"bus", "can0"}}), 1);
  EXPECT_EQ(one(all, "servotwin_bus_up", {{"bus", "can1"}}), 0);
  const auto& latency = all.at("servotwin_publish_seconds").samples;
  EXPECT_EQ(latency.back().value, 1) << "its count";
  EXPECT_EQ(one(all, "servotwin_model_holdout_rms", {{"axis", "X"}}), 1.5e-6);
  EXPECT_TRUE(std::isnan(one(all, "servotwin_model_holdout_rms", {{"axis", "Y"}})));
  EXPECT_EQ(one(all, "servotwin_tracking_error_rms", {{"axis", "X"}}), 2e-3);
  EXPECT_EQ(one(all, "servotwin_residual_rms", {{"axis", "X"}}), 4e-8);
  EXPECT_EQ(one(all, "servotwin_recordings_bytes"), 4096);
  EXPECT_EQ(one(all, "servotwin_store_damaged"), 1);
  EXPECT_EQ(one(all, "servotwin_store_lost"), 0);
  EXPECT_EQ(one(all, "servotwin_alarm", {{"axis", "X"}, {"state", "raised"}}), 1);
  EXPECT_EQ(one(all, "servotwin_alarm", {{"axis", "X"}, {"state", "learning"}}), 0);
  EXPECT_EQ(one(all, "servotwin_alarm", {{"axis", "Y"}, {"state", "learning"}}), 1);
}

// examples/grafana: what a panel asks for is there, under that name and with those labels.
// tests/bench/dashboard.py asks a Prometheus that has scraped a daemon.
TEST(Metrics, AreThoseThatTheDashboardAsksFor) {
  Histogram wake, work, published;
  MetricsInput input = an_input();
  input.wake = &wake;
  input.work = &work;
  input.published = &published;
  const auto all = read_prometheus(metrics_text(input));
  std::ifstream file(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/grafana/servotwin.json");
  const auto dashboard = nlohmann::json::parse(file);
  std::set<int> ids;
  std::set<std::pair<int, int>> taken;  // cells of the grid
  std::set<std::string> asked;
  for (const auto& panel : dashboard.at("panels")) {
    EXPECT_TRUE(ids.insert(panel.at("id").get<int>()).second) << panel.at("id");
    const auto& place = panel.at("gridPos");
    for (int x = place.at("x"); x < place.at("x").get<int>() + place.at("w").get<int>(); ++x) {
      EXPECT_LT(x, 24);
      for (int y = place.at("y"); y < place.at("y").get<int>() + place.at("h").get<int>(); ++y)
        EXPECT_TRUE(taken.emplace(x, y).second) << panel.at("title") << " covers another panel";
    }
    if (panel.at("type") == "row") continue;
    EXPECT_FALSE(panel.at("description").get<std::string>().empty()) << panel.at("title");
    for (const auto& target : panel.at("targets")) {
      const std::string expression = target.at("expr");
      const std::regex of_metric("(servotwin_[a-z0-9_]+)\\{([^}]*)\\}");
      int metrics = 0;
      for (std::sregex_iterator at(expression.begin(), expression.end(), of_metric), end; at != end;
           ++at, ++metrics) {
        const std::string name =
            std::regex_replace((*at)[1].str(), std::regex("_bucket$"), std::string());
        asked.insert(name);
        ASSERT_TRUE(all.contains(name)) << name;
        const PrometheusSample& sample = all.at(name).samples.at(0);
        for (const char* label : {"axis", "bus", "state"}) {
          if ((*at)[2].str().find(std::string(label) + "=") != std::string::npos ||
              target.at("legendFormat").get<std::string>().find("{{" + std::string(label)) !=
                  std::string::npos) {
            EXPECT_TRUE(sample.labels.contains(label)) << name << ' ' << label;
          }
        }
        EXPECT_THAT((*at)[2].str(), testing::StartsWith("instance=\"$instance\"")) << expression;
      }
      EXPECT_GT(metrics, 0) << expression;
    }
  }
  EXPECT_GE(asked.size(), 20U);
}

TEST(Metrics, WithoutAMachineHaveNoAxesAndNoHistogram) {
  const auto all = read_prometheus(metrics_text({}));
  EXPECT_FALSE(all.contains("servotwin_wake_seconds"));
  EXPECT_TRUE(all.at("servotwin_model_version").samples.empty());
}

// Every bucket holds exactly the values below its limit: counted here one by one.
TEST(Metrics, HistogramsHoldWhatWentIn) {
  std::mt19937_64 rng{7};
  std::uniform_real_distribution<double> decade(1.0, 10.5);
  Histogram work;
  std::vector<std::int64_t> values;
  double sum_s = 0.0;
  for (int i = 0; i < 5000; ++i) {
    values.push_back(static_cast<std::int64_t>(std::pow(10.0, decade(rng))));
    work.add(values.back());
    sum_s += 1e-9 * static_cast<double>(values.back());
  }
  MetricsInput input;
  input.work = &work;
  const auto all = read_prometheus(metrics_text(input));
  const PrometheusFamily& family = all.at("servotwin_work_seconds");
  EXPECT_EQ(family.type, "histogram");
  double before = 0.0, count = 0.0;
  int buckets = 0;
  for (const PrometheusSample& sample : family.samples) {
    if (sample.name.ends_with("_bucket")) {
      ++buckets;
      const std::string& le = sample.labels.at("le");
      const double limit_s = le == "+Inf" ? std::numeric_limits<double>::infinity() : std::stod(le);
      EXPECT_EQ(sample.value,
                static_cast<double>(std::count_if(
                    values.begin(), values.end(),
                    [&](std::int64_t v) { return static_cast<double>(v) < limit_s * 1e9; })))
          << le;
      EXPECT_GE(sample.value, before);
      before = sample.value;
    } else if (sample.name.ends_with("_count")) {
      count = sample.value;
    } else {
      EXPECT_NEAR(sample.value, sum_s, 1e-9 * sum_s);
    }
  }
  EXPECT_EQ(buckets, 22);
  EXPECT_EQ(count, 5000.0);
  EXPECT_EQ(before, count);
}

}  // namespace
}  // namespace servotwin::daemon
