// Programs over HTTP: put, learned as from the folder, listed, replaced and removed; and what is
// refused without changing anything.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>
#include <future>
#include <iterator>
#include <memory>
#include <optional>

#include "daemon/correct/learning_worker.h"
#include "daemon/correct/program_inbox.h"
#include "daemon/web/http_server.h"
#include "daemon/web/slow_answer.h"
#include "tests/daemon/stepped_machine.h"
#include "tests/daemon/web/http_fixture.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
namespace fs = std::filesystem;

std::string csv_of(const Eigen::ArrayXd& path) {
  std::ostringstream out;
  out.precision(12);
  out << "time[s],X.command[mm]\n";
  for (Eigen::Index k = 0; k < path.size(); ++k)
    out << kCycle_s * static_cast<double>(k) << "," << 1e3 * path(k) << "\n";
  return out.str();
}

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> files_of(const fs::path& folder) {
  std::vector<std::string> out;
  for (const auto& entry : fs::directory_iterator(folder)) out.push_back(entry.path().filename());
  return out;
}

std::string bearer(const std::string& token = kToken) {
  return "Authorization: Bearer " + token + "\r\n";
}

class ProgramHttpTest : public HttpTest {
 protected:
  ProgramHttpTest() { use(parts_.path()); }
  void use(const fs::path& folder) {
    shown_.reset();
    inbox_ = std::make_shared<ProgramInbox>(folder, machine_, events_);
    show();
  }
  [[nodiscard]] HttpAnswer put(const std::string& name, const std::string& body,
                               const std::string& more = bearer()) const {
    return ask(port_, "PUT", "/api/v1/programs/" + name, more, body);
  }
  [[nodiscard]] HttpAnswer remove(const std::string& name,
                                  const std::string& more = bearer()) const {
    return ask(port_, "DELETE", "/api/v1/programs/" + name, more);
  }
  [[nodiscard]] nlohmann::json programs() const {
    return get("/api/v1/programs").json()["programs"];
  }

  TemporaryDirectory parts_;
  const Eigen::ArrayXd path_ = circle_program()[0];
};

TEST_F(ProgramHttpTest, IsLearnedAsAFileOfTheFolderReplacedAndRemoved) {
  ModelRecord record = record_of(model_of(stepped_axis()));
  store_.promote(record, event_of("made for this test"));
  Config config;
  config.axes = {{"X", false, ""}};
  config.axes[0].correction = OffsetLimits{3e-3, 0.2, 200.0};
  config.ilc.programs = parts_.path();
  OffsetHandOver hand_over;
  LearningWorker worker(learning_rules(config, machine_), store_, events_, hand_over,
                        [](const CorrectionChunk&) {});
  worker.show_in(inbox_->list());
  std::int64_t now_ns = 0;
  const auto look = [&] {
    worker.look_into_folder(now_ns += LearningWorker::kLookEvery_ns);
    worker.show();
  };
  look();
  EXPECT_THAT(programs(), IsEmpty());

  const HttpAnswer answer = put("ring", csv_of(path_));
  EXPECT_EQ(answer.status, 202) << answer.body;
  EXPECT_EQ(answer.json()["schema"], "servotwin.request/1");
  EXPECT_EQ(answer.json()["program"], "ring");
  EXPECT_THAT(files_of(parts_.path()), testing::ElementsAre("ring.csv"));
  EXPECT_EQ(text_of(parts_.path() / "ring.csv"), csv_of(path_));
  EXPECT_EQ(programs()[0]["state"], "waiting");
  look();
  EXPECT_EQ(programs()[0]["state"], "waiting");
  look();
  ASSERT_EQ(worker.kept().size(), 1U) << said_.str();
  EXPECT_LT((worker.kept()[0]->program.command[0] - path_).abs().maxCoeff(), 1e-11);
  const nlohmann::json learned = programs();
  ASSERT_EQ(learned.size(), 1U);
  EXPECT_EQ(learned[0]["program"], "ring");
  EXPECT_EQ(learned[0]["state"], "learned");
  EXPECT_EQ(learned[0]["revision"], worker.kept()[0]->program.revision);

  EXPECT_EQ(put("ring", csv_of(0.5 * path_)).status, 202);
  EXPECT_EQ(programs()[0]["state"], "waiting") << "what is known is of the file before";
  look();
  look();
  ASSERT_EQ(worker.kept().size(), 1U);
  EXPECT_LT((worker.kept()[0]->program.command[0] - 0.5 * path_).abs().maxCoeff(), 1e-11);
  EXPECT_GT(programs()[0]["revision"], learned[0]["revision"]);
  EXPECT_EQ(programs()[0]["state"], "learned");

  EXPECT_EQ(remove("ring").status, 202);
  EXPECT_THAT(files_of(parts_.path()), IsEmpty());
  look();
  EXPECT_THAT(worker.kept(), IsEmpty());
  EXPECT_THAT(programs(), IsEmpty());
  const HttpAnswer again = remove("ring");
  EXPECT_EQ(again.status, 404);
  EXPECT_THAT(again.body, HasSubstr("'ring'"));
  EXPECT_THAT(said_.str(), HasSubstr("program 'ring': " + std::to_string(csv_of(path_).size()) +
                                     " bytes received over HTTP, put into the folder as ring.csv"));
  EXPECT_THAT(said_.str(), HasSubstr("bytes received over HTTP, in place of ring.csv"));
  EXPECT_THAT(said_.str(), HasSubstr("program 'ring': ring.csv removed over HTTP"));
}

