#include "drivers/recordings/mcap/ros_message.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <map>
#include <stdexcept>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

struct RosPrimitive {
  std::string_view name;
  RosField::Kind kind;
  std::uint32_t bytes;
};
constexpr std::array kRosPrimitives{
    RosPrimitive{"bool", RosField::Kind::kUnsigned, 1},
    RosPrimitive{"byte", RosField::Kind::kUnsigned, 1},
    RosPrimitive{"char", RosField::Kind::kUnsigned, 1},
    RosPrimitive{"int8", RosField::Kind::kSigned, 1},
    RosPrimitive{"uint8", RosField::Kind::kUnsigned, 1},
    RosPrimitive{"int16", RosField::Kind::kSigned, 2},
    RosPrimitive{"uint16", RosField::Kind::kUnsigned, 2},
    RosPrimitive{"int32", RosField::Kind::kSigned, 4},
    RosPrimitive{"uint32", RosField::Kind::kUnsigned, 4},
    RosPrimitive{"int64", RosField::Kind::kSigned, 8},
    RosPrimitive{"uint64", RosField::Kind::kUnsigned, 8},
    RosPrimitive{"float32", RosField::Kind::kFloat, 4},
    RosPrimitive{"float64", RosField::Kind::kFloat, 8},
    RosPrimitive{"string", RosField::Kind::kText, 1},
};

// A definition that contains itself has no end. The largest of the common ones have 100 fields.
constexpr int kMostNested = 32;
constexpr int kMostFields = 10'000;

struct RosLine {
  std::string type, name;
};
using RosSections = std::map<std::string, std::vector<RosLine>, std::less<>>;

/// "pkg/msg/Type" and "pkg/Type" are the same.
std::string short_type(std::string_view type) {
  std::string name(type);
  if (const std::size_t middle = name.find("/msg/"); middle != std::string::npos)
    name.erase(middle, std::string_view("/msg").size());
  return name;
}

/// The field in a line; without a name if there is none.
RosLine field_in(std::string_view line) {
  line = trimmed(line.substr(0, line.find('#')));
  const std::size_t end = line.find_first_of(kBlanks);
  if (line.empty()) return {};
  const std::string_view rest =
      end == std::string_view::npos ? std::string_view() : trimmed(line.substr(end));
  if (rest.empty()) throw std::runtime_error("line " + in_quotes(line) + " has no name");
  const std::size_t name_end = std::min(rest.find_first_of(" \t="), rest.size());
  if (trimmed(rest.substr(name_end)).starts_with('=')) return {};  // a constant
  return {std::string(line.substr(0, end)), std::string(rest.substr(0, name_end))};
}

RosSections sections_of(std::string_view type, std::string_view text) {
  RosSections sections;
  std::vector<RosLine>* section = &sections[short_type(type)];
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    constexpr std::string_view kHead = "MSG:";
    if (line.starts_with("===")) continue;
    if (line.starts_with(kHead)) {
      section = &sections[short_type(trimmed(line.substr(kHead.size())))];
      section->clear();
    } else if (RosLine field = field_in(line); !field.name.empty()) {
      section->push_back(std::move(field));
    }
  }
  return sections;
}

class Resolver {
 public:
  explicit Resolver(const RosSections& sections) : sections_(sections) {}

  std::vector<RosField> fields_of(const std::string& type, const std::string& path, int depth) {
    const auto found = sections_.find(type);
    if (found == sections_.end())
      throw std::runtime_error("its definition names " + in_quotes(type) +
                               ", which it does not contain");
    std::vector<RosField> fields;
    for (const RosLine& line : found->second) {
      if (++count_ > kMostFields || depth > kMostNested)
        throw std::runtime_error("its definition is too large or contains itself");
      fields.push_back(field_of(line, type, path, depth));
    }
    return fields;
  }

 private:
  RosField field_of(const RosLine& line, const std::string& parent, const std::string& path,
                    int depth) {
    RosField field;
    field.path = (path.empty() ? "" : path + ".") + line.name;
    std::string_view type = line.type;
    if (type.ends_with(']')) {
      const std::size_t open = std::min(type.rfind('['), type.size() - 1);
      const std::string_view size = type.substr(open + 1, type.size() - open - 2);
      type = type.substr(0, open);
      field.repeats = RosField::Repeats::kSequence;
      if (!size.empty() && !size.starts_with("<=")) {
        field.repeats = RosField::Repeats::kFixed;
        const auto [end, error] =
            std::from_chars(size.data(), size.data() + size.size(), field.count);
        if (error != std::errc() || end != size.data() + size.size() || field.count == 0)
          throw std::runtime_error("its definition has the size " + in_quotes(line.type));
      }
    }
    type = type.substr(0, type.find("<="));  // the limit of a text
    const auto* primitive =
        std::find_if(kRosPrimitives.begin(), kRosPrimitives.end(),
                     [&](const RosPrimitive& known) { return known.name == type; });
    if (primitive != kRosPrimitives.end()) {
      field.kind = primitive->kind;
      field.bytes = primitive->bytes;
      return field;
    }
    const bool has_package = type.find('/') != std::string_view::npos;
    field.fields = fields_of(
        has_package ? short_type(type) : parent.substr(0, parent.find('/') + 1) + std::string(type),
        field.path, depth + 1);
    return field;
  }

