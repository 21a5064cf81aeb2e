// Two hosts and a link between them that loses, delays, breaks and heals: network namespaces, veth
// and tc netem (tests/dds/run). The machine and a subscriber are on one host, the daemon on the
// other.
#include <gmock/gmock.h>

#include <cstdio>
#include <regex>

#include "tests/dds/support.h"

namespace servotwin::test {
namespace {

using testing::HasSubstr;

/// Two namespaces with a link, gone with the test.
class Network : public testing::Test {
 protected:
  static constexpr int kRows = 3000;

  Network() {
    for (const auto& host : {"plant", "office"}) run(std::string("ip netns add ") + host);
    run("ip link add plant0 netns plant type veth peer name office0 netns office");
    for (const auto& [host, address] : {std::pair{"plant", "10.77.0.1"}, {"office", "10.77.0.2"}}) {
      const std::string name = host, inside = "ip -n " + name + " ";
      run(inside + "addr add " + address + "/24 dev " + name + "0");
      run(inside + "link set lo up");
      run(inside + "link set " + name + "0 up");
    }
    std::ofstream table(folder_.path() / "rec.csv");
    table << "time[s],X.command[m],X.actual[m]\n";
    for (int k = 0; k < kRows; ++k) {
      char line[100];
      const double command = command_of(static_cast<std::uint64_t>(k));
      std::snprintf(line, sizeof line, "%.3f,%.9f,%.9f\n", k * daemon::kCycle_s, command,
                    command - 1e-6);
      table << line;
    }
  }
  ~Network() override {
    for (const char* host : {"plant", "office"}) Process({"ip", "netns", "del", host}).end();
  }

  /// Both ends of the link.
  static void disturb(const std::string& netem) {
    for (const std::string host : {"plant", "office"})
      run("tc -n " + host + " qdisc replace dev " + host + "0 root netem " + netem);
  }
  static std::vector<std::string> on(const std::string& host, std::vector<std::string> words) {
    words[0] = std::filesystem::read_symlink("/proc/self/exe").parent_path() / words[0];
    words.insert(words.begin(), {"ip", "netns", "exec", host});
    return words;
  }
  [[nodiscard]] std::vector<std::string> replay(const std::string& speed) const {
    return {"servotwin",    "replay",   folder_.path() / "rec.csv",    "--dds",   "--machine",
            place_.machine, "--domain", std::to_string(place_.domain), "--speed", speed,
            "--wait",       "60"};
  }
  [[nodiscard]] std::vector<std::string> subscriber() const {
    return {"servotwin-subscriber", place_.machine, std::to_string(place_.domain), "0.5"};
  }

  const Environment link_{
      {"CYCLONEDDS_URI",
       "<General><Interfaces><NetworkInterface name=\"plant0\" presence_required=\"false\"/>"
       "<NetworkInterface name=\"office0\" presence_required=\"false\"/></Interfaces>"
       "<AllowMulticast>false</AllowMulticast></General><Discovery>"
       "<ParticipantIndex>auto</ParticipantIndex><SPDPInterval>1s</SPDPInterval><Peers><Peer "
       "address=\"10.77.0.1\"/>"
       "<Peer address=\"10.77.0.2\"/></Peers></Discovery>"}};
  TemporaryDirectory folder_;
  DdsPlace place_ = place_of("network");
  Home home_{place_, daemon::drive()};
};

std::vector<std::uint64_t> cycles_in(const std::string& said) {
  std::vector<std::uint64_t> all;
  const std::regex line("cycle ([0-9]+):");
  for (std::sregex_iterator at(said.begin(), said.end(), line), end; at != end; ++at)
    all.push_back(std::stoull((*at)[1]));
  return all;
}

TEST_F(Network, EveryFrameComesOverALinkThatLosesOrIsCountedAsLost) {
  disturb("loss 5% delay 5ms 1ms");
  Process daemon(on("office", home_.daemon()), {link_});
  Process subscriber(on("plant", this->subscriber()), {link_});
  Process machine(on("plant", replay("0.25")), {link_});
  EXPECT_EQ(machine.end(0), 0) << machine.said() << daemon.said();
  EXPECT_THAT(machine.said(), HasSubstr("sent 3000 of 3000 frames"));
  // It has then taken what was delivered, which takes seconds in a guest without its own processor.
  // It knows that the machine is gone or takes it for silent, since the farewell may be lost
  // as well.
  EXPECT_TRUE(daemon.says("no frame for 1 s")) << daemon.said();
  EXPECT_EQ(subscriber.end(SIGTERM), 0);
  daemon.send(SIGTERM);
  EXPECT_EQ(daemon.end(0), 0);

  unsigned frames = 0, lost = 0;
  const std::string& said = daemon.said();
  const std::size_t at = said.find("stopped after");
  ASSERT_NE(at, std::string::npos) << said;
  ASSERT_GE(std::sscanf(said.c_str() + at, "stopped after %u frames, %u lost", &frames, &lost), 1);
  EXPECT_EQ(frames + lost, 3000U) << said;
  const std::vector<std::uint64_t> cycles = cycles_in(subscriber.said());
  EXPECT_TRUE(std::is_sorted(cycles.begin(), cycles.end()));
  EXPECT_EQ(std::adjacent_find(cycles.begin(), cycles.end()), cycles.end()) << "none twice";
  std::printf("5 %% loss each way: %u of 3000 frames came, %zu predictions\n", frames,
              cycles.size());
  EXPECT_GT(cycles.size(), 300U) << "best effort, and frames sent again come in bursts";
  EXPECT_LT(cycles.size(), 3000U) << "the link loses";
}

TEST_F(Network, AfterASplitBothSidesFindEachOtherAgain) {
  Process daemon(on("office", home_.daemon()), {link_});
  Process subscriber(on("plant", this->subscriber()), {link_});
  Process machine(on("plant", replay("0.05")), {link_});  // a minute
  ASSERT_TRUE(subscriber.says("cycle 1")) << subscriber.said() << daemon.said();
  disturb("loss 100%");
  EXPECT_TRUE(daemon.says("no frame for 1 s")) << daemon.said();
  EXPECT_TRUE(subscriber.says("silent: ")) << subscriber.said();
  EXPECT_TRUE(subscriber.says("gone: ")) << subscriber.said();
  disturb("delay 1ms");
  EXPECT_TRUE(daemon.says("frames received again after ")) << daemon.said();
  EXPECT_TRUE(subscriber.says("again after ")) << subscriber.said();
  std::smatch healed;
  const std::string said = subscriber.said();
  if (std::regex_search(said, healed, std::regex("again after [0-9.]+ s")))
    std::printf("split and healed: the subscriber hears %s\n", healed.str().c_str());
}

}  // namespace
}  // namespace servotwin::test