TEST_F(ProgramHttpTest, AProgramThatCannotBeLearnedYetIsListedWithTheReason) {
  Config config;
  config.axes = {{"X", false, ""}};
  config.axes[0].correction = OffsetLimits{3e-3, 0.2, 200.0};
  config.ilc.programs = parts_.path();
  OffsetHandOver hand_over;
  LearningWorker worker(learning_rules(config, machine_), store_, events_, hand_over,
                        [](const CorrectionChunk&) {});
  worker.show_in(inbox_->list());
  ASSERT_EQ(put("ring", csv_of(path_)).status, 202);
  worker.look_into_folder(LearningWorker::kLookEvery_ns);
  worker.look_into_folder(2 * LearningWorker::kLookEvery_ns);
  worker.show();
  EXPECT_EQ(programs()[0]["state"], "not_learned");
  EXPECT_THAT(programs()[0]["text"].get<std::string>(), HasSubstr("no model"));
}

TEST_F(ProgramHttpTest, WhatHasBeenRecognisedIsListedAndAcceptedWithoutABody) {
  EXPECT_TRUE(get("/api/v1/status").json()["repeats"].is_null());
  auto path = std::make_shared<CommandedPath>();
  *path = {"motion-1", 0, true, {0}, {path_}};
  ProgramState state{ProgramState::What::kRecognised, 0, "X repeats", path};
  inbox_->list().show({{"motion-1", state}}, 0, MotionRepeats{{"motion-1"}, 3, 1.5, 2.5});
  const nlohmann::json listed = programs();
  ASSERT_EQ(listed.size(), 1U);
  EXPECT_EQ(listed[0]["state"], "recognised");
  EXPECT_EQ(listed[0]["text"], "X repeats");
  const nlohmann::json repeats = get("/api/v1/status").json()["repeats"];
  EXPECT_EQ(repeats["programs"][0], "motion-1");
  EXPECT_EQ(repeats["repetitions"], 3);
  EXPECT_EQ(repeats["shortest_period_s"], 1.5);
  EXPECT_EQ(repeats["longest_period_s"], 2.5);

  EXPECT_EQ(put("motion-1", "", "").status, 401);
  EXPECT_THAT(files_of(parts_.path()), IsEmpty());
  EXPECT_EQ(put("motion-1", "").status, 202);
  ASSERT_THAT(files_of(parts_.path()), testing::ElementsAre("motion-1.csv"));
  EXPECT_EQ(programs()[0]["state"], "waiting");
  // The file is the path to the last bit.
  std::vector<double> command;
  for (const ProgramChunk& chunk :
       read_program(parts_.path() / "motion-1.csv", "motion-1", machine_, 1))
    command.insert(command.end(), chunk.command.begin(), chunk.command.end());
  EXPECT_EQ(command, std::vector<double>(path_.begin(), path_.end()));
  EXPECT_EQ(put("motion-1", "").status, 202) << "it is there already";
}

