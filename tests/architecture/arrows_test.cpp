// The arrows between the rooms: who may include whom, and who may know of time, threads and
// files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace servotwin {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

/// What each room may include: a room, or one file of a room.
const std::map<std::string, std::set<std::string>> kMayInclude{
    {"twin", {"twin"}},
    {"msgs", {"msgs"}},
    {"identification", {"identification", "twin"}},
    {"diagnosis", {"diagnosis", "identification", "twin"}},
    {"ilc", {"ilc", "twin"}},
    {"drivers", {"drivers", "msgs", "twin/sample.h"}},
    {"daemon", {"daemon", "diagnosis", "identification", "ilc", "drivers", "msgs", "twin"}},
    {"cli", {"cli", "daemon", "diagnosis", "identification", "ilc", "drivers", "msgs", "twin"}},
};

/// Headers of the system that a room must do without.
const std::set<std::string> kClocks{"chrono", "ctime", "time.h", "sys/time.h"};
const std::set<std::string> kWorld{"thread",   "mutex",      "atomic",   "future",  "fstream",
                                   "iostream", "filesystem", "unistd.h", "fcntl.h", "pthread.h"};
const std::map<std::string, std::vector<const std::set<std::string>*>> kMustDoWithout{
    {"twin", {&kClocks, &kWorld}},
    {"identification", {&kClocks}},
    {"diagnosis", {&kClocks}},
    {"ilc", {&kClocks, &kWorld}},
};

/// What idlc makes of msgs/servotwin.idl.
constexpr const char* kGenerated = "servotwin.h";

struct Include {
  int line = 0;
  bool ours = false;  // in quotes
  std::string name;
};

std::vector<Include> includes_of(const fs::path& file) {
  std::vector<Include> out;
  std::ifstream in(file);
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::size_t hash = line.find_first_not_of(" \t");
    if (hash == line.npos || line[hash] != '#') continue;
    const std::size_t word = line.find_first_not_of(" \t", hash + 1);
    if (word == line.npos || line.compare(word, 7, "include") != 0) continue;
    const std::size_t open = line.find_first_of("\"<", word);
    if (open == line.npos) continue;
    const std::size_t close = line.find_first_of("\">", open + 1);
    out.push_back({number, line[open] == '"', line.substr(open + 1, close - open - 1)});
  }
  return out;
}

bool allowed(const std::string& room, const Include& include) {
  if (!include.ours) {
    const auto without = kMustDoWithout.find(room);
    if (without == kMustDoWithout.end()) return true;
    for (const std::set<std::string>* headers : without->second) {
      if (headers->contains(include.name)) return false;
    }
    return true;
  }
  const std::set<std::string>& may = kMayInclude.at(room);
  if (include.name == kGenerated) return may.contains("msgs");
  return may.contains(include.name) || may.contains(include.name.substr(0, include.name.find('/')));
}

/// The C sources of an exported unit are packed as they are: they include each other and the C
/// library's headers, and nothing else.
const fs::path kUnitSources = fs::path("cli") / "export" / "sources";
const std::set<std::string> kCLibrary{"math.h",  "stdarg.h", "stddef.h",
                                      "stdio.h", "stdlib.h", "string.h"};

bool allowed_in_unit(const fs::path& file, const Include& include) {
  return include.ours ? fs::exists(file.parent_path() / include.name)
                      : kCLibrary.contains(include.name);
}

/// "room/file:line includes name", for every include that no arrow allows.
std::vector<std::string> violations(const fs::path& root) {
  std::vector<std::string> out;
  for (const auto& [room, may] : kMayInclude) {
    if (!fs::exists(root / room)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(root / room)) {
      const std::string kind = entry.path().extension().string();
      if (kind != ".h" && kind != ".cpp" && kind != ".c") continue;
      const bool in_unit = entry.path().parent_path() == root / kUnitSources;
      for (const Include& include : includes_of(entry.path())) {
        if (in_unit ? allowed_in_unit(entry.path(), include) : allowed(room, include)) continue;
        out.push_back(fs::relative(entry.path(), root).string() + ":" +
                      std::to_string(include.line) + " includes " + include.name);
      }
    }
  }
  return out;
}

