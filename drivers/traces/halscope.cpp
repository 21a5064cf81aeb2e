#include "drivers/traces/halscope.h"

#include <charconv>
#include <string>

#include "drivers/text.h"

namespace servotwin {

CsvHeader read_halscope_header(TextLines& lines, std::string_view first) {
  constexpr std::string_view kBefore = "Sampling period is ", kAfter = " nSec";
  const std::string_view digits = trimmed(first.substr(kBefore.size()));
  double period_ns = 0.0;
  const auto [end, error] =
      std::from_chars(digits.data(), digits.data() + digits.size(), period_ns);
  constexpr double kLeast_ns = 1.0, kMost_ns = 1e10;
  if (error != std::errc() || !(period_ns >= kLeast_ns && period_ns <= kMost_ns) ||
      !std::string_view(end, static_cast<std::size_t>(digits.data() + digits.size() - end))
           .starts_with(kAfter))
    lines.fail("halscope: " + in_quotes(first) + " gives no sampling period");
  CsvHeader header;
  header.separator = ' ';
  header.rate_hz = 1e9 / period_ns;
  std::string_view line;
  do {
    if (!lines.next(line)) lines.fail("halscope: there are no rows");
  } while (is_csv_comment(line));
  const std::vector<std::string> fields = fields_of(line, ' ');
  if (fields.size() % 2 != 0)
    lines.fail("halscope: " + in_quotes(line) + " is not names and values in turns");
  for (std::size_t i = 0; i < fields.size(); i += 2) {
    // The column of the name, which nobody can ask for, and that of its values.
    header.names.emplace_back();
    header.names.push_back(fields[i]);
  }
  header.notes.push_back("halscope recording at " + number(*header.rate_hz) + " Hz");
  lines.put_back();
  return header;
}

}  // namespace servotwin
