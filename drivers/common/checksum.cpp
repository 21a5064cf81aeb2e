#include "drivers/common/checksum.h"

#include <zlib.h>

#include <cstdio>

namespace servotwin {

std::uint32_t crc32_of(std::string_view bytes, std::uint32_t before) noexcept {
  return static_cast<std::uint32_t>(
      crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::string crc32_text(std::uint32_t crc32) {
  char text[9];
  std::snprintf(text, sizeof text, "%08x", crc32);
  return text;
}

}  // namespace servotwin
