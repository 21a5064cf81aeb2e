// The process data objects that a CANopen drive sends and receives, from its electronic data sheet
// (.eds) or its configuration (.dcf).
//
//   [1800sub1] DefaultValue=$NODEID+0x180     which id; bit 31: not used, bit 29: 29 bits
//   [1A00sub1] DefaultValue=0x60640020        object 0x6064:00, 32 bits
// A ParameterValue, in a DCF, has precedence over the DefaultValue. Numbers are decimal, 0x
// hexadecimal or octal with a leading 0; $NODEID stands before or after its number. Source: CiA
// 306-1, CiA 301. Any thread. Errors: std::runtime_error with file, line, section, key, value and
// rule.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/can/can_signal.h"

namespace servotwin {

struct PdoObject {
  std::uint16_t index = 0;  ///< below 0x20: unused bits
  std::uint8_t sub = 0;
  int start = 0;                 ///< first bit in the PDO
  int bits = 0;                  ///< 1..64
  std::optional<Coding> coding;  ///< absent: the object is not described, or not a number
  std::string name;              ///< of the object in the file
};

struct Pdo {
  bool transmit = true;  ///< the drive sends it
  int number = 1;        ///< 1..512
  std::uint32_t id = 0;
  bool extended = false;
  bool valid = false;               ///< it is switched on
  std::optional<int> transmission;  ///< 0..240: with SYNC; 254, 255: at any time
  std::vector<PdoObject> objects;

  [[nodiscard]] int bytes() const noexcept;
};

/// The type of a numeric object of the dictionary.
struct ObjectType {
  int bits = 0;
  Coding coding = Coding::kUnsigned;
};

struct EdsDevice {
  std::string product;
  int node_id = 0;
  std::map<std::pair<int, int>, ObjectType> objects;  ///< by index and sub-index
  std::vector<Pdo> pdos;                              ///< TPDO1.., then RPDO1..
  std::vector<std::string> notes;
};

/// `node_id`: 1..127; 0: the one in the DCF, which must then have one. `name` is used in error
/// messages.
[[nodiscard]] EdsDevice parse_eds(std::string_view text, const std::string& name, int node_id);
[[nodiscard]] EdsDevice read_eds(const std::filesystem::path& file, int node_id);

/// "TPDO1 (0x181): 0x6041:00 16 bits, 0x6064:00 32 bits", for messages.
[[nodiscard]] std::string text_of(const Pdo& pdo);
/// "0x6064", with ":01" where there is a sub-index.
[[nodiscard]] std::string object_text(int index, int sub);

}  // namespace servotwin
