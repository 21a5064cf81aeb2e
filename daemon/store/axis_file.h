// The file of an axis in a folder of the store: <store>/<folder>/<machine>/<axis><extension>. Any
// thread.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

#include "drivers/common/messages.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {

/// Throws std::runtime_error if one of the names could lead out of the store: names also come from
/// files and networks.
[[nodiscard]] inline std::filesystem::path axis_file(const std::filesystem::path& store,
                                                     const char* folder, const std::string& machine,
                                                     const std::string& axis,
                                                     const char* extension) {
  for (const std::string& name : {machine, axis}) {
    if (!usable_name(name))
      throw std::runtime_error("store " + store.string() + ": " + folder + ": the name " +
                               in_quotes(name) + " " + std::string(kUsableNameRule));
  }
  return store / folder / machine / (axis + extension);
}

}  // namespace servotwin::daemon
