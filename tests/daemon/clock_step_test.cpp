// The clock of the host is set while the daemon works, an hour on and then two hours back: the real
// programs on DDS and on CAN over UDP, with tests/support/stepped_clock.cpp as their wall clock.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "daemon/store/store.h"
#include "drivers/can/can_udp.h"
#include "drivers/recordings/table/csv.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/support.h"
#include "tests/support/process.h"

namespace servotwin::daemon {
namespace {

using test::built;
using test::Process;
using testing::HasSubstr;

// Slow enough that a busy host without real-time threads loses no cycles.
constexpr double kSlowCycle_s = 0.005;
constexpr std::size_t kCycles = 1200;
constexpr std::int64_t kHour_ns = 3'600'000'000'000;

/// Offset added to the wall clock of every program that is started with environment().
class SteppedClock {
 public:
  explicit SteppedClock(std::string file) : file_(std::move(file)) {
    const int descriptor = open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    EXPECT_EQ(ftruncate(descriptor, sizeof(std::int64_t)), 0);
    added_ns_ = static_cast<volatile std::int64_t*>(
        mmap(nullptr, sizeof(std::int64_t), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0));
    close(descriptor);
  }
  void set(std::int64_t added_ns) const { *added_ns_ = added_ns; }
  [[nodiscard]] test::Environment environment() const {
    return {{"LD_PRELOAD", built("libstepped_clock.so")},
            {"STEPPED_CLOCK", file_},
            {"ASAN_OPTIONS", "verify_asan_link_order=0"}};  // a sanitizer wants to be the first
  }

 private:
  std::string file_;
  volatile std::int64_t* added_ns_ = nullptr;
};

class ClockStep : public testing::TestWithParam<const char*> {
 protected:
  [[nodiscard]] std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(directory_.path() / name) << text;
    return directory_.path() / name;
  }
  [[nodiscard]] std::string motion() const {
    std::ostringstream text;
    text.precision(12);
    text << "time[s],X.command[m],X.actual[m]\n";
    for (std::size_t i = 0; i < kCycles; ++i) {
      const double t = static_cast<double>(i) * kSlowCycle_s;
      text << t << ',' << command_at(t) << ',' << command_at(t) - 1e-6 << '\n';
    }
    return text.str();
  }
  TemporaryDirectory directory_;
};

TEST_P(ClockStep, LosesNoCycleAndOrdersWhatItKeeps) {
  const bool udp = std::string(GetParam()) == "udp";
  const std::string machine = "clock-" + std::string(GetParam()) + std::to_string(getpid());
  const SteppedClock clock(directory_.path() / "clock");
  const std::string map = write("map.toml", R"(cycle_s = 0.005
[[axis]]
name = "X"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm*10"}
actual = {id = 0x181, start_bit = 32, length = 32, unit = "nm*10"}
)");
  const std::string place = "127.0.0.1:" + std::to_string(CanUdp({"127.0.0.1:0", ""}).port());
  const std::string config = write(
      "m.toml", std::string("[real_time]\npriority = 0\n[diagnose]\nevery_s = 0\n[http]\nlisten = "
                            "\"127.0.0.1:0\"\n") +
                    (udp ? "[source.udp]\nmap = \"map.toml\"\nlisten = \"" + place + "\"\n" : ""));
  {
    Store store(directory_.path() / "store", machine);
    Model model = drive();
    model.sample_time_s = kSlowCycle_s;
    ModelRecord record = record_of(model);
    store.promote(record,
                  {"2026-01-31T12:00:00.000Z", "X", "model_promoted", "made for this test", ""});
  }
  Process daemon({built("servotwind"), "--config", config, "--store", directory_.path() / "store",
                  "--machine", machine, "--domain", "96"},
                 {.environment = clock.environment()});
  const std::string page = "page at http://127.0.0.1:";
  ASSERT_TRUE(daemon.says(page)) << daemon.said();
  ASSERT_TRUE(daemon.says(udp ? "in force again" : "waiting for machine")) << daemon.said();
  const auto port = static_cast<std::uint16_t>(
      std::stoi(daemon.said().substr(daemon.said().find(page) + page.size())));
  const auto status = [&] { return ask(port, "GET", "/api/v1/status").json(); };

  std::vector<std::string> words = {built("servotwin"), "replay", write("motion.csv", motion())};
  const std::vector<std::string> there =
      udp ? std::vector<std::string>{"--udp", place, "--can-map", map}
          : std::vector<std::string>{"--dds", "--machine", machine, "--domain", "96"};
  words.insert(words.end(), there.begin(), there.end());
  Process replay(words, {.environment = clock.environment()});
  const auto wait_for_cycles = [&](std::uint64_t cycles) {
    for (int i = 0; i < 3000; ++i) {
      auto now = status();
      if (now.contains("frames") && now["frames"] >= cycles) return now;
      usleep(10'000);
    }
    ADD_FAILURE() << cycles << " cycles did not come: " << status().dump() << daemon.said();
    return status();
  };
  wait_for_cycles(kCycles / 4);
  clock.set(kHour_ns);
  wait_for_cycles(kCycles / 2);
  clock.set(-kHour_ns);
  const auto end = wait_for_cycles(kCycles);
  EXPECT_EQ(replay.end(), 0) << replay.said();

  EXPECT_EQ(end["frames"], kCycles);
  EXPECT_EQ(end["lost"], 0);
  EXPECT_EQ(end["axes"][0]["model_version"], 1);
  EXPECT_LT(end["publish_max_s"], 60.0) << "the step of a clock is no latency";
  EXPECT_LT(end["not_finite"], 50) << "what was on its way when the clock was set";
  EXPECT_EQ(daemon.end(SIGTERM), 0) << daemon.said();
  EXPECT_THAT(daemon.said(),
              HasSubstr("servotwind: stopped after " + std::to_string(kCycles) + " frames\n"));

  std::size_t rows = 0;
  for (const auto& file :
       std::filesystem::directory_iterator(directory_.path() / "store" / "recordings" / machine))
    rows += read_csv(file.path(), {}).time.size();
  EXPECT_EQ(rows, kCycles);
}

INSTANTIATE_TEST_SUITE_P(Source, ClockStep, testing::Values("dds", "udp"),
                         [](const auto& each) { return std::string(each.param); });

}  // namespace
}  // namespace servotwin::daemon
