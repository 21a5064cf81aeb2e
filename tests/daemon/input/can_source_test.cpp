// A machine on a bus of the test's own: cycles, deadlines, several buses, what is told, no heap;
// over UDP through real sockets; and the ways out: offsets behind the gate, virtual drives.
#include "daemon/input/can_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <deque>
#include <thread>

#include "cli/live/virtual_drive.h"
#include "daemon/between/clock.h"
#include "daemon/input/can_offset.h"
#include "drivers/can/can_encoder.h"
#include "drivers/can/can_udp.h"
#include "tests/daemon/support.h"
#include "tests/support/expect_error.h"
#include "twin/catalogue.h"
#include "twin/neighbour.h"

namespace servotwin::daemon {
namespace {

using test::expect_error;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

auto good(const std::string& text) {
  return testing::AllOf(testing::Field(&SourceNews::text, HasSubstr(text)),
                        testing::Field(&SourceNews::good, true));
}
auto bad(const std::string& text) {
  return testing::AllOf(testing::Field(&SourceNews::text, HasSubstr(text)),
                        testing::Field(&SourceNews::good, false));
}

CanMap map_of(const std::string& text) {
  CheckedCanMap checked = check_can_map(text, "m.toml", "");
  EXPECT_TRUE(checked.problems.empty()) << messages(checked.problems);
  return std::move(checked.map);
}

constexpr const char* kTwoBuses = R"(
cycle_s = 0.001
[[bus]]
name = "a"
[[bus]]
name = "b"
[[axis]]
name = "X"
bus = "a"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm"}
[[axis]]
name = "Y"
bus = "b"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm"}
)";

constexpr const char* kDrive = R"(
cycle_s = 0.001
[[axis]]
name = "X"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm*10"}
actual = {id = 0x181, start_bit = 32, length = 32, unit = "nm*10"}
status_word = {id = 0x281, start_bit = 0, length = 16}
target = {id = 0x301, start_bit = 0, length = 32, unit = "nm*10"}
control_word = {id = 0x201, start_bit = 0, length = 16}
offset = {id = 0x401, start_bit = 0, length = 32, unit = "nm*10", message_bytes = 4}
)";

/// A bus whose frames the test puts there.
class ScriptedBus final : public CanBus {
 public:
  std::size_t receive(std::span<CanFrame> batch, double) noexcept override {
    std::size_t count = 0;
    while (count < batch.size() && !frames.empty()) {
      batch[count++] = frames.front();
      frames.pop_front();
    }
    return count;
  }
  std::size_t send(std::span<const CanFrame> out) noexcept override {
    for (const CanFrame& frame : out) sent.push_back(frame);
    return takes ? out.size() : 0;
  }
  [[nodiscard]] int descriptor() const noexcept override { return -1; }
  void refuse() { count(counters_.malformed); }
  void set_up(bool up) {
    if (!up) count(counters_.downs);
    counters_.up = up;
  }

  std::deque<CanFrame> frames;
  std::vector<CanFrame> sent;
  bool takes = true;
};

CanFrame frame_of(std::uint32_t id, std::int64_t time_ns, std::int32_t value = 0, int bytes = 4) {
  CanFrame frame;
  frame.id = id;
  frame.time_ns = time_ns;
  frame.length = static_cast<std::uint8_t>(bytes);
  set_raw_bits({0, 32}, static_cast<std::uint32_t>(value), frame.data);
  return frame;
}

struct TwoBuses {
  std::vector<ScriptedBus*> buses;
  std::unique_ptr<CanSource> source;
  TwoBuses() {
    std::vector<std::unique_ptr<CanBus>> owned;
    for (int i = 0; i < 2; ++i) {
      auto bus = std::make_unique<ScriptedBus>();
      buses.push_back(bus.get());
      owned.push_back(std::move(bus));
    }
    source = std::make_unique<CanSource>(map_of(kTwoBuses), std::move(owned), Pacing::kByStamp);
  }
};

