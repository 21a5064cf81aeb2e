#include "drivers/can/eds.h"

#include <fcntl.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <stdexcept>

#include "drivers/can/can_frame.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr int kMaxPdoBits = 8 * static_cast<int>(CanFrame::kMaxBytes);

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  return out;
}

std::string hex(unsigned value, int digits) {
  char text[16];
  std::snprintf(text, sizeof text, "%0*x", digits, value);
  return text;
}

struct Entry {
  std::string value;
  int line = 0;
};
using Keys = std::map<std::string, Entry, std::less<>>;

/// The file as sections of keys, all in lower case.
class Sheet {
 public:
  Sheet(std::string_view text, std::string name) : name_(std::move(name)) {
    Keys* section = nullptr;
    int line_number = 0;
    while (!text.empty()) {
      ++line_number;
      const std::size_t end = std::min(text.find('\n'), text.size());
      std::string_view line = text.substr(0, end);
      text.remove_prefix(std::min(end + 1, text.size()));
      line = trimmed(line);
      if (line_number == 1 && line.starts_with("\xef\xbb\xbf")) line.remove_prefix(3);
      if (line.empty() || line.front() == ';' || line.front() == '#') continue;
      if (line.front() == '[') {
        const std::size_t close = line.find(']');
        if (close == line.npos) fail(line_number, in_quotes(line) + " has no ]");
        const std::string title = lower(trimmed(line.substr(1, close - 1)));
        if (sections_.contains(title)) {
          notes_.push_back(name_ + ":" + std::to_string(line_number) + ": [" + title +
                           "] occurs twice; the keys of the second have precedence");
        }
        section = &sections_[title];
        continue;
      }
      const std::size_t equals = line.find('=');
      if (equals == line.npos) {
        notes_.push_back(name_ + ":" + std::to_string(line_number) + ": " + in_quotes(line) +
                         " is neither a section nor key=value; ignored");
        continue;
      }
      if (section == nullptr) fail(line_number, "key=value must come after a [section]");
      (*section)[lower(trimmed(line.substr(0, equals)))] = {
          std::string(trimmed(line.substr(equals + 1))), line_number};
    }
    if (sections_.empty()) fail(1, "there is no [section]; this is not an EDS or DCF");
  }

  [[nodiscard]] const Entry* find(const std::string& section, const std::string& key) const {
    const auto found = sections_.find(section);
    if (found == sections_.end()) return nullptr;
    const auto entry = found->second.find(key);
    return entry == found->second.end() || entry->second.value.empty() ? nullptr : &entry->second;
  }
  [[nodiscard]] bool has(const std::string& section) const { return sections_.contains(section); }
  [[nodiscard]] std::string text(const std::string& section, const std::string& key) const {
    const Entry* entry = find(section, key);
    return entry == nullptr ? "" : entry->value;
  }
  [[nodiscard]] std::vector<std::string>& notes() { return notes_; }
  [[nodiscard]] const std::map<std::string, Keys, std::less<>>& sections() const {
    return sections_;
  }

  [[noreturn]] void fail(int line, const std::string& what) const {
    throw std::runtime_error(name_ + ":" + std::to_string(line) + ": " + what);
  }
  [[noreturn]] void fail(const std::string& section, const std::string& key, const Entry& entry,
                         const std::string& rule) const {
    fail(entry.line, "[" + section + "] " + key + " = " + in_quotes(entry.value) + ": " + rule);
  }

 private:
  std::string name_;
  std::map<std::string, Keys, std::less<>> sections_;
  std::vector<std::string> notes_;
};

