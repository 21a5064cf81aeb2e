// Writes MCAP files and messages of ROS 2 for tests, by the specifications and without the code
// that reads them.
#pragma once

#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

namespace servotwin::test {

/// An integer in little endian, as all of MCAP.
template <class Integer>
std::string little(Integer value) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}

inline std::string prefixed(std::string_view text) {
  return little(static_cast<std::uint32_t>(text.size())) + std::string(text);
}

inline std::uint32_t crc32_by_zlib(std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

inline constexpr std::string_view kMcapMagic = "\x89MCAP0\r\n";

inline std::string record(char opcode, std::string_view content) {
  return opcode + little(static_cast<std::uint64_t>(content.size())) + std::string(content);
}
inline std::string schema(std::uint16_t id, std::string_view type, std::string_view definition,
                          std::string_view encoding = "ros2msg") {
  return record(3, little(id) + prefixed(type) + prefixed(encoding) + prefixed(definition));
}
inline std::string channel(std::uint16_t id, std::uint16_t schema_id, std::string_view topic,
                           std::string_view encoding = "cdr") {
  return record(4, little(id) + little(schema_id) + prefixed(topic) + prefixed(encoding) +
                       little(std::uint32_t{0}));
}
inline std::string message(std::uint16_t channel_id, std::uint64_t log_ns, std::string_view data) {
  return record(5, little(channel_id) + little(std::uint32_t{0}) + little(log_ns) + little(log_ns) +
                       std::string(data));
}

/// `packed`: the records as they are in the file.
inline std::string chunk(std::string_view compression, std::string_view packed, std::uint64_t size,
                         std::uint32_t crc32) {
  return record(6, little(std::uint64_t{0}) + little(std::uint64_t{0}) + little(size) +
                       little(crc32) + prefixed(compression) +
                       little(static_cast<std::uint64_t>(packed.size())) + std::string(packed));
}
inline std::string packed_by(std::string_view compression, std::string_view records) {
  std::string packed(compression == "lz4" ? LZ4F_compressFrameBound(records.size(), nullptr)
                                          : ZSTD_compressBound(records.size()),
                     '\0');
  packed.resize(compression == "lz4" ? LZ4F_compressFrame(packed.data(), packed.size(),
                                                          records.data(), records.size(), nullptr)
                                     : ZSTD_compress(packed.data(), packed.size(), records.data(),
                                                     records.size(), 3));
  return packed;
}
inline std::string chunk(std::string_view records, std::string_view compression) {
  return chunk(compression,
               compression.empty() ? std::string(records) : packed_by(compression, records),
               records.size(), crc32_by_zlib(records));
}

inline std::string mcap(std::string_view data) {
  const std::string begin =
      std::string(kMcapMagic) + record(1, prefixed("ros2") + prefixed("test")) + std::string(data);
  const std::string footer(20, '\0');
  return begin + record(15, little(crc32_by_zlib(begin))) + record(2, footer) +
         std::string(kMcapMagic);
}

/// A message in CDR, version 1.
class Cdr {
 public:
  explicit Cdr(bool big_endian = false) : big_(big_endian) {}
  template <class Number>
  Cdr& number(Number value) {
    bytes_.resize((bytes_.size() + sizeof value - 1) / sizeof value * sizeof value, '\0');
    std::string raw = little(value);
    bytes_ += big_ ? std::string(raw.rbegin(), raw.rend()) : raw;
    return *this;
  }
  Cdr& text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size() + 1));
    bytes_ += std::string(text) + '\0';
    return *this;
  }
  Cdr& texts(const std::vector<std::string>& all) {
    number(static_cast<std::uint32_t>(all.size()));
    for (const std::string& one : all) text(one);
    return *this;
  }
  Cdr& doubles(const std::vector<double>& all) {
    number(static_cast<std::uint32_t>(all.size()));
    for (const double one : all) number(one);
    return *this;
  }
  /// std_msgs/Header; an odd name, so that what follows has to be aligned.
  Cdr& header(std::int32_t seconds, std::uint32_t nanoseconds) {
    return number(seconds).number(nanoseconds).text("base");
  }
  /// trajectory_msgs/JointTrajectoryPoint
  Cdr& point(const std::vector<double>& positions, const std::vector<double>& effort = {}) {
    return doubles(positions).doubles({}).doubles({}).doubles(effort).number(0).number(0U);
  }
  [[nodiscard]] std::string bytes() const {
    return std::string("\0", 1) + (big_ ? '\0' : '\1') + std::string(2, '\0') + bytes_;
  }

 private:
  bool big_;
  std::string bytes_;  // behind the head, from where numbers are aligned
};

}  // namespace servotwin::test
