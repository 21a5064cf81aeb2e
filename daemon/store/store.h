// The store: every model that was in force, diagnoses and events, in an SQLite database that
// outlives the daemon.
//
// Nothing is acknowledged before it is on the disk: WAL journal, synchronous=FULL, one transaction
// for a model or a diagnosis with its event. The version in force of an axis is its highest usable
// one. One process may write to a directory; any number may read.
//
// A copy of the model in force of every axis is in models/<machine>/<axis>.json beside the
// database. Rows and copies have checksums (daemon/store/store_checksum.h): a row that does not
// match is never returned. When the store is opened for owning it, a damaged database is put aside,
// or a copy of it if only rows are damaged, and the models in force are restored from their copies,
// with the recordings that they cite; lost() says so. Errors: std::runtime_error, one line with the
// file and the reason. Any thread.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

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

/// A model with the reason why it came into force.
struct StoredModel {
  ModelRecord record;
  std::string reason;
  /// When it was last validated on held-out motion, ISO 8601; empty: not since it came into force,
  /// or not known because the store is opened for reading only.
  std::string validated{};
};

/// A diagnosis as it is stored and published.
struct StoredDiagnosis {
  std::string time;  ///< ISO 8601, UTC
  std::string axis;
  std::string reason;          ///< why it was made: "on schedule", or the text of the alarm
  std::string verdict;         ///< name_of(Verdict)
  std::string json;            ///< servotwin.diagnosis/1
  std::string extended_model;  ///< servotwin.model/1
};

/// Another program has locked the database; it can be tried again.
struct StoreLocked : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct StoreTable;

enum class StoreAccess { kOwn, kRead };

class Store {
 public:
  /// Number of the newest events that are kept: some months of decisions.
  static constexpr int kEventsKept = 100'000;
  /// Number of the newest diagnoses of an axis that are kept: seven months of one per hour.
  static constexpr int kDiagnosesKept = 5000;

  /// Opens `directory`/servotwin.sqlite. With kOwn it is created if it does not exist, and locked
  /// for this process; what others could read is closed to them, and the umask of the process
  /// (0077 in servotwind) keeps it so. With kRead it is neither created nor locked, so that it can
  /// be read while the daemon runs, and nothing can be written.
  Store(const std::filesystem::path& directory, std::string machine,
        StoreAccess access = StoreAccess::kOwn);
  /// Throws if the permissions do not allow to open or create a store there.
  static void require_writable(const std::filesystem::path& directory);
  /// Throws if no file can be created there, or in the nearest existing parent; leaves no file
  /// behind.
  static void try_making(const std::filesystem::path& directory);
  /// True while a process has opened it with kOwn. A servotwind of version 0.1.0 is not noticed:
  /// that would need a lock, which could keep a daemon from starting.
  [[nodiscard]] static bool in_use(const std::filesystem::path& directory);
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;
  ~Store();

  /// The model in force of every axis: the newest version that this program can use. A damaged
  /// model, or one of a program with other effects, stays in the store; `lost` names it.
  [[nodiscard]] std::vector<StoredModel> in_force() const;
  /// The `most` newest usable versions of an axis, the newest first; -1: all.
  [[nodiscard]] std::vector<StoredModel> versions(const std::string& axis, int most = -1) const;
  /// Stores a model as the next version of its axis, together with its event, and sets version and
  /// parent of `record`. When it returns, the model is on the disk; when it throws, nothing has
  /// changed. `recordings`: the files in recordings/<machine> that the model was fitted to and
  /// judged on; its JSON names them as data.recordings.
  void promote(ModelRecord& record, const Event& event,
               const std::vector<std::string>& recordings = {});
  /// Stores that the version in force of an axis was validated again at `time` (ISO 8601).
  void validate(const std::string& axis, int version, const std::string& time);
  /// The recordings that stored models, in force or not, were fitted to or judged on.
  [[nodiscard]] std::set<std::string> cited() const;

  /// Stores a diagnosis with its event, and deletes the oldest ones beyond kDiagnosesKept.
  void add(const StoredDiagnosis& diagnosis, const Event& event);
  /// The `most` newest diagnoses of an axis, the newest first.
  [[nodiscard]] std::vector<StoredDiagnosis> diagnoses(const std::string& axis, int most) const;

