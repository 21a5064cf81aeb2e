// Recovery of a Store from damage: a damaged or missing database is put aside, damaged rows are
// taken out, and the models in force are restored from their copies.
#include <fcntl.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <functional>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>

#include "daemon/store/axis_file.h"
#include "daemon/store/store_checksum.h"
#include "daemon/store/store_statement.h"
#include "daemon/store/write_ahead_log.h"
#include "drivers/common/checksum.h"
#include "drivers/common/file_handle.h"

namespace servotwin::daemon {
namespace {

constexpr std::string_view kMagic("SQLite format 3\0", 16);

/// The recordings that a stored model cites.
std::vector<std::string> recordings_of(const nlohmann::json& model) {
  std::vector<std::string> out;
  const nlohmann::json data = model.value("data", nlohmann::json::object());
  for (const nlohmann::json& name : data.value("recordings", nlohmann::json::array())) {
    if (name.is_string()) out.push_back(name.get<std::string>());
  }
  return out;
}

/// The key of the checksum of a copy: CRC-32 of the file without this key, compact, as
/// crc32_text(). Copies of before version 0.2.0 have none.
constexpr const char* kCopyChecksum = "crc32";

/// A copy without its checksum; `checked`: whether it had one. Throws if it is damaged.
nlohmann::json read_copy(const std::filesystem::path& file, bool* checked = nullptr) {
  (void)read_model(file);  // names the fault of a file that is no model
  nlohmann::json model = nlohmann::json::parse(read_text(file));
  const nlohmann::json sum = model.value(kCopyChecksum, nlohmann::json());
  model.erase(kCopyChecksum);
  if (checked != nullptr) *checked = !sum.is_null();
  if (!sum.is_null() && sum != crc32_text(crc32_of(model.dump())))
    throw std::runtime_error(file.string() +
                             ": its checksum does not match: it was damaged or changed by hand");
  return model;
}

/// Makes a copy at `kept`, and says that it is there, or why there is none: a full disk must not
/// keep the daemon from starting.
std::string keep(const std::filesystem::path& kept, const std::function<void()>& make) {
  try {
    make();
    return "is kept as " + kept.string();
  } catch (const std::exception& error) {
    std::error_code ignored;
    for (const char* part : {"", "-journal"})
      std::filesystem::remove(kept.string() + part, ignored);
    return "could not be kept: " + std::string(error.what());
  }
}

/// Why a database cannot be relied on.
struct Damaged : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The first value of a query. Throws Damaged if SQLite cannot make sense of the database.
std::string first_of(sqlite3* database, const std::string& file, const std::string& sql) {
  sqlite3_stmt* statement = nullptr;
  int result = sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr);
  if (result == SQLITE_OK) result = sqlite3_step(statement);
  std::string value;
  if (result == SQLITE_ROW) {
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement, 0));
    if (text != nullptr) value = text;
  }
  const std::string why = sqlite3_errmsg(database);
  sqlite3_finalize(statement);
  switch (result & 0xff) {
    case SQLITE_ROW:
    case SQLITE_DONE:
      return value;
    case SQLITE_BUSY:
      throw StoreLocked("store " + file +
                        ": cannot be read: another program, such as sqlite3, has locked the "
                        "database; end it");
    case SQLITE_IOERR:
    case SQLITE_CANTOPEN:
    case SQLITE_NOMEM:
    case SQLITE_PERM:
    case SQLITE_READONLY:
    case SQLITE_FULL:
      throw std::runtime_error("store " + file + ": cannot be read: " + why);
    default:
      throw Damaged(why);
  }
}

/// What in a database does not agree with its checksums, rows aside; empty: all does.
std::string damage_within(sqlite3* database, const std::string& file) {
  const auto ask = [&](const std::string& sql) { return first_of(database, file, sql); };
  try {
    std::string why = ask("PRAGMA integrity_check(1)");
    std::replace(why.begin(), why.end(), '\n', ' ');
    if (why != "ok") return why;
    const std::string layout = ask("PRAGMA user_version"), sum = ask("PRAGMA application_id");
    // Stores of before version 0.2.0 have no checksum.
    if (sum == "0" && (layout == "0" || layout == "1")) return "";
    if (sum != ask(layout_checksum())) return "the checksum of its layout does not match";
    return "";
  } catch (const Damaged& damage) {
    return damage.what();
  }
}

}  // namespace

