// A wrong command line gives exit status 2 and one line on standard error, before any work.
#include <gmock/gmock.h>

#include <unistd.h>

#include <chrono>
#include <sstream>
#include <thread>

#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

struct Typed {
  std::vector<std::string> words;
  std::string complaint;
};
void PrintTo(const Typed& typed, std::ostream* out) {
  for (const std::string& word : typed.words) *out << word << ' ';
}

class WrongUsage : public testing::TestWithParam<Typed> {};

TEST_P(WrongUsage, IsOneLineAndStatusTwo) {
  const Answer answer = servotwin_says(GetParam().words);
  EXPECT_EQ(answer.status, 2) << answer;
  EXPECT_THAT(answer.out, IsEmpty());
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr(GetParam().complaint));
}

const std::vector<Typed> kTyped{
    {{}, "a command is required (see servotwin --help)"},
    {{"identfy"}, "'identfy'; did you mean 'identify'?"},
    {{"help", "identfy"}, "'identfy'; did you mean 'identify'?"},
    {{"completion", "csh"}, "csh not in {bash,zsh,fish}"},
    {{"--nonsense"}, "there is no option '--nonsense' (see"},
    {{"--versoin"}, "'--versoin'; did you mean '--version'?"},
    {{"identify"}, "REC is required"},
    {{"identify", "rec.csv", "--axis", "X", "--fast"}, "there is no option '--fast' (see"},
    {{"identify", "rec.csv", "--save", "x.json"},
     "no option '--save'; files are written by --model OUT.json, --json OUT, "
     "--plot OUT.svg (see"},
    {{"identify", "rec.csv", "-o", "x.json"}, "files are written by --model OUT.json"},
    {{"history", "--output", "x"}, "there is no option '--output'"},
    {{"identify", "rec.csv", "--axs", "X"}, "no option '--axs'; did you mean '--axis'?"},
    {{"simulate", "path.csv", "--modle=m.json"}, "no option '--modle'; did you mean '--model'?"},
    {{"identify", "rec.csv", "--axis", "X", "--method", "guess"},
     "guess not in {joint,pole-search,full-ls}"},
    {{"identify", "rec.csv", "--axis", "X", "--method", "joint", "--friction", "guess"},
     "guess not in {coulomb_friction,"},
    {{"identify", "rec.csv", "--method", "pole-search", "--friction", "lugre"},
     "needs --method joint"},
    {{"identify", "rec.csv", "--method", "pole-search", "--structure", "two-mass"},
     "need --method joint"},
    {{"identify", "rec.csv", "--axis", "X", "--structure", "auto", "--method", "joint", "--modes",
      "2"},
     "take no --modes"},
    {{"identify", "rec.csv", "--axis", "X", "--order", "4"}, "4 not in {2,3}"},
    {{"identify", "rec.csv", "--axis", "X", "--training-share", "1.5"}, "--training-share"},
    {{"identify", "rec.csv", "--axis", "X", "--damping", "2"}, "'2' is not a valid range MIN:MAX"},
    {{"identify", "rec.csv", "--axis", "X", "--real-pole-hz", "1:x"},
     "'1:x' is not a valid range MIN:MAX"},
    {{"identify", "rec.csv", "--axis", "X", "--natural-frequency-hz", "1:2:3"},
     "'1:2:3' is not a valid range"},
    {{"identify", "rec.csv", "--axis", "X", "--damping", "2:1"}, "damping"},
    {{"identify", "rec.csv", "--axis", "X", "--no-pole-constraints"}, "needs --method full-ls"},
    {{"identify", "rec.csv", "--axis", "X", "--json", "-", "--model", "-"}, "only one result"},
    {{"identify", "rec.csv", "--axis", "X", "--from", "2", "--to", "1"}, "--from"},
    {{"identify", "rec.csv", "--axis", "X", "--rate", "-5"}, "--rate"},
    {{"identify", "rec.csv", "--format", "excel"},
     "excel not in {csv,matlab,mcap,candump,asc,trc,twincat,tncscope,halscope,"},
    {{"predict", "rec.csv", "--axis", "X"}, "--model is required; servotwin identify REC --model"},
    {{"simulate", "path.csv"}, "--model is required"},
    {{"simulate", "path.csv", "--model", "m.json", "--noise", "much"},
     "'much' is not a valid STEP"},
    {{"simulate", "path.csv", "--model", "m.json", "--noise", "1:-1"}, "must not be negative"},
    {{"preview", "rec.csv"}, "--dds is required"},
    {{"put-in-force", "m.json"}, "choose one: --dds"},
    {{"put-in-force", "m.json", "--dds", "--store", "here"}, "choose one: --dds"},
    {{"predict", "rec.csv", "--axis", "X", "--axis", "Y", "--model", "m.json"},
     "2 axes and 1 models"},
    {{"preview", "rec.csv", "--dds", "--name", "a/b"}, "--name a/b"},
    {{"replay", "rec.csv"}, "choose one bus: --dds, --can or --udp"},
    {{"replay", "rec.csv", "--can", "vcan0", "--dds"}, "choose one bus: --dds, --can or --udp"},
    {{"replay", "rec.csv", "--can", "vcan0", "--udp", "a:1"}, "choose one bus: --can or --udp"},
    {{"replay", "rec.csv", "--can", "vcan0"}, "--can-map F.toml"},
    {{"replay", "rec.csv", "--dds", "--targets"}, "--targets is for --can and --udp"},
    {{"watch", "--can", "vcan0"}, "--can-map F.toml"},
    {{"watch", "--can", "vcan0", "--summary"}, "cannot be used with --can"},
    {{"watch", "--model", "m.json"}, "--model is for --can"},
    {{"simulate", "--model", "m.json", "--can", "vcan0"}, "--can-map F.toml"},
    {{"simulate", "path.csv", "--model", "m.json", "--can", "vcan0"},
     "commands and answers are on the bus"},
    {{"simulate", "--model", "m.json"}, "PATH is required"},
    {{"simulate", "--model", "m.json", "--can", "vcan0", "--udp", "127.0.0.1:1"},
     "choose one bus: --can or --udp"},
    {{"simulate", "--model", "m.json", "--udp", "127.0.0.1:1"}, "--can-map F.toml"},
    {{"identify", "rec.csv", "--axis", "X", "--can-map"}, "--can-map"},
    {{"replay", "rec.csv", "--dds", "--speed", "0"}, "--speed"},
    {{"replay", "rec.csv", "--dds", "--look-ahead", "33"}, "--look-ahead"},
    {{"replay", "rec.csv", "--dds", "--domain", "231"}, "--domain"},
    {{"watch", "--seconds", "-1"}, "--seconds"},
    {{"watch", "--json", "file.json"}, "give no file"},
    {{"characterize", "rec.csv", "--axis", "X", "--friction", "lugre"},
     "--friction needs --method motion"},
    {{"characterize", "rec.csv", "--axis", "X", "--method", "motion", "--travel", "50"},
     "--travel needs --method reversals"},
    {{"diagnose", "rec.csv", "--axis", "X", "--leave-out", "rust"}, "rust not in {added_friction,"},
    {{"check-config"}, "FILE is required"},
};
INSTANTIATE_TEST_SUITE_P(Typed, WrongUsage, testing::ValuesIn(kTyped));

