#include "drivers/recordings/can_log/can_log_form.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include "drivers/common/text.h"

namespace servotwin {

namespace {

using Words = std::vector<std::string_view>;

Words words_of(std::string_view line) {
  Words out;
  for (std::size_t at = line.find_first_not_of(kBlanks); at != line.npos;
       at = line.find_first_not_of(kBlanks, at)) {
    const std::size_t end = std::min(line.find_first_of(kBlanks, at), line.size());
    out.push_back(line.substr(at, end - at));
    at = end;
  }
  return out;
}

/// All of a word as a whole number to this base.
std::optional<std::uint32_t> whole(std::string_view word, int base) {
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value, base);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

constexpr std::int64_t kMost_ns = 9'000'000'000'000'000'000;
constexpr std::int64_t kSecond_ns = 1'000'000'000, kMillisecond_ns = 1'000'000;

/// A decimal number of this unit in ns, exactly; not negative.
std::optional<std::int64_t> time_of(std::string_view word, std::int64_t unit_ns) {
  const std::string_view before = word.substr(0, word.find('.'));
  std::int64_t units = 0;
  const auto [end, error] = std::from_chars(before.data(), before.data() + before.size(), units);
  constexpr std::int64_t kMost_s = 9'000'000'000;  // above, nanoseconds do not fit into 64 bits
  if (error != std::errc() || end != before.data() + before.size() || units < 0 ||
      units > kMost_s * (kSecond_ns / unit_ns))
    return std::nullopt;
  std::int64_t out = units * unit_ns, digit_ns = unit_ns;
  for (std::size_t i = before.size() + 1; i < word.size(); ++i) {
    if (word[i] < '0' || word[i] > '9') return std::nullopt;
    digit_ns /= 10;
    out += digit_ns * (word[i] - '0');
  }
  return out;
}

/// `count` letters from `at` on; fewer at the end.
std::string_view part(std::string_view word, std::size_t at, std::size_t count) {
  return at < word.size() ? word.substr(at, count) : std::string_view();
}

[[noreturn]] void refuse(std::string_view what, const std::string& rule) {
  throw std::runtime_error(in_quotes(what) + ": " + rule);
}

void set_id(CanFrame& frame, std::string_view word, int base, bool extended) {
  const std::optional<std::uint32_t> id = whole(word, base);
  if (!id || *id >= (extended ? kExtendedIds : kStandardIds))
    refuse(word, extended ? "is no id of 29 bits" : "is no id of 11 bits");
  frame.id = *id;
  frame.extended = extended;
}

/// `bytes` from a word on; the frame's length is `length`.
void set_data(CanFrame& frame, const Words& words, std::size_t from, std::size_t length, int base) {
  if (length > (frame.fd ? CanFrame::kMaxBytes : CanFrame::kClassicBytes) ||
      can_length_at_least(length, frame.fd) != length)
    refuse(std::to_string(length), "is no number of bytes of such a frame");
  frame.length = static_cast<std::uint8_t>(length);
  if (frame.remote && frame.fd) refuse(words.back(), "an FD frame cannot ask for another");
  if (frame.remote) return;
  if (words.size() < from + length)
    refuse(words.back(), "the frame has " + std::to_string(length) + " bytes, but fewer are here");
  for (std::size_t i = 0; i < length; ++i) {
    const std::optional<std::uint32_t> byte = whole(words[from + i], base);
    if (!byte || *byte > 0xFF) refuse(words[from + i], "is no byte");
    frame.data[i] = static_cast<std::uint8_t>(*byte);
  }
}

/// The length that a code of FD stands for.
std::size_t length_of_code(std::uint32_t code) {
  constexpr std::array<std::size_t, 16> kLengths{0, 1,  2,  3,  4,  5,  6,  7,
                                                 8, 12, 16, 20, 24, 32, 48, 64};
  return code < kLengths.size() ? kLengths[code] : CanFrame::kMaxBytes + 1;
}

/// The name of the interface, as candump -l has it.
std::string interface_of(std::string_view name) {
  if (const std::string why = why_no_interface(name); !why.empty())
    refuse(name, "is no name of an interface: " + why);
  return std::string(name);
}

CanFrame error_frame() {
  CanFrame frame;
  frame.error = true;
  return frame;
}

/// "(1607120998.528112)" in ns.
std::optional<std::int64_t> bracketed(std::string_view word) {
  if (word.size() < 3 || word.front() != '(' || word.back() != ')') return std::nullopt;
  return time_of(word.substr(1, word.size() - 2), kSecond_ns);
}

/// The first lines, without the last one if it is not complete.
std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> out;
  while (true) {
    const std::size_t end = text.find('\n');
    if (end == text.npos) break;
    out.push_back(text.substr(0, end));
    text.remove_prefix(end + 1);
  }
  return out;
}

/// Whether times in brackets are those since the frame before: they stay where they are instead of
/// growing.
bool are_differences(std::string_view beginning) {
  constexpr std::size_t kMinLines = 8;
  constexpr std::int64_t kMaxDifference_ns = 100'000'000'000;  // a pause of the bus
  std::vector<std::int64_t> times;
  for (const std::string_view line : lines_of(beginning)) {
    const Words words = words_of(line);
    if (words.empty() || words.front().front() == '#') continue;
    if (const auto time = bracketed(words.front())) times.push_back(*time);
  }
  if (times.size() < kMinLines) return false;
  const auto middle = times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2);
  const std::int64_t most_before = *std::max_element(times.begin(), middle);
  // Typical of the second half: frames of two buses may be slightly out of order.
  const auto typical = middle + (times.end() - middle) / 2;
  std::nth_element(middle, typical, times.end());
  return *std::max_element(times.begin(), times.end()) < kMaxDifference_ns &&
         *typical <= most_before;
}

