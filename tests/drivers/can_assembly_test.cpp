// From frames to cycles: complete ones, and every kind of incomplete ones.
#include "drivers/can/can_assembly.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "drivers/can/can_encoder.h"

namespace servotwin {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart = 1'700'000'000'000'000'000;

/// Two axes, one message each; steps of a micrometre, 16 bits.
CanMap two_axes(const std::string& head = "", const std::string& more = "") {
  CheckedCanMap checked = check_can_map("cycle_s = 0.001\n" + head + R"(
[[axis]]
name = "X"
command = {id = 0x181, start_bit = 0, length = 16, unit = "um", message_bytes = 4}
actual = {id = 0x181, start_bit = 16, length = 16, unit = "um", message_bytes = 4}
[[axis]]
name = "Y"
command = {id = 0x182, start_bit = 0, length = 16, unit = "um", message_bytes = 4}
actual = {id = 0x182, start_bit = 16, length = 16, unit = "um", message_bytes = 4}
)" + more,
                                        "m.toml", "");
  EXPECT_TRUE(checked.problems.empty()) << messages(checked.problems);
  return std::move(checked.map);
}

class Assembly : public testing::Test {
 protected:
  void use(CanMap map, Pacing pacing = Pacing::kByStamp) {
    assembly_ = std::make_unique<CanAssembly>(std::move(map), pacing);
  }
  void give(std::uint32_t id, std::int64_t at_ns, std::vector<int> words = {}) {
    CanFrame frame;
    frame.id = id;
    frame.time_ns = kStart + at_ns;
    for (std::size_t i = 0; i < words.size(); ++i)
      set_raw_bits({static_cast<int>(16 * i), 16}, static_cast<std::uint64_t>(words[i]) & 0xFFFFU,
                   frame.data);
    frame.length = static_cast<std::uint8_t>(2 * words.size());
    frame.after_gap = std::exchange(gap_, false);
    give(frame);
  }
  void give(const CanFrame& frame) {
    assembly_->on_frame(0, frame);
    collect();
  }
  void collect() {
    MachineFrame frame;
    while (assembly_->take(frame)) cycles_.push_back(frame);
  }
  [[nodiscard]] std::vector<std::string> told() const {
    CanAssembly fresh(assembly_->map());
    std::vector<std::string> out;
    for (const SourceNews& news : told_since(fresh.counts())) out.push_back(news.text);
    return out;
  }
  [[nodiscard]] std::vector<SourceNews> told_since(const CanCounts& before) const {
    return happened(assembly_->map(), before, assembly_->counts());
  }
  /// Complete cycles from..to-1 in which X and Y are at the position of the cycle's number [um].
  void whole(int from, int to) {
    for (int k = from; k < to; ++k) {
      give(0x80, k * kMs);
      give(0x181, k * kMs + 100'000, {k, k});
      give(0x182, k * kMs + 200'000, {k, k});
    }
  }

  std::unique_ptr<CanAssembly> assembly_ = std::make_unique<CanAssembly>(two_axes());
  std::vector<MachineFrame> cycles_;
  bool gap_ = false;
};

TEST_F(Assembly, ACycleIsThereWithItsLastMessageAndHasTheStampOfItsSync) {
  give(0x80, 0);
  give(0x182, 100'000, {7, 5});
  EXPECT_THAT(cycles_, IsEmpty());
  give(0x181, 200'000, {-3, -4});
  ASSERT_EQ(cycles_.size(), 1U);
  EXPECT_EQ(cycles_[0].time_ns, kStart);
  EXPECT_EQ(cycles_[0].axis_count, 2);
  EXPECT_DOUBLE_EQ(cycles_[0].axes[0].command, -3e-6);
  EXPECT_DOUBLE_EQ(cycles_[0].axes[0].actual, -4e-6);
  EXPECT_DOUBLE_EQ(cycles_[0].axes[1].command, 7e-6);
  EXPECT_TRUE(std::isnan(cycles_[0].axes[0].torque));
  EXPECT_THAT(told(), IsEmpty());
}

TEST_F(Assembly, SequencesCountCyclesAndLostSyncsShow) {
  whole(0, 3);
  whole(5, 6);
  ASSERT_EQ(cycles_.size(), 4U);
  EXPECT_EQ(cycles_[2].sequence, cycles_[0].sequence + 2);
  EXPECT_EQ(cycles_[3].sequence, cycles_[0].sequence + 5);
}

TEST_F(Assembly, AtTheDeadlineWhatIsNotThereIsNotANumber) {
  whole(0, 1);
  give(0x80, kMs);
  give(0x181, kMs + 100'000, {9, 9});
  EXPECT_EQ(assembly_->deadline_ns(), kStart + kMs + 900'000);
  assembly_->on_time(kStart + kMs + 900'000);
  collect();
  EXPECT_EQ(cycles_.size(), 1U);
  assembly_->on_time(kStart + kMs + 900'001);
  collect();
  ASSERT_EQ(cycles_.size(), 2U);
  EXPECT_DOUBLE_EQ(cycles_[1].axes[0].command, 9e-6);
  EXPECT_TRUE(std::isnan(cycles_[1].axes[1].command));
  EXPECT_FALSE(assembly_->deadline_ns());
}

TEST_F(Assembly, LateAndMissingAreTwoThings) {
  give(0x80, 0);
  give(0x181, 100'000, {1, 1});
  give(0x182, 950'000, {1, 1});  // after the deadline of 0.9 ms, before the next SYNC
  give(0x80, kMs);
  give(0x181, kMs + 100'000, {1, 1});
  give(0x80, 2 * kMs);
  const CanCounts counts = assembly_->counts();
  EXPECT_EQ(counts.messages[1].late, 1U);
  EXPECT_EQ(counts.messages[1].missing, 1U);
  EXPECT_EQ(counts.messages[0].late + counts.messages[0].missing, 0U);
  EXPECT_EQ(counts.incomplete, 2U);
  EXPECT_EQ(cycles_.size(), 2U);
  EXPECT_TRUE(std::isnan(cycles_[0].axes[1].actual)) << "what is late is not used";
  EXPECT_THAT(told(), ElementsAre("0x182 of axis Y: once after the deadline, once missing"));
}

TEST_F(Assembly, TheFirstOfTwoCountsAndTheSecondIsTold) {
  give(0x80, 0);
  give(0x181, 100'000, {1, 1});
  give(0x181, 150'000, {2, 2});
  give(0x182, 200'000, {1, 1});
  give(0x182, 250'000, {2, 2});
  ASSERT_EQ(cycles_.size(), 1U);
  EXPECT_DOUBLE_EQ(cycles_[0].axes[0].command, 1e-6);
  EXPECT_THAT(told(), ElementsAre("0x181 of axis X: once repeated in a cycle",
                                  "0x182 of axis Y: once repeated in a cycle"));
}

TEST_F(Assembly, AWrongLengthIsNotUsed) {
  give(0x80, 0);
  give(0x181, 100'000, {1, 1, 1});
  give(0x181, 150'000, {2});
  give(0x182, 200'000, {1, 1});
  give(0x80, kMs);
  EXPECT_TRUE(std::isnan(cycles_.at(0).axes[0].command));
  EXPECT_EQ(assembly_->wrong_length(0), 2U);
  EXPECT_THAT(told(), ElementsAre(HasSubstr("once missing, 2 times of a wrong length (it must have "
                                            "4 bytes)")));
}

TEST_F(Assembly, UnexpectedIdsAreNamedOnceAndCounted) {
  whole(0, 2);
  give(0x701, 100, {});
  give(0x701, 200, {});
  CanFrame extended;
  extended.id = 0x181;  // the same number, another id
  extended.extended = true;
  give(extended);
  EXPECT_EQ(assembly_->counts().buses[0].unexpected, 3U);
  EXPECT_THAT(told(), ElementsAre("not in the mapping, and ignored: 0x701, 0x00000181"));
  for (std::uint32_t id = 0x500; id < 0x580; ++id) give(id, 0);
  EXPECT_EQ(assembly_->counts().unexpected.size(), CanCounts::kUnexpectedIds);
}

TEST_F(Assembly, ASilentNodeIsToldAndComesBack) {
  whole(0, 5);
  for (int k = 5; k < 120; ++k) {
    give(0x80, k * kMs);
    give(0x181, k * kMs + 100'000, {k, k});
  }
  EXPECT_TRUE(assembly_->counts().messages[1].silent);
  EXPECT_THAT(told(), ElementsAre(HasSubstr("0x182 of axis Y: 114 times missing, fell silent")));
  const CanCounts silent = assembly_->counts();
  whole(120, 123);
  EXPECT_FALSE(assembly_->counts().messages[1].silent);
  ASSERT_EQ(told_since(silent).size(), 1U);
  EXPECT_TRUE(told_since(silent)[0].good) << "what was known, and that it is over";
  EXPECT_THAT(told(), ElementsAre(HasSubstr("is back")));
  CanAssembly fresh(assembly_->map());
  EXPECT_FALSE(told_since(fresh.counts())[0].good) << "nobody has been told of the silence";
  EXPECT_EQ(cycles_.size(), 123U);
}

TEST_F(Assembly, ErrorFramesAreToldByWhatTheyMean) {
  CanFrame error;
  error.error = true;
  error.id = 0x40;  // CAN_ERR_BUSOFF
  error.length = 8;
  give(error);
  error.id = 0x100;  // CAN_ERR_RESTARTED
  give(error);
  error.id = 0x04;  // CAN_ERR_CRTL
  error.data[1] = 0x01;
  give(error);
  EXPECT_THAT(told(), ElementsAre(HasSubstr("bus-off"), HasSubstr("takes part again"),
                                  HasSubstr("buffer overflowed")));
}

TEST_F(Assembly, WithoutSyncAMessageBeginsTheCycle) {
  use(two_axes("sync = 0x181\n"));
  for (int k = 0; k < 3; ++k) {
    give(0x181, k * kMs, {k, k});
    give(0x182, k * kMs + 500'000, {k, k});
  }
  ASSERT_EQ(cycles_.size(), 3U);
  EXPECT_DOUBLE_EQ(cycles_[2].axes[0].command, 2e-6);
  EXPECT_DOUBLE_EQ(cycles_[2].axes[1].command, 2e-6);
  EXPECT_EQ(cycles_[2].time_ns, kStart + 2 * kMs);
  EXPECT_THAT(told(), IsEmpty());
}

TEST_F(Assembly, CountersThatGoRoundGoOn) {
  // 16 bits of a micrometre wrap around after 65.536 mm: forwards over the end, and back.
  std::vector<int> path;
  for (int i = 0; i <= 100; ++i) path.push_back(1000 * i);
  for (int i = 100; i >= -100; --i) path.push_back(1000 * i);
  int k = 0;
  for (const int position : path) {
    give(0x80, k * kMs);
    give(0x181, k * kMs + 1, {position, position - 20});
    give(0x182, k * kMs + 2, {position, position + 20});
    ++k;
  }
  ASSERT_EQ(cycles_.size(), path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    EXPECT_NEAR(cycles_[i].axes[0].command, 1e-6 * path[i], 1e-12);
    EXPECT_NEAR(cycles_[i].axes[0].command - cycles_[i].axes[0].actual, 20e-6, 1e-12);
    EXPECT_NEAR(cycles_[i].axes[1].command - cycles_[i].axes[1].actual, -20e-6, 1e-12);
  }
}

TEST_F(Assembly, TheFirstActualIsOnTheTurnOfItsCommand) {
  give(0x80, 0);
  give(0x181, 1, {32767, -32768});  // one step apart, at the end of the bits
  give(0x182, 2, {0, 0});
  EXPECT_NEAR(cycles_.at(0).axes[0].actual - cycles_[0].axes[0].command, 1e-6, 1e-12);
}

TEST_F(Assembly, TheCommandFollowsFromTheFollowingError) {
  use(two_axes("", R"([[axis]]
name = "Z"
actual = {id = 0x183, start_bit = 0, length = 16, unit = "um"}
following_error = {id = 0x183, start_bit = 16, length = 16, unit = "um"}
)"));
  whole(0, 1);
  give(0x183, 300'000, {100, -7});
  ASSERT_EQ(cycles_.size(), 1U);
  EXPECT_NEAR(cycles_[0].axes[2].command, 93e-6, 1e-12);
}

TEST_F(Assembly, AClockThatIsSetBackOrForthIsNoLossOfCycles) {
  whole(0, 3);
  const std::int64_t step = 3'600'000 * kMs;
  assembly_->on_clock_set(step);
  give(0x80, step + 3 * kMs);
  give(0x181, step + 3 * kMs + 1, {3, 3});
  give(0x182, step + 3 * kMs + 2, {3, 3});
  ASSERT_EQ(cycles_.size(), 4U);
  EXPECT_EQ(cycles_[3].sequence, cycles_[2].sequence + 1);
  // If the step of the clock is not reported, the cycles are numbered on.
  whole(3, 5);
  ASSERT_EQ(cycles_.size(), 6U);
  EXPECT_EQ(cycles_[5].sequence, cycles_[3].sequence + 2);
}

TEST_F(Assembly, StampsThatComeInHeapsCountEveryCycle) {
  use(two_axes(), Pacing::kByCount);
  for (int k = 0; k < 100; ++k) {
    const std::int64_t packet = k / 10 * 10 * kMs;  // ten cycles each
    give(0x80, packet);
    give(0x181, packet, {k, k});
    give(0x182, packet, {k, k});
  }
  ASSERT_EQ(cycles_.size(), 100U);
  for (std::size_t k = 1; k < 100; ++k) {
    EXPECT_EQ(cycles_[k].sequence, cycles_[k - 1].sequence + 1);
    EXPECT_NEAR(static_cast<double>(cycles_[k].time_ns - cycles_[k - 1].time_ns), 1e6, 2e4);
  }
  // A packet is lost: ten cycles later the next one comes.
  gap_ = true;
  give(0x80, 120 * kMs);
  give(0x181, 120 * kMs, {1, 1});
  give(0x182, 120 * kMs, {1, 1});
  EXPECT_GT(cycles_[100].sequence, cycles_[99].sequence + 10);
}

TEST_F(Assembly, RemoteFramesAreNoData) {
  give(0x80, 0);
  CanFrame remote;
  remote.id = 0x181;
  remote.remote = true;
  remote.length = 4;
  remote.time_ns = kStart + 10;
  give(remote);
  EXPECT_EQ(assembly_->counts().messages[0].received, 0U);
  EXPECT_EQ(assembly_->counts().buses[0].unexpected, 1U);
}

TEST_F(Assembly, WhatIsEncodedIsDecodedAgain) {
  const CanMap map = two_axes();
  CanEncoder encoder(map);
  EXPECT_TRUE(encoder.set(0, CanChannel::kCommand, 123e-6));
  EXPECT_TRUE(encoder.set(0, CanChannel::kActual, 100e-6));
  EXPECT_TRUE(encoder.set(1, CanChannel::kCommand, 0.070));  // goes round
  EXPECT_TRUE(encoder.set(1, CanChannel::kActual, 0.070));
  EXPECT_FALSE(encoder.set(0, CanChannel::kTorque, 1.0)) << "there is none";
  EXPECT_FALSE(encoder.set(0, CanChannel::kActual, std::nan("")));
  CanFrame sync = encoder.start();
  sync.time_ns = kStart;
  give(sync);
  for (std::size_t m = 0; m < 2; ++m) {
    CanFrame frame = encoder.frame(m);
    frame.time_ns = kStart + 1;
    give(frame);
  }
  ASSERT_EQ(cycles_.size(), 1U);
  EXPECT_NEAR(cycles_[0].axes[0].command, 123e-6, 1e-12);
  EXPECT_NEAR(cycles_[0].axes[0].actual, 100e-6, 1e-12);
  EXPECT_NEAR(cycles_[0].axes[1].command, 0.070 - 0.065536, 1e-12);
}

}  // namespace
}  // namespace servotwin
