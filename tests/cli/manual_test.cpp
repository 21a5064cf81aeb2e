// The manual pages and completions list the same options as --help, and groff and the shells read
// them without a message.
#include <gmock/gmock.h>
#include <sys/wait.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <sstream>

#include "daemon/arguments.h"
#include "program.h"

namespace servotwin {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSupersetOf;
using testing::Not;
using testing::UnorderedElementsAreArray;

/// Runs a line of the shell; its standard error is in `out`, too.
Answer shell(const std::string& line) {
  Answer answer;
  std::FILE* pipe = ::popen(("{ " + line + "; } 2>&1 </dev/null").c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("cannot run a shell");
  std::array<char, 4096> part{};
  for (std::size_t size = 0; (size = std::fread(part.data(), 1, part.size(), pipe)) > 0;) {
    answer.out.append(part.data(), size);
  }
  const int status = ::pclose(pipe);
  answer.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return answer;
}

/// For a test that needs a program: fails if it is not installed.
#define NEEDS(program, package)                                   \
  ASSERT_EQ(shell("command -v " program " >/dev/null").status, 0) \
      << program " is missing; install the package " package " (./dev test does so)"

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::string said(const std::vector<std::string>& words) {
  const Answer answer = servotwin_says(words);
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, IsEmpty());
  return answer.out;
}

/// The commands that --help lists: lines with two blanks and a name.
std::vector<std::string> commands() {
  std::vector<std::string> names;
  for (const std::string& line : lines_of(said({"--help"}))) {
    if (line.size() > 2 && line.starts_with("  ") && std::islower(line[2]) != 0) {
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  return names;
}

/// The long options in a text of --help: "--from" of "  --from S   start ..".
std::vector<std::string> options_in(const std::string& help) {
  std::vector<std::string> names;
  for (const std::string& line : lines_of(help)) {
    if (!line.starts_with("  -")) continue;
    const std::size_t begin = line.find("--");
    names.push_back(line.substr(begin, line.find_first_of(" \n", begin) - begin));
  }
  return names;
}

/// Of every command.
const std::map<std::string, std::vector<std::string>>& options() {
  static const auto all = [] {
    std::map<std::string, std::vector<std::string>> found;
    for (const std::string& command : commands()) {
      found[command] = options_in(said({command, "--help"}));
    }
    return found;
  }();
  return all;
}

std::string daemon_help() {
  CLI::App app(daemon::kDaemonDescription, "servotwind");
  daemon::DaemonArguments arguments;
  arguments.declare(app, "0");
  return app.help();
}

/// As troff wants a name.
std::string in_troff(std::string name) {
  for (std::size_t at = 0; (at = name.find('-', at)) != name.npos; at += 2) name.insert(at, "\\");
  return name;
}

/// The lines of a page from a heading to the next one.
std::string section_of(const std::string& page, const std::string& heading) {
  std::string section;
  bool inside = false;
  for (const std::string& line : lines_of(page)) {
    if (line.starts_with(".SH") || line.starts_with(".SS")) inside = line == heading;
    if (inside) section += line + "\n";
  }
  return section;
}

TEST(Manual, HasEveryCommandWithItsOptions) {
  ASSERT_THAT(commands(), IsSupersetOf({"identify", "watch", "completion"}));
  const std::string page = said({"manual"});
  for (const auto& [command, names] : options()) {
    const std::string section = section_of(page, ".SS \"servotwin " + in_troff(command) + "\"");
    ASSERT_THAT(names, Contains("--help"));
    for (const std::string& name : names) {
      if (name == "--help") continue;  // said once, for all
      EXPECT_THAT(section, HasSubstr("\\fB" + in_troff(name) + "\\fR")) << command;
    }
  }
  const std::string shared = section_of(page, ".SH \"COMMON OPTIONS\"");
  EXPECT_THAT(shared, AllOf(HasSubstr("\\fB\\-\\-columns\\fR"), HasSubstr("\\fB\\-\\-from\\fR")));
  const std::string all = section_of(page, ".SH OPTIONS");
  EXPECT_THAT(all, AllOf(HasSubstr("\\fB\\-\\-help\\fR"), HasSubstr("\\fB\\-\\-version\\fR")));
  EXPECT_THAT(page,
              Not(HasSubstr("servotwin manual\\fR")));  // the command that writes it is hidden
}

TEST(Manual, SaysWhatAValueMayBe) {
  const std::string page = said({"manual"});
  EXPECT_THAT(section_of(page, ".SS \"servotwin identify\""),
              AllOf(HasSubstr("\\fBjoint\\fR,\n\\fBpole\\-search\\fR,\n\\fBfull\\-ls\\fR"),
                    HasSubstr("\\fBservotwin identify\\fR [\\fIOPTION\\fR...] \\fIREC\\fR")));
  EXPECT_THAT(section_of(page, ".SS \"servotwin characterize\""), HasSubstr("(greater than 0"));
}

TEST(Manual, OfTheDaemonHasItsOptions) {
  const std::string page = said({"manual", "--program", "servotwind"});
  const std::string section = section_of(page, ".SH OPTIONS");
  const std::vector<std::string> names = options_in(daemon_help());
  ASSERT_THAT(names, IsSupersetOf({"--config", "--replay", "--http", "--version"}));
  for (const std::string& name : names) {
    EXPECT_THAT(section, HasSubstr("\\fB" + in_troff(name) + "\\fR"));
  }
  EXPECT_THAT(section, HasSubstr("(0 to 230)"));
  EXPECT_THAT(page, HasSubstr("\n.SH SIGNALS\n"));
}

TEST(Manual, ItsExamplesHaveOptionsThatExist) {
  int examples = 0;
  for (std::string line : lines_of(section_of(said({"manual"}), ".SH EXAMPLES"))) {
    std::erase(line, '\\');
    std::istringstream words(line);
    std::string word, command;
    words >> word >> command;
    if (word != "servotwin") continue;
    ++examples;
    ASSERT_TRUE(options().contains(command)) << line;
    while (words >> word) {
      if (word.starts_with("--")) {
        EXPECT_THAT(options().at(command), Contains(word)) << line;
      }
    }
  }
  EXPECT_GE(examples, 5);
}

TEST(Manual, IsTheSameEveryTimeAndHasVersionAndDate) {
  std::string version = said({"version"});
  version.pop_back();
  for (const char* program : {"servotwin", "servotwind"}) {
    const std::vector<std::string> words{"manual", "--program", program, "--date", "2026-11-25"};
    const std::string page = said(words);
    EXPECT_EQ(page, said(words));
    EXPECT_THAT(page, HasSubstr(" \"2026-11-25\" \"servotwin " + version + "\" "));
    EXPECT_THAT(page, testing::Each(testing::Lt('\x7f')));
  }
}

TEST(Manual, IsTroffWithoutAWarning) {
  NEEDS("groff", "groff-base");
  const Folder folder;
  for (const char* program : {"servotwin", "servotwind"}) {
    const std::string page = folder.write("page", said({"manual", "--program", program}));
    const Answer warnings = shell("groff -man -ww -z -Tutf8 " + page);
    EXPECT_EQ(warnings.status, 0);
    EXPECT_THAT(warnings.out, IsEmpty()) << program;
    const std::string shown = shell("groff -man -Tascii " + page).out;
    EXPECT_NE(shown.find("The command line is wrong."), shown.npos) << program;
  }
}

/// The script of a program for a shell, as a file.
std::string script_for(const Folder& folder, const std::string& in, const std::string& program) {
  return folder.write(program + "." + in, said({"completion", in, "--program", program}));
}

/// What bash completes to these words, the last of which is being typed.
std::vector<std::string> bash_completes(const std::string& words) {
  const Folder folder;
  const std::string program = words.substr(0, words.find(' '));
  const Answer answer =
      shell("bash -c 'source " + script_for(folder, "bash", program) + "; COMP_WORDS=(" + words +
            "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _" + program +
            " && ((${#COMPREPLY[@]})) && printf \"%s\\n\" \"${COMPREPLY[@]}\"'");
  return lines_of(answer.out);
}

TEST(Completion, OfBashIsComputedByBash) {
  NEEDS("bash", "bash");
  EXPECT_THAT(bash_completes("servotwin iden"), ElementsAre("identify"));
  EXPECT_THAT(bash_completes("servotwin \"\""), UnorderedElementsAreArray(commands()));
  EXPECT_THAT(bash_completes("servotwin --ver"), ElementsAre("--version"));
  EXPECT_THAT(bash_completes("servotwin help pre"), ElementsAre("predict", "preview"));
  EXPECT_THAT(bash_completes("servotwin identify --meth"), ElementsAre("--method"));
  EXPECT_THAT(bash_completes("servotwin identify rec.csv --method \"\""),
              ElementsAre("joint", "pole-search", "full-ls"));
  // Readline gives the = of --method=j as a word of its own.
  EXPECT_THAT(bash_completes("servotwin identify --method = j"), ElementsAre("joint"));
  EXPECT_THAT(bash_completes("servotwin identify --method ="),
              ElementsAre("joint", "pole-search", "full-ls"));
  EXPECT_THAT(bash_completes("servotwin diagnose rec.csv --leave-out cogging,ba"),
              ElementsAre("cogging,backlash"));
  EXPECT_THAT(bash_completes("servotwin watch --json --su"), ElementsAre("--summary"));
  // Files are completed by readline; a number is not completed.
  EXPECT_THAT(bash_completes("servotwin identify \"\""), IsEmpty());
  EXPECT_THAT(bash_completes("servotwin identify --from \"\""), IsEmpty());
  EXPECT_THAT(bash_completes("servotwind --repl"), ElementsAre("--replay"));
}

TEST(Completion, OfBashHasEveryOption) {
  NEEDS("bash", "bash");
  for (const auto& [command, names] : options()) {
    EXPECT_THAT(bash_completes("servotwin " + command + " --"), UnorderedElementsAreArray(names))
        << command;
  }
  EXPECT_THAT(bash_completes("servotwind --"),
              UnorderedElementsAreArray(options_in(daemon_help())));
}

/// What fish completes to these lines; a line for each, then a blank one.
std::vector<std::vector<std::string>> fish_completes(const std::vector<std::string>& lines) {
  const Folder folder;
  std::string script = "source " + script_for(folder, "fish", "servotwin") + "\nsource " +
                       script_for(folder, "fish", "servotwind") + "\n";
  for (const std::string& line : lines) script += "complete -C '" + line + "'\necho\n";
  const Answer answer =
      shell("HOME=" + folder / "" + " fish --no-config " + folder.write("lines.fish", script));
  std::vector<std::vector<std::string>> found(1);
  for (const std::string& line : lines_of(answer.out)) {
    if (line.empty()) {
      found.emplace_back();
    } else {
      found.back().push_back(line.substr(0, line.find('\t')));
    }
  }
  found.pop_back();
  return found;
}

TEST(Completion, OfFishIsComputedByFish) {
  NEEDS("fish", "fish");
  EXPECT_THAT(fish_completes({"servotwin iden", "servotwin identify --meth",
                              "servotwin identify rec.csv --method ", "servotwin completion ",
                              "servotwin identify --from ",
                              "servotwin diagnose rec.csv --leave-out cogging,ba",
                              "servotwin help pre", "servotwind --repl"}),
              ElementsAre(ElementsAre("identify"), ElementsAre("--method"),
                          UnorderedElementsAreArray({"pole-search", "joint", "full-ls"}),
                          UnorderedElementsAreArray({"bash", "zsh", "fish"}), IsEmpty(),
                          ElementsAre("cogging,backlash"), ElementsAre("predict", "preview"),
                          ElementsAre("--replay")));
}

TEST(Completion, OfFishHasEveryOption) {
  NEEDS("fish", "fish");
  std::vector<std::string> lines{"servotwin ", "servotwind --"};
  for (const auto& [command, names] : options()) lines.push_back("servotwin " + command + " --");
  const auto found = fish_completes(lines);
  ASSERT_EQ(found.size(), lines.size());
  EXPECT_THAT(found[0], UnorderedElementsAreArray(commands()));
  EXPECT_THAT(found[1], UnorderedElementsAreArray(options_in(daemon_help())));
  std::size_t line = 2;
  for (const auto& [command, names] : options()) {
    EXPECT_THAT(found[line++], UnorderedElementsAreArray(names)) << command;
  }
}

/// Types a line and a tab into zsh, and waits for what should then be there.
bool zsh_completes(const std::string& line, const std::string& expected) {
  const Folder folder;
  const std::string script = script_for(folder, "zsh", line.substr(0, line.find(' ')));
  const std::string driver =
      folder.write("driver.zsh",
                   "zmodload zsh/zpty\n"
                   "zpty shell zsh -f -i\n"
                   "zpty -w shell 'PROMPT=; autoload -Uz compinit; compinit -u -D; source " +
                       script +
                       "; bindkey \"^I\" complete-word; print rea''dy'\n"
                       "zpty -r -m shell seen '*ready*'\n"
                       "zpty -n -w shell '" +
                       line +
                       "'$'\\t'\n"
                       "zpty -r -m shell seen '*" +
                       expected + "*' && print found\nzpty -d shell\n");
  return shell("HOME=" + folder / "" + " TERM=xterm timeout 60 zsh -f " + driver).out == "found\n";
}

TEST(Completion, OfZshIsComputedByZsh) {
  NEEDS("zsh", "zsh");
  EXPECT_TRUE(zsh_completes("servotwin iden", "identify"));
  EXPECT_TRUE(zsh_completes("servotwin identify --meth", "--method"));
  EXPECT_TRUE(zsh_completes("servotwin identify rec.csv --method=j", "joint"));
  EXPECT_TRUE(zsh_completes("servotwin diagnose rec.csv --leave-out cogging,ba", "backlash"));
  EXPECT_TRUE(zsh_completes("servotwind --repl", "--replay"));
}

TEST(Completion, OfZshHasEveryOption) {
  const std::string script = said({"completion", "zsh"});
  for (const auto& [command, names] : options()) {
    EXPECT_THAT(script, HasSubstr("\n      '" + command + ":"));
    const std::size_t begin = script.find("\n    " + command + ")\n");
    ASSERT_NE(begin, script.npos) << command;
    const std::string branch = script.substr(begin, script.find(";;", begin) - begin);
    for (const std::string& name : names) {
      EXPECT_THAT(branch, testing::ContainsRegex("['*)]" + name + "=?\\[")) << command;
    }
  }
}

TEST(Completion, HasNoFaultOfSyntax) {
  const Folder folder;
  NEEDS("bash", "bash");
  NEEDS("zsh", "zsh");
  NEEDS("fish", "fish");
  for (const std::string in : {"bash", "zsh", "fish"}) {
    for (const std::string program : {"servotwin", "servotwind"}) {
      const Answer checked = shell(in + " -n " + script_for(folder, in, program));
      EXPECT_EQ(checked.status, 0) << in;
      EXPECT_THAT(checked.out, IsEmpty()) << in << " " << program;
    }
  }
}

}  // namespace
}  // namespace servotwin
