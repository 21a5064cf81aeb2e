#include "drivers/common/text_lines.h"

#include <fcntl.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace servotwin {
namespace {

constexpr std::string_view kUtf8Mark = "\xef\xbb\xbf", kUtf16LittleMark = "\xff\xfe",
                           kUtf16BigMark = "\xfe\xff";
constexpr char32_t kReplacement = 0xfffd;  // for half of a pair of code units

}  // namespace

TextLines::TextLines(const std::filesystem::path& file)
    : source_(file.string()), file_(FileHandle::open(file, O_RDONLY)), block_(kMaxLineBytes, '\0') {
  end_ = file_.read(block_.data(), block_.size());
  ended_ = end_ == 0;
  const std::string_view start(block_.data(), end_);
  if (start.starts_with(kUtf8Mark)) begin_ = kUtf8Mark.size();
  if (!start.starts_with(kUtf16LittleMark) && !start.starts_with(kUtf16BigMark)) return;
  encoding_ = start.starts_with(kUtf16LittleMark) ? Encoding::kUtf16Little : Encoding::kUtf16Big;
  raw_ = start.substr(kUtf16LittleMark.size());
  end_ = 0;
}

bool TextLines::next(std::string_view& line) {
  while (true) {
    const char* begin = block_.data() + begin_;
    const auto* end = static_cast<const char*>(std::memchr(begin, '\n', end_ - begin_));
    if (end != nullptr || (ended_ && begin_ < end_)) {
      complete_ = end != nullptr;
      const std::size_t length = complete_ ? static_cast<std::size_t>(end - begin) : end_ - begin_;
      line = std::string_view(begin, length);
      if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
      last_ = begin_;
      begin_ += length + (complete_ ? 1 : 0);
      ++number_;
      return true;
    }
    if (ended_) return false;
    refill();
  }
}

void TextLines::put_back() {
  begin_ = last_;
  --number_;
}

void TextLines::fail(const std::string& what) const {
  throw std::runtime_error(source_ + ": line " + std::to_string(number_) + ": " + what);
}

void TextLines::refill() {
  std::memmove(block_.data(), block_.data() + begin_, end_ - begin_);
  end_ -= begin_;
  begin_ = 0;
  constexpr std::size_t kRoom_bytes = 6;  // for a decoded pair of code units
  if (end_ + (encoding_ == Encoding::kUtf8 ? 1 : kRoom_bytes) > block_.size()) {
    ++number_;
    fail("is longer than a megabyte: this is not a CSV recording");
  }
  ended_ = !read_more();
}

bool TextLines::read_more() {
  if (encoding_ != Encoding::kUtf8) return read_utf16();
  const std::size_t count = file_.read(block_.data() + end_, block_.size() - end_);
  end_ += count;
  return count > 0;
}

bool TextLines::read_utf16() {
  // A code unit of two bytes becomes at most three.
  constexpr std::size_t kMostPerUnit = 3;
  if (raw_.size() < 4) {
    const std::size_t kept = raw_.size();
    raw_.resize(kept + block_.size() / 2);
    raw_.resize(kept + file_.read(raw_.data() + kept, raw_.size() - kept));
  }
  const bool little = encoding_ == Encoding::kUtf16Little;
  const auto unit = [&](std::size_t at) {
    const auto low = static_cast<unsigned char>(raw_[at + (little ? 0 : 1)]),
               high = static_cast<unsigned char>(raw_[at + (little ? 1 : 0)]);
    return static_cast<char32_t>(high << 8 | low);
  };
  std::size_t at = 0;
  const std::size_t before = end_;
  while (at + 2 <= raw_.size() && end_ + 2 * kMostPerUnit <= block_.size()) {
    char32_t code = unit(at);
    const bool first_half = 0xd800 <= code && code < 0xdc00;
    if (first_half && at + 4 > raw_.size()) break;
    at += 2;
    if (first_half) {
      const char32_t second = unit(at);
      const bool pair = 0xdc00 <= second && second < 0xe000;
      code = pair ? 0x10000 + ((code - 0xd800) << 10) + (second - 0xdc00) : kReplacement;
      at += pair ? 2 : 0;
    } else if (0xdc00 <= code && code < 0xe000) {
      code = kReplacement;
    }
    append_utf8(code);
  }
  raw_.erase(0, at);
  return end_ > before;
}

void TextLines::append_utf8(char32_t code) {
  const auto put = [this](char32_t byte) { block_[end_++] = static_cast<char>(byte); };
  if (code < 0x80) {
    put(code);
  } else if (code < 0x800) {
    put(0xc0 | code >> 6);
    put(0x80 | (code & 0x3f));
  } else if (code < 0x10000) {
    put(0xe0 | code >> 12);
    put(0x80 | (code >> 6 & 0x3f));
    put(0x80 | (code & 0x3f));
  } else {
    put(0xf0 | code >> 18);
    put(0x80 | (code >> 12 & 0x3f));
    put(0x80 | (code >> 6 & 0x3f));
    put(0x80 | (code & 0x3f));
  }
}

}  // namespace servotwin