TEST(CanSource, MergesItsBusesByTheirStamps) {
  TwoBuses machine;
  const std::int64_t now = wall_ns();
  constexpr int kCycles = 200;  // more than a batch
  for (int k = 0; k < kCycles; ++k) {
    const std::int64_t begin = now + k * 1'000'000LL;
    machine.buses[0]->frames.push_back(frame_of(0x80, begin));
    machine.buses[0]->frames.push_back(frame_of(0x181, begin + 10, k));
    machine.buses[1]->frames.push_back(frame_of(0x181, begin + 20, -k));
  }
  MachineFrame frame;
  for (int k = 0; k < kCycles; ++k) {
    ASSERT_EQ(machine.source->receive(frame, 1.0), Received::kFrame);
    EXPECT_NEAR(frame.axes[0].command, 1e-9 * k, 1e-15);
    EXPECT_NEAR(frame.axes[1].command, -1e-9 * k, 1e-15);
  }
  EXPECT_EQ(machine.source->counts().incomplete, 0U);
}

TEST(CanSource, EveryBusHasItsFigures) {
  TwoBuses machine;
  const std::int64_t now = wall_ns();
  for (int k = 0; k < 2; ++k) {
    machine.buses[0]->frames.push_back(frame_of(0x80, now + k * 1'000'000));
    machine.buses[0]->frames.push_back(frame_of(0x181, now + k * 1'000'000 + 10, 1));
  }
  machine.buses[1]->frames.push_back(frame_of(0x181, now + 20, 1));  // and not in the second cycle
  machine.buses[1]->frames.push_back(frame_of(0x555, now + 30));
  MachineFrame frame;
  while (machine.source->receive(frame, 0.1) == Received::kFrame) {
  }
  machine.buses[0]->frames.push_back(frame_of(0x80, now + 2'000'000));  // ends the second cycle
  (void)machine.source->receive(frame, 0.1);
  machine.buses[1]->set_up(false);
  const std::vector<BusStatus> buses = machine.source->state(0).buses;
  ASSERT_EQ(buses.size(), 2U);
  EXPECT_EQ(buses[0].name, "a");
  EXPECT_EQ(buses[0].missing, 0U);
  EXPECT_TRUE(buses[0].up);
  EXPECT_EQ(buses[1].name, "b");
  EXPECT_EQ(buses[1].missing, 1U);
  EXPECT_EQ(buses[1].unexpected, 1U);
  EXPECT_FALSE(buses[1].up);
  EXPECT_EQ(buses[1].downs, 1U);
}

TEST(CanSource, ACycleEndsAtItsDeadlineWithoutAnotherFrame) {
  TwoBuses machine;
  machine.buses[0]->frames.push_back(frame_of(0x80, wall_ns()));
  machine.buses[0]->frames.push_back(frame_of(0x181, wall_ns(), 5));
  MachineFrame frame;
  ASSERT_EQ(machine.source->receive(frame, 1.0), Received::kFrame);
  EXPECT_NEAR(frame.axes[0].command, 5e-9, 1e-15);
  EXPECT_TRUE(std::isnan(frame.axes[1].command));
  EXPECT_EQ(machine.source->receive(frame, 0.0), Received::kNothing);
}

TEST(CanSource, TellsWhatHappenedOnceAndWhatGoesOnOnceAMinute) {
  TwoBuses machine;
  MachineFrame frame;
  std::int64_t now = wall_ns();
  EXPECT_THAT(machine.source->news(1), IsEmpty());
  const auto cycle_with_wrong_length = [&] {
    machine.buses[0]->frames.push_back(frame_of(0x80, now));
    machine.buses[0]->frames.push_back(frame_of(0x181, now + 10, 1));
    machine.buses[1]->frames.push_back(frame_of(0x181, now + 10, 1, 3));
    now += 1'000'000;
    EXPECT_EQ(machine.source->receive(frame, 1.0), Received::kFrame);
  };
  cycle_with_wrong_length();
  EXPECT_THAT(machine.source->news(kSecond_ns), ElementsAre(bad("0x181 on b of axis Y")));
  EXPECT_EQ(machine.source->state(0).malformed, 1U);
  cycle_with_wrong_length();
  EXPECT_THAT(machine.source->news(2 * kSecond_ns), IsEmpty());
  EXPECT_THAT(machine.source->news(62 * kSecond_ns), ElementsAre(bad("of a wrong length")));
  // So is what the first packet is refused for, and an interface that goes.
  machine.buses[0]->refuse();
  EXPECT_THAT(machine.source->news(62 * kSecond_ns + 1),
              ElementsAre(bad("1 packet ignored: not CAN, or not from the peer")));
  machine.buses[0]->refuse();
  EXPECT_THAT(machine.source->news(62 * kSecond_ns + 2), IsEmpty());
  machine.buses[1]->set_up(false);
  EXPECT_THAT(machine.source->news(63 * kSecond_ns),
              testing::Contains(bad("b: the interface went down")));
  machine.buses[1]->set_up(true);
  EXPECT_THAT(machine.source->news(64 * kSecond_ns), testing::Contains(good("up again")));
}

