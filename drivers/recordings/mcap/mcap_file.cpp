#include "drivers/recordings/mcap/mcap_file.h"

#include <fcntl.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

#include "drivers/common/checksum.h"
#include "drivers/common/memory.h"
#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr std::string_view kMagic = "\x89MCAP0\r\n";
enum McapOpcode : std::uint8_t {
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kDataEnd = 0x0f,
};
constexpr std::size_t kRecordHead = 9;  // bytes: opcode and length
// Topics and definitions are kept; those of a large robot are some hundred kB.
constexpr std::size_t kMostDeclaredBytes = std::size_t{64} << 20;

/// The fields of a record, one after the other.
class Fields {
 public:
  explicit Fields(std::string_view bytes) : rest_(bytes) {}
  template <class Integer>
  Integer integer() {
    const std::string_view bytes = take(sizeof(Integer));
    std::uint64_t value = 0;
    for (std::size_t i = bytes.size(); i-- > 0;)
      value = value << 8 | static_cast<std::uint8_t>(bytes[i]);
    return static_cast<Integer>(value);
  }
  std::string_view take(std::uint64_t size) {
    if (size > rest_.size()) throw std::out_of_range("a field is longer than its record");
    const std::string_view bytes = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return bytes;
  }
  std::string_view text() { return take(integer<std::uint32_t>()); }
  [[nodiscard]] std::string_view rest() const { return rest_; }

 private:
  std::string_view rest_;
};

/// Unpacks into `to`, whose size is the one that the file gives; returns what is wrong.
std::string unzstd(std::string_view packed, std::string& to) {
  const std::size_t size = ZSTD_decompress(to.data(), to.size(), packed.data(), packed.size());
  if (ZSTD_isError(size) != 0) return ZSTD_getErrorName(size);
  return size == to.size() ? "" : "it has " + std::to_string(size) + " bytes";
}

std::string unlz4(std::string_view packed, std::string& to) {
  LZ4F_dctx* made = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION)) != 0)
    throw std::bad_alloc();
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      made, LZ4F_freeDecompressionContext);
  std::size_t done = 0, wanted = 0;
  while (!packed.empty()) {
    std::size_t out = to.size() - done, in = packed.size();
    wanted = LZ4F_decompress(context.get(), to.data() + done, &out, packed.data(), &in, nullptr);
    if (LZ4F_isError(wanted) != 0) return LZ4F_getErrorName(wanted);
    if (in == 0 && out == 0) break;  // there is no room for more
    done += out;
    packed.remove_prefix(in);
  }
  if (wanted != 0) return "it has more bytes, or its end is missing";
  return done == to.size() ? "" : "it has " + std::to_string(done) + " bytes";
}

}  // namespace

McapFile::McapFile(const std::filesystem::path& file)
    : file_(file),
      handle_(FileHandle::open(file, O_RDONLY)),
      size_(std::filesystem::file_size(file)),
      at_(kMagic.size()) {
  std::string magic(kMagic.size(), '\0');
  magic.resize(handle_.read_at(magic.data(), magic.size(), 0));
  if (magic != kMagic)
    throw std::runtime_error(file.string() +
                             ": does not begin like an MCAP file of version 0, the only known one");
  crc32_ = crc32_of(magic);
}

void McapFile::refuse(const std::string& why) const {
  throw std::runtime_error(file_.string() + ": record at byte " + std::to_string(begin_) + ": " +
                           why + "; 'mcap recover IN -o OUT' saves what is whole");
}

const McapSchema* McapFile::schema(std::uint16_t id) const {
  const auto found = schemas_.find(id);
  return found == schemas_.end() ? nullptr : &found->second;
}

bool McapFile::next(McapMessage& message) {
  try {
    for (;;) {
      while (!pending_.empty())
        if (take(record_in_chunk(), message)) return true;
      Record record;
      if (ended_ || !read_record(record)) return false;
      if (record.opcode == kChunk) {
        open_chunk(record.content);
      } else if (take(record, message)) {
        return true;
      }
    }
  } catch (const std::out_of_range& short_record) {
    refuse(short_record.what());
  }
}

