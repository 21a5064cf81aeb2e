#include "daemon/store/store.h"

#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>

#include "daemon/store/axis_file.h"
#include "daemon/store/store_checksum.h"
#include "daemon/store/store_statement.h"
#include "drivers/common/file_handle.h"

namespace servotwin::daemon {
namespace {

// 2: with checksums (daemon/store/store_checksum.h).
constexpr int kSchemaVersion = 2;
constexpr int kFirstWithChecksums = 2;
constexpr const char* kSchema = R"(
  CREATE TABLE IF NOT EXISTS models (
    machine TEXT NOT NULL, axis TEXT NOT NULL, version INTEGER NOT NULL,
    created TEXT NOT NULL, reason TEXT NOT NULL, json TEXT NOT NULL,
    crc32 INTEGER, PRIMARY KEY (machine, axis, version)) WITHOUT ROWID;
  CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY, time TEXT NOT NULL, machine TEXT NOT NULL, axis TEXT NOT NULL,
    kind TEXT NOT NULL, text TEXT NOT NULL, detail TEXT NOT NULL,
    crc32 INTEGER);
  CREATE TABLE IF NOT EXISTS diagnoses (
    id INTEGER PRIMARY KEY, time TEXT NOT NULL, machine TEXT NOT NULL, axis TEXT NOT NULL,
    reason TEXT NOT NULL, verdict TEXT NOT NULL, json TEXT NOT NULL, extended_model TEXT NOT NULL,
    crc32 INTEGER);
  CREATE TABLE IF NOT EXISTS citations (
    machine TEXT NOT NULL, axis TEXT NOT NULL, version INTEGER NOT NULL, recording TEXT NOT NULL,
    crc32 INTEGER, PRIMARY KEY (machine, axis, version, recording)) WITHOUT ROWID;
  CREATE TABLE IF NOT EXISTS validations (
    machine TEXT NOT NULL, axis TEXT NOT NULL, version INTEGER NOT NULL, time TEXT NOT NULL,
    crc32 INTEGER, PRIMARY KEY (machine, axis)) WITHOUT ROWID;
  CREATE INDEX IF NOT EXISTS diagnoses_of_axis ON diagnoses (machine, axis, id);
)";

}  // namespace

void Store::Close::operator()(sqlite3* database) const noexcept { sqlite3_close(database); }

Store::Store(const std::filesystem::path& directory, std::string machine, StoreAccess access)
    : directory_(directory), file_(directory / "servotwin.sqlite"), machine_(std::move(machine)) {
  if (access == StoreAccess::kOwn && !usable_name(machine_))
    throw std::runtime_error("machine name " + in_quotes(machine_) + ": " +
                             std::string(kUsableNameRule));
  if (access == StoreAccess::kOwn) lock_ = lock_directory(directory);
  try {
    if (access == StoreAccess::kRead) {
      open(access);
      return;
    }
    tighten_permissions();
    if (const std::string why = damage(); !why.empty()) put_aside(why);
    open(access);
    drop_damaged_rows();
    restore_models();
    complete_copies();
    (void)newest_usable(&lost_);
  } catch (...) {
    if (lock_ >= 0) close(lock_);
    throw;
  }
}

void Store::open(StoreAccess access) {
  if (std::error_code ignored;
      access == StoreAccess::kRead && !std::filesystem::exists(file_, ignored))
    throw std::runtime_error(
        "store " + file_.string() +
        ": does not exist; --store takes the daemon's directory, which servotwin "
        "check-config prints");
  sqlite3* database = nullptr;
  const int opened =
      sqlite3_open_v2(file_.c_str(), &database,
                      access == StoreAccess::kOwn ? SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE
                                                  : SQLITE_OPEN_READONLY,
                      nullptr);
  database_.reset(database);
  if (opened != SQLITE_OK) fail("cannot be opened");
  sqlite3_busy_timeout(database, kBusy_ms);
  add_row_crc32(database);
  if (access == StoreAccess::kOwn) {
    try {
      execute("PRAGMA journal_mode=WAL");
    } catch (const StoreLocked&) {
      // A database in another journal mode cannot be changed while it is read; it can be used.
      note("another program reads the database; the next start changes its journal to WAL");
    }
    execute("PRAGMA synchronous=FULL");
  }
  layout_ = static_cast<int>(number_of("PRAGMA user_version"));
  if (layout_ > kSchemaVersion) {
    throw std::runtime_error("store " + file_.string() +
                             ": was written by a newer servotwind (layout " +
                             std::to_string(layout_) + ", this version supports " +
                             std::to_string(kSchemaVersion) + ")");
  }
  // A store of this layout is opened without writing, so that no lock of a reader is in the way.
  if (access == StoreAccess::kOwn && layout_ < kSchemaVersion) migrate();
}

