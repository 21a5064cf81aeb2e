// The example subscribers, and how silence of machine or daemon is reported.
#include <gmock/gmock.h>

#include <cstdio>

#include "tests/dds/support.h"
#include "twin/twin.h"

namespace servotwin::test {
namespace {

using testing::HasSubstr;
using testing::Not;

/// The prediction of the twin alone for cycle k.
double predicted(std::uint64_t k) {
  Twin twin(daemon::drive());
  twin.start(command_of(0));
  double error = command_of(0) - twin.position();
  for (std::uint64_t i = 1; i <= k; ++i) error = twin.follow(command_of(i));
  return error;
}

std::string line_of(std::uint64_t k, const char* axis, double error) {
  char text[100];
  std::snprintf(text, sizeof text, "cycle %llu: %s %.3f um,", static_cast<unsigned long long>(k),
                axis, error / 1e-6);
  return text;
}

class Subscriber : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(Subscriber, PrintsThePredictionsAndSaysThatTheDaemonIsGoneAndBack) {
  const auto& [program, axis] = GetParam();
  const DdsPlace place = place_of("subscriber");
  const Home home(place, daemon::drive());
  const DdsNode node(place);
  DdsWriter<MachineFrame> frames(node);
  DdsReader<MachineStatus> statuses(node);
  auto daemon = std::make_unique<Process>(home.daemon());
  Process subscriber({program, place.machine, std::to_string(place.domain), "0.5"});
  ASSERT_TRUE(frames.wait_for_readers(1, kPatience_s)) << daemon->said();
  MachineStatus status;
  while (status.axes.empty()) ASSERT_TRUE(statuses.receive(status, kPatience_s));
  const std::uint64_t k =
      send_until(frames, 0, [&] { return subscriber.said().find("cycle ") != std::string::npos; });
  DdsReader<MachinePrediction> predictions(node);
  // Samples written before discovery are not received.
  MachinePrediction prediction;
  std::uint64_t first = k;
  while (!predictions.receive(prediction, 0.05)) {
    ASSERT_LT(first, k + 1000) << daemon->said();
    frames.write(frame_of(first++));
  }
  const std::uint64_t last = first + 500;
  for (std::uint64_t i = first; i <= last; ++i) {
    frames.write(frame_of(i));
    do {
      ASSERT_TRUE(predictions.receive(prediction, kPatience_s)) << i;
    } while (prediction.sequence < i);
  }
  // It may have missed the first frames, and has forgotten that.
  EXPECT_NEAR(prediction.axes[0].predicted_error, predicted(last), 1e-9);
  EXPECT_TRUE(subscriber.says(line_of(last, axis, prediction.axes[0].predicted_error)))
      << subscriber.said();
  EXPECT_THAT(subscriber.said(), HasSubstr(" contour "));

  ASSERT_EQ(daemon->end(SIGKILL), 128 + SIGKILL);
  EXPECT_TRUE(subscriber.says("silent: no prediction for more than 0.5 s")) << subscriber.said();
  EXPECT_TRUE(subscriber.says("gone: no daemon is there")) << subscriber.said();

