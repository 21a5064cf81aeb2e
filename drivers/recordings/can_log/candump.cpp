#include "drivers/recordings/can_log/candump.h"

#include <linux/can.h>

#include <charconv>
#include <cstdio>
#include <stdexcept>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr std::string_view kHex = "0123456789ABCDEF";

int digit_of(char c) noexcept {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

/// The parts of a line, from its beginning.
class Cursor {
 public:
  explicit Cursor(std::string_view line) : line_(line) {}

  [[nodiscard]] bool done() const { return at_ >= line_.size(); }
  [[nodiscard]] char peek() const { return done() ? '\0' : line_[at_]; }
  bool take(char c) {
    if (peek() != c) return false;
    ++at_;
    return true;
  }
  void skip_blanks() {
    while (peek() == ' ' || peek() == '\t') ++at_;
  }
  std::string_view until(std::string_view stops) {
    const std::size_t begin = at_;
    at_ = std::min(line_.find_first_of(stops, at_), line_.size());
    return line_.substr(begin, at_ - begin);
  }
  [[noreturn]] void fail(const std::string& rule) const {
    throw std::runtime_error("column " + std::to_string(at_ + 1) + ": " +
                             in_quotes(line_.substr(std::min(at_, line_.size()))) + ": " + rule);
  }

 private:
  std::string_view line_;
  std::size_t at_ = 0;
};

std::int64_t stamp_in(Cursor& at) {
  constexpr const char* kRule =
      "must be a time in brackets, (seconds.fraction); record with candump -l";
  if (!at.take('(')) at.fail(kRule);
  const auto whole = at.until(".)");
  std::int64_t seconds = 0;
  const auto [end, error] = std::from_chars(whole.data(), whole.data() + whole.size(), seconds);
  // Above 9e9 s nanoseconds do not fit into 64 bits.
  if (error != std::errc() || end != whole.data() + whole.size() || seconds < 0 ||
      seconds > 9'000'000'000) {
    at.fail(kRule);
  }
  std::int64_t fraction = 0;
  if (at.take('.')) {
    int digits = 0;
    for (; digit_of(at.peek()) >= 0 && digit_of(at.peek()) < 10; ++digits) {
      if (digits < 9) fraction = 10 * fraction + digit_of(at.peek());
      at.take(at.peek());
    }
    if (digits == 0) at.fail(kRule);
    for (; digits < 9; ++digits) fraction *= 10;
  }
  if (!at.take(')')) at.fail(kRule);
  return seconds * 1'000'000'000 + fraction;
}

void read_id(Cursor& at, CanFrame& frame) {
  const std::string_view digits = at.until("# \t");
  std::uint32_t id = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), id, 16);
  if (error != std::errc() || end != digits.data() + digits.size() ||
      (digits.size() != 3 && digits.size() != 8)) {
    at.fail("an id of 3 or 8 hexadecimal digits must precede this, not " + in_quotes(digits));
  }
  if (digits.size() == 3) {
    if (id >= kStandardIds) at.fail("an id of 3 digits is at most 7FF, not " + in_quotes(digits));
    frame.id = id;
    return;
  }
  frame.error = (id & CAN_ERR_FLAG) != 0;
  frame.extended = !frame.error;
  // Eight digits with the flags of <linux/can.h> above the id.
  frame.id = id & CAN_EFF_MASK;
}

void read_data(Cursor& at, CanFrame& frame) {
  const std::size_t most = frame.fd ? CanFrame::kMaxBytes : CanFrame::kClassicBytes;
  std::size_t length = 0;
  while (digit_of(at.peek()) >= 0) {
    if (length == most)
      at.fail("a frame of this kind has at most " + std::to_string(most) + " bytes");
    const int high = digit_of(at.peek());
    at.take(at.peek());
    const int low = digit_of(at.peek());
    if (low < 0) at.fail("a byte has two hexadecimal digits");
    at.take(at.peek());
    frame.data[length++] = static_cast<std::uint8_t>(high << 4 | low);
    at.take('.');
  }
  if (can_length_at_least(length, frame.fd) != length) {
    at.fail(std::to_string(length) +
            " bytes; an FD frame beyond 8 has 12, 16, 20, 24, 32, 48 or 64");
  }
  frame.length = static_cast<std::uint8_t>(length);
  if (at.take('_') && digit_of(at.peek()) > 8) at.take(at.peek());  // a length code above 8
}

