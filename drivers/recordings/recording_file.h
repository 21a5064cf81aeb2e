// Recordings from files: CSV with units in its header, foreign tables, traces of controllers
// (drivers/recordings), MATLAB v5 and v7.3, CAN logs.
//
//   time[s],X.command[mm],X.actual[mm],X.torque[Nm],Y.command[mm],Y.actual[mm]
// Values are returned in SI units and rows in the order of the file; the notes say what was ignored
// or missing. Gaps, repeats and jitter are left unchanged (identification/recording/segments.h
// handles them). A position channel that the file does not have is NaN in every row; an empty, NaN
// or infinite cell is NaN. Errors: std::runtime_error for the file, std::invalid_argument for the
// options; one line with file, line, column and value. Any thread.
#pragma once

#include <filesystem>
#include <limits>
#include <optional>
#include <string>

#include "drivers/recordings/recording_format.h"
#include "twin/sample.h"

namespace servotwin {

struct ReadOptions {
  /// Which column of a foreign file is which channel, and its unit:
  /// "X.command=qg[m],X.actual=qm[m],X.torque=vir[V],time=t[s]". Empty: the names in the header are
  /// used.
  std::string columns;
  /// Rows per second [Hz] of a file without a time column.
  std::optional<double> rate_hz;
  /// The mapping of a CAN log (drivers/can/can_map.h).
  std::filesystem::path can_map;
  /// What the file is, whatever it looks like. Absent: its first bytes tell.
  std::optional<RecordingFormat> format;
  /// The part to read, in seconds after the first stamp of the file, both ends included.
  double from_s = 0.0;
  double to_s = std::numeric_limits<double>::infinity();
};

/// Reads a recording; the kind of file is determined by options.format, else by its
/// first bytes.
[[nodiscard]] Recording read_recording(const std::filesystem::path& file,
                                       const ReadOptions& options = {});

}  // namespace servotwin