void Store::migrate() {
  Transaction transaction(*this);
  execute(kSchema);
  for (const StoreTable& table : kStoreTables) {
    const std::string name = table.name;
    if (number_of("SELECT count(*) FROM pragma_table_info('" + name + "') WHERE name = 'crc32'") ==
        0)
      execute("ALTER TABLE " + name + " ADD COLUMN crc32 INTEGER");
    execute("UPDATE " + name + " SET crc32 = " + checksum(table));
  }
  execute("PRAGMA user_version=" + std::to_string(kSchemaVersion));
  execute("PRAGMA application_id=" + std::to_string(number_of(layout_checksum())));
  transaction.commit();
  layout_ = kSchemaVersion;
}

std::string Store::intact_column(const StoreTable& table) const {
  return layout_ < kFirstWithChecksums ? "1" : intact(table);
}

std::int64_t Store::number_of(const std::string& sql) const {
  Statement statement(*this, sql);
  return statement.step("cannot be read") ? statement.number(0) : 0;
}

void Store::report_loss(const std::string& what) { lost_ += (lost_.empty() ? "" : "; ") + what; }

void Store::note(const std::string& what) { noted_ += (noted_.empty() ? "" : "; ") + what; }

Store::~Store() {
  database_.reset();
  if (lock_ >= 0) close(lock_);
}

void Store::fail(const std::string& what) const {
  if ((sqlite3_errcode(database_.get()) & 0xff) == SQLITE_BUSY)
    throw StoreLocked("store " + file_.string() + ": " + what +
                      ": another program, such as sqlite3, has locked the database; end it");
  std::string why = sqlite3_errmsg(database_.get());
  if (const int error = sqlite3_system_errno(database_.get()); error != 0)
    why += " (" + std::generic_category().message(error) + ")";
  const int error = sqlite3_errcode(database_.get()) & 0xff;
  if (error == SQLITE_CORRUPT || error == SQLITE_NOTADB) note_damage(why);
  throw std::runtime_error("store " + file_.string() + ": " + what + ": " + why);
}