TEST(CanSource, SaysThatNoCycleBeginsAndThatTheyDoAgain) {
  TwoBuses machine;
  MachineFrame frame;
  EXPECT_EQ(machine.source->receive(frame, 0.6), Received::kNothing);
  EXPECT_THAT(machine.source->news(1), ElementsAre(bad("no cycle starts: 0x080 on a")));
  const std::int64_t now = wall_ns();
  machine.buses[0]->frames.push_back(frame_of(0x80, now));
  machine.buses[0]->frames.push_back(frame_of(0x181, now));
  machine.buses[1]->frames.push_back(frame_of(0x181, now));
  EXPECT_EQ(machine.source->receive(frame, 0.1), Received::kFrame);
  EXPECT_THAT(machine.source->news(2), ElementsAre(good("cycles start again")));
}

TEST(CanSource, NeedsOneBusPerBusOfTheMap) {
  expect_error<std::invalid_argument>(
      [] { CanSource source(map_of(kTwoBuses), {}, Pacing::kByStamp); }, {"2 buses (a, b)", "0"});
}

TEST(CanSource, AMachineOverUdp) {
  const CanMap map = map_of(kDrive);
  auto listener = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", ""});
  CanUdp machine({"127.0.0.1:0", "127.0.0.1:" + std::to_string(listener->port())});
  std::vector<std::unique_ptr<CanBus>> buses;
  buses.push_back(std::move(listener));
  CanSource source(map, std::move(buses), Pacing::kByCount);
  CanEncoder encoder(map);
  constexpr int kCycles = 500;
  for (int k = 0; k < kCycles; k += 5) {  // five cycles a packet
    std::vector<CanFrame> frames;
    for (int i = k; i < k + 5; ++i) {
      encoder.set(0, CanChannel::kCommand, 1e-6 * i);
      encoder.set(0, CanChannel::kActual, 1e-6 * i - 5e-6);
      frames.push_back(encoder.start());
      frames.push_back(encoder.frame(map.find(0, CanChannel::kCommand)->message));
    }
    ASSERT_EQ(machine.send(frames), frames.size());
  }
  MachineFrame frame;
  std::uint64_t last = 0;
  for (int k = 0; k < kCycles; ++k) {
    ASSERT_EQ(source.receive(frame, 1.0), Received::kFrame) << k;
    EXPECT_NEAR(frame.axes[0].command, 1e-6 * k, 1e-12);
    EXPECT_NEAR(frame.axes[0].command - frame.axes[0].actual, 5e-6, 1e-12);
    EXPECT_EQ(frame.sequence, k == 0 ? frame.sequence : last + 1);
    last = frame.sequence;
  }
  EXPECT_EQ(source.counts(0).lost, 0U);
}

TEST(CanOffset, SendsWhatTheGateSendsAndNothingElse) {
  const CanMap map = map_of(kDrive);
  CanOffset offset(map, 0);
  ScriptedBus bus;
  AxisOffset output;
  output.offset = -1.234e-5;
  EXPECT_FALSE(offset.send(output, bus)) << "advice";
  EXPECT_THAT(bus.sent, IsEmpty());
  output.send = true;
  EXPECT_TRUE(offset.send(output, bus));
  ASSERT_EQ(bus.sent.size(), 1U);
  EXPECT_EQ(bus.sent[0].id, 0x401U);
  EXPECT_EQ(bus.sent[0].length, 4);
  EXPECT_EQ(raw_integer({0, 32, ByteOrder::kLittle, Coding::kSigned},
                        raw_bits({0, 32}, bus.sent[0].data)),
            -1234);
  output.offset = std::nan("");
  EXPECT_FALSE(offset.send(output, bus));
  output.offset = 100.0;  // more than 32 bits of 10 nm hold
  EXPECT_FALSE(offset.send(output, bus));
  EXPECT_EQ(offset.not_carried(), 2U);
  EXPECT_EQ(bus.sent.size(), 1U);
  bus.takes = false;
  output.offset = 0.0;
  EXPECT_FALSE(offset.send(output, bus));
}