TEST(Usage, AColumnNeedsAKnownUnit) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", "a,b\n1,1\n2,2\n");
  const auto complaint = [&](const std::string& columns) {
    const Answer answer = servotwin_says({"identify", file, "--axis", "X", "--columns", columns});
    EXPECT_EQ(answer.status, 2) << answer;
    EXPECT_EQ(answer.complaints().size(), 1U) << answer;
    return answer.err;
  };
  EXPECT_THAT(complaint("X.command=a[furlong]"), HasSubstr("unknown unit [furlong]"));
  EXPECT_THAT(complaint("X.command=a"), HasSubstr("has no unit"));
  EXPECT_THAT(complaint("X.speed=a[mm]"), HasSubstr("'X.speed' is neither"));
}

TEST(Usage, ANamedFormatComesBeforeTheLooksOfAFile) {
  const Folder folder;
  const std::string file = folder.write("rec.log", "Axis1\nSampling rate;1;kHz\na;b\n1;2\n2;3\n");
  const auto says = [&](const std::string& format) {
    std::vector<std::string> words{"identify", file, "--columns", "X.command=a[mm],X.actual=b[mm]"};
    if (!format.empty()) words.insert(words.end(), {"--format", format});
    const Answer answer = servotwin_says(words);
    return answer.out + answer.err;
  };
  EXPECT_THAT(says(""), HasSubstr("is named .log"));
  EXPECT_THAT(says("csv"), HasSubstr("1000 Hz, the sampling rate, is taken from line 2"));
  EXPECT_THAT(says("halscope"), HasSubstr("--format halscope: 'Axis1' is not the first line"));
}

TEST(Usage, FormatsListsEveryNameThatFormatTakes) {
  const std::string out = servotwin_says({"formats"}).out;
  for (const char* id : {"csv", "matlab", "mcap", "candump", "asc", "trc", "twincat", "tncscope",
                         "halscope", "sinumerik-capture", "sinumerik-trace"})
    EXPECT_THAT(out, HasSubstr(std::string("\n  --format    ") + id + "\n"));
  for (const char* command : {"identify", "predict", "diagnose", "sequence", "fit-axis", "what-if",
                              "replay", "multivariable", "frequency-response"})
    EXPECT_THAT(servotwin_says({command, "--help"}).out, HasSubstr("--format NAME")) << command;
}

