// Two made sources, joined: what is said of them, and how they end. How values are joined is tested
// without threads, in frame_join_test.cpp.
#include "daemon/input/joined_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::MatchesRegex;
using testing::Not;

/// Frames of one axis every millisecond; `stamped`: by a clock that goes on.
class Made final : public FrameSource {
 public:
  Made(std::uint64_t count, bool stamped, double actual)
      : count_(count), stamped_(stamped), actual_(actual) {}
  Received receive(MachineFrame& frame, double) noexcept override {
    if (next_ == count_) return Received::kEnd;
    if (paused.load()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      return Received::kNothing;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    frame.sequence = next_++;
    frame.time_ns = stamped_ ? steady_ns() : 7;
    frame.axis_count = 1;
    frame.axes[0].command = 0.25;
    frame.axes[0].actual = actual_;
    return Received::kFrame;
  }
  [[nodiscard]] std::int64_t age_ns() const noexcept override { return 0; }
  [[nodiscard]] SourceState state(std::int64_t) const override {
    SourceState out;
    out.malformed = 3;
    out.buses.resize(1);
    return out;
  }
  [[nodiscard]] std::vector<SourceNews> news(std::int64_t) override {
    return std::exchange(news_, {});
  }

  std::atomic<bool> paused{false};

 private:
  std::uint64_t next_ = 0, count_;
  bool stamped_;
  double actual_;
  std::vector<SourceNews> news_{{"is made", true}};
};

JoinedSource joined(std::uint64_t count, bool stamped, Made** second = nullptr) {
  auto can = std::make_unique<Made>(100'000, true, 2.0);
  if (second != nullptr) *second = can.get();
  std::array<JoinedSource::Part, 2> parts{
      JoinedSource::Part{std::make_unique<Made>(count, stamped, 1.0), "dds"},
      {std::move(can), "can"}};
  return {std::move(parts), {{{0, 0}, {1, 0}}}, {1e-3, 1e-3}};
}

TEST(JoinedSource, GivesTheCyclesOfTheFirstAndEndsWithIt) {
  JoinedSource source = joined(5'000, true);
  MachineFrame frame;
  std::uint64_t frames = 0, with_encoder = 0;
  Received received = Received::kNothing;
  while ((received = source.receive(frame, 10.0)) == Received::kFrame) {
    EXPECT_EQ(frame.sequence, frames++);
    EXPECT_EQ(frame.axes[0].command, 0.25);
    if (std::isfinite(frame.axes[0].actual)) {
      EXPECT_NEAR(frame.axes[0].actual, 2.0, 1e-12);
      ++with_encoder;
    }
  }
  EXPECT_EQ(received, Received::kEnd);
  EXPECT_EQ(frames, 5'000U);
  EXPECT_GT(with_encoder, 100U) << "the last second or so";
  const SourceState state = source.state(steady_ns());
  EXPECT_TRUE(state.clocks->settled);
  EXPECT_EQ(state.malformed, 6U);
  EXPECT_EQ(state.buses.size(), 2U);
  const auto said = [&] {
    std::vector<std::string> lines;
    for (const SourceNews& one : source.news(steady_ns())) lines.push_back(one.text);
    return lines;
  };
  const std::vector<std::string> first = said();
  EXPECT_THAT(first, Contains("dds: is made"));
  EXPECT_THAT(first, Contains("can: is made"));
  EXPECT_THAT(first, Contains(HasSubstr("that of dds; what comes from can")));
  EXPECT_THAT(said(), Not(Contains(HasSubstr("made"))));
}

TEST(JoinedSource, ASecondSourceThatIsGoneIsNamedAtOnceAndWhenItIsBack) {
  Made* can = nullptr;
  JoinedSource source = joined(100'000, true, &can);
  MachineFrame frame;
  std::int64_t now = steady_ns();
  // What is said after half a second more of cycles.
  const auto said = [&] {
    for (int i = 0; i < 100; ++i) EXPECT_EQ(source.receive(frame, 10.0), Received::kFrame);
    std::vector<std::string> lines;
    for (const SourceNews& one : source.news(now += 500'000'000)) lines.push_back(one.text);
    return lines;
  };
  while (!source.state(steady_ns()).clocks->settled) (void)source.receive(frame, 10.0);
  // Single cycles are reported once a minute: the next report has been made just now.
  can->paused = true;
  (void)said(), (void)said();
  can->paused = false;
  (void)said();
  can->paused = true;
  EXPECT_THAT(said(), IsEmpty()) << "the begin of it still had samples";
  EXPECT_THAT(said(), IsEmpty());
  EXPECT_THAT(said(), IsEmpty()) << "half a second is not long";
  EXPECT_THAT(said(),
              ElementsAre("can has nothing for the cycles of dds: what it gives is missing"));
  EXPECT_THAT(said(), IsEmpty());
  can->paused = false;
  EXPECT_THAT(said(), ElementsAre(MatchesRegex("can is back: it had nothing for [56].. cycles")));
  EXPECT_THAT(said(), IsEmpty());
}

TEST(JoinedSource, ASecondSourceThatLosesSomeCyclesIsNotGone) {
  Made* can = nullptr;
  JoinedSource source = joined(100'000, true, &can);
  MachineFrame frame;
  while (!source.state(steady_ns()).clocks->settled) (void)source.receive(frame, 10.0);
  std::int64_t now = steady_ns();
  std::uint64_t absent = source.state(now).clocks->absent;
  for (int half = 0; half < 8; ++half) {
    can->paused = true;
    for (int i = 0; i < 20; ++i) EXPECT_EQ(source.receive(frame, 10.0), Received::kFrame);
    can->paused = false;
    for (int i = 0; i < 80; ++i) EXPECT_EQ(source.receive(frame, 10.0), Received::kFrame);
    for (const SourceNews& one : source.news(now += 500'000'000))
      EXPECT_THAT(one.text, Not(HasSubstr("has nothing")));
    const std::uint64_t before = std::exchange(absent, source.state(now).clocks->absent);
    EXPECT_GT(absent, before) << "it must lose some";
  }
}

TEST(JoinedSource, WithoutCyclesNothingIsBack) {
  Made* can = nullptr;
  JoinedSource source = joined(100'000, true, &can);
  MachineFrame frame;
  while (!source.state(steady_ns()).clocks->settled) (void)source.receive(frame, 10.0);
  can->paused = true;
  std::int64_t now = steady_ns();
  std::string all;
  const auto listen = [&] {
    for (const SourceNews& one : source.news(now += 600'000'000)) all += one.text + "\n";
  };
  for (int part = 0; part < 4; ++part) {
    for (int i = 0; i < 60; ++i) EXPECT_EQ(source.receive(frame, 10.0), Received::kFrame);
    listen();
  }
  ASSERT_THAT(all, HasSubstr("can has nothing"));
  listen();  // the first source has nothing either
  EXPECT_THAT(all, Not(HasSubstr("is back")));
}

TEST(JoinedSource, StampsThatDoNotGoOnAreNamedAfterAWhile) {
  JoinedSource source = joined(100'000, false);
  MachineFrame frame;
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(source.receive(frame, 10.0), Received::kFrame);
    EXPECT_TRUE(std::isnan(frame.axes[0].actual));
  }
  const std::int64_t now = steady_ns(), second = 1'000'000'000;
  (void)source.news(now);
  EXPECT_THAT(source.news(now + 9 * second), IsEmpty());
  EXPECT_THAT(
      source.news(now + 11 * second),
      ElementsAre(Field(&SourceNews::text, HasSubstr("the clocks of dds and can are not known"))));
  EXPECT_THAT(source.news(now + 30 * second), IsEmpty());
}

}  // namespace
}  // namespace servotwin::daemon
