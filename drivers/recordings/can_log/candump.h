// CAN logs as text, in the format of `candump -l`, `candump -L`, python-can and canplayer.
//
//   (1436509052.249713) can0 181#E803000012000000     data, 11 bits of id; 8 digits: 29 bits
//   (1436509052.249713) can0 181#R4                   remote request for four bytes
//   (1436509052.249713) can0 181##1E8030000           FD: one digit of flags before the data
//   (1436509052.249713) can0 20000040#0000000000000000   an error frame of the interface
// A direction at the end of a line (R, T) is ignored. Source: can-utils, lib.c. Any thread.
#pragma once

#include <string>
#include <string_view>

#include "drivers/can/can_frame.h"

namespace servotwin {

struct CandumpLine {
  CanFrame frame;
  std::string interface;
};

/// Why this is no name of an interface (1 to 32 printable characters without blanks); empty if it
/// is.
[[nodiscard]] std::string why_no_interface(std::string_view name);

/// Parses one line without its line end. Throws std::runtime_error with column, value and rule.
[[nodiscard]] CandumpLine parse_candump_line(std::string_view line);

/// The line of a frame, without a line end.
[[nodiscard]] std::string candump_line(const CanFrame& frame, std::string_view interface);

/// Whether a file with this beginning is such a log.
[[nodiscard]] bool is_candump(std::string_view beginning);

}  // namespace servotwin