// False at the end of the data: what follows repeats it, for readers that search.
bool McapFile::read_record(Record& record) {
  begin_ = at_;
  ended_ = true;
  const std::uint64_t left = size_ - std::min(size_, at_);
  std::string head(kRecordHead, '\0');
  head.resize(handle_.read_at(head.data(), kRecordHead, at_));
  const auto cut_off = [&](const std::string& how) {
    missing_ = "cut off or not closed by its recorder: " + how;
    return false;
  };
  const std::string rest = counted(left, "byte") + " from byte " + std::to_string(at_) + " on " +
                           (left == 1 ? "is" : "are") + " not read";
  if (left == 0) return cut_off("its end is missing");
  if (head.size() < kRecordHead) return cut_off("the last " + rest);
  Fields fields(head);
  record.opcode = fields.integer<std::uint8_t>();
  const auto length = fields.integer<std::uint64_t>();
  // A file system fills what was not written before a power failure with zeros.
  if (record.opcode == 0) return cut_off("the last " + rest + " (they are no records)");
  if (length > left - kRecordHead) {
    return cut_off("the last record would have " + std::to_string(length) + " bytes; the " + rest);
  }

  const std::uint32_t crc32_before = crc32_;
  crc32_ = crc32_of(head, crc32_);
  const bool kept =
      record.opcode == kDataEnd || (record.opcode >= kSchema && record.opcode <= kChunk);
  constexpr std::uint64_t kPiece = std::uint64_t{1} << 20;  // attachments may be large
  content_.clear();
  for (std::uint64_t read = 0; read < length;) {
    const auto piece = static_cast<std::size_t>(std::min(kPiece, length - read));
    const std::size_t before = kept ? content_.size() : 0;
    content_.resize(before + piece);
    if (handle_.read_at(content_.data() + before, piece, at_ + kRecordHead + read) != piece)
      return cut_off("the last " + rest);
    crc32_ = crc32_of(std::string_view(content_).substr(before), crc32_);
    read += piece;
  }
  at_ += kRecordHead + length;
  record.content = content_;
  ended_ = record.opcode == kDataEnd || record.opcode == kFooter;
  if (record.opcode == kDataEnd) {
    const auto written = Fields(record.content).integer<std::uint32_t>();
    if (written != 0 && written != crc32_before)
      refuse("the data before it have the CRC-32 " + crc32_text(crc32_before) +
             ", but were written with " + crc32_text(written) + ": the file is damaged");
  }
  return !ended_;
}

McapFile::Record McapFile::record_in_chunk() {
  Fields fields(pending_);
  Record record{fields.integer<std::uint8_t>(), {}};
  record.content = fields.take(fields.integer<std::uint64_t>());
  pending_ = fields.rest();
  return record;
}

void McapFile::open_chunk(std::string_view content) {
  Fields fields(content);
  fields.take(2 * sizeof(std::uint64_t));  // times
  const auto size = fields.integer<std::uint64_t>();
  const auto crc32 = fields.integer<std::uint32_t>();
  const std::string compression(fields.text());
  const std::string_view records = fields.take(fields.integer<std::uint64_t>());
  if (compression != "zstd" && compression != "lz4" && !compression.empty())
    refuse("the chunk has the unknown compression " + in_quotes(compression) +
           "; known are none, 'lz4' and 'zstd'");
  require_plausible_size(file_, static_cast<double>(size), "a chunk", kMcapRemedy);
  std::string wrong;
  if (compression.empty()) {
    chunk_ = records;
    if (records.size() != size) wrong = "it has " + std::to_string(records.size()) + " bytes";
  } else {
    chunk_.resize(size);
    wrong = compression == "lz4" ? unlz4(records, chunk_) : unzstd(records, chunk_);
  }
  if (!wrong.empty())
    refuse("the chunk should unpack to " + std::to_string(size) + " bytes, but " +
           in_quotes(wrong) + ": the file is damaged");
  if (crc32 != 0 && crc32 != crc32_of(chunk_))
    refuse("the chunk has the CRC-32 " + crc32_text(crc32_of(chunk_)) + ", but was written with " +
           crc32_text(crc32) + ": the file is damaged");
  pending_ = chunk_;
}

// True if the record is a message.
bool McapFile::take(const Record& record, McapMessage& message) {
  Fields fields(record.content);
  if (record.opcode == kSchema) {
    const auto id = fields.integer<std::uint16_t>();
    if (id == 0 || schemas_.contains(id)) return false;  // invalid; a copy
    count_declared(record.content.size());
    McapSchema& schema = schemas_[id];
    schema.type = fields.text();
    schema.encoding = fields.text();
    schema.definition = fields.text();
  } else if (record.opcode == kChannel) {
    const auto id = fields.integer<std::uint16_t>();
    McapChannel channel;
    channel.schema = fields.integer<std::uint16_t>();
    channel.topic = fields.text();
    channel.encoding = fields.text();
    const auto [known, added] = channels_.emplace(id, channel);
    if (added) count_declared(record.content.size());
    if (known->second.schema != channel.schema || known->second.topic != channel.topic)
      refuse("channel " + std::to_string(id) + " is declared as " + in_quotes(channel.topic) +
             ", but before as " + in_quotes(known->second.topic) + ": the file is damaged");
  } else if (record.opcode == kMessage) {
    message.channel = fields.integer<std::uint16_t>();
    fields.take(sizeof(std::uint32_t));  // sequence
    message.log_time_ns = fields.integer<std::uint64_t>();
    fields.take(sizeof(std::uint64_t));  // time of publication
    message.bytes = fields.rest();
    if (!channels_.contains(message.channel))
      refuse("a message of channel " + std::to_string(message.channel) +
             ", which is not declared before it: the file is damaged");
    return true;
  }
  return false;
}

void McapFile::count_declared(std::size_t bytes) {
  declared_bytes_ += bytes;
  if (declared_bytes_ > kMostDeclaredBytes)
    refuse("topics and definitions of more than " + std::to_string(kMostDeclaredBytes >> 20) +
           " MB");
}

}  // namespace servotwin
