#include "drivers/recordings/halscope/halscope.h"

#include <charconv>
#include <string>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr std::string_view kPeriodIs = "Sampling period is ", kComment = "# ";

/// Rows per second by "100000 nSec", the rest of the first line of either form.
std::optional<double> rate_by_period(std::string_view text, std::string_view unit) {
  constexpr double kLeast_ns = 1.0, kMost_ns = 1e10;
  text = trimmed(text);
  double period_ns = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), period_ns);
  if (error != std::errc() || !(period_ns >= kLeast_ns && period_ns <= kMost_ns) ||
      !trimmed(text.substr(static_cast<std::size_t>(end - text.data()))).starts_with(unit))
    return std::nullopt;
  return 1e9 / period_ns;
}

}  // namespace

CsvHeader read_halscope_header(TextLines& lines, std::string_view first) {
  CsvHeader header;
  header.separator = ' ';
  header.rate_hz = rate_by_period(first.substr(kPeriodIs.size()), "nSec");
  if (!header.rate_hz) lines.fail("halscope: " + in_quotes(first) + " gives no sampling period");
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

std::optional<double> halscope_table_rate_hz(std::string_view comment) {
  if (!comment.starts_with(kComment)) return std::nullopt;
  comment.remove_prefix(kComment.size());
  if (!is_halscope(comment)) return std::nullopt;
  return rate_by_period(comment.substr(kPeriodIs.size()), "ns");
}

}  // namespace servotwin
