// The lines of CAN logs of other programs than candump -l, one frame each.
//
//   candump on a terminal   (1607120998.528112)  can0  181   [8]  00 00 00 00 00 00 00 00
//       with -ta, -tz or -td (time since the frame before), -x (direction) and -tA (date and time)
//   Vector ASC              0.000100 1  181  Rx  d 8 00 00 00 00 00 00 00 00
//       ids and bytes to the base of the header; CANFD and ErrorFrame lines; the interface is the
//       number of the channel
//   PEAK TRC                2        0.100 DT      181 Rx 8 00 00 00 00 00 00 00 00
//       versions 1.0 to 1.3 and 2.0, 2.1; the interface is the number of the bus, 1 without one
//
// Other lines (headers, comments, statistics of the bus, events) are passed over. Sources:
// can-utils, candump.c and lib.c; python-can, io/asc.py and io/trc.py; PEAK, "PEAK CAN TRC file
// format" 2.1. Units: times in ns since the start that the log names, else since its first frame.
// Any thread.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/recordings/can_log/candump.h"

namespace servotwin {

enum class CanLogForm : std::uint8_t { kCandump, kTerminal, kVectorAsc, kPeakTrc };

/// What a file with this beginning is; nothing if no CAN log.
[[nodiscard]] std::optional<CanLogForm> can_log_form(std::string_view beginning);

/// Parses the lines of one log, in their order.
class CanLogLines {
 public:
  /// From the beginning of the file, which tells the form, if it is not `named`, and whether its
  /// times are differences. kCandump names either form of candump.
  explicit CanLogLines(std::string_view beginning, std::optional<CanLogForm> named = {});

  /// Empty if the line holds no frame. Throws std::runtime_error with value and rule.
  [[nodiscard]] std::optional<CandumpLine> parse(std::string_view line);

 private:
  std::optional<CandumpLine> parse_terminal(std::string_view line);
  std::optional<CandumpLine> parse_asc(std::string_view line);
  std::optional<CandumpLine> parse_trc(std::string_view line);
  void take_trc_header(std::string_view line);
  std::int64_t since_start(std::int64_t time_ns);

  CanLogForm form_ = CanLogForm::kCandump;
  bool differences_ = false;   // times are those since the frame before
  int base_ = 16;              // ASC: of ids and bytes
  std::int64_t sum_ns_ = 0;    // of the differences
  std::int64_t start_ns_ = 0;  // TRC
  std::string trc_columns_;    // TRC: one letter each, as in $COLUMNS
};

}  // namespace servotwin