TEST_F(ProgramHttpTest, WhatHasBeenRecognisedIsCheckedAsWhatIsSent) {
  const auto recognised = [&](const std::string& name, const Eigen::ArrayXd& path) {
    ProgramState state{ProgramState::What::kRecognised, 0, "",
                       std::make_shared<CommandedPath>(CommandedPath{name, 0, true, {0}, {path}})};
    inbox_->list().show({{name, state}}, 0);
  };
  recognised("short", path_.head(15));
  HttpAnswer answer = put("short", "");
  EXPECT_EQ(answer.status, 400);
  EXPECT_THAT(answer.body, HasSubstr("short.csv: too short: 15 rows, at least 16"));
  EXPECT_THAT(files_of(parts_.path()), IsEmpty());

  fs::create_directory(parts_.path() / "folder.csv");
  recognised("folder", path_);
  EXPECT_THAT(put("folder", "").body, HasSubstr("it is not a regular file"));

  ASSERT_EQ(put("ring", csv_of(0.5 * path_)).status, 202);
  recognised("ring", path_);
  answer = put("ring", "");
  EXPECT_EQ(answer.status, 400);
  EXPECT_THAT(answer.body, HasSubstr("ring.csv in the folder has another path"));
  EXPECT_EQ(text_of(parts_.path() / "ring.csv"), csv_of(0.5 * path_));
}

TEST_F(ProgramHttpTest, WhatIsRefusedLeavesTheFolderAsItWas) {
  const std::string csv = csv_of(path_);
  ASSERT_EQ(put("ring", csv).status, 202);
  struct Case {
    std::string method, name, body, more;
    int status;
    std::string why;
  };
  const std::string other = csv_of(0.5 * path_), name64(64, 'a');
  for (const Case& one : std::vector<Case>{
           {"PUT", "ring", other, "", 401, "http.token"},
           {"PUT", "ring", other, bearer("another token......"), 401, "http.token"},
           {"DELETE", "ring", "", "", 401, "http.token"},
           {"PUT", ".ring", other, bearer(), 400, "'.ring': must be 1 to 63 letters, digits"},
           {"PUT", "a%20b", other, bearer(), 400, "'a b': must be"},
           {"PUT", name64, other, bearer(), 400, "must be 1 to 63"},
           {"DELETE", "%2e%2e", "", bearer(), 400, "'..': must be"},
           {"PUT", "..%2fring", other, bearer(), 405, "cannot be changed"},
           {"POST", "ring", "", bearer(), 405, "cannot be changed"},
           {"PUT", "ring", "", bearer(), 400, "the request has no body"},
           {"PUT", "ring?revision=3", other, bearer(), 400, "there is no parameter 'revision'"},
           {"PUT", "ring", "time[s],X.command[mm]\n0,1\n0.001,x\n", bearer(), 400, "line 3"},
           {"PUT", "ring", "time[s],X.command[deg]\n0,1\n0.001,2\n", bearer(), 400,
            "ring.csv: X.command has the unit of a rotary axis"},
           {"PUT", "ring", "time[s],Q.command[mm]\n0,1\n0.001,2\n", bearer(), 400,
            "ring.csv: the machine has no axis 'Q'"},
           {"PUT", "ring", "time[s],X.command[mm]\n0,1\n0.001,2\n", bearer(), 400,
            "ring.csv: too short: 2 rows"},
           {"DELETE", "ring", "x", bearer(), 413, "body"},
           {"PUT", "ring", "", bearer() + "Content-Length: 64000001\r\n", 413, "64000001 bytes"},
           {"PUT", "ring", "", bearer() + "Content-Length: 99999999999999999999999\r\n", 413, ""},
           {"PUT", "ring", "", bearer() + "Transfer-Encoding: chunked\r\n", 411, "Content-Length"},
           {"PUT", "ring", other, bearer() + "Transfer-Encoding: chunked\r\n", 411,
            "Content-Length"}}) {
    // Of an address of its own, which does not wait for the wrong tokens of another.
    const HttpAnswer answer =
        ask(port_, one.method, "/api/v1/programs/" + one.name, one.more, one.body, "localhost",
            "127.0.0." + std::to_string(one.status % 100 + 2));
    EXPECT_EQ(answer.status, one.status) << one.method << " " << one.name << ": " << answer.body;
    EXPECT_THAT(answer.body, HasSubstr(one.why)) << one.method << " " << one.name;
    EXPECT_THAT(answer.body, Not(HasSubstr(".part-"))) << "nobody knows that name";
  }
  EXPECT_THAT(files_of(parts_.path()), testing::ElementsAre("ring.csv"));
  EXPECT_EQ(text_of(parts_.path() / "ring.csv"), csv);
  EXPECT_EQ(get("/api/v1/programs/ring").status, 404);
}

