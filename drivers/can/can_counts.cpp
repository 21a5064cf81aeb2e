#include "drivers/can/can_counts.h"

#include "drivers/can/can_frame.h"

namespace servotwin {
namespace {

/// "2 times", "once".
std::string times(std::uint64_t count) {
  return count == 1 ? "once" : std::to_string(count) + " times";
}

void about_message(const MappedMessage& message, const CanMessageCounts& before,
                   const CanMessageCounts& now, std::vector<SourceNews>& lines) {
  std::string text;
  // A message that is back was missing meanwhile, which has been reported; other counts are news.
  const bool only_missing = now.late == before.late && now.repeated == before.repeated &&
                            now.wrong_length == before.wrong_length &&
                            now.silences == before.silences;
  const auto add = [&](std::uint64_t was, std::uint64_t is, const std::string& what) {
    if (is > was) text += (text.empty() ? "" : ", ") + times(is - was) + " " + what;
  };
  add(before.late, now.late, "after the deadline");
  add(before.missing, now.missing, "missing");
  add(before.repeated, now.repeated, "repeated in a cycle");
  add(before.wrong_length, now.wrong_length,
      "of a wrong length (it must have " + std::to_string(message.length) +
          (message.at_least ? " bytes or more)" : " bytes)"));
  if (now.silences > before.silences)
    text += (text.empty() ? "" : ", ") + std::string("fell silent");
  const bool back = !now.silent && (before.silent || now.silences > before.silences);
  if (back) text += (text.empty() ? "" : ", ") + std::string("is back");
  if (!text.empty()) lines.push_back({message.name + ": " + text, back && only_missing});
}

void about_bus(const std::string& name, const CanTrafficCounts& before, const CanTrafficCounts& now,
               std::vector<SourceNews>& lines) {
  const auto add = [&](std::uint64_t was, std::uint64_t is, const std::string& what,
                       bool good = false) {
    if (is > was) lines.push_back({name + ": " + what + ", " + times(is - was), good});
  };
  add(before.bus_off, now.bus_off,
      "bus-off: the interface no longer takes part in the bus (ip link set " + name +
          " type can restart-ms 100 restarts it automatically)");
  add(before.restarted, now.restarted, "the interface takes part again after bus-off", true);
  add(before.passive, now.passive, "error passive");
  add(before.lost_in_controller, now.lost_in_controller,
      "the controller's buffer overflowed: frames are lost");
  add(before.not_acknowledged, now.not_acknowledged,
      "no node acknowledges: the cable is open, or no other node is switched on");
  add(before.protocol, now.protocol, "damaged bits: check cable, termination and bit rate");
  const std::uint64_t named_before = before.bus_off + before.restarted + before.passive +
                                     before.lost_in_controller + before.not_acknowledged +
                                     before.protocol;
  const std::uint64_t named_now = now.bus_off + now.restarted + now.passive +
                                  now.lost_in_controller + now.not_acknowledged + now.protocol;
  if (named_now == named_before) add(before.error_frames, now.error_frames, "error frames");
}

}  // namespace

std::vector<SourceNews> happened(const CanMap& map, const CanCounts& before, const CanCounts& now) {
  std::vector<SourceNews> lines;
  for (std::size_t i = 0; i < map.buses.size(); ++i)
    about_bus(map.buses[i], before.buses[i], now.buses[i], lines);
  for (std::size_t i = 0; i < map.messages.size(); ++i)
    about_message(map.messages[i], before.messages[i], now.messages[i], lines);
  std::string ids;
  for (std::size_t i = before.unexpected.size(); i < now.unexpected.size(); ++i) {
    const CanId& id = now.unexpected[i];
    ids += (ids.empty() ? "" : ", ") + can_id_text(id.id, id.extended) +
           (map.buses.size() > 1 ? " on " + map.buses[id.bus] : "");
  }
  if (!ids.empty()) lines.push_back({"not in the mapping, and ignored: " + ids});
  return lines;
}

}  // namespace servotwin
