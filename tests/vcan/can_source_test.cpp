// A machine on a real bus: cycles without loss under load, faults told, and the loop controller -
// virtual drive - twin closed.
#include "daemon/input/can_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <memory>
#include <numbers>
#include <thread>

#include "cli/live/virtual_drive.h"
#include "daemon/between/clock.h"
#include "drivers/can/can_encoder.h"
#include "tests/vcan/support.h"

namespace servotwin {
namespace {

using test::drives;
using test::ip;
using testing::HasSubstr;

std::unique_ptr<daemon::CanSource> listening(const CanMap& map) {
  std::vector<std::unique_ptr<CanBus>> buses;
  for (const std::string& bus : map.buses) buses.push_back(std::make_unique<SocketCan>(bus));
  return std::make_unique<daemon::CanSource>(map, std::move(buses), Pacing::kByStamp);
}

std::vector<std::string> texts(const std::vector<SourceNews>& news) {
  std::vector<std::string> out;
  for (const SourceNews& one : news) out.push_back(one.text);
  return out;
}

void sleep_until(std::int64_t steady) {
  std::this_thread::sleep_for(
      std::chrono::nanoseconds(std::max<std::int64_t>(0, steady - daemon::steady_ns())));
}

/// Sends `cycles` cycles of a machine: position of axis a in cycle k is k um + a mm.
void be_machine(const CanMap& map, int cycles, std::size_t silent_axis = 99) {
  SocketCan bus("vcan0");
  CanEncoder encoder(map);
  const std::int64_t begin = daemon::steady_ns();
  for (int k = 0; k < cycles; ++k) {
    std::vector<CanFrame> frames{encoder.start()};
    for (std::size_t a = 0; a < map.machine.axes.size(); ++a) {
      const double position = 1e-6 * k + 1e-3 * static_cast<double>(a);
      encoder.set(a, CanChannel::kCommand, position);
      encoder.set(a, CanChannel::kActual, position - 2e-6);
      encoder.set(a, CanChannel::kTorque, 12.5);
      for (std::size_t m = 0; m < map.messages.size() && a != silent_axis; ++m) {
        if (map.messages[m].from_machine && map.find(a, CanChannel::kCommand)->message == m)
          frames.push_back(encoder.frame(m));
        if (map.messages[m].from_machine && map.find(a, CanChannel::kTorque)->message == m)
          frames.push_back(encoder.frame(m));
      }
    }
    sleep_until(begin + std::llround(1e9 * map.machine.cycle_s * k));
    EXPECT_EQ(bus.send(frames), frames.size());
  }
}

TEST(CanSource, ThreeAxesAtFullLoadAreReceivedWithoutLoss) {
  CanMap map = drives(3);
  // A sender that the host holds up within a cycle must not look like a late drive.
  map.deadline_s = 1.0;
  const auto source = listening(map);
  constexpr int kCycles = 2000;
  std::thread machine([&] { be_machine(map, kCycles); });
  MachineFrame frame;
  int cycles = 0;
  double last = -1.0;
  while (source->receive(frame, 0.5) == daemon::Received::kFrame) {
    ++cycles;
    for (std::size_t a = 0; a < 3; ++a) {
      const AxisSample& axis = frame.axes[a];
      EXPECT_NEAR(axis.command - axis.actual, 2e-6, 1e-9);
      EXPECT_NEAR(axis.torque, 12.5, 1e-9);
      EXPECT_NEAR(axis.command - frame.axes[0].command, 1e-3 * static_cast<double>(a), 1e-9);
    }
    EXPECT_GT(frame.axes[0].command, last);
    last = frame.axes[0].command;
  }
  machine.join();
  EXPECT_EQ(cycles, kCycles);
  EXPECT_NEAR(last, 1e-6 * (kCycles - 1), 1e-9);
  EXPECT_EQ(source->counts(0).dropped, 0U);
  EXPECT_EQ(source->counts().buses[0].frames, static_cast<std::uint64_t>(kCycles) * 7);
}

TEST(CanSource, ANodeThatIsSilentIsNamedAndTheOthersGoOn) {
  CanMap map = drives(2);
  // A host that is held up must not make the other node late: a cycle ends with the next one, and
  // only the last one at its deadline.
  map.deadline_s = 0.2;
  constexpr int kCycles = 300;
  const auto source = listening(map);
  std::thread machine([&] { be_machine(map, kCycles, 1); });
  MachineFrame frame;
  int good = 0, absent = 0;
  while (source->receive(frame, 0.5) == daemon::Received::kFrame) {
    good += std::isfinite(frame.axes[0].command);
    absent += std::isnan(frame.axes[1].command);
  }
  machine.join();
  EXPECT_EQ(good, kCycles);
  EXPECT_EQ(absent, kCycles);
  const auto news = texts(source->news(daemon::steady_ns()));
  EXPECT_THAT(news, testing::Contains(testing::AllOf(HasSubstr("0x182"), HasSubstr("axis A2"),
                                                     HasSubstr("fell silent"))));
}

TEST(CanSource, TheInterfaceGoesDownAndUp) {
  const CanMap map = drives(1);
  const auto source = listening(map);
  MachineFrame frame;
  std::thread before([&] { be_machine(map, 50); });
  int cycles = 0;
  while (source->receive(frame, 0.3) == daemon::Received::kFrame) ++cycles;
  before.join();
  EXPECT_EQ(cycles, 50);
  ip("link set vcan0 down");
  EXPECT_EQ(source->receive(frame, 0.7), daemon::Received::kNothing);
  EXPECT_THAT(texts(source->news(daemon::steady_ns())),
              testing::IsSupersetOf({HasSubstr("went down"), HasSubstr("no cycle starts")}));
  ip("link set vcan0 up");
  EXPECT_EQ(source->receive(frame, 0.3), daemon::Received::kNothing);
  std::thread after([&] { be_machine(map, 50); });
  cycles = 0;
  while (source->receive(frame, 0.3) == daemon::Received::kFrame) ++cycles;
  after.join();
  EXPECT_EQ(cycles, 50);
  EXPECT_THAT(texts(source->news(daemon::steady_ns())),
              testing::IsSupersetOf({HasSubstr("up again"), HasSubstr("cycles start again")}));
}

/// A stiff loop of second order without friction.
Model loop_model() {
  Model model;
  model.sample_time_s = 0.001;
  model.loop.order = 2;
  model.loop.denominator = denominator_of({0.0, 20.0 * 2.0 * std::numbers::pi, 0.6}, 2);
  model.loop.numerator = {1.0, model.loop.denominator[0], 0.0};
  return model;
}

TEST(CanSource, TheLoopOfControllerDriveAndTwinCloses) {
  CanMap map = drives(2);
  map.deadline_s = 1.0;
  const auto source = listening(map);
  std::atomic<bool> stop{false}, ready{false};
  std::atomic<int> cycles{0};
  std::uint64_t answered = 0;
  std::thread drive([&] {
    SocketCan bus("vcan0");
    VirtualDrive nodes(map, {{Twin(loop_model())}, {Twin(loop_model())}});
    std::array<CanFrame, 64> batch;
    ready = true;
    while (!stop) {
      const std::size_t count = bus.receive(batch, 0.05);
      for (std::size_t i = 0; i < count; ++i) {
        for (const auto& answer : nodes.on_frame(0, batch[i])) bus.send({&answer.frame, 1});
      }
    }
    answered = nodes.cycles();
  });
  constexpr int kCycles = 1000;
  std::thread controller([&] {
    SocketCan bus("vcan0");
    CanEncoder encoder(map);
    while (!ready) std::this_thread::yield();
    for (int k = 0; k < kCycles; ++k) {
      std::vector<CanFrame> frames;
      for (std::size_t a = 0; a < 2; ++a) {
        encoder.set(a, CanChannel::kTarget, 0.01 * std::sin(0.01 * k) * static_cast<double>(a + 1));
        frames.push_back(encoder.frame(map.find(a, CanChannel::kTarget)->message));
      }
      frames.push_back(encoder.start());
      bus.send(frames);
      // The next cycle when the drives have answered this one, so that no host is too slow.
      const std::int64_t patience = daemon::steady_ns() + 1'000'000'000;
      while (cycles <= k && daemon::steady_ns() < patience)
        std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
  });
  // The same loop here: what comes back must be what it predicts from the commands alone.
  std::array<Twin, 2> twins{Twin(loop_model()), Twin(loop_model())};
  MachineFrame frame;
  double largest = 0.0;
  while (source->receive(frame, 2.0) == daemon::Received::kFrame) {
    for (std::size_t a = 0; a < 2; ++a) {
      const AxisSample& axis = frame.axes[a];
      const double wanted = 0.01 * std::sin(0.01 * cycles) * static_cast<double>(a + 1);
      EXPECT_NEAR(axis.command, wanted, 5.1e-9);  // steps of 10 nm
      if (cycles == 0) twins[a].start(axis.command);
      const double error =
          cycles == 0 ? axis.command - twins[a].position() : twins[a].follow(axis.command);
      EXPECT_NEAR(axis.command - axis.actual, error, 1.1e-8);
      largest = std::max(largest, std::abs(error));
    }
    if (++cycles == kCycles) break;
  }
  controller.join();
  stop = true;
  drive.join();
  EXPECT_EQ(answered, static_cast<std::uint64_t>(kCycles));
  EXPECT_EQ(cycles, kCycles);
  EXPECT_GT(largest, 1e-5) << "the axes must have moved";
}

}  // namespace
}  // namespace servotwin
