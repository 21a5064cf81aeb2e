#include "drivers/dds/dds_log.h"

#include <dds/ddsrt/log.h>
#include <unistd.h>

#include <chrono>
#include <utility>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

void write_limited(void* limit, const dds_log_data_t* data) {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  const std::string text = static_cast<LineLimit*>(limit)->pass(
      data->message, std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
  // In one piece: other threads write as well. Nobody could be told that standard error is closed.
  if (!text.empty()) (void)!write(STDERR_FILENO, text.data(), text.size());
}

}  // namespace

std::string LineLimit::pass(std::string_view line, std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  std::string out;
  if (!begun_ || now_ns - began_ns_ >= kPeriod_ns) {
    begun_ = true;
    began_ns_ = now_ns;
    lines_ = 0;
    if (left_out_ > 0)
      out = "Cyclone DDS: " + counted(std::exchange(left_out_, 0), "line") + " left out\n";
  }
  if (lines_ == kMaxLines) {
    ++left_out_;
    return out;
  }
  ++lines_;
  out += line;
  if (out.back() != '\n') out += '\n';
  if (lines_ == kMaxLines)
    out += "Cyclone DDS: more than " + std::to_string(kMaxLines) +
           " lines in a minute; the next ones are counted\n";
  return out;
}

void limit_dds_log() {
  // Never destroyed: threads of Cyclone DDS may report until the process ends.
  static LineLimit& limit = []() -> LineLimit& {
    auto& made = *new LineLimit;
    dds_set_log_sink(write_limited, &made);
    return made;
  }();
  (void)limit;
}

}  // namespace servotwin
