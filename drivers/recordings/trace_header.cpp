#include "drivers/recordings/trace_header.h"

#include "drivers/common/text.h"
#include "drivers/common/units.h"
#include "drivers/recordings/halscope/halscope.h"
#include "drivers/recordings/tncscope/tncscope.h"
#include "drivers/recordings/twincat_scope/twincat_scope.h"

namespace servotwin {

std::optional<CsvHeader> read_trace_header(TextLines& lines, const std::string& first,
                                           std::optional<RecordingFormat> named) {
  using enum RecordingFormat;
  const RecordingFormat found = is_tncscope(first)               ? kTncscope
                                : is_halscope(first)             ? kHalscope
                                : is_twincat_scope(lines, first) ? kTwincatScope
                                                                 : kTable;
  if (named && *named != found) {
    const FormatForm& form = form_of(*named);
    lines.fail("--format " + std::string(form.id) + ": " + in_quotes(first) +
               " is not the first line of such a file (" + form.name + "), as " +
               in_quotes(form.line) + " is");
  }
  if (found == kTncscope) return read_tncscope_header(lines);
  if (found == kHalscope) return read_halscope_header(lines, first);
  if (found == kTwincatScope) return read_twincat_scope_header(lines, first);
  return std::nullopt;
}

bool is_trace(std::string_view first) noexcept { return is_tncscope(first) || is_halscope(first); }

std::string column_name(const std::string& name, std::string_view unit) {
  return parse_unit(unit) ? name + "[" + std::string(unit) + "]" : name;
}

}  // namespace servotwin
