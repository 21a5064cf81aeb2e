#include "cli/export/zip.h"

#include <zip.h>

#include <memory>
#include <stdexcept>

namespace servotwin {
namespace {

[[noreturn]] void fail(zip_error_t* error) {
  throw std::runtime_error(std::string("the unit cannot be packed: ") + zip_error_strerror(error));
}

}  // namespace

std::string zipped(const std::vector<PackedFile>& files) {
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* bytes = zip_source_buffer_create(nullptr, 0, 0, &error);
  if (bytes == nullptr) fail(&error);
  const std::unique_ptr<zip_source_t, decltype([](zip_source_t* s) { zip_source_free(s); })> kept(
      bytes);
  zip_source_keep(bytes);  // the archive releases its own reference
  zip_t* archive = zip_open_from_source(bytes, ZIP_TRUNCATE, &error);
  if (archive == nullptr) {
    zip_source_free(bytes);
    fail(&error);
  }
  constexpr zip_uint16_t kDosDay = (0 << 9) | (1 << 5) | 1;  // 1980-01-01 stands for no date
  for (const PackedFile& file : files) {
    zip_source_t* content = zip_source_buffer(archive, file.content.data(), file.content.size(), 0);
    const zip_int64_t place =
        content == nullptr ? -1
                           : zip_file_add(archive, file.name.c_str(), content, ZIP_FL_ENC_UTF_8);
    if (place < 0 ||
        zip_file_set_dostime(archive, static_cast<zip_uint64_t>(place), 0, kDosDay, 0) != 0) {
      if (place < 0) zip_source_free(content);
      error = *zip_get_error(archive);
      zip_discard(archive);
      fail(&error);
    }
  }
  if (zip_close(archive) != 0) {
    error = *zip_get_error(archive);
    zip_discard(archive);
    fail(&error);
  }
  zip_stat_t stat;
  zip_stat_init(&stat);
  if (zip_source_stat(bytes, &stat) != 0 || zip_source_open(bytes) != 0)
    fail(zip_source_error(bytes));
  std::string out(stat.size, '\0');
  const zip_int64_t read = zip_source_read(bytes, out.data(), out.size());
  zip_source_close(bytes);
  if (read != static_cast<zip_int64_t>(out.size())) fail(zip_source_error(bytes));
  return out;
}

}  // namespace servotwin