TEST(Usage, HelpNamesEveryCommand) {
  const Answer answer = servotwin_says({"--help"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, IsEmpty());
  for (const char* command :
       {"identify", "predict", "simulate", "export", "replay", "watch", "check-config", "help"}) {
    EXPECT_THAT(answer.out, HasSubstr(std::string("\n  ") + command));
    const Answer help = servotwin_says({command, "--help"});
    EXPECT_EQ(help.status, 0) << help;
    EXPECT_THAT(help.out, HasSubstr(std::string("Usage: servotwin ") + command));
    EXPECT_EQ(servotwin_says({"help", command}).out, help.out);
  }
  EXPECT_EQ(servotwin_says({"help"}).out, answer.out);
}

/// The words of a line.
std::vector<std::string> split_at_blanks(const std::string& line) {
  std::istringstream in(line);
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

TEST(Usage, HelpOfEveryCommandEndsWithAnExample) {
  std::istringstream help(servotwin_says({"--help"}).out);
  std::size_t commands = 0;
  bool options_over = false;
  for (std::string line; std::getline(help, line);) {
    options_over = options_over || line.starts_with("Models of axes:");
    if (!options_over || !line.starts_with("  ") || line.starts_with("   ")) continue;
    const std::string command = split_at_blanks(line).front();
    ++commands;
    const std::string text = servotwin_says({command, "--help"}).out;
    const std::size_t at = text.find("\nExample:\n  servotwin " + command);
    ASSERT_NE(at, text.npos) << text;
    // Its options are those of the command.
    for (const std::string& word : split_at_blanks(text.substr(at))) {
      if (word.starts_with("--")) {
        EXPECT_LT(text.find("  " + word + " "), at) << command << ' ' << word;
      }
    }
  }
  EXPECT_EQ(commands, 26U);
}

TEST(Usage, HelpGroupsTheCommandsByTaskAndNamesTheManual) {
  const std::string help = servotwin_says({"--help"}).out;
  std::size_t before = 0;
  for (const char* line : {"\nModels of axes:\n  identify ", "\nDiagnosis:\n  diagnose ",
                           "\nPath correction:\n  learn ", "\nThis program:\n  help "}) {
    const std::size_t at = help.find(line);
    ASSERT_NE(at, help.npos) << line << help;
    EXPECT_GT(at, before);
    before = at;
  }
  EXPECT_THAT(help, HasSubstr("man servotwin"));
  EXPECT_THAT(help, Not(HasSubstr("docs/")));
  EXPECT_THAT(help, Not(HasSubstr("\n  manual")));
}

/// What follows `start` in the first line of a file of the sources that begins with it, up to
/// `end`.
std::string first_after(const std::string& file, const std::string& start, char end) {
  std::istringstream text(content_of(SERVOTWIN_SOURCE_DIR "/" + file));
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with(start)) {
      return line.substr(start.size(), line.find(end, start.size()) - start.size());
    }
  }
  return "nothing in " + file;
}

TEST(Usage, VersionIsTheSameEverywhere) {
  const Answer answer = servotwin_says({"--version"});
  EXPECT_EQ(answer.status, 0);
  EXPECT_THAT(answer.out, testing::MatchesRegex("[0-9]+\\.[0-9]+\\.[0-9]+\n"));
  EXPECT_EQ(servotwin_says({"version"}).out, answer.out);
  const std::string version = answer.out.substr(0, answer.out.size() - 1);
  EXPECT_EQ(first_after("CMakeLists.txt", "project(servotwin VERSION ", ' '), version);
  EXPECT_EQ(first_after("CHANGELOG.md", "## [", ']'), version);
  EXPECT_EQ(first_after("systemd/package/debian/changelog", "servotwin (", ')'), version);
}

// In a pipe the library keeps what is printed until there are kilobytes of it.
TEST(Usage, WhatIsSaidIsThereBeforeTheWorkIsDone) {
  const Program program({"replay", SERVOTWIN_SOURCE_DIR "/examples/axis_production.csv", "--dds",
                         "--machine", "nobody-" + std::to_string(::getpid()), "--wait", "60"});
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(40);
  while (program.so_far().find("24517 rows") == std::string::npos) {
    ASSERT_LT(std::chrono::steady_clock::now(), until) << program.so_far();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

}  // namespace
}  // namespace servotwin
