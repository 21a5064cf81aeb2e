// DDS Security with the certificates of the example: permitted roles can communicate; others can
// neither read nor write.
#include <gmock/gmock.h>

#include <cstdio>

#include "tests/dds/support.h"

namespace servotwin::test {
namespace {

using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

class Security : public testing::Test {
 protected:
  Security() {
    for (const char* authority : {"ours", "strangers"}) {
      run(SERVOTWIN_SOURCE_DIR "/examples/dds_security/make_certificates " +
          (folder_.path() / authority).string());
    }
    std::ofstream table(folder_.path() / "rec.csv");
    table << "time[s],X.command[m],X.actual[m]\n";
    for (int k = 0; k < kRows; ++k) {
      char line[100];
      std::snprintf(line, sizeof line, "%.3f,%.9f,%.9f\n", k * daemon::kCycle_s,
                    command_of(static_cast<std::uint64_t>(k)),
                    command_of(static_cast<std::uint64_t>(k)) - 1e-6);
      table << line;
    }
  }
  /// The environment of a role; `authority` empty: without security, on the same interface.
  [[nodiscard]] Environment as(const std::string& authority, const std::string& role = "") const {
    if (authority.empty()) return {{"CYCLONEDDS_URI", ""}};
    return {
        {"CYCLONEDDS_URI", "file://" + (folder_.path() / authority / (role + ".xml")).string()}};
  }
  [[nodiscard]] std::vector<std::string> replay(const std::string& wait_s) const {
    return {"servotwin",    "replay",   folder_.path() / "rec.csv",    "--dds",  "--machine",
            place_.machine, "--domain", std::to_string(place_.domain), "--wait", wait_s};
  }
  [[nodiscard]] std::vector<std::string> subscriber() const {
    return {"servotwin-subscriber", place_.machine, std::to_string(place_.domain), "0.5"};
  }

  static constexpr int kRows = 3000;
  TemporaryDirectory folder_;
  DdsPlace place_ = place_of("secure");
  Home home_{place_, daemon::drive()};
};

TEST_F(Security, AStrangerNeitherReadsPredictionsNorWritesFrames) {
  Process daemon(home_.daemon(), {as("ours", "daemon")});
  Process viewer(subscriber(), {as("ours", "viewer")});
  Process plain(subscriber(), {as("")}), stranger(subscriber(), {as("strangers", "viewer")});
  // Writers of frames that are refused: without a certificate, with one of another authority, and
  // with one that permits reading only.
  for (const Environment& who : {as(""), as("strangers", "machine"), as("ours", "viewer")}) {
    Process intruder(replay("3"), {who});
    EXPECT_NE(intruder.end(0), 0) << intruder.said();
    EXPECT_THAT(intruder.said(), Not(HasSubstr("sent 3000")));
  }
  Process machine(replay("60"), {as("ours", "machine")});
  EXPECT_EQ(machine.end(0), 0) << machine.said();
  EXPECT_THAT(machine.said(), HasSubstr("sent 3000 of 3000 frames"));
  EXPECT_TRUE(viewer.says("cycle 2")) << viewer.said();
  EXPECT_THAT(viewer.said(), ContainsRegex("cycle [0-9]+: X -?[0-9.]+ um, contour"));
  EXPECT_THAT(plain.said(), Not(HasSubstr("cycle ")));
  EXPECT_THAT(stranger.said(), Not(HasSubstr("cycle ")));
  EXPECT_THAT(stranger.said(), HasSubstr("Certificate not valid")) << "it was there and tried";
  EXPECT_EQ(daemon.end(SIGTERM), 0);
  EXPECT_THAT(daemon.said(), HasSubstr("stopped after 3000 frames"))
      << "the machine's and no other";
}

}  // namespace
}  // namespace servotwin::test