TEST(CanOffset, TheSourceSendsThemOnTheBusOfTheAxis) {
  auto owned = std::make_unique<ScriptedBus>();
  ScriptedBus& bus = *owned;
  std::vector<std::unique_ptr<CanBus>> buses;
  buses.push_back(std::move(owned));
  CanSource source(map_of(kDrive), std::move(buses), Pacing::kByStamp);
  MachineOffset offset;
  offset.axis_count = 1;
  offset.axes[0] = {2e-5, 1, true, 0};
  EXPECT_EQ(source.send(offset, steady_ns() + kSecond_ns), 0U);
  EXPECT_THAT(bus.sent, IsEmpty()) << "not asked to";
  source.carry_offsets({0});
  EXPECT_EQ(source.send(offset, steady_ns() + kSecond_ns), 0U);
  ASSERT_EQ(bus.sent.size(), 1U);
  EXPECT_EQ(bus.sent[0].id, 0x401U);
  EXPECT_EQ(source.send(offset, steady_ns() - 1), 1U) << "it had to leave before";
  EXPECT_EQ(bus.sent.size(), 1U);
  offset.axes[0].send = false;
  EXPECT_EQ(source.send(offset, steady_ns() + kSecond_ns), 0U);
  EXPECT_EQ(bus.sent.size(), 1U) << "a dry run";
}

/// A drive's bus, with a source that carries its offsets.
struct CarriedOffsets {
  ScriptedBus* bus = nullptr;
  std::unique_ptr<CanSource> source;
  CarriedOffsets() {
    auto owned = std::make_unique<ScriptedBus>();
    bus = owned.get();
    std::vector<std::unique_ptr<CanBus>> buses;
    buses.push_back(std::move(owned));
    source = std::make_unique<CanSource>(map_of(kDrive), std::move(buses), Pacing::kByStamp);
    source->carry_offsets({0});
  }
  void send(bool armed) const {
    MachineOffset offset;
    offset.axis_count = 1;
    offset.axes[0] = {2e-5, 1, armed, 0};
    (void)source->send(offset, steady_ns() + kSecond_ns);
  }
  void hear(std::uint32_t id) const {
    MachineFrame frame;
    bus->frames = {frame_of(id, 1'000'000)};
    EXPECT_EQ(source->receive(frame, 0.002), Received::kNothing);
  }
};

// Two armed daemons on one bus: each would correct the offsets of the other.
TEST(CanOffset, WhereTwoSendThemOursAreHeldBackForGood) {
  const CarriedOffsets ours;
  ours.hear(0x301);
  ours.send(true);
  EXPECT_EQ(ours.bus->sent.size(), 1U) << "a target is the controller's";
  EXPECT_EQ(ours.source->state(0).offsets_held_back, "");
  ours.hear(0x401);
  EXPECT_NE(ours.source->state(0).offsets_held_back, "") << "at once, not with the next of ours";
  ours.send(true);
  EXPECT_EQ(ours.bus->sent.size(), 1U);
  EXPECT_THAT(ours.source->state(0).offsets_held_back,
              HasSubstr("another sender also sends offsets to the drive of axis X"));
}

// A standby daemon receives the offsets of the active one; it must work when that has stopped.
TEST(CanOffset, WhoIsNotArmedHearsTheOffsetsOfAnotherAndSendsWhenItIsQuiet) {
  const CarriedOffsets ours;
  ours.send(false);
  ours.hear(0x401);
  ours.send(false);
  EXPECT_EQ(ours.source->state(0).offsets_held_back, "");
  std::this_thread::sleep_for(std::chrono::milliseconds(1050));
  ours.send(true);
  EXPECT_EQ(ours.bus->sent.size(), 1U);

  const CarriedOffsets other;
  other.hear(0x401);
  other.send(true);
  EXPECT_THAT(other.bus->sent, IsEmpty()) << "armed beside it";
  EXPECT_NE(other.source->state(0).offsets_held_back, "");
}

TEST(CanOffset, AMessageWithMoreInItIsRefused) {
  std::string text = kDrive;
  text.replace(text.find("message_bytes = 4"), 17, "message_bytes = 8");
  const CanMap map = map_of(text);
  expect_error<std::runtime_error>([&] { CanOffset offset(map, 0); },
                                   {"0x401", "axis X", "0x60B0", "alone"});
  const CanMap none = map_of(kTwoBuses);
  expect_error<std::runtime_error>([&] { CanOffset offset(none, 0); }, {"axis X", "0x60B0"});
}