void read_body(Cursor& at, CanFrame& frame) {
  if (!at.take('#')) at.fail("must be # between id and data");
  if (at.take('#')) {
    if (at.peek() == '#') at.fail("CAN XL frames are not read");
    const int flags = digit_of(at.peek());
    if (flags < 0) at.fail("an FD frame has one digit of flags after ##");
    at.take(at.peek());
    frame.fd = true;
    frame.fast = (flags & CANFD_BRS) != 0;
    frame.passive = (flags & CANFD_ESI) != 0;
  } else if (at.take('R') || at.take('r')) {
    frame.remote = true;
    const int asked = digit_of(at.peek());
    if (asked >= 0) at.take(at.peek());
    frame.length = static_cast<std::uint8_t>(asked < 0 ? 0 : std::min(asked, 8));
    return;
  }
  read_data(at, frame);
}

}  // namespace

std::string why_no_interface(std::string_view name) {
  constexpr std::size_t kMaxLength = 32;  // twice what Linux allows
  if (name.empty() || name.size() > kMaxLength)
    return "a name has 1 to " + std::to_string(kMaxLength) + " characters, not " +
           std::to_string(name.size());
  for (const char c : name) {
    if (static_cast<unsigned char>(c) < '!' || c == '\x7f') return "invalid character";
  }
  return "";
}

CandumpLine parse_candump_line(std::string_view line) {
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  CandumpLine out;
  Cursor at(line);
  at.skip_blanks();
  out.frame.time_ns = stamp_in(at);
  at.skip_blanks();
  out.interface = std::string(at.until(" \t"));
  if (const std::string why = why_no_interface(out.interface); !why.empty())
    at.fail("the name of the interface must precede this: " + why);
  at.skip_blanks();
  read_id(at, out.frame);
  read_body(at, out.frame);
  at.skip_blanks();
  if (!at.take('R')) at.take('T');
  at.skip_blanks();
  if (!at.done()) at.fail("is beyond the end of the frame");
  return out;
}

std::string candump_line(const CanFrame& frame, std::string_view interface) {
  char head[96];
  const std::uint32_t id = frame.id | (frame.error ? CAN_ERR_FLAG : 0U);
  std::snprintf(
      head, sizeof head,
      frame.extended || frame.error ? "(%lld.%09lld) %.*s %08X#" : "(%lld.%09lld) %.*s %03X#",
      static_cast<long long>(frame.time_ns / 1'000'000'000),
      static_cast<long long>(frame.time_ns % 1'000'000'000),
      static_cast<int>(std::min<std::size_t>(interface.size(), 32)), interface.data(),
      static_cast<unsigned>(id));
  std::string line = head;
  if (frame.remote) {
    line += 'R';
    if (frame.length > 0) line += kHex[frame.length & 0xFU];
    return line;
  }
  if (frame.fd) {
    line += '#';
    line += kHex[(frame.fast ? CANFD_BRS : 0U) | (frame.passive ? CANFD_ESI : 0U)];
  }
  for (std::size_t i = 0; i < frame.length && i < frame.data.size(); ++i) {
    line += kHex[frame.data[i] >> 4];
    line += kHex[frame.data[i] & 0xFU];
  }
  return line;
}

bool is_candump(std::string_view beginning) {
  while (!beginning.empty()) {
    const std::string_view line = trimmed(beginning.substr(0, beginning.find('\n')));
    if (!line.empty() && line.front() != '#') {
      try {
        (void)parse_candump_line(line);
        return true;
      } catch (const std::runtime_error&) {
        return false;
      }
    }
    beginning.remove_prefix(std::min(beginning.find('\n'), beginning.size() - 1) + 1);
  }
  return false;
}

}  // namespace servotwin
