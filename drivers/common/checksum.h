// CRC-32 as of zlib, gzip and PNG: finds every flipped bit and every burst of up to 32 bits. It
// tells damage, not forgery. Any thread.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace servotwin {

/// CRC-32 of `bytes`; `before`: the CRC-32 of the bytes before them.
[[nodiscard]] std::uint32_t crc32_of(std::string_view bytes, std::uint32_t before = 0) noexcept;

/// As eight hexadecimal digits, lower case.
[[nodiscard]] std::string crc32_text(std::uint32_t crc32);

}  // namespace servotwin