std::optional<std::uint64_t> plain_number(std::string_view text) {
  int base = 10;
  if (text.size() > 2 && text[0] == '0' && (text[1] == 'x' || text[1] == 'X')) {
    base = 16;
    text.remove_prefix(2);
  } else if (text.size() > 1 && text[0] == '0') {
    base = 8;
  }
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// A sum of numbers and at most one $NODEID.
std::optional<std::uint32_t> number_of(std::string_view text, int node_id) {
  std::uint64_t sum = 0;
  bool node = false;
  for (bool more = true; more;) {
    const std::size_t plus = text.find('+');
    const std::string_view term = trimmed(text.substr(0, plus));
    more = plus != text.npos;
    if (more) text.remove_prefix(plus + 1);
    if (lower(term) == "$nodeid") {
      if (node) return std::nullopt;
      node = true;
      sum += static_cast<std::uint64_t>(node_id);
    } else if (const auto value = plain_number(term); value && *value <= 0xffffffffU) {
      sum += *value;
    } else {
      return std::nullopt;
    }
    if (sum > 0xffffffffU) return std::nullopt;
  }
  return static_cast<std::uint32_t>(sum);
}

/// CiA 301, the static data types.
std::optional<ObjectType> type_of(std::uint32_t data_type) {
  constexpr auto kSigned = Coding::kSigned, kUnsigned = Coding::kUnsigned;
  switch (data_type) {
    case 0x01:
      return ObjectType{1, kUnsigned};
    case 0x02:
      return ObjectType{8, kSigned};
    case 0x03:
      return ObjectType{16, kSigned};
    case 0x04:
      return ObjectType{32, kSigned};
    case 0x05:
      return ObjectType{8, kUnsigned};
    case 0x06:
      return ObjectType{16, kUnsigned};
    case 0x07:
      return ObjectType{32, kUnsigned};
    case 0x08:
      return ObjectType{32, Coding::kFloat};
    case 0x10:
      return ObjectType{24, kSigned};
    case 0x11:
      return ObjectType{64, Coding::kFloat};
    case 0x12:
    case 0x13:
    case 0x14:
      return ObjectType{40 + 8 * static_cast<int>(data_type - 0x12), kSigned};
    case 0x15:
      return ObjectType{64, kSigned};
    case 0x16:
      return ObjectType{24, kUnsigned};
    case 0x18:
    case 0x19:
    case 0x1a:
    case 0x1b:
      return ObjectType{40 + 8 * static_cast<int>(data_type - 0x18), kUnsigned};
    default:
      return std::nullopt;
  }
}

std::optional<int> whole_hex(std::string_view digits) {
  int value = 0;
  const auto [end, error] =
      std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
  if (error != std::errc() || end != digits.data() + digits.size()) return std::nullopt;
  return value;
}

/// The objects of one device.
class Dictionary {
 public:
  Dictionary(Sheet& sheet, int node_id) : sheet_(sheet), node_id_(node_id) {}

  /// The configured value of an entry, else its default, if the file has one.
  [[nodiscard]] std::optional<std::uint32_t> value(unsigned index, unsigned sub) const {
    const std::string object = hex(index, 4);
    const std::string section = object + "sub" + hex(sub, 1);
    for (const char* key : {"parametervalue", "defaultvalue"}) {
      if (const Entry* entry = sheet_.find(section, key)) return read(section, key, *entry);
    }
    // Compact storage: one list of values, and a default for those that are not in it.
    const std::string list = object + "value";
    const std::string number = std::to_string(sub);
    if (const Entry* entry = sheet_.find(list, number)) return read(list, number, *entry);
    const Entry* compact = sheet_.find(object, "compactsubobj");
    if (compact == nullptr || sub == 0) {
      if (compact == nullptr || sub > 0) return std::nullopt;
      return read(object, "compactsubobj", *compact);
    }
    const Entry* all = sheet_.find(object, "defaultvalue");
    return all == nullptr ? std::nullopt : std::optional(read(object, "defaultvalue", *all));
  }

  /// The section that gives the type of an object: a variable, or an entry of a record.
  [[nodiscard]] std::string described_in(unsigned index, unsigned sub) const {
    std::string entry = hex(index, 4) + "sub" + hex(sub, 1);
    if (sheet_.has(entry)) return entry;
    return sub == 0 ? hex(index, 4) : std::string();
  }

  [[nodiscard]] std::optional<Coding> coding(unsigned index, unsigned sub, int bits) const {
    const std::string section = described_in(index, sub);
    const Entry* entry = sheet_.find(section, "datatype");
    if (entry == nullptr) return std::nullopt;
    const auto type = type_of(read(section, "datatype", *entry));
    if (!type || (type->coding == Coding::kFloat && type->bits != bits)) return std::nullopt;
    return type->coding;
  }

  /// Every object that is a number.
  [[nodiscard]] std::map<std::pair<int, int>, ObjectType> objects() const {
    std::map<std::pair<int, int>, ObjectType> out;
    for (const auto& [section, keys] : sheet_.sections()) {
      const std::size_t sub = section.find("sub");
      const auto index = whole_hex(section.substr(0, std::min<std::size_t>(sub, 4)));
      const auto part = sub == section.npos ? std::optional(0) : whole_hex(section.substr(sub + 3));
      const auto entry = keys.find("datatype");
      if ((sub != section.npos ? sub : section.size()) != 4 || !index || !part ||
          entry == keys.end()) {
        continue;
      }
      const auto number = number_of(entry->second.value, 0);
      if (const auto type = number ? type_of(*number) : std::nullopt)
        out.try_emplace({*index, *part}, *type);
    }
    return out;
  }

  [[nodiscard]] bool has(unsigned index) const {
    return sheet_.has(hex(index, 4)) || sheet_.has(hex(index, 4) + "sub1");
  }
  [[nodiscard]] Sheet& sheet() const { return sheet_; }

 private:
  [[nodiscard]] std::uint32_t read(const std::string& section, const std::string& key,
                                   const Entry& entry) const {
    if (const auto number = number_of(entry.value, node_id_)) return *number;
    sheet_.fail(section, key, entry,
                "must be a number of 32 bits, 0x1A or 26, or $NODEID + such a number");
  }

  Sheet& sheet_;
  int node_id_;
};

/// The objects that are mapped into one PDO.
std::vector<PdoObject> mapped(const Dictionary& dictionary, unsigned index, const Pdo& pdo) {
  std::vector<PdoObject> objects;
  const std::uint32_t count = dictionary.value(index, 0).value_or(0);
  std::vector<std::string>& notes = dictionary.sheet().notes();
  const std::string which = (pdo.transmit ? "TPDO" : "RPDO") + std::to_string(pdo.number);
  if (count > 64) {
    notes.push_back(which + ": [" + hex(index, 4) + "sub0] = " + std::to_string(count) +
                    ": a multiplexed PDO is not read");
    return objects;
  }
  int start = 0;
  for (unsigned i = 1; i <= count; ++i) {
    const std::uint32_t entry = dictionary.value(index, i).value_or(0);
    PdoObject object;
    object.index = static_cast<std::uint16_t>(entry >> 16);
    object.sub = static_cast<std::uint8_t>(entry >> 8);
    object.bits = static_cast<int>(entry & 0xffU);
    object.start = start;
    const std::string where = which + ": [" + hex(index, 4) + "sub" + hex(i, 1) + "]: ";
    if (object.bits == 0 || object.bits > 64 || start + object.bits > kMaxPdoBits) {
      // The position of the following objects would be unknown.
      notes.push_back(where + object_text(object.index, object.sub) + " with " +
                      std::to_string(object.bits) +
                      " bits does not fit; this PDO is not read further");
      break;
    }
    if (object.index >= 0x20) {
      object.coding = dictionary.coding(object.index, object.sub, object.bits);
      const std::string section = dictionary.described_in(object.index, object.sub);
      object.name = dictionary.sheet().text(section, "parametername");
    }
    start += object.bits;
    objects.push_back(std::move(object));
  }
  return objects;
}

void read_pdos(const Dictionary& dictionary, bool transmit, std::vector<Pdo>& pdos) {
  const unsigned communication = transmit ? 0x1800 : 0x1400;
  const unsigned mapping = transmit ? 0x1a00 : 0x1600;
  for (unsigned i = 0; i < 512; ++i) {
    if (!dictionary.has(mapping + i)) continue;
    Pdo pdo;
    pdo.transmit = transmit;
    pdo.number = static_cast<int>(i) + 1;
    const std::uint32_t id = dictionary.value(communication + i, 1).value_or(1U << 31);
    pdo.valid = (id & 1U << 31) == 0;
    pdo.extended = (id & 1U << 29) != 0;
    pdo.id = id & (pdo.extended ? kExtendedIds - 1 : kStandardIds - 1);
    if (const auto type = dictionary.value(communication + i, 2))
      pdo.transmission = static_cast<int>(*type & 0xffU);
    pdo.objects = mapped(dictionary, mapping + i, pdo);
    pdos.push_back(std::move(pdo));
  }
}

}  // namespace

