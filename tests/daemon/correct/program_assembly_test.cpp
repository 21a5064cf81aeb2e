#include "daemon/correct/program_assembly.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;

const MachineDescription kThreeAxes{0.001, {{"X", false, ""}, {"Y", false, ""}, {"B", true, ""}}};

double value(std::size_t axis, std::size_t row) {
  return static_cast<double>(axis) + 1e-6 * static_cast<double>(row);
}

/// Rows `from` .. `from + rows` of axes B and X.
ProgramChunk chunk_of(std::uint32_t chunk, std::uint32_t chunks, std::size_t rows = 20,
                      std::uint64_t revision = 1) {
  ProgramChunk out;
  out.program = "part";
  out.revision = revision;
  out.chunk = chunk;
  out.chunks = chunks;
  out.learn = true;
  out.axes = {"B", "X"};
  const std::size_t from = chunk * rows;
  for (std::size_t k = 0; k < rows; ++k)
    out.time_s.push_back(5.0 + 0.001 * static_cast<double>(from + k));
  for (std::size_t axis = 0; axis < 2; ++axis) {
    for (std::size_t k = 0; k < rows; ++k) out.command.push_back(value(axis, from + k));
  }
  return out;
}

using Outcome = ProgramAssembly::Outcome;
bool waits(const Outcome& outcome) { return std::holds_alternative<std::monostate>(outcome); }
std::string refusal(const Outcome& outcome) {
  const auto* refused = std::get_if<ProgramRefusal>(&outcome);
  return refused == nullptr ? "not refused" : refused->reason;
}

TEST(ProgramAssembly, PutsChunksTogetherInTheirOrder) {
  ProgramAssembly assembly(kThreeAxes);
  EXPECT_TRUE(waits(assembly.take(chunk_of(0, 3), 1)));
  EXPECT_TRUE(waits(assembly.take(chunk_of(1, 3), 2)));
  const Outcome whole = assembly.take(chunk_of(2, 3), 3);
  const auto* program = std::get_if<CommandedPath>(&whole);
  ASSERT_NE(program, nullptr) << refusal(whole);
  EXPECT_EQ(program->name, "part");
  EXPECT_EQ(program->revision, 1U);
  EXPECT_TRUE(program->learn);
  EXPECT_EQ(program->axes, (std::vector<std::size_t>{2, 0}));
  ASSERT_EQ(program->rows(), 60);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    for (std::size_t k = 0; k < 60; ++k)
      ASSERT_EQ(program->command[axis](static_cast<Eigen::Index>(k)), value(axis, k));
  }
}

TEST(ProgramAssembly, ANewRevisionAndTheSameOnceMoreBeginAnew) {
  ProgramAssembly assembly(kThreeAxes);
  EXPECT_TRUE(waits(assembly.take(chunk_of(0, 2, 20, 1), 1)));
  EXPECT_TRUE(waits(assembly.take(chunk_of(0, 2, 20, 2), 2)));
  EXPECT_TRUE(std::holds_alternative<CommandedPath>(assembly.take(chunk_of(1, 2, 20, 2), 3)));
  EXPECT_TRUE(waits(assembly.take(chunk_of(0, 2, 20, 2), 4)));
  EXPECT_TRUE(std::holds_alternative<CommandedPath>(assembly.take(chunk_of(1, 2, 20, 2), 5)));
}

struct Spoiled {
  const char* name;
  std::function<void(ProgramChunk&)> spoil;
  const char* reason;
};

class WrongChunk : public testing::TestWithParam<Spoiled> {};

// The second of three chunks is wrong; it is refused by name, once, and the rest of it is ignored.
TEST_P(WrongChunk, IsRefusedByNameOnce) {
  ProgramAssembly assembly(kThreeAxes);
  ASSERT_TRUE(waits(assembly.take(chunk_of(0, 3), 1)));
  ProgramChunk wrong = chunk_of(1, 3);
  GetParam().spoil(wrong);
  EXPECT_THAT(refusal(assembly.take(wrong, 2)), HasSubstr(GetParam().reason));
  EXPECT_TRUE(waits(assembly.take(chunk_of(1, 3), 3)));
  EXPECT_TRUE(waits(assembly.take(chunk_of(2, 3), 4)));
  EXPECT_FALSE(assembly.overdue(5 + kChunkPatience_ns)) << "it does not wait for anything";
}

