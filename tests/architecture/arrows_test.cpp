// The arrows between the rooms: who may include whom, and who may know of time, threads and
// files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tests/support/temporary_directory.h"

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
    {"python", {"python", "diagnosis", "identification", "ilc", "drivers", "msgs", "twin"}},
};

/// The inner rooms of a room, floor by floor from below. A room may include itself and every floor
/// below its own; rooms of one floor do not know each other. What lies in the room itself, outside
/// of its inner rooms, is above all of them.
using Floors = std::vector<std::set<std::string>>;
const std::map<std::string, Floors> kFloors{
    {"daemon",
     {{"between", "config"},
      {"store"},
      {"input", "publish"},
      {"loop"},
      {"correct", "record"},
      {"identify", "diagnose", "web"}}},
    {"identification",
     {{"recording", "least_squares"}, {"model"}, {"response", "torque"}, {"loop"}}},
    {"drivers", {{"common"}, {"can", "dds"}, {"recordings"}}},
    {"diagnosis", {{"statistics"}, {"evidence"}, {"search"}, {"torque"}, {"report"}}},
    {"cli", {{"common", "export"}, {"live", "program"}, {"recording"}}},
};

/// What an inner room must do without although its floor would allow it: the real-time loop
/// compiles against neither store nor configuration.
const std::map<std::string, std::set<std::string>> kMayNotInclude{
    {"daemon/between", {"daemon/config", "daemon/store"}},
    {"daemon/loop", {"daemon/config", "daemon/store", "daemon/publish"}},
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

/// What idlc makes of the files of msgs.
constexpr std::array kGenerated{"servotwin.h", "servotwin_ros2.h"};

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

/// The first two folders of a path, "daemon/loop"; one where there are no more.
std::string inner_room(const std::string& path) {
  const std::size_t first = path.find('/');
  const std::size_t second = first == path.npos ? path.npos : path.find('/', first + 1);
  return second == path.npos ? path.substr(0, first) : path.substr(0, second);
}

/// On which floor of its room an inner room lies; none: in the room itself.
std::optional<std::size_t> floor_of(const Floors& floors, const std::string& inner) {
  for (std::size_t i = 0; i < floors.size(); ++i) {
    if (floors[i].contains(inner)) return i;
  }
  return std::nullopt;
}

/// Whether a file of `from` ("daemon/loop") may include one of `to` of the same room.
bool allowed_inside(const std::string& room, const std::string& from, const std::string& to) {
  const auto floors = kFloors.find(room);
  if (floors == kFloors.end() || from == to) return true;
  const auto name = [&](const std::string& inner) {
    return inner == room ? std::string() : inner.substr(room.size() + 1);
  };
  const std::optional<std::size_t> above = floor_of(floors->second, name(from));
  const std::optional<std::size_t> below = floor_of(floors->second, name(to));
  if (!above) return true;  // the room itself is above all of them
  return below && *below < *above;
}

bool allowed(const std::string& file, const Include& include) {
  const std::string room = file.substr(0, file.find('/'));
  if (!include.ours) {
    const auto without = kMustDoWithout.find(room);
    if (without == kMustDoWithout.end()) return true;
    for (const std::set<std::string>* headers : without->second) {
      if (headers->contains(include.name)) return false;
    }
    return true;
  }
  const std::set<std::string>& may = kMayInclude.at(room);
  if (std::find(kGenerated.begin(), kGenerated.end(), include.name) != kGenerated.end())
    return may.contains("msgs");
  const std::string other = include.name.substr(0, include.name.find('/'));
  if (!may.contains(include.name) && !may.contains(other)) return false;
  const std::string from = inner_room(file), to = inner_room(include.name);
  if (const auto not_these = kMayNotInclude.find(from);
      not_these != kMayNotInclude.end() && not_these->second.contains(to))
    return false;
  return other != room || allowed_inside(room, from, to);
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
      const std::string file = fs::relative(entry.path(), root).string();
      for (const Include& include : includes_of(entry.path())) {
        if (in_unit ? allowed_in_unit(entry.path(), include) : allowed(file, include)) continue;
        out.push_back(file + ":" + std::to_string(include.line) + " includes " + include.name);
      }
    }
  }
  return out;
}