int Pdo::bytes() const noexcept {
  return objects.empty() ? 0 : (objects.back().start + objects.back().bits + 7) / 8;
}

std::string object_text(int index, int sub) {
  char text[24];
  std::snprintf(text, sizeof text, sub == 0 ? "0x%04X" : "0x%04X:%02X",
                static_cast<unsigned>(index), static_cast<unsigned>(sub));
  return text;
}

std::string text_of(const Pdo& pdo) {
  std::string text = (pdo.transmit ? "TPDO" : "RPDO") + std::to_string(pdo.number);
  text += pdo.valid ? " (" + can_id_text(pdo.id, pdo.extended) + ")" : " (switched off)";
  std::string objects;
  for (const PdoObject& object : pdo.objects) {
    objects += (objects.empty() ? "" : ", ") + object_text(object.index, object.sub) + " " +
               std::to_string(object.bits) + " bits";
  }
  return text + ": " + (objects.empty() ? "nothing" : objects);
}

EdsDevice parse_eds(std::string_view text, const std::string& name, int node_id) {
  Sheet sheet(text, name);
  EdsDevice device;
  device.node_id = node_id;
  if (node_id == 0) {
    // CiA 306 spells the name of this section with one m.
    const Entry* entry = nullptr;
    for (const char* section : {"devicecomissioning", "devicecommissioning"}) {
      if (entry == nullptr) entry = sheet.find(section, "nodeid");
    }
    if (entry == nullptr) {
      throw std::runtime_error(name +
                               ": has no node id; give it as id of the [[node]] in the mapping");
    }
    const auto number = number_of(entry->value, 0);
    if (!number || *number < 1 || *number > 127)
      sheet.fail("DeviceComissioning", "NodeID", *entry, "must be 1 to 127");
    device.node_id = static_cast<int>(*number);
  }
  device.product = sheet.text("deviceinfo", "productname");
  const Dictionary dictionary(sheet, device.node_id);
  read_pdos(dictionary, true, device.pdos);
  read_pdos(dictionary, false, device.pdos);
  device.objects = dictionary.objects();
  device.notes = sheet.notes();
  return device;
}

EdsDevice read_eds(const std::filesystem::path& file, int node_id) {
  return parse_eds(read_text(file), file.string(), node_id);
}

}  // namespace servotwin
