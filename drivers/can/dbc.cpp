#include "drivers/can/dbc.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "drivers/can/can_frame.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr std::string_view kBlank = " \t\r\n";
constexpr std::uint32_t kNoMessage = 0xC0000000;  // for signals without a message (Vector)

/// The text, word by word.
class Words {
 public:
  Words(std::string_view text, const std::string& name) : text_(text), name_(name) {
    if (text_.starts_with("\xef\xbb\xbf")) text_.remove_prefix(3);
  }

  [[nodiscard]] bool done() const { return at_ >= text_.size(); }
  [[nodiscard]] int line() const { return line_; }
  [[nodiscard]] char peek() const { return done() ? '\0' : text_[at_]; }
  void advance() {
    if (peek() == '\n') ++line_;
    if (!done()) ++at_;
  }
  void skip_blanks(std::string_view blanks = kBlank) {
    while (!done() && blanks.find(peek()) != blanks.npos) advance();
  }
  /// Up to a blank or one of `stops`.
  std::string_view word(std::string_view stops = "") {
    skip_blanks();
    const std::size_t begin = at_;
    while (!done() && kBlank.find(peek()) == kBlank.npos && stops.find(peek()) == stops.npos) ++at_;
    return text_.substr(begin, at_ - begin);
  }
  void expect(char c, const char* where) {
    skip_blanks();
    if (peek() != c) fail(std::string("there must be '") + c + "' " + where);
    advance();
  }
  bool take(char c) {
    skip_blanks();
    if (peek() != c) return false;
    advance();
    return true;
  }
  std::string quoted() {
    expect('"', "before a text");
    std::string out;
    while (!done() && peek() != '"') {
      // An escaped quote; but "C:\" before the end of a statement ends there.
      if (peek() == '\\' && following(1) == '"' && following(2) != ';') advance();
      out += peek();
      advance();
    }
    expect('"', "after a text");
    return out;
  }
  /// To the end of a statement: a semicolon outside of texts.
  void skip_statement() {
    while (!done() && peek() != ';') {
      if (peek() == '"') {
        (void)quoted();
      } else {
        advance();
      }
    }
    advance();
  }
  void skip_line() {
    while (!done() && peek() != '\n') ++at_;
  }
  template <class T>
  T number(std::string_view stops, const char* what) {
    const std::string_view digits = word(stops);
    std::string_view bare = digits;
    if (bare.starts_with('+')) bare.remove_prefix(1);
    T value{};
    const auto [end, error] = std::from_chars(bare.data(), bare.data() + bare.size(), value);
    if (error != std::errc() || end != bare.data() + bare.size() || bare.empty())
      fail(in_quotes(digits) + " is not a valid " + what);
    return value;
  }
  [[noreturn]] void fail(const std::string& what) const { fail(line_, what); }
  [[noreturn]] void fail(int line, const std::string& what) const {
    throw std::runtime_error(name_ + ":" + std::to_string(line) + ": " + what);
  }

 private:
  [[nodiscard]] char following(std::size_t by) const {
    return at_ + by < text_.size() ? text_[at_ + by] : '\0';
  }

  std::string_view text_;
  const std::string& name_;
  std::size_t at_ = 0;
  int line_ = 1;
};

/// "M", "m3" or "m3M" after a signal's name.
void read_multiplexing(Words& words, DbcSignal& signal) {
  const std::string_view text = words.word(":");
  if (text.empty()) return;
  if (text == "M") {
    signal.multiplexing = Multiplexing::kSelector;
    return;
  }
  std::string_view digits = text.substr(1);
  const bool both = digits.ends_with('M');
  if (both) digits.remove_suffix(1);
  const auto [end, error] =
      std::from_chars(digits.data(), digits.data() + digits.size(), signal.selected_by);
  if (text.front() != 'm' || error != std::errc() || end != digits.data() + digits.size())
    words.fail(in_quotes(text) + ": a multiplexed signal is marked M, m3 or m3M");
  signal.multiplexing = both ? Multiplexing::kExtended : Multiplexing::kSelected;
}

void read_signal(Words& words, DbcMessage& message) {
  DbcSignal out;
  out.line = words.line();
  out.name = std::string(words.word(":"));
  read_multiplexing(words, out);
  words.expect(':', "after a signal's name");
  CanSignal& signal = out.signal;
  signal.start = words.number<int>("|", "start bit");
  words.expect('|', "between start bit and length");
  signal.length = words.number<int>("@", "length in bits");
  words.expect('@', "between length and byte order");
  if (words.peek() != '0' && words.peek() != '1')
    words.fail("the byte order must be 0 (big endian) or 1 (little endian)");
  signal.order = words.peek() == '1' ? ByteOrder::kLittle : ByteOrder::kBig;
  words.advance();
  if (words.peek() != '+' && words.peek() != '-')
    words.fail("+ (unsigned) or - (signed) must follow the byte order");
  signal.coding = words.peek() == '+' ? Coding::kUnsigned : Coding::kSigned;
  words.advance();
  words.expect('(', "before factor and offset");
  signal.scale = words.number<double>(",", "factor");
  words.expect(',', "between factor and offset");
  signal.offset = words.number<double>(")", "offset");
  words.expect(')', "after factor and offset");
  words.expect('[', "before the range");
  (void)words.word("]\"");  // the range is invalid in many files
  words.expect(']', "after the range");
  out.unit = words.quoted();
  words.skip_line();
  if (!std::isfinite(signal.scale) || signal.scale == 0.0 || !std::isfinite(signal.offset))
    words.fail(out.line, in_quotes(out.name) + ": the factor must be a number other than 0");
  if (bytes_needed(signal) == 0)
    words.fail(out.line, in_quotes(out.name) + ": " + std::to_string(signal.length) +
                             " bits from bit " + std::to_string(signal.start) +
                             " are not in a frame");
  message.signals.push_back(std::move(out));
}

