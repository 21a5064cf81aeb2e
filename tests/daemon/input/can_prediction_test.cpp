// Predictions to a PLC: the bytes of the messages worked out by hand, when they are sent, and when
// not.
#include "daemon/input/can_prediction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "daemon/input/can_source.h"

namespace servotwin::daemon {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr std::int64_t kMillisecond_ns = 1'000'000;
constexpr std::uint32_t kSeed = 1'234'567'890;

// X: two figures of 16 bits in 0.1 um, the second big endian, and two bits. Y: one of 32 bits in
// 1/1000 degree.
constexpr const char* kMachine = R"(
cycle_s = 0.001
prediction_period_s = 0.004
[[axis]]
name = "X"
invert = true
position_unit = "um"
command = {id = 0x181, start_bit = 0, length = 32}
predicted_error = {id = 0x1A0, start_bit = 0, length = 16, unit = "um*0.1"}
residual = {id = 0x1A0, start_bit = 23, length = 16, byte_order = "big", unit = "um*0.1"}
prediction_valid = {id = 0x1A0, start_bit = 32, length = 1}
alarm = {id = 0x1A0, start_bit = 33, length = 1}
[[axis]]
name = "C"
units = "rad"
command = {id = 0x182, start_bit = 0, length = 32, unit = "deg*0.001"}
predicted_error = {id = 0x12345, start_bit = 0, length = 32, unit = "deg*0.001"}
prediction_valid = {id = 0x12345, start_bit = 32, length = 8}
)";

CanMap machine_with_plc() {
  CheckedCanMap checked = check_can_map(kMachine, "m.toml", "");
  EXPECT_TRUE(checked.problems.empty()) << messages(checked.problems);
  return std::move(checked.map);
}

/// Takes what is sent, and gives what the test has put there.
class Sink final : public CanBus {
 public:
  std::size_t receive(std::span<CanFrame> batch, double) noexcept override {
    if (!to_come) return 0;
    batch[0] = *to_come;
    to_come.reset();
    return 1;
  }
  std::size_t send(std::span<const CanFrame> frames) noexcept override {
    for (const CanFrame& frame : frames) sent.push_back(frame);
    return frames.size();
  }
  [[nodiscard]] int descriptor() const noexcept override { return -1; }

  std::vector<CanFrame> sent;
  std::optional<CanFrame> to_come;
};

MachinePrediction predicted(double x, double residual, double c) {
  MachinePrediction out;
  out.axis_count = 2;
  out.axes[0].predicted_error = x;
  out.axes[0].residual = residual;
  out.axes[1].predicted_error = c;
  for (AxisPrediction& axis : out.axes) axis.state = AxisState::kPredicting;
  return out;
}

class CanPredictionTest : public testing::Test {
 protected:
  CanPredictionTest() {
    auto owned = std::make_unique<Sink>();
    sink_ = owned.get();
    buses_.push_back(std::move(owned));
  }
  /// Tells it until it is sent, and returns the bytes of the message with this id.
  std::vector<int> bytes(const MachinePrediction& prediction, std::uint32_t id) {
    sink_->sent.clear();
    while (sink_->sent.empty()) teller_.tell(prediction, buses_, now_ns_ += kMillisecond_ns);
    EXPECT_THAT(sink_->sent, SizeIs(2));
    for (const CanFrame& frame : sink_->sent) {
      if (frame.id == id) return {frame.data.begin(), frame.data.begin() + frame.length};
    }
    return {};
  }

  CanMap map_ = machine_with_plc();
  CanPrediction teller_{map_, 0, kSeed};
  std::vector<std::unique_ptr<CanBus>> buses_;
  Sink* sink_ = nullptr;
  std::int64_t now_ns_ = 0;
};