  /// The axes of this machine with a stored model or diagnosis, in alphabetical order.
  [[nodiscard]] std::vector<std::string> axes() const;
  /// The machines with a stored model or diagnosis, in alphabetical order.
  [[nodiscard]] std::vector<std::string> machines() const;

  /// Stores an event, and deletes the oldest ones beyond kEventsKept.
  void add(const Event& event);
  /// Tests writing, without changing the content. Throws if it fails.
  void try_writing();
  /// The `most` newest events, the newest first.
  [[nodiscard]] std::vector<Event> events(int most) const;

  [[nodiscard]] const std::filesystem::path& directory() const noexcept { return directory_; }
  [[nodiscard]] const std::string& machine() const noexcept { return machine_; }
  /// What was lost or could not be used when the store was opened, and where it is kept; empty:
  /// nothing.
  [[nodiscard]] const std::string& lost() const noexcept { return lost_; }
  /// The first damage that was found since the store was opened, and what to do; empty: none.
  [[nodiscard]] std::string found_damage() const;
  /// What else was put right when the store was opened; empty: nothing.
  [[nodiscard]] const std::string& noted() const noexcept { return noted_; }

 private:
  struct Close {
    void operator()(sqlite3* database) const noexcept;
  };
  class Statement;
  class Transaction;

  /// Longest wait for a lock of another program, such as sqlite3.
  static constexpr int kBusy_ms = 2000;

  /// Locks the directory for this process; the kernel releases the lock when the process ends.
  [[nodiscard]] static int lock_directory(const std::filesystem::path& directory);
  void tighten_permissions();
  void open(StoreAccess access);
  /// Brings an empty database, or one of an older layout, to the layout of this version.
  void migrate();
  /// Why the database cannot be used; empty if it can, or if the file is not an SQLite database
  /// (then opening it fails).
  [[nodiscard]] std::string damage();
  void put_aside(const std::string& why);
  [[nodiscard]] std::filesystem::path aside() const;
  void drop_damaged_rows();
  void cite_anew();
  void restore_models();
  void complete_copies();
  void keep_journal(std::ptrdiff_t unread);
  void report_loss(const std::string& what);
  void note(const std::string& what);
  [[nodiscard]] std::filesystem::path copy_of(const std::string& machine,
                                              const std::string& axis) const;
  [[noreturn]] void fail(const std::string& what) const;
  void execute(const std::string& sql) const;
  [[nodiscard]] std::int64_t number_of(const std::string& sql) const;
  /// SQL: whether a row of this table has its checksum; 1 in a layout without checksums.
  [[nodiscard]] std::string intact_column(const StoreTable& table) const;
  [[nodiscard]] std::string models_of_axis() const;
  /// Throws if the column after `id` says that the row does not have its checksum.
  /// Keeps `what` for found_damage().
  void note_damage(const std::string& what) const;
  void require_intact(const StoreTable& table, const Statement& row, int id) const;
  void insert_event(const Event& event);
  void insert_citation(const std::string& machine, const std::string& axis, int version,
                       const std::string& recording) const;
  /// A model file with the checksum that the copies have.
  [[nodiscard]] static std::string copy_text(nlohmann::json model);
  /// The model of a row of models_of_axis(). Throws if this program cannot use it.
  [[nodiscard]] StoredModel model_in(const Statement& row) const;
  /// The first column of all rows.
  [[nodiscard]] static std::vector<std::string> all_texts(Statement& rows);
  /// The newest usable model of every axis; a sentence about newer unusable ones is added to
  /// `passed_over`.
  [[nodiscard]] std::vector<StoredModel> newest_usable(std::string* passed_over = nullptr) const;

  std::filesystem::path directory_, file_;
  std::string machine_;
  std::string lost_, noted_;
  mutable std::string found_damage_;
  int layout_ = 0;
  int lock_ = -1;
  std::unique_ptr<sqlite3, Close> database_;
  mutable std::mutex mutex_;
};

/// Formats ns since 1970 as "2026-01-31T12:00:00.000Z".
[[nodiscard]] std::string iso_time(std::int64_t wall_ns);

}  // namespace servotwin::daemon
