// Writes files as one zip in memory, without times, so that the same files give the same zip.
// Throws std::runtime_error with the message of the library. Source: libzip (BSD-3-Clause).
#pragma once

#include <string>
#include <vector>

namespace servotwin {

struct PackedFile {
  std::string name;  ///< with its folders: "sources/fmu.c"
  std::string content;
};

[[nodiscard]] std::string zipped(const std::vector<PackedFile>& files);

}  // namespace servotwin