TEST(Architecture, NoIncludeGoesAgainstTheArrows) {
  EXPECT_THAT(violations(SERVOTWIN_SOURCE_DIR), IsEmpty());
}

int files_in(const fs::path& folder) {
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    files += entry.is_regular_file() ? 1 : 0;
  return files;
}

TEST(Architecture, EveryRoomIsThere) {
  const fs::path root = SERVOTWIN_SOURCE_DIR;
  for (const auto& [room, may] : kMayInclude) EXPECT_GT(files_in(root / room), 0) << room;
  for (const auto& [room, floors] : kFloors) {
    for (const std::set<std::string>& floor : floors) {
      for (const std::string& inner : floor)
        EXPECT_GT(files_in(root / room / inner), 0) << room << "/" << inner;
    }
  }
}

/// A folder that no floor names would have no walls.
TEST(Architecture, EveryInnerRoomOfADividedRoomHasAFloor) {
  for (const auto& [room, floors] : kFloors) {
    for (const auto& entry : fs::directory_iterator(fs::path(SERVOTWIN_SOURCE_DIR) / room)) {
      if (!entry.is_directory()) continue;
      EXPECT_TRUE(floor_of(floors, entry.path().filename().string()).has_value()) << entry.path();
    }
  }
}

/// A tree with one file in it.
class Planted {
 public:
  Planted(const std::string& file, const std::string& text) {
    fs::create_directories((root_.path() / file).parent_path());
    std::ofstream(root_.path() / file) << text;
  }
  [[nodiscard]] std::vector<std::string> found() const { return violations(root_.path()); }

 private:
  test::TemporaryDirectory root_;
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

/// For every inner room and every other that it must not know: an include planted in it is found.
TEST(Architecture, AnIncludeThroughAnInnerWallIsFound) {
  int walls = 0;
  for (const auto& [room, floors] : kFloors) {
    for (std::size_t i = 0; i < floors.size(); ++i) {
      for (const std::string& from : floors[i]) {
        for (std::size_t k = i; k < floors.size(); ++k) {
          for (const std::string& to : floors[k]) {
            if (from == to) continue;
            ++walls;
            const std::string file = room + "/" + from + "/x.cpp";
            const std::string header = room + "/" + to + "/x.h";
            EXPECT_THAT(Planted(file, "#include \"" + header + "\"\n").found(),
                        ElementsAre(file + ":1 includes " + header));
          }
        }
        // What lies in the room itself is above.
        const std::string file = room + "/" + from + "/x.h";
        EXPECT_THAT(Planted(file, "#include \"" + room + "/x.h\"\n").found(),
                    ElementsAre(file + ":1 includes " + room + "/x.h"));
      }
    }
  }
  EXPECT_GT(walls, 40);
  for (const auto& [from, without] : kMayNotInclude) {
    for (const std::string& to : without) {
      EXPECT_THAT(Planted(from + "/x.h", "#include \"" + to + "/x.h\"\n").found(),
                  ElementsAre(from + "/x.h:1 includes " + to + "/x.h"));
    }
  }
}

TEST(Architecture, ARightIncludeIsNot) {
  EXPECT_THAT(
      Planted("drivers/x.cpp", "#include \"twin/sample.h\"\n#include \"msgs/topics.h\"\n").found(),
      IsEmpty());
  EXPECT_THAT(Planted("daemon/web/x.cpp", "#include \"daemon/store/store.h\"\n").found(),
              IsEmpty());
  EXPECT_THAT(Planted("daemon/x.cpp", "#include \"daemon/web/api.h\"\n").found(), IsEmpty());
  EXPECT_THAT(
      Planted("identification/loop/x.h", "#include \"identification/recording/segments.h\"\n")
          .found(),
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
