#include "daemon/store/store_checksum.h"

#include <string_view>

#include "drivers/common/checksum.h"

namespace servotwin::daemon {
namespace {

/// With type and length, so that no two different rows are the same bytes.
void row_crc32(sqlite3_context* context, int count, sqlite3_value** values) {
  std::uint32_t crc = 0;
  for (int i = 0; i < count; ++i) {
    const int type = sqlite3_value_type(values[i]);
    const auto* text = reinterpret_cast<const char*>(sqlite3_value_text(values[i]));
    const auto size = static_cast<std::size_t>(sqlite3_value_bytes(values[i]));
    const std::string head = std::to_string(type) + ":" + std::to_string(size) + ":";
    crc = crc32_of(head, crc);
    if (text != nullptr) crc = crc32_of(std::string_view(text, size), crc);
  }
  sqlite3_result_int64(context, crc);
}

}  // namespace

void add_row_crc32(sqlite3* database) {
  sqlite3_create_function_v2(database, "row_crc32", -1, SQLITE_UTF8 | SQLITE_DETERMINISTIC, nullptr,
                             row_crc32, nullptr, nullptr, nullptr);
}

std::string checksum(const StoreTable& table) {
  return std::string("row_crc32(") + table.columns + ")";
}

std::string intact(const StoreTable& table) { return "crc32 IS " + checksum(table); }

std::string insertion(const StoreTable& table) {
  const std::string name = table.name, columns = table.columns;
  std::string values;
  for (std::size_t at = 0; at != std::string::npos; at = columns.find(',', at + 1)) {
    const bool id = at == 0 && columns.starts_with("id,");
    values += id ? "(SELECT coalesce(max(id), 0) + 1 FROM " + name + ")" : at == 0 ? "?" : ", ?";
  }
  return "WITH row(" + columns + ") AS (VALUES (" + values + ")) INSERT OR REPLACE INTO " + name +
         " (" + columns + ", crc32) SELECT " + columns + ", " + checksum(table) + " FROM row";
}

std::string layout_checksum() {
  std::string names = "'diagnoses_of_axis'";
  for (const StoreTable& table : kStoreTables) names += std::string(", '") + table.name + "'";
  // As the 32-bit number with a sign that the header of a database holds.
  return "SELECT (row_crc32(user_version, parts) + 0x80000000) % 0x100000000 - 0x80000000 FROM "
         "pragma_user_version, (SELECT group_concat(type || ' ' || name || ' ' || tbl_name || ' ' "
         "|| sql) AS parts FROM (SELECT * FROM sqlite_schema WHERE name IN (" +
         names + ") ORDER BY name))";
}

}  // namespace servotwin::daemon