TEST_F(CanPredictionTest, TheBytesAreThoseOfTheMapping) {
  // 123 and -32 steps of 0.1 um: 0x007B, 0xFFE0. The drive's sign is not that of the axis.
  const MachinePrediction now = predicted(12.3e-6, -3.2e-6, -1.5 * std::acos(-1.0) / 180.0);
  EXPECT_THAT(bytes(now, 0x1A0), ElementsAre(0x7B, 0x00, 0xFF, 0xE0, 0x01));
  // -1500 steps of 0.001 degree: 0xFFFFFA24.
  EXPECT_THAT(bytes(now, 0x12345), ElementsAre(0x24, 0xFA, 0xFF, 0xFF, 0x01));
  for (const CanFrame& frame : sink_->sent) EXPECT_EQ(frame.extended, frame.id == 0x12345);
  teller_.alarm(0, true);
  EXPECT_THAT(bytes(now, 0x1A0), ElementsAre(0x7B, 0x00, 0xFF, 0xE0, 0x03));
  teller_.alarm(0, false);
  EXPECT_THAT(bytes(now, 0x1A0), ElementsAre(0x7B, 0x00, 0xFF, 0xE0, 0x01));
}

TEST_F(CanPredictionTest, WhatIsNotKnownIsZeroAndNotValid) {
  MachinePrediction now = predicted(12.3e-6, std::nan(""), 0.0);  // no encoder value
  EXPECT_THAT(bytes(now, 0x1A0), ElementsAre(0, 0, 0, 0, 0));
  EXPECT_THAT(bytes(now, 0x12345), ElementsAre(0, 0, 0, 0, 1)) << "it has no residual to send";
  now = predicted(12.3e-6, 1e-6, 0.0);
  now.axes[0].state = AxisState::kSettling;
  teller_.alarm(0, true);
  EXPECT_THAT(bytes(now, 0x1A0), ElementsAre(0, 0, 0, 0, 2));
  // 4 mm are 40 000 steps of 0.1 um, more than 16 bits hold.
  EXPECT_THAT(bytes(predicted(4e-3, 1e-6, 0.0), 0x1A0), ElementsAre(0, 0, 0, 0, 2));
  EXPECT_THAT(bytes(predicted(3e-6, 1e-6, 0.0), 0x1A0), ElementsAre(30, 0, 0, 10, 3));
}

TEST_F(CanPredictionTest, OnePerPeriodAfterOneOrTwoSecondsOfListening) {
  const MachinePrediction now = predicted(0.0, 0.0, 0.0);
  std::vector<std::int64_t> at_ms;
  for (int ms = 1; at_ms.size() < 3; ++ms) {
    ASSERT_LE(ms, 2100);
    teller_.tell(now, buses_, ms * kMillisecond_ns);
    if (!sink_->sent.empty()) at_ms.push_back(ms);
    sink_->sent.clear();
  }
  EXPECT_GE(at_ms[0], 1000);
  EXPECT_LE(at_ms[0], 2000);
  EXPECT_THAT(at_ms, ElementsAre(at_ms[0], at_ms[0] + 4, at_ms[0] + 8));
}

TEST_F(CanPredictionTest, AsLongAsAnotherSendsThemNothingIsSent) {
  const MachinePrediction now = predicted(0.0, 0.0, 0.0);
  CanFrame frame;
  frame.id = 0x1A0;
  (void)bytes(now, 0x1A0);
  teller_.on_frame(0, frame, now_ns_);
  EXPECT_TRUE(teller_.heard_other(now_ns_));
  sink_->sent.clear();
  const std::int64_t heard_ns = now_ns_;
  while (now_ns_ < heard_ns + 999 * kMillisecond_ns)
    teller_.tell(now, buses_, now_ns_ += kMillisecond_ns);
  EXPECT_THAT(sink_->sent, IsEmpty());
  EXPECT_TRUE(teller_.heard_other(now_ns_));
  EXPECT_THAT(bytes(now, 0x1A0), SizeIs(5));
  EXPECT_LE(now_ns_, heard_ns + 2000 * kMillisecond_ns);
  EXPECT_FALSE(teller_.heard_other(now_ns_));

  frame.id = 0x181;  // of the machine
  teller_.on_frame(0, frame, now_ns_);
  frame.id = 0x1A0;
  frame.extended = true;  // another message
  teller_.on_frame(0, frame, now_ns_);
  EXPECT_FALSE(teller_.heard_other(now_ns_));
}

