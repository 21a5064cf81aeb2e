#include "drivers/recordings/recording_file.h"

#include <fcntl.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string_view>

#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "drivers/recordings/can_log/can_log_form.h"
#include "drivers/recordings/can_log/can_recording.h"
#include "drivers/recordings/column_map.h"
#include "drivers/recordings/foreign_format.h"
#include "drivers/recordings/matlab/mat.h"
#include "drivers/recordings/mcap/mcap.h"
#include "drivers/recordings/sinumerik_capture/sinumerik_capture.h"
#include "drivers/recordings/sinumerik_trace/sinumerik_trace.h"
#include "drivers/recordings/table/csv.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {
namespace {

std::string first_bytes(const std::filesystem::path& file, std::size_t most = 4096) {
  std::string bytes(most, '\0');
  bytes.resize(FileHandle::open(file, O_RDONLY).read(bytes.data(), bytes.size()));
  return bytes;
}

bool is_utf16(std::string_view start) {
  return start.starts_with("\xff\xfe") || start.starts_with("\xfe\xff");
}

/// The format that the first bytes show; nothing for a table, a text trace and what is unknown.
std::optional<RecordingFormat> shown_format(std::string_view start) {
  if (start.starts_with("MATLAB 5.0 MAT-file") || start.starts_with("MATLAB 7.3 MAT-file"))
    return RecordingFormat::kMatlab;
  if (const auto form = can_log_form(start)) {
    return *form == CanLogForm::kVectorAsc ? RecordingFormat::kVectorAsc
           : *form == CanLogForm::kPeakTrc ? RecordingFormat::kPeakTrc
                                           : RecordingFormat::kCandump;
  }
  if (is_mcap(start)) return RecordingFormat::kMcap;
  if (is_sinumerik_trace(start)) return RecordingFormat::kSinumerikTrace;
  if (is_sinumerik_capture(start)) return RecordingFormat::kSinumerikCapture;
  return std::nullopt;
}

bool is_binary(std::string_view start) {
  return !is_utf16(start) && start.find('\0') != std::string::npos;
}

/// What a file looks like; continues a message.
std::string look_of(std::string_view start) {
  if (const auto shown = shown_format(start))
    return in_quotes(form_of(*shown).name) + ", --format " + form_of(*shown).id;
  if (const ForeignFormat* foreign = foreign_format(start))
    return std::string("a ") + foreign->name + ", which is not read; " + foreign->advice;
  if (is_binary(start)) return "a binary file of another kind";
  if (is_utf16(start)) return "text in UTF-16";
  return "text that begins with " + in_quotes(start.substr(0, start.find_first_of("\r\n")));
}

/// Throws if a file is not of the named format, where its first bytes must show it.
void require_named(RecordingFormat named, std::string_view start, const std::string& source) {
  if (shown_format(start) == named) return;
  const std::size_t first = std::min(start.find_first_not_of(" \t\r\n\xef\xbb\xbf"), start.size());
  const auto begins = [&](char c) {
    return is_utf16(start) || start.substr(first, 1) == std::string(1, c);
  };
  using enum RecordingFormat;
  if (named == kMatlab || named == kMcap || (named == kSinumerikCapture && !begins('{')) ||
      (named == kSinumerikTrace && !begins('<')) || is_binary(start))
    throw std::runtime_error(source + ": --format " + form_of(named).id +
                             ": this is no such file; it looks like " + look_of(start));
}

/// The schema of a file that Servotwin itself wrote, such as servotwin.model/1; empty of others.
std::string own_schema(std::string_view start, const std::filesystem::path& file) {
  const std::size_t first = start.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos || start[first] != '{') return {};
  constexpr std::size_t kMostBytes = 1 << 20;  // the keys are sorted: the schema is not the first
  constexpr std::string_view kBegin = "\"servotwin.";
  const std::string json = first_bytes(file, kMostBytes);
  const std::size_t at = json.find(kBegin);
  const std::size_t end = at == std::string::npos ? at : json.find('"', at + kBegin.size());
  return end == std::string::npos ? "" : json.substr(at + 1, end - at - 1);
}

/// The format by the first bytes; of a table or a text trace, which its first lines tell, kTable.
RecordingFormat format_by(std::string_view start, const std::filesystem::path& file) {
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(file.string() + ": " + why);
  };
  const std::optional<RecordingFormat> shown = shown_format(start);
  if (shown == RecordingFormat::kMatlab) return *shown;
  if (const ForeignFormat* foreign = foreign_format(start))
    refuse(std::string("is a ") + foreign->name + ", which is not read; " + foreign->advice);
  if (const std::string schema = own_schema(start, file); !shown && !schema.empty())
    refuse("is a file of Servotwin (" + schema + ") and not a recording");
  if (file.extension() == ".mat")
    refuse("is named .mat, but is not a MATLAB file of version 5 or 7.3");
  if (!shown && file.extension() == ".log" && !is_utf16(start) && !is_table(start)) {
    refuse(
        "is named .log, but its first line is not that of a CAN log, such as (12.345678) can0 "
        "181#00");
  }
  return shown.value_or(RecordingFormat::kTable);
}

Recording read_as(RecordingFormat format, std::string_view start, const std::filesystem::path& file,
                  const ReadOptions& options) {
  using enum RecordingFormat;
  if (format == kMatlab) return read_mat(file, options);
  if (format == kCandump || format == kVectorAsc || format == kPeakTrc)
    return read_candump(file, options);
  if (!options.can_map.empty())
    throw std::invalid_argument(file.string() + ": --can-map is for CAN logs, and this is not one");
  if (format == kMcap) return read_mcap(file, options);
  if (format == kSinumerikTrace) return read_sinumerik_trace(file, options);
  if (format == kSinumerikCapture) return read_sinumerik_capture(file, options);
  if (is_binary(start))
    throw std::runtime_error(file.string() + ": is a binary file, and a table is text");
  return read_csv(file, options);
}

Recording read_by_format(const std::filesystem::path& file, const ReadOptions& options) {
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(file.string() + ": " + why);
  };
  std::error_code unknown;
  const auto status = std::filesystem::status(file, unknown);
  if (!std::filesystem::exists(status)) refuse("there is no such file");
  if (std::filesystem::is_directory(status)) refuse("is a directory; give one recording in it");
  if (!std::filesystem::is_regular_file(status)) refuse("is not a regular file");

  const std::string start = first_bytes(file);
  if (start.empty()) refuse("the file is empty");
  if (!options.format) return read_as(format_by(start, file), start, file, options);
  require_named(*options.format, start, file.string());
  try {
    return read_as(*options.format, start, file, options);
  } catch (const std::runtime_error& error) {
    const auto shown = shown_format(start);
    if (!shown || shown == options.format) throw;
    throw std::runtime_error(std::string(error.what()) + "; the file looks like " + look_of(start));
  }
}

}  // namespace

Recording read_recording(const std::filesystem::path& file, const ReadOptions& options) {
  check(options);
  const auto too_large = [&]() -> std::runtime_error {
    std::error_code unknown_size;
    const std::uintmax_t bytes = std::filesystem::file_size(file, unknown_size);
    return std::runtime_error(
        file.string() + ": " +
        (unknown_size ? "" : number(static_cast<double>(bytes) / 1e9) + " GB ") +
        "do not fit into memory; read a part with --from S --to S");
  };
  try {
    return read_by_format(file, options);
  } catch (const std::bad_alloc&) {
    throw too_large();
  } catch (const std::length_error&) {
    throw too_large();
  }
}

}  // namespace servotwin
