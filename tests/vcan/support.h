// What the tests on virtual CAN share: frames, the interfaces, a mapping of a few axes.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/can/can_map.h"
#include "drivers/can/socketcan.h"
#include "twin/model.h"

namespace servotwin::test {

inline CanFrame frame_of(std::uint32_t id, std::initializer_list<std::uint8_t> data) {
  CanFrame frame;
  frame.id = id;
  frame.extended = id >= kStandardIds;
  frame.length = static_cast<std::uint8_t>(data.size());
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

/// Runs a command of iproute2; throws if it fails.
inline void ip(const std::string& arguments) {
  if (std::system(("ip " + arguments).c_str()) != 0)
    throw std::runtime_error("ip " + arguments + " failed");
}

/// All that comes until nothing more does.
inline std::vector<CanFrame> received(CanBus& bus, double timeout_s = 0.2) {
  std::vector<CanFrame> all;
  std::array<CanFrame, 64> batch;
  while (const std::size_t count = bus.receive(batch, timeout_s))
    all.insert(all.end(), batch.begin(), batch.begin() + static_cast<std::ptrdiff_t>(count));
  return all;
}

/// `axes` CiA 402 nodes: demand and actual value in one PDO of 8 bytes, torque and status word in a
/// second one, target and offset in RPDOs; steps of 10 nm.
inline CanMap drives(int axes, double cycle_s = 0.001) {
  std::string text = "cycle_s = " + std::to_string(cycle_s) + "\n[[bus]]\nname = \"vcan0\"\n";
  const auto signal = [&](const char* name, int id, int start, int length, const char* unit) {
    text += std::string("[axis.") + name + "]\nid = " + std::to_string(id) +
            "\nstart_bit = " + std::to_string(start) + "\nlength = " + std::to_string(length) +
            (*unit == '\0' ? "" : std::string("\nunit = \"") + unit + "\"") + "\n";
  };
  for (int node = 1; node <= axes; ++node) {
    text += "[[axis]]\nname = \"A" + std::to_string(node) + "\"\n";
    signal("command", 0x180 + node, 0, 32, "nm*10");
    signal("actual", 0x180 + node, 32, 32, "nm*10");
    signal("torque", 0x280 + node, 0, 16, "%*0.1");
    signal("status_word", 0x280 + node, 16, 16, "");
    signal("target", 0x300 + node, 0, 32, "nm*10");
    signal("offset", 0x400 + node, 0, 32, "nm*10");
  }
  CheckedCanMap checked = check_can_map(text, "drives.toml", "");
  if (!checked.problems.empty()) throw std::runtime_error(messages(checked.problems));
  return std::move(checked.map);
}

}  // namespace servotwin::test