std::string Store::damage() {
  std::error_code error;
  const bool copies = std::filesystem::exists(directory_ / "models", error);
  if (!std::filesystem::exists(file_, error)) return copies ? "the database file is missing" : "";
  std::array<char, kMagic.size() + 4> start{};  // with page size, and formats to write and read
  const FileHandle file = FileHandle::open(file_, O_RDONLY);
  const std::size_t size = file.read(start.data(), start.size());
  // A file with another beginning is damaged if there are copies of its models. Otherwise it may be
  // anything: opening it reports that it is not a database.
  if (!std::string_view(start.data(), size).starts_with(kMagic.substr(0, size)))
    return copies ? "the database file does not begin as one" : "";
  // SQLite treats a file shorter than a page as a new database; if there are copies of models, it
  // was truncated.
  constexpr std::uintmax_t kSmallestPage = 512;
  if (const std::uintmax_t bytes = std::filesystem::file_size(file_); bytes < kSmallestPage)
    return copies ? "the database file has only " + std::to_string(bytes) + " bytes" : "";
  // A database of an unknown format to write would only be read, without a word.
  if (start[18] != start[19] || (start[18] != 1 && start[18] != 2))
    return "the format in the header of the database is unknown";
  // SQLite reads the missing part of a truncated page as zeros, which may be inside a model.
  const std::filesystem::path journal = file_.string() + "-wal";
  const auto high = static_cast<unsigned char>(start[16]),
             low = static_cast<unsigned char>(start[17]);
  const unsigned page = high == 0 && low == 1 ? 65'536U : 256U * high + low;
  const bool journaled = std::filesystem::exists(journal) && !std::filesystem::is_empty(journal);
  if (!journaled && page != 0 && std::filesystem::file_size(file_) % page != 0)
    return "the database file is truncated within a page";
  const std::vector<int> commits = commits_in_log(journal, page);
  sqlite3* database = nullptr;
  sqlite3_open_v2(file_.c_str(), &database, SQLITE_OPEN_READWRITE, nullptr);
  const std::unique_ptr<sqlite3, Close> closed(database);
  sqlite3_busy_timeout(database, kBusy_ms);
  add_row_crc32(database);
  std::string why = damage_within(database, file_.string());
  int read = 0;  // frames
  if (why.empty() && !commits.empty() &&
      sqlite3_wal_checkpoint_v2(database, nullptr, SQLITE_CHECKPOINT_PASSIVE, &read, nullptr) ==
          SQLITE_OK &&
      read < commits.back())
    keep_journal(commits.end() - std::upper_bound(commits.begin(), commits.end(), read));
  return why;
}

/// `unread`: transactions in the journal that SQLite does not read.
void Store::keep_journal(std::ptrdiff_t unread) {
  const std::string kept = aside().string() + "-wal";
  const std::string where =
      keep(kept, [&] { std::filesystem::copy_file(file_.string() + "-wal", kept); });
  report_loss(
      "the journal of the database was damaged, or the power failed while it was written: " +
      std::to_string(unread) + " of the last models, diagnoses and events are lost; the journal " +
      where);
}

std::filesystem::path Store::aside() const {
  std::error_code error;
  std::filesystem::path name;
  for (int i = 1; name.empty() || std::filesystem::exists(name, error) ||
                  std::filesystem::exists(name.string() + "-wal", error);
       ++i)
    name = directory_ / ("servotwin.sqlite.damaged-" + std::to_string(i));
  return name;
}

void Store::put_aside(const std::string& why) {
  const std::filesystem::path kept = aside();
  std::error_code error;
  for (const char* part : {"", "-wal", "-shm"}) {
    const std::filesystem::path from = file_.string() + part;
    if (std::filesystem::exists(from, error)) std::filesystem::rename(from, kept.string() + part);
  }
  report_loss(
      "the store was damaged (" + why +
      "): older models, diagnoses and events are lost; what is left of the database is kept as " +
      kept.string());
}

/// Rows that do not have their checksums, in a database that is otherwise well.
void Store::drop_damaged_rows() {
  std::string rows;
  for (const StoreTable& table : kStoreTables) {
    const std::int64_t count = number_of(std::string("SELECT count(*) FROM ") + table.name +
                                         " WHERE NOT (" + intact(table) + ")");
    if (count > 0) rows += (rows.empty() ? "" : ", ") + std::to_string(count) + " of " + table.name;
  }
  if (rows.empty()) return;
  const std::filesystem::path kept = aside();
  const std::string where = keep(kept, [&] {
    Statement(*this, "VACUUM INTO ?").bind(kept.string()).step("cannot be copied");
  });
  Transaction transaction(*this);
  for (const StoreTable& table : kStoreTables)
    execute(std::string("DELETE FROM ") + table.name + " WHERE NOT (" + intact(table) + ")");
  cite_anew();
  transaction.commit();
  report_loss("the store was damaged (rows that do not match their checksums: " + rows +
              "): these rows are lost; the database with them " + where);
}

