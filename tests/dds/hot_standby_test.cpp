// Two daemons of one machine: one is active, and when it dies the other takes over.
#include <gmock/gmock.h>

#include <cstdio>
#include <map>

#include "daemon/between/clock.h"
#include "tests/daemon/http_client.h"
#include "tests/dds/support.h"

namespace servotwin::test {
namespace {

TEST(HotStandby, OneStreamIsHeardAndGoesOnWhenTheStrongerDaemonIsKilled) {
  const DdsPlace place = place_of("standby");
  const Home strong_home(place, daemon::drive(), 10, "of the strong one"),
      weak_home(place, daemon::drive(), 1, "of the standby");
  const DdsNode node(place);
  DdsWriter<MachineFrame> frames(node);
  DdsReader<MachinePrediction> predictions(node);
  DdsReader<ModelAnnouncement> models(node);
  auto strong = std::make_unique<Process>(strong_home.daemon());
  Process weak(weak_home.daemon());
  ASSERT_TRUE(frames.wait_for_readers(2, kPatience_s));
  ASSERT_TRUE(weak.says("standby: another daemon is active")) << weak.said();
  // Both daemons write predictions from now on, and only one of them may be received.
  std::map<std::uint64_t, dds_instance_handle_t> writer_of;
  std::map<dds_instance_handle_t, int> heard;
  std::int64_t last_ns = 0, longest_ns = 0;
  MachinePrediction prediction;
  const auto listen = [&] {
    while (predictions.receive(prediction, 0.0)) {
      const auto [seen, first] = writer_of.emplace(prediction.sequence, predictions.writer());
      EXPECT_TRUE(first || seen->second == predictions.writer())
          << "cycle " << prediction.sequence << " from two daemons";
      ++heard[predictions.writer()];
      const std::int64_t now_ns = daemon::steady_ns();
      if (last_ns != 0) longest_ns = std::max(longest_ns, now_ns - last_ns);
      last_ns = now_ns;
    }
  };
  // A reader knows the stronger daemon from its first prediction on: until then it may receive
  // those of the other one, and a cycle twice.
  std::uint64_t k = send_until(frames, 0, [&] {
    while (predictions.receive(prediction, 0.0)) ++heard[predictions.writer()];
    return !heard.empty() && heard.begin()->second + heard.rbegin()->second >= 200;
  });
  while (predictions.receive(prediction, 0.1)) {
  }
  heard.clear();
  k = send_until(frames, k, [&] {
    listen();
    return writer_of.size() >= 1000;
  });
  ASSERT_EQ(heard.size(), 1U) << "one of the two";
  const dds_instance_handle_t first = heard.begin()->first;

  longest_ns = 0;
  ASSERT_EQ(strong->end(SIGKILL), 128 + SIGKILL);
  k = send_until(frames, k, [&] {
    listen();
    return heard.size() > 1 && heard.rbegin()->second + heard.begin()->second > heard[first] + 500;
  });
  ASSERT_EQ(heard.size(), 2U);
  std::printf("gap at kill -9: %.0f ms, with a lease of %.0f ms\n",
              1e-6 * static_cast<double>(longest_ns), 1e-6 * kLivelinessLease_ns);

  EXPECT_TRUE(weak.says("this daemon is now active for the machine")) << weak.said();
  ModelAnnouncement model;
  do {
    ASSERT_TRUE(models.receive(model, kPatience_s)) << "the standby's model is never heard";
  } while (model.reason != "of the standby");

  // When the stronger daemon is back, it takes over and may repeat some cycles of the standby.
  const auto standbys = [&] {
    int count = 0;
    const std::string& said = weak.said();
    for (std::size_t at = 0; (at = said.find("standby: ", at)) != std::string::npos; ++at) ++count;
    return count;
  };
  strong = std::make_unique<Process>(strong_home.daemon());
  send_until(frames, k, [&] {
    while (predictions.receive(prediction, 0.0)) ++heard[predictions.writer()];
    return standbys() == 2 && heard.size() == 3;
  });
  EXPECT_EQ(strong->end(SIGTERM), 0);
  EXPECT_EQ(weak.end(SIGTERM), 0);
}

/// Asks a daemon with this token to be armed.
daemon::HttpAnswer arm(Process& daemon, const std::string& token) {
  const std::string at = "page at http://127.0.0.1:";
  for (const std::string& line : {at, std::string("X: model 1 is in force again")})
    EXPECT_TRUE(daemon.says(line)) << daemon.said();
  const auto port = static_cast<std::uint16_t>(
      std::stoi(daemon.said().substr(daemon.said().find(at) + at.size())));
  return daemon::ask(port, "POST", "/api/v1/offsets/arm",
                     "Authorization: Bearer " + token + "\r\n");
}

// Drives would hear its offsets from the middle of a run on.
TEST(HotStandby, IsDisarmedAndNotArmedUntilItIsActive) {
  const DdsPlace place = place_of("arming");
  const std::string token = "a token of the test";
  const std::string rest =
      "[http]\nlisten = '127.0.0.1:0'\ntoken = '" + token + "'\n[ilc]\nlive = true\n";
  const Home strong_home(place, daemon::drive(), 10, "of the strong one", rest),
      weak_home(place, daemon::drive(), 1, "of the standby", rest);
  Process weak(weak_home.daemon());
  ASSERT_EQ(arm(weak, token).status, 200) << weak.said();
  Process strong(strong_home.daemon());
  ASSERT_TRUE(weak.says("standby: another daemon is active")) << weak.said();
  EXPECT_TRUE(weak.says("disarmed: offsets are not sent to drives")) << weak.said();
  const daemon::HttpAnswer refused = arm(weak, token);
  EXPECT_EQ(refused.status, 409);
  EXPECT_THAT(refused.body, testing::HasSubstr("standby: another daemon is active"));
  EXPECT_EQ(arm(strong, token).status, 200) << strong.said();
  ASSERT_EQ(strong.end(SIGKILL), 128 + SIGKILL);
  ASSERT_TRUE(weak.says("this daemon is now active for the machine")) << weak.said();
  EXPECT_EQ(arm(weak, token).status, 200) << weak.said();
  EXPECT_EQ(weak.end(SIGTERM), 0);
}

}  // namespace
}  // namespace servotwin::test
