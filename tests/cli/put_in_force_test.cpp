// servotwin put-in-force: with this test as the daemon, and in a store.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "daemon/store/store.h"
#include "drivers/dds/dds.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr double kPatience = 30.0;  // [s]

DdsPlace place_here() {
  const auto id = static_cast<std::uint32_t>(::getpid());
  return {"force-test-" + std::to_string(id), 1 + id % 200, ""};
}

class PutInForce : public testing::Test {
 protected:
  PutInForce() {
    write_model(model_, known_axis());
    status_of_axis_.state = DaemonState::kRunning;
    status_of_axis_.axes.resize(1);
    status_of_axis_.axes[0].name = "X";
    status_of_axis_.axes[0].model_version = 3;
    status_of_axis_.axes[0].refused = 5;
    EXPECT_TRUE(status_.write(status_of_axis_));
  }
  /// Starts the tool and receives its model.
  ModelProposal ask(std::vector<std::string> more = {}) {
    const std::vector<std::string> words{"put-in-force",
                                         model_,
                                         "--dds",
                                         "--machine",
                                         place_here().machine,
                                         "--domain",
                                         std::to_string(place_here().domain)};
    more.insert(more.begin(), words.begin(), words.end());
    tool_ = std::make_unique<Program>(more);
    ModelProposal asked;
    EXPECT_TRUE(proposals_.receive(asked, kPatience));
    return asked;
  }

  Folder folder_;
  std::string model_ = folder_ / "mine.json";
  DdsNode node_{place_here()};
  DdsReader<ModelProposal> proposals_{node_};
  DdsWriter<ModelAnnouncement> models_{node_};
  DdsWriter<MachineStatus> status_{node_};
  MachineStatus status_of_axis_;
  std::unique_ptr<Program> tool_;
};

TEST_F(PutInForce, AsksTheDaemonAndTellsWhatIsInForce) {
  const ModelProposal asked = ask();
  EXPECT_EQ(asked.axis, "X");
  EXPECT_THAT(asked.origin, testing::StartsWith("mine.json at 20"));
  EXPECT_FALSE(asked.force);
  EXPECT_EQ(asked.model_json, to_json(known_axis()).dump());
  // A model that the daemon found by itself meanwhile is not the answer.
  ASSERT_TRUE(models_.write({"X", 4, 3, "2026-01-31T12:00:00Z", "residual 1 um", "{}"}));
  ASSERT_TRUE(
      models_.write({"X", 5, 4, "2026-01-31T12:00:01Z",
                     "residual 0.5 um; from " + asked.origin + ", proposed by hand", "{}"}));
  const Answer said = tool_->answer();
  EXPECT_EQ(said.status, 0) << said;
  EXPECT_THAT(said.out, HasSubstr("model 5 of axis X is in force: residual 0.5 um"));
}

TEST_F(PutInForce, ARefusalIsTheDaemonsReason) {
  const ModelProposal asked = ask({"--force"});
  EXPECT_TRUE(asked.force);
  status_of_axis_.axes[0].refused = 6;
  status_of_axis_.axes[0].last_refusal = "candidate refused: of somebody else";
  ASSERT_TRUE(status_.write(status_of_axis_));
  status_of_axis_.axes[0].refused = 7;
  status_of_axis_.axes[0].last_refusal =
      "candidate refused: must be better by 2 %; from " + asked.origin + ", proposed by hand";
  ASSERT_TRUE(status_.write(status_of_axis_));
  const Answer said = tool_->answer();
  EXPECT_EQ(said.status, 1) << said;
  EXPECT_THAT(said.err, HasSubstr("not in force: candidate refused: must be better by 2 %"));
}

TEST_F(PutInForce, WithoutADecisionItSaysWhatTheDaemonDoes) {
  status_of_axis_.axes[0].activity = "judging a candidate: 0.0 of 4.0 s of motion";
  ASSERT_TRUE(status_.write(status_of_axis_));
  ask({"--wait", "5"});
  const Answer said = tool_->answer();
  EXPECT_EQ(said.status, 1) << said;
  EXPECT_THAT(said.err, AllOf(HasSubstr("not decided after 5 s"), HasSubstr("judging a candidate"),
                              HasSubstr("may still decide")));
}

