// What must outlive the daemon: every model that was in force, diagnoses and events (SQLite).
//
// Nothing is acknowledged before it is on the disk: WAL journal, synchronous=FULL, one transaction
// for a model or a diagnosis and its event. The version in force of an axis is its highest one. One
// process per directory, and any number that read.
//
// The model in force of every axis is beside the database, too: models/<machine>/<axis>.json. A
// database that is damaged is put aside, and the models in force come back from there, with the
// recordings that they cite. Errors: std::runtime_error, one line with the file and the reason. Any
// thread.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "identification/model/model_file.h"

struct sqlite3;

namespace servotwin::daemon {

struct Event {
  std::string time;    ///< ISO 8601, UTC
  std::string axis;    ///< empty: the machine
  std::string kind;    ///< "model_promoted", "model_refused", ...
  std::string text;    ///< one line for people
  std::string detail;  ///< JSON, or empty
};

/// A model with why it came into force.
struct StoredModel {
  ModelRecord record;
  std::string reason;
  /// When it was last found to hold on motion that nobody was fitted to, ISO 8601; empty: when it
  /// came into force, or not known where the store is only read.
  std::string validated{};
};

/// A diagnosis as it is kept and published.
struct StoredDiagnosis {
  std::string time;  ///< ISO 8601, UTC
  std::string axis;
  std::string reason;          ///< why it was made: "on schedule", or the alarm
  std::string verdict;         ///< name_of(Verdict)
  std::string json;            ///< servotwin.diagnosis/1
  std::string extended_model;  ///< servotwin.model/1
};

enum class StoreAccess { kOwn, kRead };

class Store {
 public:
  /// The newest events that are kept; some months of decisions.
  static constexpr int kEventsKept = 100'000;
  /// The newest diagnoses of an axis that are kept: seven months of one an hour.
  static constexpr int kDiagnosesKept = 5000;

  /// Opens or makes `directory`/servotwin.sqlite. To read it neither is made nor held, so that it
  /// can be read beside the daemon; nothing can be written then.
  Store(const std::filesystem::path& directory, std::string machine,
        StoreAccess access = StoreAccess::kOwn);
  /// Throws if it could not be opened or made there, as far as that can be told from outside.
  static void require_writable(const std::filesystem::path& directory);
  /// Throws if nothing can be made there, or where it would be made; leaves nothing behind.
  static void try_making(const std::filesystem::path& directory);
  /// True while a process has it open as its own.
  [[nodiscard]] static bool in_use(const std::filesystem::path& directory);
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;
  ~Store();

  /// The model in force of every axis: the newest that this program can use. A damaged one, or one
  /// of a program with other effects, stays where it is; `lost` names it.
  [[nodiscard]] std::vector<StoredModel> in_force() const;
  /// The versions of an axis, the newest first; -1: all of them.
  [[nodiscard]] std::vector<StoredModel> versions(const std::string& axis, int most = -1) const;
  /// Stores a model as the axis' next version, with the event that tells of it; version and parent
  /// of `record` are set. When this returns it is on the disk; when it throws nothing has changed.
  /// `recordings`: the files of recordings/<machine> that it was found and judged on; its JSON
  /// names them, too, as data.recordings.
  void promote(ModelRecord& record, const Event& event,
               const std::vector<std::string>& recordings = {});
  /// The version in force of an axis was found to hold, at this time (ISO 8601).
  void validate(const std::string& axis, int version, const std::string& time);
  /// The recordings that models were found and judged on. Every model is kept, in force or not.
  [[nodiscard]] std::set<std::string> cited() const;

  /// Stores a diagnosis with the event that tells of it, and forgets what is too old.
  void add(const StoredDiagnosis& diagnosis, const Event& event);
  /// Of an axis, the newest first.
  [[nodiscard]] std::vector<StoredDiagnosis> diagnoses(const std::string& axis, int most) const;

  /// The axes of this machine of which there is a model or a diagnosis, in alphabetical order.
  [[nodiscard]] std::vector<std::string> axes() const;
  /// The machines, likewise.
  [[nodiscard]] std::vector<std::string> machines() const;

  void add(const Event& event);
  /// Writes to the disk what is there already. Throws if that fails.
  void try_writing();
  /// The newest first.
  [[nodiscard]] std::vector<Event> events(int most) const;

  [[nodiscard]] const std::filesystem::path& directory() const noexcept { return directory_; }
  [[nodiscard]] const std::string& machine() const noexcept { return machine_; }
  /// What was lost or cannot be used when it was opened, and where it is kept; empty if nothing.
  [[nodiscard]] const std::string& lost() const noexcept { return lost_; }

 private:
  struct Close {
    void operator()(sqlite3* database) const noexcept;
  };
  class Statement;
  class Transaction;

  void open(StoreAccess access);
  /// Why the database cannot be used; empty if it can. Throws where it is none of ours.
  [[nodiscard]] std::string damage() const;
  void put_aside(const std::string& why);
  void restore_models();
  void complete_copies() const;
  [[nodiscard]] std::filesystem::path copy_of(const std::string& machine,
                                              const std::string& axis) const;
  [[noreturn]] void fail(const std::string& what) const;
  void execute(const char* sql) const;
  void insert_event(const Event& event);
  void insert_citation(const std::string& machine, const std::string& axis, int version,
                       const std::string& recording) const;
  /// Of a row of axis, version, reason, json. Throws where this program cannot use it.
  [[nodiscard]] static StoredModel model_in(const Statement& row);
  /// The first column of all rows.
  [[nodiscard]] static std::vector<std::string> all_texts(Statement& rows);
  /// Of every axis; what was newer and cannot be used is added to `passed_over`, as a sentence.
  [[nodiscard]] std::vector<StoredModel> newest_usable(std::string* passed_over = nullptr) const;

  std::filesystem::path directory_, file_;
  std::string machine_;
  std::string lost_;
  int lock_ = -1;
  std::unique_ptr<sqlite3, Close> database_;
  mutable std::mutex mutex_;
};

/// "2026-01-31T12:00:00.000Z"
[[nodiscard]] std::string iso_time(std::int64_t wall_ns);

}  // namespace servotwin::daemon