INSTANTIATE_TEST_SUITE_P(
    , WrongChunk,
    testing::Values(Spoiled{"Missing", [](ProgramChunk& c) { c.chunk = 2; },
                            "chunk 1 of 3 is missing: chunk 2 came instead"},
                    Spoiled{"Number", [](ProgramChunk& c) { c.chunk = 3; }, "chunk 3 of 3"},
                    Spoiled{"OtherCount", [](ProgramChunk& c) { c.chunks = 4; },
                            "other values of chunks, axes or learn"},
                    Spoiled{"OtherAxes",
                            [](ProgramChunk& c) {
                              c.axes = {"B", "Y"};
                            },
                            "other values of chunks, axes or learn"},
                    Spoiled{"OtherWish", [](ProgramChunk& c) { c.learn = false; },
                            "other values of chunks, axes or learn"},
                    Spoiled{"Empty",
                            [](ProgramChunk& c) {
                              c.time_s.clear();
                              c.command.clear();
                            },
                            "has no rows"},
                    Spoiled{"Length", [](ProgramChunk& c) { c.command.pop_back(); },
                            "command_m has 39 values, and 20 rows of 2 axes need 40"},
                    Spoiled{"NotANumber", [](ProgramChunk& c) { c.command[25] = kAbsent; },
                            "command_m of axis X of row 25 is not a number"},
                    Spoiled{"Infinite",
                            [](ProgramChunk& c) {
                              c.command[3] = std::numeric_limits<double>::infinity();
                            },
                            "command_m of axis B of row 23 is not a number"},
                    Spoiled{"TimeNotANumber", [](ProgramChunk& c) { c.time_s[7] = kAbsent; },
                            "time_s of row 27 is not a number"},
                    Spoiled{"UnevenTime", [](ProgramChunk& c) { c.time_s[7] += 2e-5; },
                            "the time of row 27 is"},
                    Spoiled{"TimeGoesBack", [](ProgramChunk& c) { c.time_s[7] = 0.0; },
                            "the time of row 27 is"},
                    Spoiled{"GapBetweenChunks",
                            [](ProgramChunk& c) {
                              for (double& time_s : c.time_s) time_s += 0.001;
                            },
                            "the time of row 20 is 0.002 s after"}),
    [](const auto& one) { return one.param.name; });

TEST(ProgramAssembly, AxesThatTheMachineHasNotAreRefused) {
  ProgramAssembly assembly(kThreeAxes);
  ProgramChunk chunk = chunk_of(0, 1);
  chunk.axes = {"B", "Z"};
  EXPECT_THAT(refusal(assembly.take(chunk, 1)),
              HasSubstr("the machine has no axis 'Z'; it has X, Y, B"));
  chunk.axes = {"B", "B"};
  EXPECT_THAT(refusal(assembly.take(chunk, 2)), HasSubstr("'B' is named twice"));
  chunk.axes.clear();
  chunk.command.clear();
  EXPECT_THAT(refusal(assembly.take(chunk, 3)), HasSubstr("names no axes"));
}

TEST(ProgramAssembly, AnotherCycleThanTheMachinesIsUneven) {
  ProgramAssembly assembly({0.002, kThreeAxes.axes});
  EXPECT_THAT(refusal(assembly.take(chunk_of(0, 1), 1)), HasSubstr("one cycle of the machine"));
}

TEST(ProgramAssembly, TooLongAndTooShortAreRefused) {
  ProgramAssembly assembly(kThreeAxes);
  EXPECT_THAT(refusal(assembly.take(chunk_of(0, 257), 1)), HasSubstr("too long: 257 chunks"));
  EXPECT_THAT(refusal(assembly.take(chunk_of(0, 1, 15), 2)), HasSubstr("too short: 15 rows"));

  MachineDescription large{0.001, {}};
  for (int i = 0; i < 32; ++i) large.axes.push_back({"A" + std::to_string(i), false, ""});
  ProgramAssembly of_many(large);
  ProgramChunk chunk;
  chunk.program = "part";
  chunk.chunks = 256;
  for (const AxisDescription& axis : large.axes) chunk.axes.push_back(axis.name);
  chunk.command.assign(kMaxChunkValues, 0.0);
  for (chunk.chunk = 0; chunk.chunk < 256; ++chunk.chunk) {
    chunk.time_s.clear();
    for (std::size_t k = 0; k < kMaxChunkSamples; ++k)
      chunk.time_s.push_back(0.001 * static_cast<double>(chunk.chunk * kMaxChunkSamples + k));
    const Outcome outcome = of_many.take(chunk, 1);
    if (waits(outcome)) continue;
    EXPECT_THAT(refusal(outcome), HasSubstr("too long: more than 65536 rows of 32 axes"));
    break;
  }
  EXPECT_EQ(chunk.chunk, 64U) << "65,536 rows of 32 axes are just possible";
}

TEST(ProgramAssembly, AChunkThatNeverComesIsMissing) {
  ProgramAssembly assembly(kThreeAxes);
  EXPECT_TRUE(waits(assembly.take(chunk_of(0, 2), 1000)));
  EXPECT_FALSE(assembly.overdue(999 + kChunkPatience_ns));
  const std::optional<ProgramRefusal> overdue = assembly.overdue(1000 + kChunkPatience_ns);
  ASSERT_TRUE(overdue);
  EXPECT_EQ(overdue->program, "part");
  EXPECT_THAT(overdue->reason, HasSubstr("chunk 1 of 2 is missing"));
  EXPECT_FALSE(assembly.overdue(1001 + kChunkPatience_ns)) << "told once";
}

TEST(ProgramAssembly, ManyNamesTakeNoMoreThanTheirRoom) {
  ProgramAssembly assembly(kThreeAxes);
  for (std::size_t i = 0; i <= kMaxProgramsAtOnce; ++i) {
    ProgramChunk chunk = chunk_of(0, 2);
    chunk.program = "part" + std::to_string(i);
    EXPECT_TRUE(waits(assembly.take(chunk, static_cast<std::int64_t>(i))));
  }
  ProgramChunk rest = chunk_of(1, 2);
  rest.program = "part0";
  EXPECT_THAT(refusal(assembly.take(rest, 100)), HasSubstr("chunk 0 of 2 is missing"))
      << "the one that had waited longest made room";
  rest.program = "part16";
  EXPECT_TRUE(std::holds_alternative<CommandedPath>(assembly.take(rest, 101)));
}

}  // namespace
}  // namespace servotwin::daemon
