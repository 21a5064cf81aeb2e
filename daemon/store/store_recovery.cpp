// Recovery of a Store from a damaged or missing database: the database is put aside, and the models
// in force are restored from their copies.
#include <fcntl.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>

#include "daemon/store/store_statement.h"
#include "drivers/file_handle.h"

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

}  // namespace

std::string Store::damage() const {
  std::error_code error;
  const bool copies = std::filesystem::exists(directory_ / "models", error);
  if (!std::filesystem::exists(file_, error)) return copies ? "the database file is missing" : "";
  std::array<char, kMagic.size() + 2> start{};  // with the size of a page
  const FileHandle file = FileHandle::open(file_, O_RDONLY);
  const std::size_t size = file.read(start.data(), start.size());
  // A file with another beginning is not an SQLite database: opening it reports that. SQLite treats
  // a file shorter than a page as a new database; if there are copies of models, it was truncated.
  if (!std::string_view(start.data(), size).starts_with(kMagic.substr(0, size))) return "";
  constexpr std::uintmax_t kSmallestPage = 512;
  if (const std::uintmax_t bytes = std::filesystem::file_size(file_); bytes < kSmallestPage)
    return copies ? "the database file has only " + std::to_string(bytes) + " bytes" : "";
  // SQLite reads the missing part of a truncated page as zeros, which may be inside a model.
  const std::filesystem::path journal = file_.string() + "-wal";
  const auto high = static_cast<unsigned char>(start[16]),
             low = static_cast<unsigned char>(start[17]);
  const unsigned page = high == 0 && low == 1 ? 65'536U : 256U * high + low;
  const bool journaled = std::filesystem::exists(journal) && !std::filesystem::is_empty(journal);
  if (!journaled && page != 0 && std::filesystem::file_size(file_) % page != 0)
    return "the database file is truncated within a page";
  sqlite3* database = nullptr;
  sqlite3_open_v2(file_.c_str(), &database, SQLITE_OPEN_READWRITE, nullptr);
  const std::unique_ptr<sqlite3, Close> closed(database);
  sqlite3_stmt* check = nullptr;
  int result = sqlite3_prepare_v2(database, "PRAGMA quick_check(1)", -1, &check, nullptr);
  std::string why;
  if (result == SQLITE_OK) {
    result = sqlite3_step(check);
    if (result == SQLITE_ROW) {
      const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(check, 0));
      if (text != nullptr && std::string_view(text) != "ok") why = text;
    }
  }
  if (result == SQLITE_CORRUPT || result == SQLITE_NOTADB) why = sqlite3_errmsg(database);
  sqlite3_finalize(check);
  std::replace(why.begin(), why.end(), '\n', ' ');
  return why;
}

void Store::put_aside(const std::string& why) {
  std::error_code error;
  std::string aside;
  for (int i = 1; aside.empty() || std::filesystem::exists(directory_ / aside, error); ++i)
    aside = "servotwin.sqlite.damaged-" + std::to_string(i);
  for (const char* part : {"", "-wal", "-shm"}) {
    const std::filesystem::path from = file_.string() + part;
    if (std::filesystem::exists(from, error))
      std::filesystem::rename(from, directory_ / (aside + part));
  }
  lost_ =
      "the store was damaged (" + why +
      "): older models, diagnoses and events are lost; what is left of the database is kept as " +
      (directory_ / aside).string();
}

std::filesystem::path Store::copy_of(const std::string& machine, const std::string& axis) const {
  return directory_ / "models" / machine / (axis + ".json");
}

void Store::restore_models() {
  int restored = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(directory_ / "models")) {
    if (entry.path().extension() != ".json") continue;
    try {
      const ModelRecord record = read_model(entry.path());
      Statement insert(*this,
                       "INSERT INTO models (machine, axis, version, created, reason, json) VALUES "
                       "(?, ?, ?, ?, ?, ?)");
      insert.bind(entry.path().parent_path().filename()).bind(record.axis);
      insert.bind(std::int64_t{record.version}).bind(record.created);
      insert.bind("restored from " + entry.path().string());
      const nlohmann::json json = nlohmann::json::parse(read_text(entry.path()));
      insert.bind(json.dump()).step("cannot be written");
      for (const std::string& recording : recordings_of(json))
        insert_citation(entry.path().parent_path().filename(), record.axis, record.version,
                        recording);
      ++restored;
    } catch (const std::exception& error) {
      lost_ += "; a model in force could not be restored: " + std::string(error.what());
    }
  }
  lost_ += "; models in force restored: " + std::to_string(restored);
}

/// Writes missing copies: of stores of a version without copies, and after a crash between the two.
void Store::complete_copies() const {
  Statement axes(*this, "SELECT DISTINCT machine, axis FROM models");
  while (axes.step("cannot be read")) {
    const std::string machine = axes.text(0), axis = axes.text(1);
    Statement rows(*this,
                   "SELECT axis, version, reason, json FROM models WHERE machine = ? AND axis = ? "
                   "ORDER BY version DESC");
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
    const std::filesystem::path copy = copy_of(machine, axis);
    try {
      if (std::filesystem::exists(copy) && read_model(copy).version == rows.number(1)) continue;
    } catch (const std::exception&) {
      // An unreadable copy is written again.
    }
    std::filesystem::create_directories(copy.parent_path());
    AtomicFile file(copy);
    file.write(rows.text(3));
    file.commit();
  }
}

}  // namespace servotwin::daemon
