// A directory of one test's own, gone with it.
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace servotwin::test {

class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string name = (std::filesystem::temp_directory_path() / "servotwin-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no directory " + name);
    path_ = name;
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  /// Writes a file, which may replace one, and returns its path.
  [[nodiscard]] std::filesystem::path file(const std::string& name, std::string_view text) const {
    auto where = path_ / name;
    // Written over, a file is flushed to the disk at once by some file systems; a new one is not.
    std::filesystem::remove(where);
    std::ofstream out(where, std::ios::binary);
    out << text;
    if (!out.flush()) throw std::runtime_error("cannot write " + where.string());
    return where;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace servotwin::test
