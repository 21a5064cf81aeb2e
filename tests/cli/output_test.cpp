// Text for people: --quiet, and progress in a pipe.
#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "cli/common/output.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

/// What a Progress writes into a file while `work` is done.
template <class Work>
std::string progress_in_a_file(const std::string& file, std::chrono::milliseconds period,
                               const Work& work) {
  std::FILE* out = std::fopen(file.c_str(), "w");
  {
    cli::Progress progress("fitting", out, period);
    work(progress);
  }
  std::fclose(out);
  return content_of(file);
}

TEST(Progress, InAFileIsALinePerPeriod) {
  const Folder folder;
  const std::string file = folder / "log";
  const std::string said =
      progress_in_a_file(file, std::chrono::milliseconds(250), [&](auto& progress) {
        const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        const auto waiting_for = [&](const char* line) {
          return content_of(file).find(line) == std::string::npos &&
                 std::chrono::steady_clock::now() < until;
        };
        while (waiting_for("0.25 s")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
        progress.trying("cogging");
        while (waiting_for("0.5 s")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
      });
  EXPECT_TRUE(said.starts_with("fitting, 0.25 s\nfitting, trying cogging, 0.5 s\n")) << said;
}

TEST(Progress, IsSilentAboutShortWork) {
  const Folder folder;
  EXPECT_EQ(progress_in_a_file(folder / "log", std::chrono::hours(1), [](auto&) {}), "");
}

class Quiet : public testing::Test {
 protected:
  Quiet() {
    write_model(model_, known_axis());
    folder_.write("path.csv", command_table());
  }
  Answer simulate(const std::vector<std::string>& before, const std::vector<std::string>& after) {
    std::vector<std::string> words = before;
    words.insert(words.end(), {"simulate", folder_ / "path.csv", "--model", model_});
    words.insert(words.end(), after.begin(), after.end());
    return servotwin_says(words);
  }

  Folder folder_;
  std::string model_ = folder_ / "m.json";
};

TEST(Written, NamesTheFilesInOneLineAndNotStandardOutput) {
  const Folder folder;
  const std::string said = folder / "said";
  std::FILE* people = std::fopen(said.c_str(), "w");
  cli::say_written(people, {"a.csv", "", "-", "b.html"});
  cli::say_written(people, {"", "-"});
  std::fclose(people);
  EXPECT_EQ(content_of(said), "written     a.csv, b.html\n");
}

TEST_F(Quiet, LeavesResultsAlone) {
  const Answer loud = simulate({}, {"--out", "-"});
  EXPECT_THAT(loud.err, HasSubstr("tracking error"));
  for (const Answer& answer :
       {simulate({"--quiet"}, {"--out", "-"}), simulate({}, {"--out", "-", "--quiet"})}) {
    EXPECT_EQ(answer.status, 0) << answer.err;
    EXPECT_EQ(answer.out, loud.out);
    EXPECT_THAT(answer.err, IsEmpty());
  }
  EXPECT_EQ(servotwin_says({"formats", "--quiet"}).out, servotwin_says({"formats"}).out);
}

TEST_F(Quiet, PrintsNothingWhereNoResultIsAskedFor) {
  EXPECT_THAT(simulate({}, {}).out, HasSubstr("tracking error"));
  const Answer answer = simulate({}, {"--quiet"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out + answer.err, IsEmpty());
}

TEST_F(Quiet, PrintsTheFigureThatIsAskedFor) {
  folder_.write("r.csv", recording(
                             12'000, [](int k) { return cell(rich_motion(1e-3 * k)); },
                             [](int k) { return cell(rich_motion(1e-3 * (k - 9))); }));
  const Answer answer =
      servotwin_says({"predict", folder_ / "r.csv", "--model", model_, "--quiet"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_TRUE(answer.out.starts_with("all  ")) << answer.out;
  EXPECT_EQ(std::count(answer.out.begin(), answer.out.end(), '\n'), 1) << answer.out;
  EXPECT_THAT(answer.err, IsEmpty());
}

TEST_F(Quiet, LeavesErrorsAlone) {
  const std::vector<std::string> words{"predict", folder_ / "nowhere.csv", "--model", model_};
  std::vector<std::string> quiet = words;
  quiet.emplace_back("--quiet");
  const Answer answer = servotwin_says(quiet);
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, Not(IsEmpty()));
  EXPECT_EQ(answer.err, servotwin_says(words).err);
}

}  // namespace
}  // namespace servotwin
