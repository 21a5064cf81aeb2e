// A type of one name in one namespace is defined in one header. Two of them are two definitions of
// their constructors and destructors too, of which the linker keeps one for both, silently.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <string>
#include <vector>

#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

/// "namespace::Type: header, header" of every type that several headers of these folders define.
std::vector<std::string> defined_twice(const fs::path& root,
                                       const std::vector<std::string>& folders) {
  static const std::regex begin(R"(^namespace ([\w:]+) \{)"), end(R"(^\}  // namespace)"),
      type(
          R"(^(?:struct|class|enum|enum class|union) (?:\[\[.*\]\] |alignas\(.*\) )?(\w+)(?: final)?(?: :.*)?(?: \{.*)?)");
  std::map<std::string, std::vector<std::string>> headers;
  for (const std::string& folder : folders) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (entry.path().extension() != ".h") continue;
      std::ifstream file(entry.path());
      std::string line;
      std::vector<std::string> inside;
      std::smatch found;
      while (std::getline(file, line)) {
        if (std::regex_search(line, found, begin)) inside.push_back(found[1]);
        if (std::regex_search(line, end) && !inside.empty()) inside.pop_back();
        if (!std::regex_match(line, found, type)) continue;
        std::string name;
        for (const std::string& space : inside) name += space + "::";
        headers[name + found[1].str()].push_back(fs::relative(entry.path(), root));
      }
    }
  }
  std::vector<std::string> out;
  for (auto& [name, files] : headers) {
    if (files.size() < 2) continue;
    std::sort(files.begin(), files.end());
    out.push_back(name + ":");
    for (const std::string& file : files) out.back() += " " + file;
  }
  return out;
}

TEST(TypeNames, AreDefinedInOneHeaderEach) {
  EXPECT_THAT(defined_twice(SERVOTWIN_SOURCE_DIR, {"twin", "identification", "diagnosis", "ilc",
                                                   "drivers", "msgs", "daemon", "cli", "tests"}),
              IsEmpty());
}

TEST(TypeNames, OneDefinedTwiceIsFound) {
  const test::TemporaryDirectory root;
  const auto write = [&](const fs::path& name, const std::string& text) {
    fs::create_directories((root.path() / name).parent_path());
    std::ofstream(root.path() / name) << text;
  };
  write("a/unit.h", "namespace servotwin {\nstruct Unit {\n  int x = 0;\n};\nstruct Same;\n}\n");
  write("b/units.h", "namespace servotwin {\nclass Unit final : public Base {\n};\n}\n");
  write("b/after.h",
        "namespace servotwin {\nnamespace detail {\nstruct Inner {\n};\n}  // namespace detail\n"
        "enum Kind : unsigned {\n};\n}  // namespace servotwin\n");
  write("a/kind.h",
        "namespace servotwin {\nclass [[nodiscard]] Kind\n    : public Base {\n};\n}\n");
  write("b/inner.h", "namespace servotwin::b {\nstruct Unit {\n};\nstruct Same {\n};\n}\n");
  EXPECT_THAT(
      defined_twice(root.path(), {"a", "b"}),
      ElementsAre("servotwin::Kind: a/kind.h b/after.h", "servotwin::Unit: a/unit.h b/units.h"));
}

}  // namespace
}  // namespace servotwin
