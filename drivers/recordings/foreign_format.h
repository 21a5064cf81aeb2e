// Files that record motion and are not read, by the first bytes of each, and how they become one
// that is. Any thread; errors: none.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace servotwin {

struct ForeignFormat {
  std::string_view begins;    ///< its first bytes
  const char *name, *advice;  ///< what it is; what to do, continues a sentence
};

/// In no order; several may have the same name.
[[nodiscard]] std::span<const ForeignFormat> foreign_formats() noexcept;
/// The format that begins so; null if it is none of these.
[[nodiscard]] const ForeignFormat* foreign_format(std::string_view start) noexcept;

}  // namespace servotwin
