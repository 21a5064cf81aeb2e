// Messages and signals of a CAN bus from a .dbc file.
//
//   BO_ 385 Drive1_Status: 8 Drive1
//    SG_ PositionActual : 0|32@1- (0.001,0) [0|0] "mm" Controller
//   SIG_VALTYPE_ 385 PositionActual : 1;
// BO_, SG_, SIG_VALTYPE_ and SG_MUL_VAL_ are read; everything else is skipped, including comments
// of several lines. @1 is little endian, @0 big endian (drivers/can/can_signal.h numbers bits as
// DBC does),
// + unsigned, - signed. Any thread. Errors: std::runtime_error with file, line, value and rule.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_signal.h"

namespace servotwin {

enum class Multiplexing : std::uint8_t {
  kNone,
  kSelector,  ///< its value selects which other signals are in the frame
  kSelected,  ///< in the frame if the selector has the value `selected_by`
  kExtended,  ///< in several layers or ranges; not supported
};

struct DbcSignal {
  std::string name;
  CanSignal signal;
  std::string unit;
  Multiplexing multiplexing = Multiplexing::kNone;
  std::uint64_t selected_by = 0;
  int line = 0;
};

struct DbcMessage {
  std::string name;
  std::uint32_t id = 0;
  bool extended = false;
  int length = 0;  ///< bytes, 0..64
  std::vector<DbcSignal> signals;
};

struct Dbc {
  std::vector<DbcMessage> messages;
};

/// `name` is used in error messages.
[[nodiscard]] Dbc parse_dbc(std::string_view text, const std::string& name);
[[nodiscard]] Dbc read_dbc(const std::filesystem::path& file);

}  // namespace servotwin
