#include "drivers/recordings/can_log/can_log.h"

#include <fcntl.h>

#include <stdexcept>
#include <utility>

namespace servotwin {

namespace {

constexpr std::size_t kBlock = 1 << 16;

}  // namespace

bool is_can_log(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;
  std::string start(4096, '\0');
  start.resize(FileHandle::open(file, O_RDONLY).read(start.data(), start.size()));
  return can_log_form(start).has_value();
}

CanLogReader::CanLogReader(const std::filesystem::path& file, std::optional<CanLogForm> named)
    : name_(file.string()), file_(FileHandle::open(file, O_RDONLY)), lines_(read_block(), named) {}

std::string_view CanLogReader::read_block() {
  const std::size_t kept = block_.size();
  block_.resize(kept + kBlock);
  const std::size_t count = file_.read(block_.data() + kept, kBlock);
  block_.resize(kept + count);
  at_end_ = count == 0;
  return block_;
}

bool CanLogReader::next_text(std::string_view& text) {
  std::size_t end = block_.find('\n', begin_);
  while (end == std::string::npos && !at_end_) {
    const std::size_t searched = block_.size() - begin_;
    block_.erase(0, begin_);
    begin_ = 0;
    if (block_.size() > kBlock) {
      throw std::runtime_error(name_ + ":" + std::to_string(line_ + 1) +
                               ": a line of more than 65536 characters is not a line of a CAN log");
    }
    read_block();
    end = block_.find('\n', searched);
  }
  whole_ = end != std::string::npos;
  if (!whole_) end = block_.size();
  if (begin_ >= block_.size()) return false;
  text = std::string_view(block_).substr(begin_, end - begin_);
  begin_ = std::min(end + 1, block_.size());
  ++line_;
  return true;
}

bool CanLogReader::next(CandumpLine& line) {
  std::string_view text;
  while (next_text(text)) {
    std::optional<CandumpLine> frame;
    try {
      frame = lines_.parse(text);
    } catch (const std::runtime_error& error) {
      // A recorder that was killed leaves an incomplete line.
      if (!whole_) {
        notes_.push_back(name_ + ":" + std::to_string(line_) +
                         ": the last line is cut off and dropped");
        return false;
      }
      throw std::runtime_error(name_ + ":" + std::to_string(line_) + ": " + error.what());
    }
    if (!frame) continue;
    if (!whole_) {
      notes_.push_back(name_ + ":" + std::to_string(line_) +
                       ": the last line has no end and is dropped: its data may be cut off");
      return false;
    }
    line = std::move(*frame);
    return true;
  }
  return false;
}

}  // namespace servotwin