void Store::execute(const std::string& sql) const {
  if (sqlite3_exec(database_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    fail("cannot be written");
}

std::string Store::models_of_axis() const {
  return "SELECT axis, version, reason, json, " + intact_column(kModels) +
         " FROM models WHERE machine = ? AND axis = ? ORDER BY version DESC";
}

StoredModel Store::model_in(const Statement& row) const {
  if (row.number(4) == 0) {
    note_damage("model of axis " + row.text(0) + ", version " + row.text(1));
    throw std::runtime_error("its checksum does not match: the row is damaged");
  }
  StoredModel model;
  model.record = model_from_json(nlohmann::json::parse(row.text(3)));
  model.reason = row.text(2);
  model.record.version = static_cast<int>(row.number(1));
  if (model.record.axis != row.text(0))
    throw std::runtime_error("axis: is '" + model.record.axis + "'");
  return model;
}

std::vector<std::string> Store::all_texts(Statement& rows) {
  std::vector<std::string> out;
  while (rows.step("cannot be read")) out.push_back(rows.text(0));
  return out;
}

std::vector<StoredModel> Store::newest_usable(std::string* passed_over) const {
  Statement names(*this, "SELECT DISTINCT axis FROM models WHERE machine = ? ORDER BY axis");
  names.bind(machine_);
  std::vector<StoredModel> out;
  for (const std::string& axis : all_texts(names)) {
    Statement rows(*this, models_of_axis());
    rows.bind(machine_).bind(axis);
    std::string unusable;
    const std::size_t found = out.size();
    while (out.size() == found && rows.step("cannot be read")) {
      try {
        out.push_back(model_in(rows));
      } catch (const std::exception& error) {
        unusable += "model of axis " + axis + ", version " + std::to_string(rows.number(1)) +
                    ", cannot be used: " + error.what() + "; ";
      }
    }
    if (passed_over == nullptr || unusable.empty()) continue;
    *passed_over += passed_over->empty() ? unusable : "; " + unusable;
    *passed_over += out.size() > found
                        ? "version " + std::to_string(out.back().record.version) + " is in force"
                        : "the axis is identified again";
  }
  return out;
}

std::vector<StoredModel> Store::in_force() const {
  const std::lock_guard lock(mutex_);
  std::vector<StoredModel> models = newest_usable();
  if (lock_ < 0) return models;  // a store of an older version may not have the table
  for (StoredModel& model : models) {
    Statement validated(*this,
                        "SELECT time FROM validations WHERE machine = ? AND axis = ? AND version = "
                        "? AND " +
                            intact(kValidations));
    validated.bind(machine_).bind(model.record.axis).bind(std::int64_t{model.record.version});
    if (validated.step("cannot be read")) model.validated = validated.text(0);
  }
  return models;
}

std::vector<std::string> Store::axes() const {
  const std::lock_guard lock(mutex_);
  Statement rows(*this,
                 "SELECT axis FROM models WHERE machine = ?1 UNION SELECT axis FROM diagnoses "
                 "WHERE machine = ?1 ORDER BY axis");
  rows.bind(machine_);
  return all_texts(rows);
}

std::vector<std::string> Store::machines() const {
  const std::lock_guard lock(mutex_);
  Statement rows(*this,
                 "SELECT machine FROM models UNION SELECT machine FROM diagnoses ORDER BY machine");
  return all_texts(rows);
}

void Store::validate(const std::string& axis, int version, const std::string& time) {
  const std::lock_guard lock(mutex_);
  Statement replace(*this, insertion(kValidations));
  replace.bind(machine_)
      .bind(axis)
      .bind(std::int64_t{version})
      .bind(time)
      .step("cannot be written");
}

std::vector<StoredModel> Store::versions(const std::string& axis, int most) const {
  const std::lock_guard lock(mutex_);
  Statement rows(*this, models_of_axis());
  rows.bind(machine_).bind(axis);
  std::vector<StoredModel> out;
  while ((most < 0 || out.size() < static_cast<std::size_t>(most)) && rows.step("cannot be read")) {
    try {
      out.push_back(model_in(rows));
    } catch (const std::exception&) {
      continue;  // an unusable version cannot be restored
    }
  }
  return out;
}

void Store::promote(ModelRecord& record, const Event& event,
                    const std::vector<std::string>& recordings) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(*this);
  ModelRecord stored = record;
  {
    Statement newest(*this,
                     "SELECT coalesce(max(version), 0) FROM models WHERE machine = ? AND axis = ?");
    newest.bind(machine_).bind(record.axis).step("cannot be read");
    stored.version = static_cast<int>(newest.number(0)) + 1;
    stored.parent = 0;
    for (const StoredModel& model : newest_usable()) {
      if (model.record.axis == stored.axis) stored.parent = model.record.version;
    }
  }
  Statement insert(*this, insertion(kModels));
  insert.bind(machine_).bind(stored.axis).bind(std::int64_t{stored.version}).bind(stored.created);
  nlohmann::json model = to_json(stored);
  if (!recordings.empty()) model["data"]["recordings"] = recordings;
  insert.bind(event.text).bind(model.dump()).step("cannot be written");
  for (const std::string& recording : recordings)
    insert_citation(machine_, stored.axis, stored.version, recording);
  insert_event(event);
  // Everything that may fail on a full disk comes before the commit.
  const std::filesystem::path copy = copy_of(machine_, stored.axis);
  std::filesystem::create_directories(copy.parent_path());
  AtomicFile file(copy);
  file.write(copy_text(model));
  transaction.commit();
  try {
    file.commit();
  } catch (const std::runtime_error&) {
    // The model is stored; the next start completes the copy.
  }
  record = std::move(stored);
}

void Store::insert_citation(const std::string& machine, const std::string& axis, int version,
                            const std::string& recording) const {
  Statement cite(*this, insertion(kCitations));
  cite.bind(machine).bind(axis).bind(std::int64_t{version}).bind(recording);
  cite.step("cannot be written");
}

std::set<std::string> Store::cited() const {
  const std::lock_guard lock(mutex_);
  Statement statement(*this, "SELECT DISTINCT recording FROM citations WHERE machine = ?");
  statement.bind(machine_);
  std::set<std::string> out;
  while (statement.step("cannot be read")) out.insert(statement.text(0));
  return out;
}

void Store::add(const StoredDiagnosis& diagnosis, const Event& event) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(*this);
  Statement insert(*this, insertion(kDiagnoses));
  insert.bind(diagnosis.time).bind(machine_).bind(diagnosis.axis).bind(diagnosis.reason);
  insert.bind(diagnosis.verdict).bind(diagnosis.json).bind(diagnosis.extended_model);
  insert.step("cannot be written");
  Statement forget(*this,
                   "DELETE FROM diagnoses WHERE machine = ?1 AND axis = ?2 AND id <= (SELECT id "
                   "FROM diagnoses WHERE machine = ?1 AND axis = ?2 ORDER BY id DESC LIMIT 1 "
                   "OFFSET ?3)");
  forget.bind(machine_).bind(diagnosis.axis).bind(std::int64_t{kDiagnosesKept});
  forget.step("cannot be written");
  insert_event(event);
  transaction.commit();
}

