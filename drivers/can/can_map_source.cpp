#include "drivers/can/can_map_source.h"

#include <algorithm>
#include <stdexcept>

#include "drivers/can/can_frame.h"
#include "drivers/common/text.h"

namespace servotwin {
namespace {

/// The types of objects that the file maps but does not describe, according to CiA 402.
Coding usual_coding(int object) {
  return object == 0x6040 || object == 0x6041 ? Coding::kUnsigned : Coding::kSigned;
}

void read_by_hand(Section& section, SignalKeys& keys) {
  int id = 0;
  bool extended = false, is_signed = true, is_float = false;
  std::string order = "little";
  for (const char* key : {"id", "start_bit", "length"}) {
    if (section.has(key)) continue;
    section.report_missing(
        key,
        "is missing; a signal is written by hand with id, start_bit and length, or named by "
        "message and signal of the .dbc, or by object of a node");
    keys.failed = true;
  }
  section.integer("id", 0, static_cast<int>(kExtendedIds - 1), id);
  section.flag("extended", extended);
  section.integer("start_bit", 0, 511, keys.signal.start);
  section.integer("length", 1, 64, keys.signal.length);
  section.one_of("byte_order", {"little", "big"}, order);
  section.flag("signed", is_signed);
  section.flag("float", is_float);
  section.number("scale", -1e18, 1e18, "", keys.signal.scale);
  section.number("offset", -1e18, 1e18, "", keys.signal.offset);
  int bytes = 0;
  section.integer("message_bytes", 1, 64, bytes);
  if (keys.failed) return;

  keys.signal.order = order == "little" ? ByteOrder::kLittle : ByteOrder::kBig;
  keys.signal.coding =
      is_float ? Coding::kFloat : (is_signed ? Coding::kSigned : Coding::kUnsigned);
  const int needed = bytes_needed(keys.signal);
  if (needed == 0) {
    section.report("length", is_float && keys.signal.length != 32 && keys.signal.length != 64
                                 ? "a float has 32 or 64 bits"
                                 : "from this start_bit the signal reaches beyond 64 bytes");
    keys.failed = true;
  } else if (bytes != 0 && needed > bytes) {
    section.report("message_bytes", "the signal reaches into byte " + std::to_string(needed));
    keys.failed = true;
  }
  if (keys.signal.scale == 0.0) {
    section.report("scale", "must not be 0");
    keys.failed = true;
  }
  keys.message.bus = keys.bus;
  keys.message.id = static_cast<std::uint32_t>(id);
  keys.message.extended = extended || keys.message.id >= kStandardIds;
  keys.message.length = bytes != 0 ? bytes : needed;
  keys.message.at_least = bytes == 0;
  keys.message.name = can_id_text(keys.message.id, keys.message.extended);
}

}  // namespace

SignalKeys read_signal_keys(Section& section, const SignalDefaults& defaults, int default_object) {
  SignalKeys keys;
  keys.bus = defaults.bus;
  keys.node = defaults.node;
  keys.object = default_object;
  section.text("unit", 1, 40, keys.unit);
  section.number("rollover", 1.0, 1e18, "steps", keys.rollover);
  if (section.has("message") || section.has("signal")) {
    keys.kind = SignalKeys::Kind::kDbc;
    section.text("message", 1, 255, keys.dbc_message);
    section.text("signal", 1, 255, keys.dbc_signal);
    keys.failed = keys.dbc_message.empty() || keys.dbc_signal.empty();
    for (const char* key : {"message", "signal"}) {
      if (!section.has(key))
        section.report_missing(key, "is missing; a .dbc names a signal by message and signal");
    }
  } else if (section.has("object") || section.has("node") ||
             (defaults.node != 0 && !section.has("id"))) {
    keys.kind = SignalKeys::Kind::kObject;
    section.integer("node", 1, 127, keys.node);
    section.integer("object", 0x1000, 0xFFFF, keys.object);
    section.integer("sub", 0, 255, keys.sub);
    if (keys.node == 0) {
      section.report("object", "of which node? give node, here or for the axis");
      keys.failed = true;
    }
  } else {
    read_by_hand(section, keys);
  }
  return keys;
}

void SignalSources::add_dbc(std::size_t bus, const std::string& file) {
  dbcs_[bus] = {file, read_dbc(folder_ / file)};
}

int SignalSources::add_node(std::size_t bus, int id, const std::string& file) {
  EdsDevice device = read_eds(folder_ / file, id);
  notes_.insert(notes_.end(), device.notes.begin(), device.notes.end());
  const std::pair key{bus, device.node_id};
  if (nodes_.contains(key)) {
    throw std::runtime_error("there is a node " + std::to_string(device.node_id) +
                             " on this bus already");
  }
  nodes_[key] = {file, std::move(device)};
  return key.second;
}

void SignalSources::map_pdo(std::size_t bus, int id, bool transmit, int number,
                            const std::optional<std::uint32_t>& can_id,
                            const std::vector<std::pair<int, int>>& objects) {
  Node& node = nodes_.at({bus, id});
  std::vector<Pdo>& pdos = node.device.pdos;
  auto pdo = std::find_if(pdos.begin(), pdos.end(), [&](const Pdo& one) {
    return one.transmit == transmit && one.number == number;
  });
  const std::string which = (transmit ? "TPDO" : "RPDO") + std::to_string(number);
  if (pdo == pdos.end()) {
    if (!can_id) {
      throw std::runtime_error(node.file + " has no " + which +
                               "; give its id, or one of the PDOs of the file" + pdos_of(bus, id));
    }
    pdo = pdos.insert(pdos.end(), Pdo{});
    pdo->transmit = transmit;
    pdo->number = number;
  }
  if (can_id) {
    pdo->id = *can_id;
    pdo->extended = *can_id >= kStandardIds;
  }
  pdo->valid = true;
  pdo->objects.clear();
  int start = 0;
  for (const auto& [index, sub] : objects) {
    const auto type = node.device.objects.find({index, sub});
    if (type == node.device.objects.end()) {
      throw std::runtime_error(node.file + " does not describe object " + object_text(index, sub) +
                               " as a number");
    }
    PdoObject object;
    object.index = static_cast<std::uint16_t>(index);
    object.sub = static_cast<std::uint8_t>(sub);
    object.start = start;
    object.bits = type->second.bits;
    object.coding = type->second.coding;
    start += object.bits;
    pdo->objects.push_back(std::move(object));
  }
  if (pdo->bytes() > static_cast<int>(CanFrame::kMaxBytes)) {
    throw std::runtime_error(which + " would have " + std::to_string(pdo->bytes()) +
                             " bytes; a frame has at most 64");
  }
}

std::string SignalSources::pdos_of(std::size_t bus, int id) const {
  const auto node = nodes_.find({bus, id});
  if (node == nodes_.end()) return "";
  std::string text;
  for (const Pdo& pdo : node->second.device.pdos) {
    if (!pdo.objects.empty()) text += (text.empty() ? "" : "; ") + text_of(pdo);
  }
  return "; " + node->second.file + " maps " + (text.empty() ? "nothing" : text);
}

std::optional<SourceSignal> SignalSources::find_object(std::size_t bus, int id, int object, int sub,
                                                       bool to_drive) const {
  const auto node = nodes_.find({bus, id});
  if (node == nodes_.end()) return std::nullopt;
  // An object that the drive sends is preferred to one that it receives.
  for (const bool transmit : {true, false}) {
    if (transmit && to_drive) continue;
    for (const Pdo& pdo : node->second.device.pdos) {
      if (!pdo.valid || pdo.transmit != transmit) continue;
      for (const PdoObject& mapped : pdo.objects) {
        if (mapped.index != object || mapped.sub != sub) continue;
        SourceSignal found;
        found.object = object;
        found.origin = "object " + object_text(object, sub) + " of node " + std::to_string(id);
        found.signal.start = mapped.start;
        found.signal.length = mapped.bits;
        found.signal.coding = mapped.coding.value_or(usual_coding(object));
        found.message.bus = bus;
        found.message.id = pdo.id;
        found.message.extended = pdo.extended;
        found.message.length = pdo.bytes();
        found.message.rpdo = transmit ? 0 : pdo.number;
        found.message.name = can_id_text(pdo.id, pdo.extended) + ", " +
                             (transmit ? "TPDO" : "RPDO") + std::to_string(pdo.number) +
                             " of node " + std::to_string(id) + ",";
        return found;
      }
    }
  }
  return std::nullopt;
}

SourceSignal SignalSources::from_node(const SignalKeys& keys, bool to_drive) const {
  if (!has_node(keys.bus, keys.node)) {
    throw std::runtime_error("there is no [[node]] " + std::to_string(keys.node) + " on this bus");
  }
  if (auto found = find_object(keys.bus, keys.node, keys.object, keys.sub, to_drive)) return *found;
  throw std::runtime_error("no " + std::string(to_drive ? "RPDO" : "PDO") + " of node " +
                           std::to_string(keys.node) + " that is switched on carries object " +
                           object_text(keys.object, keys.sub) + pdos_of(keys.bus, keys.node) +
                           "; map the object in the drive and export the .dcf, or write the bits "
                           "by hand");
}

SourceSignal SignalSources::from_dbc(const SignalKeys& keys) const {
  const auto dbc = dbcs_.find(keys.bus);
  if (dbc == dbcs_.end()) throw std::runtime_error("this bus has no dbc = \"FILE\"");
  const auto& [file, contents] = dbc->second;
  std::vector<std::string> names;
  const DbcMessage* message = nullptr;
  for (const DbcMessage& one : contents.messages) {
    names.push_back(one.name);
    if (one.name == keys.dbc_message) message = &one;
  }
  if (message == nullptr) {
    throw std::runtime_error(file + " has no message " + in_quotes(keys.dbc_message) +
                             did_you_mean(keys.dbc_message, names));
  }
  names.clear();
  const DbcSignal* signal = nullptr;
  const DbcSignal* selector = nullptr;
  for (const DbcSignal& one : message->signals) {
    names.push_back(one.name);
    if (one.name == keys.dbc_signal) signal = &one;
    if (one.multiplexing == Multiplexing::kSelector) selector = &one;
  }
  if (signal == nullptr) {
    throw std::runtime_error(file + ": message " + in_quotes(keys.dbc_message) + " has no signal " +
                             in_quotes(keys.dbc_signal) + did_you_mean(keys.dbc_signal, names));
  }
  const std::string where =
      file + ":" + std::to_string(signal->line) + ": " + in_quotes(signal->name) + " ";
  if (signal->multiplexing == Multiplexing::kExtended)
    throw std::runtime_error(where + "is multiplexed in layers or ranges, which is not read");
  if (bytes_needed(signal->signal) > message->length) {
    throw std::runtime_error(where + "reaches beyond the " + std::to_string(message->length) +
                             " bytes of its message");
  }
  SourceSignal found;
  found.signal = signal->signal;
  found.unit = signal->unit == "\xb0" || signal->unit == "\u00b0" ? "deg" : signal->unit;
  found.origin = "signal " + signal->name + " of " + message->name;
  found.message.bus = keys.bus;
  found.message.id = message->id;
  found.message.extended = message->extended;
  found.message.length = message->length;
  found.message.name = can_id_text(message->id, message->extended) + ", " + message->name;
  if (signal->multiplexing == Multiplexing::kSelected) {
    if (selector == nullptr) throw std::runtime_error(where + "is multiplexed, but by no signal");
    if (bytes_needed(selector->signal) > message->length)
      throw std::runtime_error(where + "is multiplexed by a signal beyond its message");
    found.message.selector = {selector->signal, signal->selected_by};
  }
  return found;
}

SourceSignal SignalSources::resolve(const SignalKeys& keys, bool to_drive) const {
  switch (keys.kind) {
    case SignalKeys::Kind::kDbc:
      return from_dbc(keys);
    case SignalKeys::Kind::kObject:
      return from_node(keys, to_drive);
    case SignalKeys::Kind::kHand:
      break;
  }
  return {keys.signal, keys.message, "", 0,
          std::to_string(keys.signal.length) + " bits from bit " +
              std::to_string(keys.signal.start) + " of " + keys.message.name};
}

}  // namespace servotwin