  const RosSections& sections_;
  int count_ = 0;
};

/// The bytes of a message in the order of its fields. Numbers are aligned to their size, counted
/// from behind the head.
class CdrReader {
 public:
  CdrReader(std::string_view bytes, RosValues& values) : values_(values) {
    constexpr std::size_t kHead = 4;
    // Representation 0 and 1 are CDR, big and little endian; two bytes of options follow.
    if (bytes.size() < kHead || bytes[0] != 0 || (bytes[1] != 0 && bytes[1] != 1))
      throw std::runtime_error(
          "it is not in CDR, version 1 (a bag that was recorded with --compression-mode message is "
          "unpacked by ros2 bag convert)");
    big_endian_ = bytes[1] == 0;
    bytes_ = bytes.substr(kHead);
  }

  void read(const RosField& field) {
    path_ = &field.path;
    std::uint64_t count = field.count;
    if (field.repeats == RosField::Repeats::kSequence) count = length();
    if (field.kind == RosField::Kind::kMessage) {
      for (std::uint64_t i = 0; i < count; ++i) read_fields(field);
    } else if (field.kind == RosField::Kind::kText) {
      for (std::uint64_t i = 0; i < count; ++i) read_text(field);
    } else if (count > 0) {
      align(field.bytes);
      const std::string_view numbers = take(count * field.bytes);
      if (field.slot < 0) return;
      std::vector<double>& to = values_.numbers[static_cast<std::size_t>(field.slot)];
      for (std::size_t i = 0; i < numbers.size(); i += field.bytes)
        to.push_back(number_in(numbers.substr(i, field.bytes), field.kind));
    }
  }

  void read_fields(const RosField& message) {
    for (const RosField& field : message.fields) read(field);
    if (!message.fields.empty()) return;
    path_ = &message.path;
    take(1);  // no structure of IDL is empty: it has one byte
  }

 private:
  void read_text(const RosField& field) {
    path_ = &field.path;
    std::string_view text = take(length());
    if (text.ends_with('\0')) text.remove_suffix(1);
    if (field.slot >= 0) values_.texts[static_cast<std::size_t>(field.slot)].emplace_back(text);
  }
  std::uint64_t length() {
    align(sizeof(std::uint32_t));
    return raw(take(sizeof(std::uint32_t)));
  }
  void align(std::size_t size) {
    at_ = (at_ + size - 1) / size * size;
    if (at_ > bytes_.size()) throw_short();
  }
  std::string_view take(std::uint64_t size) {
    if (size > bytes_.size() - at_) throw_short();
    const std::string_view taken = bytes_.substr(at_, size);
    at_ += size;
    return taken;
  }
  [[nodiscard]] std::uint64_t raw(std::string_view bytes) const {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i)
      value = value << 8 | static_cast<std::uint8_t>(bytes[big_endian_ ? i : bytes.size() - 1 - i]);
    return value;
  }
  [[nodiscard]] double number_in(std::string_view bytes, RosField::Kind kind) const {
    const std::uint64_t value = raw(bytes);
    if (kind == RosField::Kind::kUnsigned) return static_cast<double>(value);
    if (kind == RosField::Kind::kFloat) {
      return bytes.size() == sizeof(double)
                 ? std::bit_cast<double>(value)
                 : static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(value)));
    }
    const std::size_t unused_bits = 64 - 8 * bytes.size();
    return static_cast<double>(static_cast<std::int64_t>(value << unused_bits) >> unused_bits);
  }
  [[noreturn]] void throw_short() const {
    throw std::runtime_error("it ends in " + in_quotes(*path_) +
                             ": it does not fit its definition, or is damaged");
  }

  RosValues& values_;
  std::string_view bytes_;
  std::size_t at_ = 0;
  bool big_endian_ = false;
  const std::string* path_ = nullptr;  // of the field that is read
};

}  // namespace

RosField parse_ros_definition(std::string_view type, std::string_view text) {
  const RosSections sections = sections_of(type, text);
  RosField message;
  message.fields = Resolver(sections).fields_of(short_type(type), "", 0);
  return message;
}

void decode_cdr(const RosField& message, std::string_view bytes, RosValues& values) {
  for (auto& numbers : values.numbers) numbers.clear();
  for (auto& texts : values.texts) texts.clear();
  CdrReader reader(bytes, values);
  reader.read_fields(message);
}

}  // namespace servotwin