// Two daemons in standby hear the last frame of the one that sent at the same moment, and hear each
// other from then on, a millisecond late.
TEST_F(CanPredictionTest, OfTwoThatWaitOneSends) {
  const MachinePrediction now = predicted(0.0, 0.0, 0.0);
  CanPrediction other(map_, 0, kSeed / 2);
  CanFrame last;
  last.id = 0x1A0;
  for (int times = 0; times < 10; ++times) {
    SCOPED_TRACE(times);
    teller_.on_frame(0, last, now_ns_);
    other.on_frame(0, last, now_ns_);
    int ours = 0, its = 0;
    for (int ms = 1; ms <= 4000; ++ms) {
      now_ns_ += kMillisecond_ns;
      sink_->sent.clear();
      teller_.tell(now, buses_, now_ns_);
      const std::vector<CanFrame> from_us = std::exchange(sink_->sent, {});
      other.tell(now, buses_, now_ns_);
      const std::vector<CanFrame> from_it = std::exchange(sink_->sent, {});
      for (const CanFrame& frame : from_us) other.on_frame(0, frame, now_ns_ + kMillisecond_ns);
      for (const CanFrame& frame : from_it) teller_.on_frame(0, frame, now_ns_ + kMillisecond_ns);
      if (ms <= 3000) continue;
      ours += from_us.empty() ? 0 : 1;
      its += from_it.empty() ? 0 : 1;
    }
    EXPECT_EQ(std::min(ours, its), 0);
    EXPECT_EQ(std::max(ours, its), 250);
  }
}

TEST(CanPredictions, ThatComeRarelyAreWaitedForThreePeriods) {
  std::string rarely = kMachine;
  rarely.replace(rarely.find("0.004"), 5, "1.000");
  CheckedCanMap checked = check_can_map(rarely, "m.toml", "");
  ASSERT_TRUE(checked.problems.empty()) << messages(checked.problems);
  CanPrediction teller(checked.map, 0, kSeed);
  std::vector<std::unique_ptr<CanBus>> buses;
  buses.push_back(std::make_unique<Sink>());
  const auto& sink = dynamic_cast<const Sink&>(*buses.front());
  int ms = 0;
  while (sink.sent.empty() && ms < 10'000)
    teller.tell(predicted(0.0, 0.0, 0.0), buses, ++ms * kMillisecond_ns);
  EXPECT_GE(ms, 3000);
  EXPECT_LE(ms, 6000);
}

TEST(CanSourceTells, OnlyIfAskedToAndSaysWhenAnotherDoes) {
  auto owned = std::make_unique<Sink>();
  Sink& sink = *owned;
  std::vector<std::unique_ptr<CanBus>> buses;
  buses.push_back(std::move(owned));
  CanSource source(machine_with_plc(), std::move(buses), Pacing::kByStamp);
  source.tell(predicted(0.0, 0.0, 0.0));
  source.tell_predictions();
  EXPECT_THAT(source.news(1), IsEmpty());
  CanFrame frame;
  frame.id = 0x1A0;
  frame.length = 5;
  sink.to_come = frame;
  MachineFrame cycle;
  EXPECT_EQ(source.receive(cycle, 0.002), Received::kNothing);
  const std::vector<SourceNews> news = source.news(2);
  ASSERT_THAT(news, SizeIs(1));
  EXPECT_THAT(news[0].text, HasSubstr("another sender tells the PLC predictions"));
  for (int i = 0; i < 100; ++i) source.tell(predicted(0.0, 0.0, 0.0));
  EXPECT_THAT(sink.sent, IsEmpty());
}

}  // namespace
}  // namespace servotwin::daemon
