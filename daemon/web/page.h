// The files of the page, built into the program: daemon/web/page and daemon/web/vendor
// (docs/decisions/0007). Any thread.
#pragma once

#include <span>
#include <string_view>

namespace servotwin::daemon {

struct PageFile {
  std::string_view path;  ///< as it is asked for: "/", "/main.js"
  std::string_view type;
  std::string_view tag;  ///< of its content, in quotes: the ETag
  std::string_view content;
};

[[nodiscard]] std::span<const PageFile> page_files() noexcept;

}  // namespace servotwin::daemon
