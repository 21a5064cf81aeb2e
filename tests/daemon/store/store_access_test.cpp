// Who may use a store: other users may not read it, readers may not keep the daemon from starting,
// and no name leads out of it.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "daemon/store/report_file.h"
#include "daemon/store/store.h"
#include "tests/daemon/support.h"
#include "tests/support/process.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

fs::perms mode_of(const fs::path& path) { return fs::status(path).permissions(); }

/// A program like sqlite3 that reads or writes the database beside the daemon.
class OtherProgram {
 public:
  explicit OtherProgram(const fs::path& store) {
    EXPECT_EQ(sqlite3_open((store / "servotwin.sqlite").c_str(), &database_), SQLITE_OK);
  }
  OtherProgram(const OtherProgram&) = delete;
  OtherProgram& operator=(const OtherProgram&) = delete;
  ~OtherProgram() { sqlite3_close(database_); }
  void runs(const char* sql) {
    char* error = nullptr;
    EXPECT_EQ(sqlite3_exec(database_, sql, nullptr, nullptr, &error), SQLITE_OK) << error;
  }

 private:
  sqlite3* database_ = nullptr;
};

class StoreAccessTest : public testing::Test {
 protected:
  [[nodiscard]] fs::path store() const { return directory_.path() / "store"; }
  void make_store() const {
    Store made(store(), "mill");
    ModelRecord record = record_of(drive());
    made.promote(record, event_of("first"));
  }
  TemporaryDirectory directory_;
};

TEST_F(StoreAccessTest, AReaderDoesNotKeepTheDaemonFromStarting) {
  make_store();
  for (const char* lock : {"BEGIN; SELECT count(*) FROM events", "BEGIN IMMEDIATE"}) {
    OtherProgram other(store());
    other.runs(lock);
    const Store starts(store(), "mill");
    EXPECT_EQ(starts.lost(), "") << lock;
    EXPECT_EQ(starts.in_force().size(), 1U) << lock;
  }
}

TEST_F(StoreAccessTest, AReaderOfADatabaseWithoutAWriteAheadLogDoesNotEither) {
  make_store();
  OtherProgram other(store());
  other.runs("PRAGMA journal_mode=DELETE");
  other.runs("BEGIN; SELECT count(*) FROM events");
  const Store starts(store(), "mill");
  EXPECT_EQ(starts.in_force().size(), 1U);
  EXPECT_THAT(starts.noted(), HasSubstr("another program reads the database"));
}

TEST_F(StoreAccessTest, AProgramThatKeepsTheDatabaseToItselfIsNamed) {
  make_store();
  OtherProgram other(store());
  other.runs("PRAGMA locking_mode=EXCLUSIVE; BEGIN EXCLUSIVE; SELECT count(*) FROM events");
  EXPECT_THAT(message_of([&] { Store starts(store(), "mill"); }),
              HasSubstr("another program, such as sqlite3, has locked the database; end it"));
}