TEST_F(ProgramHttpTest, WithoutAFolderOrAMachineItIsNotPossibleNow) {
  use({});
  const HttpAnswer none = put("ring", csv_of(path_));
  EXPECT_EQ(none.status, 409);
  EXPECT_THAT(none.body, HasSubstr("configure ilc.programs"));
  shown_.reset();
  EXPECT_EQ(put("ring", csv_of(path_)).status, 409);
  EXPECT_THAT(remove("ring").body, HasSubstr("no machine is known yet"));
  EXPECT_THAT(programs(), IsEmpty());
}

TEST_F(ProgramHttpTest, AFolderThatIsMissingIsMadeAndOneThatCannotBeSaysWhatToDo) {
  use(parts_.path() / "parts");
  EXPECT_EQ(remove("ring").status, 500) << "nothing is made for it";
  EXPECT_EQ(put("ring", csv_of(path_)).status, 202);
  EXPECT_THAT(files_of(parts_.path() / "parts"), testing::ElementsAre("ring.csv"));
  use(parts_.path() / "parts" / "ring.csv" / "parts");
  const HttpAnswer answer = put("ring", csv_of(path_));
  EXPECT_EQ(answer.status, 500);
  EXPECT_THAT(answer.body, HasSubstr("Not a directory"));
  EXPECT_THAT(answer.body, HasSubstr("let the user of the daemon write into ilc.programs"));
  use(parts_.path() / "nowhere" / "parts");
  EXPECT_THAT(put("ring", csv_of(path_)).body, HasSubstr("No such file or directory"));
}

TEST_F(ProgramHttpTest, OnAFullDiskTheFileBeforeStays) {
  const std::string csv = csv_of(path_);
  ASSERT_EQ(put("ring", csv).status, 202);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  auto* const signal_before = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const HttpAnswer answer = put("ring", csv_of(0.5 * path_));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, signal_before);
  EXPECT_EQ(answer.status, 500);
  EXPECT_THAT(answer.body, HasSubstr("ring.csv: cannot be written: File too large"));
  EXPECT_THAT(files_of(parts_.path()), testing::ElementsAre("ring.csv"));
  EXPECT_EQ(text_of(parts_.path() / "ring.csv"), csv);
}

TEST_F(ProgramHttpTest, TheFileThatGivesTheProgramIsReplacedWhateverItIsCalled) {
  std::ofstream(parts_.path() / "my ring.CSV") << "old";
  fs::create_directory(parts_.path() / "a_folder.csv");
  EXPECT_EQ(put("my_ring", csv_of(path_)).status, 202);
  EXPECT_EQ(text_of(parts_.path() / "my ring.CSV"), csv_of(path_));
  EXPECT_FALSE(fs::exists(parts_.path() / "my_ring.csv"));
  const HttpAnswer folder = put("a_folder", csv_of(path_));
  EXPECT_EQ(folder.status, 500);
  EXPECT_THAT(folder.body, HasSubstr("it is not a regular file"));
  EXPECT_EQ(remove("my_ring").status, 202);
  EXPECT_THAT(files_of(parts_.path()), testing::ElementsAre("a_folder.csv"));
}

TEST_F(ProgramHttpTest, ABodyIsAskedForOnlyWithTheToken) {
  const std::string head =
      "PUT /api/v1/programs/ring HTTP/1.1\r\nHost: localhost\r\nConnection: "
      "close\r\nExpect: 100-continue\r\nContent-Length: ";
  const std::string csv = csv_of(path_);
  HttpConnection stranger(port_);
  stranger.send(head + std::to_string(csv.size()) + "\r\n" + bearer("another token......") +
                "\r\n");
  EXPECT_THAT(stranger.rest(), HasSubstr("HTTP/1.1 401 "));
  EXPECT_THAT(stranger.received(), Not(HasSubstr("100 Continue")));
  HttpConnection person(port_);
  person.send(head + std::to_string(csv.size()) + "\r\n" + bearer() + "\r\n");
  ASSERT_TRUE(person.has_sent("HTTP/1.1 100 Continue"));
  const HttpAnswer second = put("other", csv);
  EXPECT_EQ(second.status, 503) << "one at a time";
  EXPECT_EQ(ask(port_, "POST", "/api/v1/offsets/arm", bearer()).status, 200)
      << "a body that does not come keeps nobody";
  person.send(csv);
  EXPECT_THAT(person.rest(), HasSubstr("HTTP/1.1 202 "));
  EXPECT_EQ(text_of(parts_.path() / "ring.csv"), csv);
  HttpConnection gone(port_);
  gone.send(head + "64000000\r\n" + bearer() + "\r\n");
  ASSERT_TRUE(gone.has_sent("HTTP/1.1 100 Continue"));
  shown_.reset();
  web_.reset();  // the service ends while a body is expected
}