/// Where "can0  181   [8]" begins in a line of candump on a terminal; nothing if it is none.
std::optional<std::size_t> place_of_interface(const Words& words) {
  for (std::size_t i = 0; i + 2 < words.size() && i < 3; ++i) {
    // -x: direction and flags between interface and id.
    for (const std::size_t id : {i + 1, i + 4}) {
      if (id + 1 >= words.size()) continue;
      const std::string_view length = words[id + 1];
      if (whole(words[id], 16) && (words[id].size() == 3 || words[id].size() == 8) &&
          length.size() >= 3 && length.front() == '[' && length.back() == ']')
        return i;
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<CanLogForm> can_log_form(std::string_view beginning) {
  if (is_candump(beginning)) return CanLogForm::kCandump;
  bool dated = false;
  for (const std::string_view line : lines_of(beginning)) {
    const Words words = words_of(line);
    if (words.empty()) continue;
    if (words.front().starts_with(";$FILEVERSION=")) return CanLogForm::kPeakTrc;
    if (words.front() == "date") {
      dated = true;
      continue;
    }
    if (dated) {
      if (words.front() == "base") return CanLogForm::kVectorAsc;
      return std::nullopt;
    }
    if (words.front().front() == ';') continue;  // TRC 1.0 has no version
    if (place_of_interface(words)) return CanLogForm::kTerminal;
    if (words.front().ends_with(')') && words.size() >= 4 &&
        whole(words.front().substr(0, words.front().size() - 1), 10) &&
        time_of(words[1], kMillisecond_ns))
      return CanLogForm::kPeakTrc;
    return std::nullopt;
  }
  return std::nullopt;
}

CanLogLines::CanLogLines(std::string_view beginning, std::optional<CanLogForm> named) {
  std::optional<CanLogForm> form = can_log_form(beginning);
  if (named && !(named == CanLogForm::kCandump && form == CanLogForm::kTerminal)) form = named;
  if (!form) return;  // the first line tells what is wrong
  form_ = *form;
  if (form_ == CanLogForm::kCandump || form_ == CanLogForm::kTerminal)
    differences_ = are_differences(beginning);
}

std::optional<CandumpLine> CanLogLines::parse(std::string_view line) {
  const std::string_view text = trimmed(line);
  if (text.empty()) return std::nullopt;
  switch (form_) {
    case CanLogForm::kCandump: {
      if (text.front() == '#') return std::nullopt;
      CandumpLine out = parse_candump_line(text);
      out.frame.time_ns = since_start(out.frame.time_ns);
      return out;
    }
    case CanLogForm::kTerminal:
      return parse_terminal(text);
    case CanLogForm::kVectorAsc:
      return parse_asc(text);
    case CanLogForm::kPeakTrc:
      return parse_trc(text);
  }
  return std::nullopt;
}

std::int64_t CanLogLines::since_start(std::int64_t time_ns) {
  if (!differences_) return time_ns;
  if (time_ns > kMost_ns - sum_ns_) refuse(std::to_string(time_ns), "the times add up to too much");
  return sum_ns_ += time_ns;
}

std::optional<CandumpLine> CanLogLines::parse_terminal(std::string_view line) {
  const Words words = words_of(line);
  const std::optional<std::size_t> at = place_of_interface(words);
  if (!at) refuse(line, "must be a line of candump: (time) interface id [length] bytes");
  CandumpLine out;
  if (*at == 0) refuse(line, "has no time: record with candump -l, or with -ta on a terminal");
  if (*at == 1) {
    const auto time = bracketed(words[0]);
    if (!time) refuse(words[0], "must be a time in brackets, (seconds.fraction)");
    out.frame.time_ns = since_start(*time);
  } else {  // -tA: (2024-05-16 18:16:50.884123)
    const std::string_view date = words[0], clock = words[1];
    const auto year = whole(part(date, 1, 4), 10), month = whole(part(date, 6, 2), 10),
               day = whole(part(date, 9, 2), 10), hours = whole(part(clock, 0, 2), 10),
               minutes = whole(part(clock, 3, 2), 10);
    const auto seconds =
        time_of(part(clock, 6, clock.size() - std::min<std::size_t>(7, clock.size())), kSecond_ns);
    const std::chrono::year_month_day when{std::chrono::year(static_cast<int>(year.value_or(0))),
                                           std::chrono::month(month.value_or(0)),
                                           std::chrono::day(day.value_or(0))};
    if (!when.ok() || year.value_or(0) < 1970 || year.value_or(0) > 2200 ||
        hours.value_or(24) > 23 || minutes.value_or(60) > 59 || !seconds.has_value())
      refuse(clock, "must be a date and a time in brackets, as of candump -tA");
    constexpr std::int64_t kMinutesPerDay = 24 * 60;
    const std::int64_t days = std::chrono::sys_days(when).time_since_epoch().count();
    out.frame.time_ns =
        (days * kMinutesPerDay + hours.value_or(0) * std::int64_t{60} + minutes.value_or(0)) * 60 *
            kSecond_ns +
        seconds.value_or(0);
  }
  out.interface = interface_of(words[*at]);
  const bool flags = !words[*at + 2].starts_with('[');
  const std::size_t id = *at + (flags ? 4 : 1);
  const std::string_view length = words[id + 1];
  const auto count = whole(length.substr(1, length.size() - 2), 10);
  if (!count) refuse(length, "must be the number of bytes in brackets");
  const std::uint32_t value = *whole(words[id], 16);
  constexpr std::uint32_t kErrorFlag = 0x20000000U;
  if (words[id].size() == 8 && (value & kErrorFlag) != 0) {
    const std::int64_t time_ns = out.frame.time_ns;
    out.frame = error_frame();
    out.frame.time_ns = time_ns;
    out.frame.id = value & (kExtendedIds - 1);
  } else {
    set_id(out.frame, words[id], 16, words[id].size() == 8);
  }
  // Two digits in the brackets: candump writes [02] for FD.
  out.frame.fd = length.size() == 4;
  out.frame.remote =
      words.size() > id + 3 && words[id + 2] == "remote" && words[id + 3] == "request";
  set_data(out.frame, words, id + 2, *count, 16);
  return out;
}

std::optional<CandumpLine> CanLogLines::parse_asc(std::string_view line) {
  const Words words = words_of(line);
  if (words.front() == "base") {
    for (std::size_t i = 0; i + 1 < words.size(); ++i) {
      if (words[i] == "base") base_ = words[i + 1] == "dec" ? 10 : 16;
      if (words[i] == "timestamps") differences_ = words[i + 1] == "relative";
    }
    return std::nullopt;
  }
  const auto time = time_of(words.front(), kSecond_ns);
  if (!time || words.size() < 3) return std::nullopt;
  CandumpLine out;
  const bool fd = words[1] == "CANFD";
  // Every line with a time counts for the differences, a frame or not.
  const std::int64_t time_ns = since_start(*time);
  if (words.size() < (fd ? 9U : 5U) && words[2] != "ErrorFrame") return std::nullopt;
  const std::string_view channel = fd ? words[2] : words[1];
  if (!whole(channel, 10)) return std::nullopt;
  out.interface = interface_of(channel);
  if (!fd && words[2] == "ErrorFrame") {
    out.frame = error_frame();
    out.frame.time_ns = time_ns;
    return out;
  }
  const std::string_view direction = words[3];
  if (direction != "Rx" && direction != "Tx") return std::nullopt;  // TxRq, Statistic: and others
  std::string_view id = fd ? words[4] : words[2];
  const bool extended = id.ends_with('x');
  if (extended) id.remove_suffix(1);
  out.frame.time_ns = time_ns;
  out.frame.fd = fd;
  set_id(out.frame, id, base_, extended);
  if (fd) {
    // A name may follow the id.
    std::size_t at = 5;
    if (words[at] != "0" && words[at] != "1") ++at;
    if (words.size() < at + 4) refuse(line, "must have bit rate switch, state, code and length");
    out.frame.fast = words[at] == "1";
    out.frame.passive = words[at + 1] == "1";
    const auto length = whole(words[at + 3], 10);
    if (!length) refuse(words[at + 3], "must be the number of bytes");
    set_data(out.frame, words, at + 4, *length, base_);
    return out;
  }
  out.frame.remote = words[4] == "r";
  if (!out.frame.remote && words[4] != "d") return std::nullopt;
  const auto length = words.size() > 5 ? whole(words[5], 16) : std::nullopt;
  if (!length && !out.frame.remote) refuse(line, "must have the number of bytes behind d");
  set_data(out.frame, words, 6, length.value_or(0), base_);
  return out;
}

void CanLogLines::take_trc_header(std::string_view line) {
  const auto value_of = [&](std::string_view key) -> std::optional<std::string_view> {
    if (!line.starts_with(key)) return std::nullopt;
    return trimmed(line.substr(key.size()));
  };
  if (const auto version = value_of(";$FILEVERSION=")) {
    trc_columns_ = *version == "1.0"   ? "NOIlD"
                   : *version == "1.1" ? "NOdIlD"
                   : *version == "1.2" ? "NOBdIlD"
                   : *version == "1.3" ? "NOBdIRlD"
                                       : "NOTIdlD";
  } else if (const auto columns = value_of(";$COLUMNS=")) {
    trc_columns_.assign(*columns);
    std::erase(trc_columns_, ',');
  } else if (const auto start = value_of(";$STARTTIME=")) {
    // Days since 1899-12-30, of which 25569 are before 1970.
    double days = 0.0;
    const auto [end, error] = std::from_chars(start->data(), start->data() + start->size(), days);
    constexpr double kDaysTo1970 = 25569.0, kSecondsPerDay = 86400.0, kMaxDays = 100000.0;
    if (error == std::errc() && days >= kDaysTo1970 && days < kMaxDays)
      start_ns_ = std::llround((days - kDaysTo1970) * kSecondsPerDay * 1e3) * 1'000'000;
  }
}

std::optional<CandumpLine> CanLogLines::parse_trc(std::string_view line) {
  if (line.front() == ';') {
    take_trc_header(line);
    return std::nullopt;
  }
  if (trc_columns_.empty()) trc_columns_ = "NOIlD";  // 1.0 has no header of its own
  const std::size_t data = trc_columns_.find('D');
  if (data == std::string::npos) refuse(trc_columns_, "$COLUMNS has no D, the data of the frames");
  const Words words = words_of(line);
  CandumpLine out;
  out.interface = "1";
  std::string_view type = "DT";
  std::optional<std::size_t> length;
  std::string_view id;
  for (std::size_t i = 0; i < trc_columns_.size(); ++i) {
    const char column = trc_columns_[i];
    if (i >= words.size()) {
      if (column == 'D') break;  // a frame without data
      if (type == "DT" || type.starts_with('F'))
        refuse(line, "the line is shorter than its columns");
      return std::nullopt;
    }
    const std::string_view word = words[i];
    switch (column) {
      case 'O': {
        const auto time = time_of(word, kMillisecond_ns);
        if (!time || *time > kMost_ns - start_ns_) refuse(word, "must be the time in ms");
        out.frame.time_ns = start_ns_ + *time;
        break;
      }
      case 'T':
        type = word;
        break;
      case 'd':
        if (word != "Rx" && word != "Tx") return std::nullopt;  // Warng, Error
        break;
      case 'B':
        if (whole(word, 10)) out.interface = interface_of(word);
        break;
      case 'I':
        id = word;
        break;
      case 'L':
      case 'l': {
        const auto count = whole(word, 10);
        if (!count) refuse(word, "must be the number of bytes");
        length = column == 'L' && trc_columns_.find('l') == std::string::npos
                     ? length_of_code(*count)
                     : std::size_t{*count};
        break;
      }
      default:
        break;
    }
  }
  if (type == "ER" || type == "ST" || type == "EC" || type == "EV") return std::nullopt;
  out.frame.fd = type == "FD" || type == "FB" || type == "FE" || type == "BI";
  out.frame.fast = type == "FB" || type == "BI";
  out.frame.passive = type == "FE" || type == "BI";
  out.frame.remote = type == "RR" || (data < words.size() && words[data] == "RTR");
  if (id.empty() || !length) refuse(line, "has no id or no length");
  set_id(out.frame, id, 16, id.size() > 4);
  set_data(out.frame, words, data, *length, 16);
  return out;
}

}  // namespace servotwin