class Drives : public testing::Test {
 protected:
  /// One SYNC; what the drive sent.
  const std::vector<CanFrame>& sync() {
    sent_.clear();
    for (const auto& answer : drive_.on_frame(0, encoder_.start())) sent_.push_back(answer.frame);
    return sent_;
  }
  void tell(CanChannel channel, double value) {
    ASSERT_TRUE(encoder_.set(0, channel, value));
    EXPECT_TRUE(drive_.on_frame(0, encoder_.frame(map_.find(0, channel)->message)).empty());
  }
  double said(CanChannel channel) const {
    const MappedSignal* signal = map_.find(0, channel);
    for (const CanFrame& frame : sent_) {
      if (frame.id == map_.messages[signal->message].id) return decoded(signal->signal, frame.data);
    }
    return kAbsent;
  }

  CanMap map_ = map_of(kDrive);
  CanEncoder encoder_{map_};
  VirtualDrive drive_{map_, {{Twin(drive())}}};
  std::vector<CanFrame> sent_;
};

TEST_F(Drives, DropAnOffsetThatIsNotRenewedAndRampItOut) {
  for (const int word : {0x06, 0x07, 0x0F}) tell(CanChannel::kControlWord, word);
  tell(CanChannel::kTarget, 1e-3);
  for (int k = 0; k < 50; ++k) {
    tell(CanChannel::kOffset, -4e-5);
    sync();
  }
  EXPECT_NEAR(said(CanChannel::kCommand), 1e-3 - 4e-5, 1e-9);
  for (int k = 0; k < 19; ++k) sync();
  EXPECT_NEAR(said(CanChannel::kCommand), 1e-3 - 4e-5, 1e-9) << "within 20 ms it holds";
  double before = said(CanChannel::kCommand);
  for (int k = 0; k < 103; ++k) {
    sync();
    const double now = said(CanChannel::kCommand);
    EXPECT_LE(std::abs(now - before), 4e-5 / 100.0 + 1.1e-8) << "a straight line of 100 ms";
    before = now;
  }
  EXPECT_NEAR(before, 1e-3, 1e-9) << "then it is gone";
  tell(CanChannel::kOffset, 1e-5);
  sync();
  EXPECT_NEAR(said(CanChannel::kCommand), 1e-3 + 1e-5, 1e-9) << "and may come back";
}

TEST_F(Drives, GoThroughTheStatesOfCia402) {
  EXPECT_EQ(sync().size(), 2U);
  EXPECT_EQ(said(CanChannel::kStatusWord), 0x0250);
  tell(CanChannel::kControlWord, 0x0F);  // not from there
  sync();
  EXPECT_EQ(said(CanChannel::kStatusWord), 0x0250);
  for (const auto& [control, status] : {std::pair{0x06, 0x0231},
                                        {0x07, 0x0233},
                                        {0x0F, 0x1237},
                                        {0x07, 0x0233},
                                        {0x0F, 0x1237},
                                        {0x06, 0x0231},
                                        {0x0F, 0x1237},
                                        {0x02, 0x0250}}) {
    tell(CanChannel::kControlWord, control);
    sync();
    EXPECT_EQ(said(CanChannel::kStatusWord), status) << std::hex << control;
  }
}

TEST_F(Drives, FollowTheTargetAsTheTwinDoesOnceTheyAreEnabled) {
  tell(CanChannel::kTarget, 1e-3);
  sync();
  EXPECT_NEAR(said(CanChannel::kCommand), 1e-3, 1e-12) << "it stands where it is wanted";
  tell(CanChannel::kTarget, 2e-3);
  sync();
  EXPECT_NEAR(said(CanChannel::kCommand), 1e-3, 1e-12) << "not enabled: it holds its place";
  for (const int word : {0x06, 0x07, 0x0F}) tell(CanChannel::kControlWord, word);
  Twin twin(drive());
  twin.start(1e-3);
  (void)twin.follow(1e-3);
  for (int k = 0; k < 500; ++k) {
    const double target = 1e-3 + 1e-3 * std::sin(0.02 * k);
    const double offset = k < 250 ? 0.0 : 5e-6;
    tell(CanChannel::kTarget, target);
    tell(CanChannel::kOffset, offset);
    sync();
    const double demand = std::nearbyint(target * 1e8) * 1e-8 + std::nearbyint(offset * 1e8) * 1e-8;
    EXPECT_NEAR(said(CanChannel::kCommand), demand, 1e-12);
    EXPECT_NEAR(said(CanChannel::kActual), demand - twin.follow(demand), 5.1e-9);
  }
  EXPECT_EQ(drive_.not_carried(), 0U);
}