TEST_F(ProgramHttpTest, AfterWrongTokensFromAnAddressABodyWaitsForItsTurn) {
  const std::string csv = csv_of(path_);
  for (unsigned i = 0; i < TokenGuesses::kGuessesBeforeHold; ++i)
    ASSERT_EQ(put("ring", csv, bearer("a wrong token ......")).status, 401);
  for (const auto& [token, status] :
       {std::pair(std::string("another wrong token"), 401), std::pair(std::string(kToken), 202)}) {
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_EQ(put("ring", csv, bearer(token)).status, status);
    EXPECT_GE(std::chrono::steady_clock::now() - begin,
              std::chrono::nanoseconds(TokenGuesses::kHold_ns));
  }
  EXPECT_EQ(text_of(parts_.path() / "ring.csv"), csv);
}

TEST_F(ProgramHttpTest, AProgramOfManyMegabytesIsTaken) {
  Eigen::ArrayXd path(200'000);
  for (Eigen::Index k = 0; k < path.size(); ++k)
    path(k) = command_at(kCycle_s * static_cast<double>(k));
  const std::string csv = csv_of(path);
  ASSERT_GT(csv.size(), 3'000'000U);
  EXPECT_EQ(put("long", csv).status, 202);
  EXPECT_EQ(text_of(parts_.path() / "long.csv"), csv);
}

TEST(HttpServer, AnAnswerThatIsMadeLaterKeepsNobodyWaiting) {
  std::promise<void> disk;
  SlowAnswer slow;
  HttpServer server({"127.0.0.1", 0, false}, {}, [&](const HttpRequest& request) {
    if (request.path != "/slow") return HttpResponse{200, "text/plain", "at once"};
    if (slow.busy()) return HttpResponse{503, "text/plain", "busy"};
    return slow.begin([answers = disk.get_future().share()] {
      answers.wait();
      return HttpResponse{200, "text/plain", "made later"};
    });
  });
  HttpConnection first(server.address().port), second(server.address().port),
      other(server.address().port);
  const auto send = [](const HttpConnection& to, const std::string& path) {
    to.send("DELETE " + path + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  };
  const auto answered = [&](HttpConnection& by, const std::string& text) {
    for (int turn = 0; turn < 1000 && by.received().find(text) == std::string::npos; ++turn) {
      server.poll(10);
      by.drain();
    }
    return by.received().find(text) != std::string::npos;
  };
  send(first, "/slow");
  while (!slow.busy()) server.poll(10);
  send(second, "/slow");
  send(other, "/");
  EXPECT_TRUE(answered(other, "at once"));
  EXPECT_TRUE(answered(second, "busy"));
  first.drain();
  EXPECT_EQ(first.received(), "");
  disk.set_value();
  EXPECT_TRUE(answered(first, "made later"));
  EXPECT_FALSE(slow.busy());
}

TEST(ProgramList, AChangeSinceTheLastLookIsWaiting) {
  ProgramList list;
  const std::map<std::string, ProgramState> learned{
      {"ring", {ProgramState::What::kLearned, 7, "text"}}};
  list.show(learned, list.changes());
  EXPECT_EQ(list.states().at("ring").what, ProgramState::What::kLearned);
  const std::uint64_t before = list.changes();  // a look begins
  list.changed("ring");
  list.show(learned, before);
  EXPECT_EQ(list.states().at("ring").what, ProgramState::What::kWaiting);
  EXPECT_EQ(list.states().at("ring").revision, 7U);
  list.show(learned, list.changes());
  EXPECT_EQ(list.states().at("ring").what, ProgramState::What::kLearned);
  list.changed("ring", true);
  EXPECT_EQ(list.states().at("ring").what, ProgramState::What::kRemoved);
  list.show({}, list.changes());
  EXPECT_TRUE(list.states().empty());
}

}  // namespace
}  // namespace servotwin::daemon
