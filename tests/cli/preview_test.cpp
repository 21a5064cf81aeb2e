// servotwin preview, with this test as the daemon.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/dds/dds.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using testing::HasSubstr;

constexpr double kPatience_s = 30.0;

DdsPlace place() {
  const auto id = static_cast<std::uint32_t>(::getpid());
  return {"preview-test-" + std::to_string(id), 1 + id % 200, ""};
}

class Preview : public testing::Test {
 protected:
  Preview() {
    MachineStatus status;
    status.state = DaemonState::kRunning;
    status.axes.resize(1);
    status.axes[0].name = "X";
    EXPECT_TRUE(status_.write(status));
  }
  /// Starts the tool with a table of 2.5 s and receives its program.
  void ask(std::vector<std::string> more) {
    const std::vector<std::string> words{"preview",
                                         folder_.write("my path.csv", command_table(2.5)),
                                         "--dds",
                                         "--machine",
                                         place().machine,
                                         "--domain",
                                         std::to_string(place().domain)};
    more.insert(more.begin(), words.begin(), words.end());
    tool_ = std::make_unique<Program>(more);
    ProgramChunk chunk;
    do {
      ASSERT_TRUE(programs_.receive(chunk, kPatience_s));
      asked_.push_back(chunk);
    } while (chunk.chunk + 1 < chunk.chunks);
  }
  [[nodiscard]] CorrectionChunk answer(CorrectionState state) const {
    CorrectionChunk out;
    out.program = asked_.front().program;
    out.revision = asked_.front().revision;
    out.state = state;
    return out;
  }

  Folder folder_;
  DdsNode node_{place()};
  DdsReader<ProgramChunk> programs_{node_};
  DdsWriter<CorrectionChunk> corrections_{node_};
  DdsWriter<MachineStatus> status_{node_};
  std::unique_ptr<Program> tool_;
  std::vector<ProgramChunk> asked_;
};

TEST_F(Preview, SendsThePathInChunksAndWritesTheCorrectedOne) {
  ask({"--learn", "--out", folder_ / "out.csv"});
  ASSERT_EQ(asked_.size(), 3U);
  std::vector<double> command;
  for (const ProgramChunk& chunk : asked_) {
    EXPECT_EQ(chunk.program, "my_path");
    EXPECT_EQ(chunk.revision, asked_.front().revision);
    EXPECT_TRUE(chunk.learn);
    EXPECT_EQ(chunk.axes, std::vector<std::string>{"X"});
    command.insert(command.end(), chunk.command.begin(), chunk.command.end());
  }
  for (std::size_t k = 0; k < command.size(); ++k)
    ASSERT_NEAR(command[k], rich_motion(0.001 * static_cast<double>(k)), 1e-9) << k;

  CorrectionChunk other = answer(CorrectionState::kRefused);
  other.revision -= 1;  // of somebody else: not for this one
  ASSERT_TRUE(corrections_.write(other));
  CorrectionChunk learned = answer(CorrectionState::kLearned);
  learned.axes = {{"X", false, 7, 1e-4, 2e-4, 3e-6, 4e-6}};
  learned.chunks = 2;
  learned.corrected.assign(2, 0.25);
  learned.error_before = learned.error_after = learned.corrected;
  ASSERT_TRUE(corrections_.write(learned));
  learned.chunk = 1;
  learned.corrected.assign(command.size() - 2, 0.5);
  learned.error_before = learned.error_after = learned.corrected;
  ASSERT_TRUE(corrections_.write(learned));
  const Answer said = tool_->answer();
  ASSERT_EQ(said.status, 0) << said;
  EXPECT_THAT(said.out, HasSubstr("program 'my_path' learned with the models in force (X 7)"));
  EXPECT_THAT(said.out, HasSubstr("100.000 um RMS"));
  EXPECT_THAT(said.out, HasSubstr("3.000 um RMS"));
  EXPECT_THAT(content_of(folder_ / "out.csv"),
              HasSubstr("time[s],X.command[m]\n0,0.25\n0.001,0.25\n0.002,0.5\n"));
}

TEST_F(Preview, ARefusalIsTheDaemonsReason) {
  ask({});
  EXPECT_FALSE(asked_.front().learn);
  CorrectionChunk refused = answer(CorrectionState::kRefused);
  refused.reason = "axis X has no model in force yet";
  ASSERT_TRUE(corrections_.write(refused));
  const Answer said = tool_->answer();
  EXPECT_EQ(said.status, 1);
  EXPECT_THAT(said.err, HasSubstr("the daemon refused it: axis X has no model in force yet"));
}

// Messages contain no units.
TEST_F(Preview, DegreesOfALinearAxisAreRefused) {
  std::string table = command_table(0.5);
  table.replace(table.find("[mm]"), 4, "[deg]");
  Program tool({"preview", folder_.write("path.csv", table), "--dds", "--machine", place().machine,
                "--domain", std::to_string(place().domain), "--wait", "5"});
  const Answer said = tool.answer();
  EXPECT_EQ(said.status, 1);
  EXPECT_THAT(said.err, HasSubstr("X.command has the unit of a rotary axis, and X of machine"));
  EXPECT_THAT(said.err, HasSubstr("is linear; correct the unit in the header"));
  ProgramChunk chunk;
  EXPECT_FALSE(programs_.receive(chunk, 0.1)) << "nothing was sent";
}

TEST_F(Preview, ADaemonThatKnowsNoAxesYetIsNotDenied) {
  DdsNode other({"waiting", place().domain, ""});
  DdsWriter<MachineStatus> status(other);
  ASSERT_TRUE(status.write(MachineStatus{}));
  Program tool({"preview", folder_.write("path.csv", command_table(0.5)), "--dds", "--machine",
                "waiting", "--domain", std::to_string(place().domain), "--wait", "2"});
  const Answer said = tool.answer();
  EXPECT_EQ(said.status, 1);
  EXPECT_THAT(said.err, HasSubstr("the daemon of machine 'waiting' in DDS domain"));
  EXPECT_THAT(said.err, HasSubstr("does not know its axes yet"));
}

// The topics exist, but belong to another machine.
TEST_F(Preview, AMachineThatNobodySpeaksForIsNamed) {
  Program tool({"preview", folder_.write("path.csv", command_table(0.5)), "--dds", "--machine",
                "misspelt", "--domain", std::to_string(place().domain), "--wait", "2"});
  const Answer said = tool.answer();
  EXPECT_EQ(said.status, 1);
  EXPECT_THAT(said.err, HasSubstr("no daemon listens to machine 'misspelt' in DDS domain " +
                                  std::to_string(place().domain)));
  ProgramChunk chunk;
  EXPECT_FALSE(programs_.receive(chunk, 0.0)) << "and nothing is sent";
}

}  // namespace
}  // namespace servotwin