DbcMessage read_message(Words& words) {
  DbcMessage message;
  const int line = words.line();
  const auto id = words.number<std::uint32_t>("", "message id");
  message.extended = (id & 1U << 31) != 0;
  message.id = id & ~(1U << 31);
  message.name = std::string(words.word(":"));
  words.expect(':', "after a message's name");
  message.length = words.number<int>("", "length of a message");
  words.skip_line();
  const bool real = message.id < (message.extended ? kExtendedIds : kStandardIds);
  if (id != kNoMessage && !real) {
    words.fail(line, in_quotes(message.name) + ": " + std::to_string(id) +
                         " is not an id: 0 to 2047, or 2147483648 + an id of 29 bits");
  }
  if (message.length < 0 || message.length > static_cast<int>(CanFrame::kMaxBytes)) {
    if (id != kNoMessage)
      words.fail(line, in_quotes(message.name) + ": a frame has 0 to 64 bytes, not " +
                           std::to_string(message.length));
  }
  return message;
}

/// The signal that a statement after all messages refers to; none if it does not exist.
DbcSignal* named(Dbc& dbc, std::uint32_t id, std::string_view name) {
  for (DbcMessage& message : dbc.messages) {
    if ((message.id | (message.extended ? 1U << 31 : 0U)) != id) continue;
    for (DbcSignal& signal : message.signals) {
      if (signal.name == name) return &signal;
    }
  }
  return nullptr;
}

void read_value_type(Words& words, Dbc& dbc) {
  const auto id = words.number<std::uint32_t>("", "message id");
  const std::string name(words.word(":;"));
  words.take(':');
  const int type = words.number<int>(";", "value type");
  const int line = words.line();
  words.skip_statement();
  DbcSignal* signal = named(dbc, id, name);
  if (signal == nullptr || type == 0) return;
  if ((type != 1 || signal->signal.length != 32) && (type != 2 || signal->signal.length != 64)) {
    words.fail(line, "SIG_VALTYPE_ of " + in_quotes(name) + " is " + std::to_string(type) +
                         ", which is for signals of " + (type == 1 ? "32" : "64") +
                         " bits: 1 is "
                         "float, 2 is double");
  }
  signal->signal.coding = Coding::kFloat;
}

/// Words that begin a statement which ends with a semicolon.
bool has_semicolon(std::string_view keyword) {
  constexpr std::string_view kWith[] = {
      "CM_",         "BA_DEF_",        "BA_",       "VAL_",          "VAL_TABLE_",
      "BA_DEF_DEF_", "BA_DEF_REL_",    "BA_REL_",   "EV_",           "ENVVAR_DATA_",
      "SGTYPE_",     "SIG_GROUP_",     "BO_TX_BU_", "SIG_TYPE_REF_", "BA_DEF_DEF_REL_",
      "SGTYPE_VAL_", "BA_DEF_SGTYPE_", "BA_SGTYPE_"};
  return std::find(std::begin(kWith), std::end(kWith), keyword) != std::end(kWith);
}

}  // namespace

Dbc parse_dbc(std::string_view text, const std::string& name) {
  Dbc dbc;
  Words words(text, name);
  bool any = false;
  bool in_message = false;
  for (words.skip_blanks(); !words.done(); words.skip_blanks()) {
    const int line = words.line();
    const std::string_view keyword = words.word(":;\"");
    words.skip_blanks(" \t\r");
    // The list of new symbols is keywords alone on their lines.
    const bool alone = words.peek() == '\n' || words.done();
    if (keyword == "BO_" && !alone) {
      dbc.messages.push_back(read_message(words));
      in_message = any = true;
    } else if (keyword == "SG_" && !alone) {
      if (!in_message) words.fail(line, "SG_ must come after the BO_ that it belongs to");
      read_signal(words, dbc.messages.back());
    } else {
      in_message = in_message && keyword.empty();
      if (keyword == "SIG_VALTYPE_" && !alone) {
        read_value_type(words, dbc);
      } else if (keyword == "SG_MUL_VAL_" && !alone) {
        const auto id = words.number<std::uint32_t>("", "message id");
        if (DbcSignal* signal = named(dbc, id, words.word()))
          signal->multiplexing = Multiplexing::kExtended;
        words.skip_statement();
      } else if (has_semicolon(keyword) && !alone) {
        any = true;
        words.skip_statement();
      } else {
        any = any || keyword == "VERSION" || keyword == "NS_" || keyword == "BU_";
        words.skip_line();
      }
    }
  }
  if (!any) throw std::runtime_error(name + ": is no DBC file: there is no BO_ in it");
  std::erase_if(dbc.messages, [](const DbcMessage& message) {
    return !message.extended ? false : message.id == (kNoMessage & ~(1U << 31));
  });
  return dbc;
}

Dbc read_dbc(const std::filesystem::path& file) {
  return parse_dbc(read_text(file), file.string());
}

}  // namespace servotwin
