#include "drivers/recording_file.h"

#include <fcntl.h>

#include <cstring>
#include <new>
#include <stdexcept>
#include <string_view>

#include "drivers/can_log_form.h"
#include "drivers/can_recording.h"
#include "drivers/column_map.h"
#include "drivers/csv.h"
#include "drivers/csv_header.h"
#include "drivers/file_handle.h"
#include "drivers/foreign_format.h"
#include "drivers/mat.h"
#include "drivers/mcap/mcap.h"
#include "drivers/text.h"
#include "drivers/traces/sinumerik_capture.h"
#include "drivers/traces/sinumerik_trace.h"

namespace servotwin {
namespace {

std::string first_bytes(const std::filesystem::path& file) {
  std::string bytes(4096, '\0');
  bytes.resize(FileHandle::open(file, O_RDONLY).read(bytes.data(), bytes.size()));
  return bytes;
}

bool is_utf16(std::string_view start) {
  return start.starts_with("\xff\xfe") || start.starts_with("\xfe\xff");
}

/// The format by the first bytes; of a table or a text trace, which its first lines tell, kTable.
RecordingFormat format_by(std::string_view start, const std::filesystem::path& file) {
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(file.string() + ": " + why);
  };
  if (start.starts_with("MATLAB 5.0 MAT-file") || start.starts_with("MATLAB 7.3 MAT-file"))
    return RecordingFormat::kMatlab;
  if (const ForeignFormat* foreign = foreign_format(start))
    refuse(std::string("is a ") + foreign->name + ", which is not read; " + foreign->advice);
  if (file.extension() == ".mat")
    refuse("is named .mat, but is not a MATLAB file of version 5 or 7.3");
  if (can_log_form(start)) return RecordingFormat::kCandump;
  if (file.extension() == ".log" && !is_utf16(start) && !is_table(start)) {
    refuse(
        "is named .log, but its first line is not that of a CAN log, such as (12.345678) can0 "
        "181#00");
  }
  if (is_mcap(start)) return RecordingFormat::kMcap;
  if (is_sinumerik_trace(start)) return RecordingFormat::kSinumerikTrace;
  if (is_sinumerik_capture(start)) return RecordingFormat::kSinumerikCapture;
  return RecordingFormat::kTable;
}

Recording read_by_format(const std::filesystem::path& file, const ReadOptions& options) {
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(file.string() + ": " + why);
  };
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) refuse("there is no such file");
  if (std::filesystem::is_directory(status)) refuse("is a directory; give one recording in it");
  if (!std::filesystem::is_regular_file(status)) refuse("is not a regular file");

  const std::string start = first_bytes(file);
  if (start.empty()) refuse("the file is empty");
  const RecordingFormat format = options.format ? *options.format : format_by(start, file);
  using enum RecordingFormat;
  if (format == kMatlab) return read_mat(file, options);
  if (format == kCandump || format == kVectorAsc || format == kPeakTrc)
    return read_candump(file, options);
  if (!options.can_map.empty())
    throw std::invalid_argument(file.string() + ": --can-map is for CAN logs, and this is not one");
  if (format == kMcap) return read_mcap(file, options);
  if (format == kSinumerikTrace) return read_sinumerik_trace(file, options);
  if (format == kSinumerikCapture) return read_sinumerik_capture(file, options);
  if (!is_utf16(start) && start.find('\0') != std::string::npos)
    refuse("is a binary file, and a table is text");
  return read_csv(file, options);
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
