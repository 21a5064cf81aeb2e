#include "drivers/traces/formats.h"

#include "drivers/traces/halscope.h"
#include "drivers/traces/tncscope.h"
#include "drivers/traces/twincat_scope.h"
#include "drivers/units.h"

namespace servotwin {

std::optional<CsvHeader> read_trace_header(TextLines& lines, const std::string& first) {
  if (is_tncscope(first)) return read_tncscope_header(lines);
  if (is_halscope(first)) return read_halscope_header(lines, first);
  if (is_twincat_scope(lines, first)) return read_twincat_scope_header(lines, first);
  return std::nullopt;
}

bool is_trace(std::string_view first) noexcept { return is_tncscope(first) || is_halscope(first); }

std::string column_name(const std::string& name, std::string_view unit) {
  return parse_unit(unit) ? name + "[" + std::string(unit) + "]" : name;
}

}  // namespace servotwin