TEST_F(StoreAccessTest, AskingWhetherAStoreIsInUseLocksNothing) {
  make_store();
  EXPECT_FALSE(Store::in_use(store()));
  {
    const Store used(store(), "mill");
    EXPECT_TRUE(Store::in_use(store()));
  }
  // Whoever can read the file may lock it for reading.
  const int reader = open((store() / "lock").c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_GE(reader, 0);
  ASSERT_EQ(flock(reader, LOCK_SH), 0);
  EXPECT_FALSE(Store::in_use(store()));
  EXPECT_EQ(Store(store(), "mill").in_force().size(), 1U);
  close(reader);
}

// Version 0.1.0 locked the file by flock(LOCK_EX | LOCK_NB).
TEST_F(StoreAccessTest, ADaemonOfVersion010AndThisOneDoNotOwnTheSameStore) {
  make_store();
  const int old = open((store() / "lock").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(old, 0);
  {
    const Store used(store(), "mill");
    EXPECT_NE(flock(old, LOCK_EX | LOCK_NB), 0);
    EXPECT_EQ(errno, EWOULDBLOCK);
  }
  ASSERT_EQ(flock(old, LOCK_EX | LOCK_NB), 0);
  EXPECT_THAT(message_of([&] { Store starts(store(), "mill"); }),
              HasSubstr("is in use by another servotwind"));
  close(old);
  EXPECT_EQ(Store(store(), "mill").in_force().size(), 1U);
}

// The whole daemon, with the database locked for writing by another process.
TEST_F(StoreAccessTest, TheDaemonStartsWhileTheDatabaseIsLockedAndSaysSo) {
  make_store();
  int locked[2];
  ASSERT_EQ(pipe(locked), 0);
  const pid_t other = fork();
  ASSERT_GE(other, 0);
  if (other == 0) {
    {
      OtherProgram program(store());
      program.runs("BEGIN IMMEDIATE");
      (void)!write(locked[1], "x", 1);
      pause();
    }
    _exit(1);
  }
  char byte = 0;
  ASSERT_EQ(read(locked[0], &byte, 1), 1);
  test::Process daemon({test::built("servotwind"), "--store", store(), "--domain", "94",
                        "--machine", "mill", "--http", "none"});
  EXPECT_TRUE(daemon.says("another program, such as sqlite3, has locked the database; end it"));
  EXPECT_TRUE(daemon.says("waiting for machine"));
  kill(other, SIGKILL);
  waitpid(other, nullptr, 0);
  close(locked[0]);
  close(locked[1]);
  EXPECT_EQ(daemon.end(SIGTERM), 0) << daemon.said();
}

TEST_F(StoreAccessTest, NobodyElseMayReadWhatTheDaemonWrites) {
  test::Process daemon({test::built("servotwind"), "--store", store(), "--domain", "94",
                        "--machine", "mill", "--http", "none"},
                       {.prepare = [] { umask(0); }});
  ASSERT_TRUE(daemon.says("waiting for machine"));
  EXPECT_EQ(mode_of(store()), fs::perms::owner_all);
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(store())) {
    ++files;
    EXPECT_EQ(mode_of(entry.path()) & (fs::perms::group_all | fs::perms::others_all),
              fs::perms::none)
        << entry.path();
  }
  EXPECT_GE(files, 3) << "lock, database and journal";
  EXPECT_EQ(daemon.end(SIGTERM), 0) << daemon.said();
}

TEST_F(StoreAccessTest, WhatOthersCouldReadIsClosedToThem) {
  make_store();
  const fs::path copy = store() / "models" / "mill" / "X.json";
  fs::permissions(store(), static_cast<fs::perms>(0755));
  fs::permissions(copy.parent_path(), static_cast<fs::perms>(0775));
  for (const fs::path& file : {copy, store() / "servotwin.sqlite", store() / "lock"})
    fs::permissions(file, static_cast<fs::perms>(0664));
  {
    const Store tightened(store(), "mill");
    EXPECT_THAT(tightened.noted(), HasSubstr("other users could read "));
  }
  EXPECT_EQ(mode_of(store()), static_cast<fs::perms>(0700));
  EXPECT_EQ(mode_of(copy.parent_path()), static_cast<fs::perms>(0700));
  for (const fs::path& file : {copy, store() / "servotwin.sqlite", store() / "lock"})
    EXPECT_EQ(mode_of(file), static_cast<fs::perms>(0600)) << file;
  umask(0077);
  const Store again(store(), "mill");
  EXPECT_EQ(again.noted(), "");
}

TEST_F(StoreAccessTest, ADirectoryWithOtherFilesIsLeftAsItIs) {
  make_store();
  std::ofstream(store() / "letter.txt") << "of somebody else";
  fs::permissions(store(), static_cast<fs::perms>(0755));
  fs::permissions(store() / "letter.txt", static_cast<fs::perms>(0644));
  const Store opened(store(), "mill");
  EXPECT_EQ(mode_of(store()), static_cast<fs::perms>(0755));
  EXPECT_EQ(mode_of(store() / "letter.txt"), static_cast<fs::perms>(0644));
  EXPECT_EQ(mode_of(store() / "servotwin.sqlite"), static_cast<fs::perms>(0600));
}

class StoreName : public StoreAccessTest, public testing::WithParamInterface<std::string> {
 protected:
  /// The files of the whole temporary directory outside of the store.
  [[nodiscard]] int files_outside() const {
    int count = 0;
    for (const auto& entry : fs::recursive_directory_iterator(directory_.path())) {
      if (entry.is_regular_file() && !entry.path().string().starts_with(store().string() + "/"))
        ++count;
    }
    return count;
  }
};

TEST_P(StoreName, OfAnAxisIsRefusedAndNothingIsWritten) {
  Store opened(store(), "mill");
  ModelRecord record = record_of(drive());
  record.axis = GetParam();
  EXPECT_THAT(message_of([&] { opened.promote(record, event_of("first")); }),
              HasSubstr("must be 1 to 63 letters, digits or any of . _ -"));
  EXPECT_THAT(message_of([&] { write_report(store(), "mill", GetParam(), "html"); }),
              HasSubstr("must be 1 to 63 letters"));
  EXPECT_EQ(read_report(store(), "mill", GetParam()), std::nullopt);
  EXPECT_TRUE(opened.in_force().empty());
  EXPECT_TRUE(opened.events(10).empty());
  EXPECT_EQ(files_outside(), 0);
}

TEST_P(StoreName, OfAMachineIsRefused) {
  EXPECT_THAT(message_of([&] { Store opened(store(), GetParam()); }),
              HasSubstr("must be 1 to 63 letters"));
  EXPECT_EQ(files_outside(), 0);
}

// A database that another program wrote, or a copy that somebody put there.
TEST_P(StoreName, InTheStoreItselfLeadsNowhere) {
  make_store();
  ModelRecord record = record_of(drive());
  record.axis = GetParam();
  record.version = 1;
  const std::string text = to_json(record).dump();
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((store() / "servotwin.sqlite").c_str(), &database), SQLITE_OK);
  add_row_crc32(database);
  for (const bool machine : {true, false}) {
    sqlite3_stmt* insert = nullptr;
    ASSERT_EQ(sqlite3_prepare_v2(database, insertion(kModels).c_str(), -1, &insert, nullptr),
              SQLITE_OK);
    const std::string other = machine ? "Y" : "mill";
    const auto bind = [&](int at, const std::string& value) {
      sqlite3_bind_text(insert, at, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT);
    };
    bind(1, machine ? GetParam() : "mill");
    bind(2, machine ? "Y" : GetParam());
    sqlite3_bind_int64(insert, 3, 1);
    for (const int at : {4, 5}) bind(at, "then");
    bind(6, text);
    ASSERT_EQ(sqlite3_step(insert), SQLITE_DONE);
    sqlite3_finalize(insert);
  }
  sqlite3_close(database);
  std::ofstream(store() / "models" / "mill" / "B.json") << text;
  const Store opened(store(), "mill");
  EXPECT_THAT(opened.lost(), HasSubstr("B.json"));
  EXPECT_EQ(files_outside(), 0);
  EXPECT_FALSE(fs::exists(store() / "models" / "mill" / ".json"));
}

INSTANTIATE_TEST_SUITE_P(Bad, StoreName,
                         testing::Values("../../x", "a/b", "", ".", "..", "/tmp/x",
                                         std::string("a\0b", 3), std::string(300, 'a'), "a\nb",
                                         ".hidden"),
                         [](const auto& tested) { return "Name" + std::to_string(tested.index); });

}  // namespace
}  // namespace servotwin::daemon