std::vector<StoredDiagnosis> Store::diagnoses(const std::string& axis, int most) const {
  const std::lock_guard lock(mutex_);
  Statement statement(
      *this, "SELECT time, axis, reason, verdict, json, extended_model, id, " +
                 intact_column(kDiagnoses) +
                 " FROM diagnoses WHERE machine = ? AND axis = ? ORDER BY id DESC LIMIT ?");
  statement.bind(machine_).bind(axis).bind(std::int64_t{most});
  std::vector<StoredDiagnosis> out;
  while (statement.step("cannot be read")) {
    require_intact(kDiagnoses, statement, 6);
    out.push_back({statement.text(0), statement.text(1), statement.text(2), statement.text(3),
                   statement.text(4), statement.text(5)});
  }
  return out;
}

void Store::add(const Event& event) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(*this);
  insert_event(event);
  transaction.commit();
}

void Store::try_writing() {
  const std::lock_guard lock(mutex_);
  execute("PRAGMA user_version=" + std::to_string(kSchemaVersion));
}

void Store::insert_event(const Event& event) {
  Statement insert(*this, insertion(kEvents));
  insert.bind(event.time)
      .bind(machine_)
      .bind(event.axis)
      .bind(event.kind)
      .bind(event.text)
      .bind(event.detail);
  insert.step("cannot be written");
  Statement forget(*this, "DELETE FROM events WHERE id <= (SELECT max(id) FROM events) - ?");
  forget.bind(std::int64_t{kEventsKept}).step("cannot be written");
}

void Store::require_intact(const StoreTable& table, const Statement& row, int id) const {
  if (row.number(id + 1) != 0) return;
  note_damage("row " + row.text(id) + " of " + table.name);
  throw std::runtime_error("store " + file_.string() + ": row " + row.text(id) + " of " +
                           table.name +
                           " is damaged: its checksum does not match; restart servotwind, which "
                           "puts the damaged database aside and recovers the rest");
}

void Store::note_damage(const std::string& what) const {
  if (found_damage_.empty())
    found_damage_ = "store " + file_.string() + ": is damaged (" + what +
                    "); restart servotwind, which recovers the rest";
}

std::string Store::found_damage() const {
  const std::lock_guard lock(mutex_);
  return found_damage_;
}

std::vector<Event> Store::events(int most) const {
  const std::lock_guard lock(mutex_);
  Statement statement(*this, "SELECT time, axis, kind, text, detail, id, " +
                                 intact_column(kEvents) +
                                 " FROM events WHERE machine = ? ORDER BY id DESC LIMIT ?");
  statement.bind(machine_).bind(std::int64_t{most});
  std::vector<Event> out;
  while (statement.step("cannot be read")) {
    require_intact(kEvents, statement, 5);
    out.push_back({statement.text(0), statement.text(1), statement.text(2), statement.text(3),
                   statement.text(4)});
  }
  return out;
}

std::string iso_time(std::int64_t wall_ns) {
  const std::time_t seconds = wall_ns / 1'000'000'000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[40];
  const std::size_t length = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text + length, sizeof text - length, ".%03dZ",
                static_cast<int>(wall_ns / 1'000'000 % 1000));
  return text;
}

}  // namespace servotwin::daemon