// The truth is the prediction of whole motions, by turns, which shares nothing with the drives but
// the twin.
TEST(VirtualDrive, OfAxesThatPushEachOtherMovesAsThePredictionFromCommandsSays) {
  constexpr const char* kTwo = R"(
cycle_s = 0.001
[[axis]]
name = "X"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm"}
actual = {id = 0x181, start_bit = 32, length = 32, unit = "nm"}
target = {id = 0x301, start_bit = 0, length = 32, unit = "nm"}
[[axis]]
name = "Y"
command = {id = 0x182, start_bit = 0, length = 32, unit = "nm"}
actual = {id = 0x182, start_bit = 32, length = 32, unit = "nm"}
target = {id = 0x302, start_bit = 0, length = 32, unit = "nm"}
)";
  const CanMap map = map_of(kTwo);
  Model model = drive();
  model.effects.push_back(make_effect<CrossCouplingByMotion>());
  model.effects.back().coefficient[0] = 0.1;
  const TwinInForce x{Twin(model), 1, 1e-6, 0, 1, true}, y{Twin(model), 1, 1e-6, 0, 0, true};
  VirtualDrive nodes(map, {x, y});
  CanEncoder encoder(map);
  constexpr Eigen::Index kCycles = 1500;
  std::array<Eigen::ArrayXd, 2> target, actual;
  for (std::size_t i = 0; i < 2; ++i) target[i].resize(kCycles), actual[i].resize(kCycles);
  for (Eigen::Index k = 0; k < kCycles; ++k) {
    const double t = 1e-3 * static_cast<double>(k);
    target[0](k) = 1e-9 * std::nearbyint(2e6 * (1.0 - std::cos(6.0 * t)));
    target[1](k) = 1e-9 * std::nearbyint(1e7 * (1.0 - std::cos(9.0 * t)));
    for (std::size_t i = 0; i < 2; ++i) {
      ASSERT_TRUE(encoder.set(i, CanChannel::kTarget, target[i](k)));
      (void)nodes.on_frame(0, encoder.frame(map.find(i, CanChannel::kTarget)->message));
    }
    for (const auto& answer : nodes.on_frame(0, encoder.start())) {
      for (std::size_t i = 0; i < 2; ++i) {
        const MappedSignal* signal = map.find(i, CanChannel::kActual);
        if (answer.frame.id == map.messages[signal->message].id)
          actual[i](k) = decoded(signal->signal, answer.frame.data);
      }
    }
  }
  for (std::size_t i = 0; i < 2; ++i) {
    Segment segment;
    segment.sample_time_s = map.machine.cycle_s;
    segment.command = target[i];
    segment.neighbour = target[1 - i];
    predict_neighbour(segment, model, model, true);
    const Eigen::ArrayXd pushed = simulate(model, segment);
    segment.neighbour_motion.setConstant(0.0);
    segment.neighbour.setConstant(0.0);
    const Eigen::ArrayXd alone = simulate(model, segment);
    const double push = (pushed - alone).abs().maxCoeff();
    EXPECT_GT(push, 5e-7) << "well above a nanometre";
    EXPECT_LT((target[i] - actual[i] - pushed).abs().maxCoeff(), 0.01 * push);
  }
}

TEST(VirtualDrive, NeedsATargetAndASync) {
  const CanMap none = map_of(kTwoBuses);
  expect_error<std::runtime_error>(
      [&] {
        VirtualDrive nodes(none, {{Twin(drive())}, {Twin(drive())}});
      },
      {"axis X", "0x607A"});
  const CanMap own = map_of("sync = 0x181\n" + std::string(kDrive));
  expect_error<std::runtime_error>([&] { VirtualDrive nodes(own, {{Twin(drive())}}); },
                                   {"0x181", "SYNC"});
}

}  // namespace
}  // namespace servotwin::daemon
