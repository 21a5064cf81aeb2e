// Messages of an MCAP file, in the order of the file; drivers/recordings/mcap/mcap.h gives them
// their meaning.
//
//   magic, records (opcode, length, content), magic; Schema, Channel and Message records stand in
//   the file or in chunks, which may be packed with zstd or lz4
// The file is read from its start, so that a recording whose recorder was stopped is read as far as
// it is complete. Errors: std::runtime_error with file and byte for a damaged record, a checksum
// that does not match, an unknown compression. One thread at a time. Source: the specification of
// MCAP (foxglove/mcap, website/docs/spec).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "drivers/common/file_handle.h"

namespace servotwin {

/// For what a small file would unpack to.
inline constexpr const char* kMcapRemedy = "unpack it: mcap decompress IN -o OUT";

/// How the messages of channels are laid out.
struct McapSchema {
  std::string type;      ///< "sensor_msgs/msg/JointState"
  std::string encoding;  ///< of `definition`: "ros2msg", "ros2idl", ...
  std::string definition;
};

struct McapChannel {
  std::uint16_t schema = 0;  ///< 0: none
  std::string topic;
  std::string encoding;  ///< of the messages: "cdr", "json", ...
};

struct McapMessage {
  std::uint16_t channel = 0;
  std::uint64_t log_time_ns = 0;
  std::string_view bytes;  ///< valid until the next message is read
};

class McapFile {
 public:
  explicit McapFile(const std::filesystem::path& file);

  /// Reads the next message; false at the end. Its channel and schema have been read then.
  [[nodiscard]] bool next(McapMessage& message);
  [[nodiscard]] const std::map<std::uint16_t, McapChannel>& channels() const { return channels_; }
  /// Null if the file has no such schema.
  [[nodiscard]] const McapSchema* schema(std::uint16_t id) const;
  /// What the file lacks at its end, for output; empty if it is complete.
  [[nodiscard]] const std::string& missing() const { return missing_; }

 private:
  struct Record {
    std::uint8_t opcode = 0;
    std::string_view content;
  };
  [[nodiscard]] bool read_record(Record& record);
  [[nodiscard]] Record record_in_chunk();
  [[nodiscard]] bool take(const Record& record, McapMessage& message);
  void open_chunk(std::string_view content);
  void count_declared(std::size_t bytes);
  [[noreturn]] void refuse(const std::string& why) const;

  std::filesystem::path file_;
  FileHandle handle_;
  std::uint64_t size_ = 0, at_ = 0, begin_ = 0;  // of the file; next record; record being read
  std::uint32_t crc32_ = 0;                      // of the file up to that record
  bool ended_ = false;
  std::string content_;       // of a record in the file
  std::string chunk_;         // unpacked records
  std::string_view pending_;  // records of the chunk that are still to be read
  std::map<std::uint16_t, McapSchema> schemas_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::size_t declared_bytes_ = 0;
  std::string missing_;
};

}  // namespace servotwin
