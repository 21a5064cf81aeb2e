// The checksums within the database, so that a flipped bit is found: every row has the CRC-32 of
// its other columns in its column crc32; the application_id of the database is the CRC-32 of the
// layout number and of the tables' SQL. What neither covers - pages, indexes, free space - is
// checked by SQLite's integrity_check. For store*.cpp and tests. One thread at a time per
// connection.
#pragma once

#include <sqlite3.h>

#include <array>
#include <cstdint>
#include <string>

namespace servotwin::daemon {

/// A table of the store.
struct StoreTable {
  const char* name;
  /// All columns but crc32. `id`, where there is one, counts the rows.
  const char* columns;
};
inline constexpr StoreTable kModels{"models", "machine, axis, version, created, reason, json"};
inline constexpr StoreTable kEvents{"events", "id, time, machine, axis, kind, text, detail"};
inline constexpr StoreTable kDiagnoses{
    "diagnoses", "id, time, machine, axis, reason, verdict, json, extended_model"};
inline constexpr StoreTable kCitations{"citations", "machine, axis, version, recording"};
inline constexpr StoreTable kValidations{"validations", "machine, axis, version, time"};
inline constexpr std::array kStoreTables{kModels, kEvents, kDiagnoses, kCitations, kValidations};

/// Gives a connection the SQL function row_crc32(...): of its arguments with their types.
void add_row_crc32(sqlite3* database);

/// SQL: INSERT of one row with its checksum, a parameter for every column but `id`. A row with the
/// same key is replaced.
[[nodiscard]] std::string insertion(const StoreTable& table);
/// SQL: whether a row has its checksum.
[[nodiscard]] std::string intact(const StoreTable& table);
/// SQL: the checksum of a row as its columns are now.
[[nodiscard]] std::string checksum(const StoreTable& table);

/// SQL: one number, the checksum of the layout of the database, to be its application_id.
[[nodiscard]] std::string layout_checksum();

}  // namespace servotwin::daemon
