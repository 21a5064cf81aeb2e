// Prepared SQL statements and transactions of a Store; for store*.cpp only. Errors as those of the
// store.
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <string>

#include "daemon/store/store.h"

namespace servotwin::daemon {

/// A prepared statement that is finalised when it goes out of scope.
class Store::Statement {
 public:
  Statement(const Store& store, const std::string& sql) : store_(store) {
    if (sqlite3_prepare_v2(store.database_.get(), sql.c_str(), -1, &statement_, nullptr) !=
        SQLITE_OK)
      store.fail("cannot be read");
  }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;
  ~Statement() { sqlite3_finalize(statement_); }

  Statement& bind(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.c_str(), static_cast<int>(text.size()),
                      SQLITE_TRANSIENT);
    return *this;
  }
  Statement& bind(std::int64_t number) {
    sqlite3_bind_int64(statement_, ++bound_, number);
    return *this;
  }
  /// Steps to the next row; true if there is one. `doing`: text of the error.
  bool step(const char* doing) {
    const int result = sqlite3_step(statement_);
    if (result != SQLITE_ROW && result != SQLITE_DONE) store_.fail(doing);
    return result == SQLITE_ROW;
  }
  [[nodiscard]] std::string text(int column) const {
    const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return bytes == nullptr ? std::string() : std::string(bytes);
  }
  [[nodiscard]] std::int64_t number(int column) const {
    return sqlite3_column_int64(statement_, column);
  }

 private:
  const Store& store_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

/// A transaction: all changes until commit() are stored together or not at all.
class Store::Transaction {
 public:
  explicit Transaction(const Store& store) : store_(store) { store.execute("BEGIN IMMEDIATE"); }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  ~Transaction() {
    if (!committed_) sqlite3_exec(store_.database_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
  }
  void commit() {
    store_.execute("COMMIT");
    committed_ = true;
  }

 private:
  const Store& store_;
  bool committed_ = false;
};

}  // namespace servotwin::daemon