/// Without its citation a recording that a model cites would be deleted; the models name them, too.
void Store::cite_anew() {
  Statement models(*this, "SELECT machine, axis, version, json FROM models");
  while (models.step("cannot be read")) {
    const nlohmann::json model = nlohmann::json::parse(models.text(3), nullptr, false);
    if (!model.is_object()) continue;
    for (const std::string& recording : recordings_of(model))
      insert_citation(models.text(0), models.text(1), static_cast<int>(models.number(2)),
                      recording);
  }
}

std::filesystem::path Store::copy_of(const std::string& machine, const std::string& axis) const {
  return axis_file(directory_, "models", machine, axis, ".json");
}

std::string Store::copy_text(nlohmann::json model) {
  model[kCopyChecksum] = crc32_text(crc32_of(model.dump()));
  return model.dump();
}

/// Takes in the copies of models that the database does not have.
void Store::restore_models() {
  const std::filesystem::path models = directory_ / "models";
  if (!std::filesystem::exists(models)) return;
  int restored = 0;
  std::string failed;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(models)) {
    if (entry.path().extension() != ".json") continue;
    const std::string machine = entry.path().parent_path().filename(), axis = entry.path().stem();
    Statement newest(*this,
                     "SELECT coalesce(max(version), 0) FROM models WHERE machine = ? AND axis = ?");
    newest.bind(machine).bind(axis).step("cannot be read");
    try {
      const nlohmann::json model = read_copy(entry.path());
      const ModelRecord record = model_from_json(model);
      if (record.version <= newest.number(0)) continue;
      // The copy of one axis is not that of another, and no name leads out of the store.
      if (record.axis != axis || !usable_name(axis) || !usable_name(machine))
        throw std::runtime_error(entry.path().string() + ": is a model of axis " +
                                 in_quotes(record.axis));
      Statement insert(*this, insertion(kModels));
      insert.bind(machine).bind(record.axis).bind(std::int64_t{record.version});
      insert.bind(record.created).bind("restored from " + entry.path().string());
      insert.bind(model.dump()).step("cannot be written");
      for (const std::string& recording : recordings_of(model))
        insert_citation(machine, record.axis, record.version, recording);
      ++restored;
    } catch (const std::exception& error) {
      // Where the database has the axis, the copy is written again.
      if (newest.number(0) == 0)
        failed += "; a model in force could not be restored: " + std::string(error.what());
    }
  }
  if (lost_.empty() && restored == 0 && failed.empty()) return;
  if (lost_.empty()) lost_ = "the database has not the newest model of every axis";
  lost_ += failed + "; models in force restored: " + std::to_string(restored);
}

/// Writes copies that are missing, damaged or without a checksum: of stores of a version without
/// them, after a crash between the two, and after damage.
void Store::complete_copies() {
  Statement axes(*this, "SELECT DISTINCT machine, axis FROM models");
  while (axes.step("cannot be read")) {
    const std::string machine = axes.text(0), axis = axes.text(1);
    Statement rows(*this, models_of_axis());
    rows.bind(machine).bind(axis);
    // The copy of a usable model is not replaced by an unusable one.
    bool usable = false;
    while (!usable && rows.step("cannot be read")) {
      try {
        (void)model_in(rows);
        usable = true;
      } catch (const std::exception&) {
        continue;
      }
    }
    if (!usable) continue;
    try {
      const std::filesystem::path copy = copy_of(machine, axis);
      try {
        bool checked = false;
        if (std::filesystem::exists(copy) &&
            model_from_json(read_copy(copy, &checked)).version == rows.number(1) && checked)
          continue;
      } catch (const std::exception& error) {
        report_loss(std::string(error.what()) +
                    "; this copy of a model is written again from the database");
      }
      std::filesystem::create_directories(copy.parent_path());
      AtomicFile file(copy);
      file.write(copy_text(nlohmann::json::parse(rows.text(3))));
      file.commit();
    } catch (const std::exception& error) {
      note("a model in force has no copy: " + std::string(error.what()));
    }
  }
}

}  // namespace servotwin::daemon
