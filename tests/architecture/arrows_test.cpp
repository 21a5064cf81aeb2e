// Every #include of our own, held against the arrows of the architecture.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

/// Rooms and what each may include, followed along the arrows.
const std::map<std::string, std::set<std::string>> kMayInclude{
    {"twin", {}},
    {"msgs", {}},
    {"identification", {"twin"}},
    {"diagnosis", {"identification", "twin"}},
    {"ilc", {"twin"}},
    {"drivers", {"msgs"}},  // and twin/sample.h alone
    {"daemon", {"diagnosis", "identification", "twin", "ilc", "drivers", "msgs"}},
};

/// Libraries that belong in one place: the rest of the program does not know them.
const std::map<std::string, std::set<std::string>> kLibraryRooms{
    {"ceres/", {"identification"}},
    {"dds/", {"drivers", "msgs"}},
    {"sqlite3.h", {"daemon"}},
    {"matio.h", {"drivers"}},
    {"toml++/", {"daemon"}},
    {"CLI/", {"daemon"}},
};

bool allowed(const std::string& room, const std::string& header) {
  if (const auto slash = header.find('/'); slash != std::string::npos) {
    const std::string other = header.substr(0, slash);
    if (kMayInclude.contains(other) && other != room) {
      if (room == "drivers" && header == "twin/sample.h") return true;
      return kMayInclude.at(room).contains(other);
    }
    if (other == "tests") return false;
  }
  for (const auto& [library, rooms] : kLibraryRooms) {
    if (header.rfind(library, 0) == 0) return rooms.contains(room);
  }
  return true;
}

std::vector<std::string> includes_of(const fs::path& file) {
  static const std::regex pattern(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  std::vector<std::string> out;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (std::smatch match; std::regex_search(line, match, pattern)) out.push_back(match[1]);
  }
  return out;
}

std::vector<fs::path> sources_in(const fs::path& folder) {
  std::vector<fs::path> out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const auto extension = entry.path().extension();
    if (extension == ".h" || extension == ".cpp") out.push_back(entry.path());
  }
  return out;
}

TEST(Architecture, EveryIncludeFollowsAnArrow) {
  const fs::path root = SERVOTWIN_SOURCE_DIR;
  for (const auto& [room, others] : kMayInclude) {
    const auto sources = sources_in(root / room);
    EXPECT_FALSE(sources.empty()) << room << " is empty";
    for (const fs::path& source : sources) {
      for (const std::string& header : includes_of(source)) {
        EXPECT_TRUE(allowed(room, header)) << source.string() << " includes " << header;
      }
    }
  }
}

// The virtual machine is the independent truth: it may know nothing of the program.
TEST(Architecture, TheVirtualMachineSharesNoCodeWithTheProgram) {
  const fs::path root = SERVOTWIN_SOURCE_DIR;
  for (const fs::path& source : sources_in(root / "tests" / "virtual_machine")) {
    for (const std::string& header : includes_of(source)) {
      const std::string room = header.substr(0, header.find('/'));
      EXPECT_FALSE(header.find('/') != std::string::npos && kMayInclude.contains(room)) << source.string() << " includes " << header;
    }
  }
}

TEST(Architecture, ForbiddenArrowsAreSeen) {
  EXPECT_FALSE(allowed("twin", "identification/identify.h"));
  EXPECT_FALSE(allowed("drivers", "twin/twin.h"));
  EXPECT_TRUE(allowed("drivers", "twin/sample.h"));
  EXPECT_FALSE(allowed("diagnosis", "daemon/store.h"));
  EXPECT_FALSE(allowed("ilc", "identification/identify.h"));
  EXPECT_FALSE(allowed("twin", "ceres/jet.h"));
  EXPECT_TRUE(allowed("identification", "ceres/jet.h"));
  EXPECT_FALSE(allowed("daemon", "tests/support/real_data.h"));
  EXPECT_TRUE(allowed("daemon", "twin/twin.h"));
}

}  // namespace
