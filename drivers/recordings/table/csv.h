// Recordings as text: read in one pass through a small block, written so that they read back bit
// for bit.
//
// Lines that begin with # are comments; then the header (drivers/recordings/table/csv_header.h),
// then one row per line. Foreign files may be separated by ; tabs or blanks, be UTF-16, have CRLF
// line ends, quoted names and a separator at the end of every line. Numbers have a decimal point
// or, where no comma separates the columns, a decimal comma; the other mark may divide thousands. A
// time may be a date or a time of day (drivers/common/time_stamp.h). N/A and the like are missing
// values. A last line without a line end is reported in the notes; it is dropped if fields are
// missing or its last number is shorter than the one above it. Memory: eight bytes per row and
// column that is read; the text itself is never held. Errors: as
// drivers/recordings/recording_file.h. Any thread.
#pragma once

#include <filesystem>
#include <string_view>

#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

class AtomicFile;

[[nodiscard]] Recording read_csv(const std::filesystem::path& file, const ReadOptions& options);

/// The last line of a recording that this program wrote is this comment with the CRC-32 of all
/// bytes before it (drivers/common/checksum.h). read_csv() refuses a file that does not match it; a
/// file without it is read as it is.
inline constexpr std::string_view kChecksumComment = "# crc32 ";

/// Writes in SI units with all digits, and kChecksumComment. The file is written completely or not
/// at all: under a temporary name, flushed to the disk, then renamed. Channels that are NaN in
/// every row are left out. Throws std::runtime_error if the disk refuses, std::invalid_argument if
/// the recording is not consistent.
void write_recording_csv(const std::filesystem::path& file, const Recording& recording);
/// The same, into a file that the caller commits.
void write_recording_csv(const AtomicFile& out, const Recording& recording);

}  // namespace servotwin