TEST(Architecture, NoIncludeGoesAgainstTheArrows) {
  EXPECT_THAT(violations(SERVOTWIN_SOURCE_DIR), IsEmpty());
}

TEST(Architecture, EveryRoomIsThere) {
  for (const auto& [room, may] : kMayInclude) {
    int files = 0;
    for (const auto& entry :
         fs::recursive_directory_iterator(fs::path(SERVOTWIN_SOURCE_DIR) / room)) {
      files += entry.is_regular_file() ? 1 : 0;
    }
    EXPECT_GT(files, 0) << room;
  }
}

/// A tree with one file in it.
class Planted {
 public:
  Planted(const std::string& file, const std::string& text) {
    std::string name = (fs::temp_directory_path() / "servotwin-arrows-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary directory");
    root_ = name;
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }
  Planted(const Planted&) = delete;
  Planted& operator=(const Planted&) = delete;
  ~Planted() {
    std::error_code ignored;
    fs::remove_all(root_, ignored);
  }
  [[nodiscard]] std::vector<std::string> found() const { return violations(root_); }

 private:
  fs::path root_;
};

TEST(Architecture, AWrongIncludeIsFoundWithItsPlace) {
  EXPECT_THAT(
      Planted("twin/x.h", "#pragma once\n#include \"identification/loop/identify.h\"\n").found(),
      ElementsAre("twin/x.h:2 includes identification/loop/identify.h"));
  EXPECT_THAT(Planted("twin/effects/x.h", "  #  include <chrono>\n").found(),
              ElementsAre("twin/effects/x.h:1 includes chrono"));
  EXPECT_THAT(Planted("drivers/x.cpp", "#include \"twin/model.h\"\n").found(),
              ElementsAre("drivers/x.cpp:1 includes twin/model.h"));
  EXPECT_THAT(Planted("drivers/x.cpp", "#include \"daemon/config/config.h\"\n").found(),
              ElementsAre("drivers/x.cpp:1 includes daemon/config/config.h"));
  EXPECT_THAT(Planted("identification/x.cpp", "#include \"servotwin.h\"\n").found(),
              ElementsAre("identification/x.cpp:1 includes servotwin.h"));
  EXPECT_THAT(Planted("daemon/x.cpp", "#include \"tests/daemon/support.h\"\n").found(),
              ElementsAre("daemon/x.cpp:1 includes tests/daemon/support.h"));
  EXPECT_THAT(Planted("cli/export/sources/x.c", "#include \"twin/twin.h\"\n").found(),
              ElementsAre("cli/export/sources/x.c:1 includes twin/twin.h"));
  EXPECT_THAT(Planted("cli/export/sources/x.c", "#include <pthread.h>\n").found(),
              ElementsAre("cli/export/sources/x.c:1 includes pthread.h"));
  EXPECT_THAT(Planted("daemon/x.cpp", "#include \"config.h\"\n").found(),
              ElementsAre("daemon/x.cpp:1 includes config.h"))
      << "ours are included from the root";
}

TEST(Architecture, ARightIncludeIsNot) {
  EXPECT_THAT(
      Planted("drivers/x.cpp", "#include \"twin/sample.h\"\n#include \"msgs/topics.h\"\n").found(),
      IsEmpty());
  EXPECT_THAT(Planted("cli/x.cpp", "#include \"twin/twin.h\"\n#include <chrono>\n").found(),
              IsEmpty());
  EXPECT_THAT(Planted("diagnosis/x.cpp", "#include \"identification/loop/identify.h\"\n").found(),
              IsEmpty());
  EXPECT_THAT(Planted("cli/export/sources/x.c", "#include \"x.c\"\n#include <math.h>\n").found(),
              IsEmpty());
}

}  // namespace
}  // namespace servotwin
