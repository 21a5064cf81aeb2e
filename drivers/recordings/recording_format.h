// The formats of recordings, by which a file is read whatever it looks like (--format).
// Any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace servotwin {

enum class RecordingFormat : std::uint8_t {
  kTable,
  kMatlab,
  kMcap,
  kCandump,
  kVectorAsc,
  kPeakTrc,
  kTwincatScope,
  kTncscope,
  kHalscope,
  kSinumerikCapture,
  kSinumerikTrace
};

/// A format, or one of several forms of it, as people see it.
struct FormatForm {
  RecordingFormat format;
  const char* id;  ///< of --format
  const char* name;
  const char* line;      ///< an example of its first line
  const char* channels;  ///< how its columns become channels
};

/// All forms, those of one format together; the order of `servotwin formats`.
[[nodiscard]] std::span<const FormatForm> recording_formats() noexcept;
/// The first form of a format.
[[nodiscard]] const FormatForm& form_of(RecordingFormat format) noexcept;
/// The identifiers, each once.
[[nodiscard]] std::vector<std::string> format_ids();
/// The format with this identifier. Throws std::invalid_argument with the list of them.
[[nodiscard]] RecordingFormat format_named(const std::string& id);

}  // namespace servotwin
