#include "drivers/recordings/sinumerik_trace/sinumerik_trace.h"

#include <expat.h>
#include <fcntl.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "drivers/recordings/column_map.h"

namespace servotwin {
namespace {

// Rows of a trace: so many, and so many more for every record. An axis at rest needs no records,
// but noise makes some; a damaged time would fill the memory.
constexpr double kMaxRestRows = 1e5, kMaxRowsPerRecord = 1e3;
// The bits of an infinity, which a trace writes as a whole number where a value is missing.
constexpr double kNoValue = 9.2e18;

std::string_view attribute(const XML_Char** attributes, std::string_view name) {
  for (; *attributes != nullptr; attributes += 2) {
    if (attributes[0] == name) return attributes[1];
  }
  return {};
}

/// All of a text as a number; absent if it is none.
double number_in(std::string_view text) {
  double value = kAbsent;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? value : kAbsent;
}

/// "CmdPos2ndEnc64_7" of "/Nck/!SD/nckServoDataCmdPos2ndEnc64 [u1, 7]".
std::string short_name(std::string_view name) {
  constexpr std::string_view kFamily = "nckServoData";
  if (const std::size_t slash = name.rfind('/'); slash != name.npos) name.remove_prefix(slash + 1);
  if (name.starts_with(kFamily)) name.remove_prefix(kFamily.size());
  const std::size_t bracket = name.find('[');
  std::string out(trimmed(name.substr(0, bracket)));
  if (bracket != name.npos) {
    const std::string_view place = name.substr(bracket);
    const std::size_t last = place.find_last_of(", [");
    const std::string_view axis = trimmed(place.substr(last + 1, place.find(']') - last - 1));
    if (!axis.empty()) out += "_" + std::string(axis);
  }
  std::replace_if(
      out.begin(), out.end(), [](unsigned char c) { return c <= ' ' || c == ',' || c == '='; },
      '_');
  return out;
}

/// Takes the elements of a trace in their order.
class Trace {
 public:
  Trace(std::string source, const ReadOptions& options)
      : source_(std::move(source)), options_(options) {}

  void element(std::string_view name, const XML_Char** attributes) {
    if (name == "traceData") in_data_ = true;
    if (!in_data_) return;
    // Signals after records belong to another frame, whose times begin anew.
    if (name == "dataSignal" && laid_out_) {
      recording_.notes.emplace_back("only the first data frame of the trace is read");
      in_data_ = false;
      return;
    }
    if (name == "frameHeader") {
      const std::string_view drops = attribute(attributes, "dropOuts");
      if (!drops.empty() && drops != "0")
        notes_.push_back("the control lost data " +
                         (drops == "1" ? "once" : std::string(drops) + " times"));
    } else if (name == "dataSignal") {
      add_signal(attributes);
    } else if (name == "rec") {
      take(attributes);
    }
  }

  [[nodiscard]] Recording recording() {
    if (ids_.empty()) throw std::runtime_error(source_ + ": this trace has no signals");
    if (!laid_out_)
      throw std::runtime_error(source_ +
                               ": this trace has no records; packed data, as of a measuring "
                               "function, are not read: export it as text");
    if (std::isfinite(next_s_)) rows_before(last_s_ + 0.5 * step_s_);
    if (recording_.time.empty()) throw_no_rows(source_, last_s_, options_);
    fill_absent(recording_);
    return std::move(recording_);
  }

 private:
  void add_signal(const XML_Char** attributes) {
    const double interval_s = number_in(attribute(attributes, "interval"));
    if (!(interval_s > 0.0 && std::isfinite(interval_s)))
      throw std::runtime_error(source_ + ": the interval of signal " +
                               in_quotes(attribute(attributes, "name")) + " must be positive");
    ids_.emplace_back(attribute(attributes, "id"));
    names_.push_back(short_name(attribute(attributes, "name")));
    if (std::count(names_.begin(), names_.end(), names_.back()) > 1)
      names_.back() += "_" + ids_.back();
    intervals_s_.push_back(interval_s);
  }

  void lay_out_columns() {
    std::vector<std::string> names{"time[s]"};
    names.insert(names.end(), names_.begin(), names_.end());
    layout_ = lay_out(source_, names, options_);
    recording_.source = source_;
    recording_.axes = layout_.axes;
    step_s_ = 0.0;
    for (const Layout::Column& column : layout_.columns) {
      if (column.index == 0 || column.index > ids_.size())
        throw std::runtime_error(source_ + ": the time is no channel of an axis");
      step_s_ = std::max(step_s_, intervals_s_[column.index - 1]);
    }
    values_.assign(ids_.size(), kAbsent);
    recording_.notes = {"SINUMERIK trace, a row every " + number(1e3 * step_s_) + " ms"};
    recording_.notes.insert(recording_.notes.end(), notes_.begin(), notes_.end());
    recording_.notes.insert(recording_.notes.end(), layout_.notes.begin(), layout_.notes.end());
    laid_out_ = true;
  }