TEST_F(PutInForce, AnAxisThatTheMachineDoesNotHaveIsRefusedHere) {
  Program tool({"put-in-force", model_, "--axis", "Z", "--dds", "--machine", place_here().machine,
                "--domain", std::to_string(place_here().domain)});
  const Answer said = tool.answer();
  EXPECT_EQ(said.status, 1) << said;
  EXPECT_THAT(said.err, AllOf(HasSubstr("has no axis 'Z'"), HasSubstr("it has X")));
}

class PutInStore : public testing::Test {
 protected:
  PutInStore() {
    // The machine is this model; the one in force has half of its friction.
    write_model(right_, known_axis());
    ModelRecord half = known_axis();
    for (Effect& effect : half.model.effects) effect.coefficient[0] *= 0.5;
    write_model(half_, half);
    daemon::Store store(store_, "mill");
    store.promote(half, {"2026-01-01T00:00:00.000Z", "X", "model_promoted", "by the test", ""});
  }
  void record(const std::string& name) {
    fs::create_directories(store_ / "recordings" / "mill");
    const Answer simulated = servotwin_says({"simulate", folder_.write("path.csv", command_table()),
                                             "--model", right_, "--noise", "0.1", "--out",
                                             (store_ / "recordings" / "mill" / name).string()});
    ASSERT_EQ(simulated.status, 0) << simulated;
  }
  Answer put(const std::string& model, std::vector<std::string> more = {}) {
    const std::vector<std::string> words{"put-in-force",  model,       "--store",
                                         store_.string(), "--machine", "mill"};
    more.insert(more.begin(), words.begin(), words.end());
    return servotwin_says(more);
  }
  [[nodiscard]] daemon::StoredModel in_force() const {
    return daemon::Store(store_, "mill", daemon::StoreAccess::kRead).in_force().at(0);
  }

  Folder folder_;
  fs::path store_ = folder_.path() / "store";
  std::string right_ = folder_ / "right.json", half_ = folder_ / "half.json";
};

TEST_F(PutInStore, JudgesOnMotionFromAfterTheModelWasMade) {
  record("2026-01-31T120000.000Z.csv");
  const Answer better = put(right_);
  ASSERT_EQ(better.status, 0) << better;
  EXPECT_THAT(better.out, HasSubstr("model 2 of axis X is in force: residual 0.0"));
  EXPECT_EQ(in_force().record.version, 2);
  EXPECT_EQ(daemon::Store(store_, "mill", daemon::StoreAccess::kRead).cited(),
            std::set<std::string>{"2026-01-31T120000.000Z.csv"});

  const Answer worse = put(half_);
  EXPECT_EQ(worse.status, 1) << worse;
  EXPECT_THAT(worse.err, AllOf(HasSubstr("not in force: "), HasSubstr("must be better by")));
  EXPECT_EQ(in_force().record.version, 2);

  const Answer forced = put(half_, {"--force"});
  EXPECT_EQ(forced.status, 0) << forced;
  EXPECT_EQ(in_force().record.version, 3);
  EXPECT_THAT(in_force().reason,
              HasSubstr("put in force without being judged (--force); from half.json at 20"));
}

TEST_F(PutInStore, OlderMotionDecidesNothing) {
  record("2023-12-31T235959.000Z.csv");  // the model is of 2024
  const Answer answer = put(right_);
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, AllOf(HasSubstr("only 0 s of motion to judge on"),
                                HasSubstr("2024-01-01T00:00:00Z")));
  EXPECT_EQ(in_force().record.version, 1);
}

TEST_F(PutInStore, AFolderWithoutAStoreIsNotMadeOne) {
  const Answer answer = servotwin_says({"put-in-force", right_, "--store", folder_ / "nowhere"});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("there is no store of a daemon here"));
  EXPECT_FALSE(fs::exists(folder_.path() / "nowhere"));
  const Answer other = servotwin_says({"put-in-force", right_, "--store", store_.string()});
  EXPECT_EQ(other.status, 1) << other;
  EXPECT_THAT(other.err, AllOf(HasSubstr("knows no machine 'machine'"), HasSubstr("it has mill")));
}

TEST_F(PutInStore, ADaemonThatRunsIsAsked) {
  const daemon::Store running(store_, "mill");
  const Answer answer = put(right_);
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("ask it with --dds"));
}

}  // namespace
}  // namespace servotwin