  daemon = std::make_unique<Process>(home.daemon());
  send_until(frames, last + 1,
             [&] { return subscriber.said().find("again after ") != std::string::npos; });
  const std::string said = subscriber.said();  // no frames from here on: silence again
  EXPECT_EQ(said.find("silent:"), said.rfind("silent:")) << "said once";
  EXPECT_EQ(subscriber.end(SIGTERM), 0);
  EXPECT_EQ(daemon->end(SIGTERM), 0);
}

TEST_P(Subscriber, GivesARotaryAxisInItsUnit) {
  const DdsPlace place = place_of("rotary");
  daemon::TemporaryDirectory directory;
  std::ofstream(directory.path() / "m.toml")
      << "[machine]\nname = '" << place.machine << "'\ncycle_s = 0.001\n[[axis]]\nname = 'X'\n"
      << "[[axis]]\nname = 'C'\nunits = 'rad'\n[dds]\ndomain = " << place.domain
      << "\n[store]\ndirectory = '" << (directory.path() / "store").string()
      << "'\n[http]\nlisten = 'none'\n[real_time]\npriority = 0\n";
  const DdsNode node(place);
  DdsWriter<MachineFrame> frames(node);
  Process daemon({"servotwind", "--config", directory.path() / "m.toml"});
  Process subscriber({GetParam().first, place.machine, std::to_string(place.domain)});
  ASSERT_TRUE(frames.wait_for_readers(1, kPatience_s)) << daemon.said();
  MachineFrame frame;
  frame.axis_count = 2;
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (subscriber.said().find(" urad, contour ") == std::string::npos) {
    ASSERT_LT(std::chrono::steady_clock::now(), until) << subscriber.said();
    ++frame.sequence;
    frame.time_ns += 1'000'000;
    frames.write(frame);
    dds_sleepfor(DDS_MSECS(5));
  }
  const std::string last = subscriber.said().substr(0, subscriber.said().rfind(" urad, contour "));
  EXPECT_THAT(last.substr(last.rfind("cycle ")), HasSubstr(" um,")) << "X is linear";
}

TEST_P(Subscriber, RefusesADomainThatIsNone) {
  for (const char* wrong : {"x", "", "12a", "-1"}) {
    Process subscriber({GetParam().first, "mill", wrong});
    EXPECT_EQ(subscriber.end(0), 2) << wrong;
    EXPECT_THAT(subscriber.said(),
                HasSubstr(std::string("DOMAIN = '") + wrong + "': must be a whole number"));
  }
}

INSTANTIATE_TEST_SUITE_P(, Subscriber,
                         testing::Values(std::pair{"servotwin-subscriber", "X"},
                                         std::pair{"servotwin-subscriber-c", "axis 1"}),
                         [](const auto& one) {
                           return one.index == 0 ? std::string("InCpp") : std::string("InC");
                         });

TEST(Silence, OfTheMachineIsToldOnceAndItsEndWithItsLength) {
  const DdsPlace place = place_of("silence");
  const Home home(place, daemon::drive());
  const DdsNode node(place);
  DdsReader<MachineStatus> statuses(node);
  DdsReader<MachinePrediction> predictions(node);
  Process daemon(home.daemon());
  MachineStatus status;
  MachinePrediction prediction;
  std::uint64_t k = 0;
  const auto until_state = [&](DaemonState wanted) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    do {
      if (statuses.receive(status, 1.0) && status.state == wanted) return true;
    } while (std::chrono::steady_clock::now() < until);
    return false;
  };
  {
    DdsWriter<MachineFrame> frames(node);
    ASSERT_TRUE(frames.wait_for_readers(1, kPatience_s));
    k = send_until(frames, 0, [&] { return predictions.receive(prediction, 0.0); });
    k = send_until(frames, k, [&] {
      return statuses.receive(status, 0.0) && status.state == DaemonState::kRunning;
    });
    ASSERT_TRUE(daemon.says("frame source silent: no frame for 1 s, but it is still connected"))
        << daemon.said();
    EXPECT_TRUE(until_state(DaemonState::kWaiting));
    k = send_until(frames, k, [&] {
      return daemon.said().find("frames received again after ") != std::string::npos;
    });
    send_until(frames, k, [&] {
      return statuses.receive(status, 0.0) && status.state == DaemonState::kRunning;
    });
  }
  EXPECT_TRUE(daemon.says("frame source stopped: no frame for 1 s")) << daemon.said();
  EXPECT_TRUE(until_state(DaemonState::kWaiting));
  // The last error stays in the status, with its time, after the frames are back.
  EXPECT_THAT(
      status.last_error,
      testing::MatchesRegex("20..-..-..T..:..:......Z frame source .*: no frame for 1 s.*"));
  EXPECT_EQ(daemon.end(SIGTERM), 0);
  const std::string& said = daemon.said();
  EXPECT_EQ(said.find("frame source silent"), said.rfind("frame source silent")) << said;
  EXPECT_EQ(said.find("frames received again"), said.rfind("frames received again")) << said;
  EXPECT_THAT(said, Not(HasSubstr("second writer")));
}

}  // namespace
}  // namespace servotwin::test
