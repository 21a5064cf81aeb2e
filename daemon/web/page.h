// The files of the page (daemon/web/page and daemon/web/vendor), which are built into the program
// (docs/decisions/0007). Any thread; errors: none.
#pragma once

#include <span>
#include <string_view>

namespace servotwin::daemon {

struct PageFile {
  std::string_view path;  ///< path of the request: "/", "/main.js"
  std::string_view type;
  std::string_view tag;  ///< ETag of the content, in quotes
  std::string_view content;
};

[[nodiscard]] std::span<const PageFile> page_files() noexcept;

}  // namespace servotwin::daemon