  void take(const XML_Char** attributes) {
    if (!laid_out_) lay_out_columns();
    const double time_s = number_in(attribute(attributes, "time"));
    if (!std::isfinite(time_s) || time_s < last_s_)
      throw std::runtime_error(source_ + ": the time of a record, " +
                               in_quotes(attribute(attributes, "time")) +
                               ", must be a number that does not decrease");
    if (std::isfinite(next_s_)) {
      if ((time_s - begin_s_) / step_s_ >
          kMaxRestRows + kMaxRowsPerRecord * static_cast<double>(++records_))
        throw std::runtime_error(source_ + ": a record at " + number(time_s) +
                                 " s follows one at " + number(last_s_) +
                                 " s: that many rows cannot be of this few records");
      rows_before(time_s - 0.25 * step_s_);
    }
    last_s_ = time_s;
    bool slowest = false;
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      const std::string_view text = attribute(attributes, ids_[i]);
      if (text.empty()) continue;
      const double value = number_in(text);
      values_[i] = std::abs(value) < kNoValue ? value : kAbsent;
      slowest = slowest || (is_used(i) && intervals_s_[i] == step_s_);
    }
    // The rows begin where the slowest signal is sampled.
    if (!std::isfinite(next_s_) && slowest) begin_s_ = next_s_ = time_s;
  }

  [[nodiscard]] bool is_used(std::size_t signal) const {
    return std::any_of(layout_.columns.begin(), layout_.columns.end(),
                       [&](const Layout::Column& c) { return c.index == signal + 1; });
  }

  /// The rows until before this time, with the values that are known by now.
  void rows_before(double end_s) {
    for (; next_s_ < end_s; next_s_ = begin_s_ + step_s_ * static_cast<double>(++row_)) {
      const double since_s = next_s_ - begin_s_;
      if (!(since_s >= options_.from_s && since_s <= options_.to_s)) continue;
      recording_.time.push_back(since_s);
      for (const Layout::Column& column : layout_.columns)
        values_of(recording_.axes[column.axis], column.channel)
            .push_back(column.unit.to_si(values_[column.index - 1]));
    }
  }

  std::string source_;
  const ReadOptions& options_;
  bool in_data_ = false, laid_out_ = false;
  std::vector<std::string> ids_, names_, notes_;  // of the signals; for the recording
  std::vector<double> intervals_s_, values_;      // of the signals
  Layout layout_;
  Recording recording_;
  double step_s_ = 0.0, begin_s_ = 0.0;
  double next_s_ = kAbsent;    // of the next row
  double last_s_ = -HUGE_VAL;  // of the last record
  std::size_t row_ = 0, records_ = 0;
};

/// What goes through the C library: the trace, and what it threw.
struct Parse {
  Trace trace;
  std::exception_ptr thrown;
  XML_Parser parser = nullptr;
};

void XMLCALL on_element(void* data, const XML_Char* name, const XML_Char** attributes) {
  auto& parse = *static_cast<Parse*>(data);
  if (parse.thrown) return;
  try {
    parse.trace.element(name, attributes);
  } catch (...) {
    parse.thrown = std::current_exception();
    XML_StopParser(parse.parser, XML_FALSE);
  }
}

}  // namespace

bool is_sinumerik_trace(std::string_view start) noexcept {
  return start.find("<?xml") < 4 &&
         (start.find("<traceSession") != start.npos || start.find("<traceData") != start.npos);
}

Recording read_sinumerik_trace(const std::filesystem::path& file, const ReadOptions& options) {
  const std::string source = file.string();
  Parse parse{Trace(source, options), nullptr, nullptr};
  const std::unique_ptr<std::remove_pointer_t<XML_Parser>, decltype(&XML_ParserFree)> parser(
      XML_ParserCreate(nullptr), &XML_ParserFree);
  if (!parser) throw std::bad_alloc();
  parse.parser = parser.get();
  XML_SetUserData(parser.get(), &parse);
  XML_SetStartElementHandler(parser.get(), on_element);
  FileHandle in = FileHandle::open(file, O_RDONLY);
  std::string block(std::size_t{1} << 16, '\0');
  bool at_end = false;
  while (!at_end) {
    const std::size_t count = in.read(block.data(), block.size());
    at_end = count == 0;
    const XML_Status status =
        XML_Parse(parser.get(), block.data(), static_cast<int>(count), at_end ? 1 : 0);
    if (parse.thrown) std::rethrow_exception(parse.thrown);
    if (status == XML_STATUS_OK) continue;
    throw std::runtime_error(source + ":" + std::to_string(XML_GetCurrentLineNumber(parser.get())) +
                             ": this SINUMERIK trace cannot be read: " +
                             XML_ErrorString(XML_GetErrorCode(parser.get())));
  }
  return parse.trace.recording();
}

}  // namespace servotwin
