#include "daemon/store/write_ahead_log.h"

#include <fcntl.h>

#include <array>
#include <cstdint>
#include <string_view>

#include "drivers/common/file_handle.h"

namespace servotwin::daemon {
namespace {

constexpr std::size_t kHeader = 32, kFrameHeader = 24;  // bytes

std::uint32_t big_endian(const char* bytes) {
  std::uint32_t out = 0;
  for (int i = 0; i < 4; ++i) out = out << 8 | static_cast<unsigned char>(bytes[i]);
  return out;
}

std::uint32_t little_endian(const char* bytes) {
  std::uint32_t out = 0;
  for (int i = 3; i >= 0; --i) out = out << 8 | static_cast<unsigned char>(bytes[i]);
  return out;
}

bool has_its_checksum(const std::array<char, kHeader>& header) {
  const bool big = (big_endian(header.data()) & 1) != 0;
  std::uint32_t first = 0, second = 0;
  for (std::size_t at = 0; at < 24; at += 8) {
    const auto word = [&](std::size_t i) {
      return big ? big_endian(&header[i]) : little_endian(&header[i]);
    };
    first += word(at) + second;
    second += word(at + 4) + first;
  }
  return first == big_endian(&header[24]) && second == big_endian(&header[28]);
}

}  // namespace

std::vector<int> commits_in_log(const std::filesystem::path& log, std::size_t page_size) {
  std::vector<int> commits;
  if (!std::filesystem::exists(log) || page_size == 0) return commits;
  const FileHandle file = FileHandle::open(log, O_RDONLY);
  std::array<char, kHeader> header{};
  if (file.read_at(header.data(), kHeader, 0) < kHeader) return commits;
  // Frames of before the last checkpoint have other salts. Where the header is damaged itself, the
  // first frame has them.
  std::array<char, kFrameHeader> frame{};
  std::array<char, 8> salts{};
  // SQLite writes a frame's header and then its page: a process that is killed in between leaves a
  // frame without an end, whose transaction nobody was told of.
  const std::uintmax_t size = std::filesystem::file_size(log);
  const auto next = [&](int number) {
    const std::uint64_t at = kHeader + (kFrameHeader + page_size) * (number - 1ULL);
    return at + kFrameHeader + page_size <= size &&
           file.read_at(frame.data(), kFrameHeader, at) == kFrameHeader;
  };
  const auto salts_of = [](const char* bytes) { return std::string_view(bytes, 8); };
  if (has_its_checksum(header)) {
    salts_of(&header[16]).copy(salts.data(), 8);
  } else if (next(1)) {
    salts_of(&frame[8]).copy(salts.data(), 8);
  }
  for (int number = 1; next(number); ++number) {
    const bool ends_transaction = big_endian(&frame[4]) != 0;
    if (ends_transaction && salts_of(&frame[8]) == salts_of(salts.data()))
      commits.push_back(number);
  }
  return commits;
}

}  // namespace servotwin::daemon
