#include "daemon/store/store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <nlohmann/json.hpp>

#include "tests/daemon/full_disk.h"
#include "tests/daemon/support.h"
#include "twin/twin.h"

namespace servotwin::daemon {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(Store, CountsVersionsAndParentsPerAxis) {
  TemporaryDirectory directory;
  Store store(directory.path(), "mill");
  for (int version = 1; version <= 3; ++version) {
    ModelRecord record = record_of(drive());
    store.promote(record, event_of("better"));
    EXPECT_EQ(record.version, version);
    EXPECT_EQ(record.parent, version - 1);
  }
  ModelRecord other = record_of(drive(), "Y");
  store.promote(other, event_of("first"));
  EXPECT_EQ(other.version, 1);
  const std::vector<StoredModel> versions = store.versions("X");
  ASSERT_EQ(versions.size(), 3U);
  EXPECT_EQ(versions.front().record.version, 3);
  EXPECT_EQ(versions.back().record.version, 1);
}

TEST(Store, ComesBackWithTheModelsInForceBitForBit) {
  TemporaryDirectory directory;
  std::vector<double> commands, before(200), after(200);
  for (int i = 0; i < 200; ++i) commands.push_back(command_at(i * kCycle_s));
  {
    Store store(directory.path(), "mill");
    ModelRecord old = record_of(drive(15.0)),
                record = record_of(drive(20.0 + 1.0 / 3.0, 0.1 + 1e-17));
    store.promote(old, event_of("first"));
    store.promote(record, event_of("leaves 1.3 um"));
    Twin(record.model).predict(commands, before);
  }
  Store store(directory.path(), "mill");
  const std::vector<StoredModel> models = store.in_force();
  ASSERT_EQ(models.size(), 1U);
  EXPECT_EQ(models[0].record.version, 2);
  EXPECT_EQ(models[0].record.parent, 1);
  EXPECT_EQ(models[0].reason, "leaves 1.3 um");
  EXPECT_EQ(models[0].record.holdout.rms, 1.3e-6);
  Twin(models[0].record.model).predict(commands, after);
  EXPECT_EQ(before, after);
}

TEST(Store, KnowsWhenTheVersionInForceWasLastFoundToHold) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord first = record_of(drive());
    store.promote(first, event_of("first"));
    EXPECT_EQ(store.in_force()[0].validated, "");
    store.validate("X", 1, "2026-01-31T12:00:00.000Z");
    store.validate("X", 1, "2026-02-01T12:00:00.000Z");
    EXPECT_EQ(store.in_force()[0].validated, "2026-02-01T12:00:00.000Z");
  }
  {
    const Store other(directory.path(), "lathe", StoreAccess::kRead);
    EXPECT_THAT(other.in_force(), testing::IsEmpty());
  }
  Store store(directory.path(), "mill");
  EXPECT_EQ(store.in_force()[0].validated, "2026-02-01T12:00:00.000Z");
  ModelRecord second = record_of(drive());
  store.promote(second, event_of("second"));
  EXPECT_EQ(store.in_force()[0].validated, "") << "that was another version";
}

TEST(Store, KeepsMachinesApart) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord record = record_of(drive());
    store.promote(record, event_of("first"));
  }
  Store store(directory.path(), "lathe");
  EXPECT_TRUE(store.in_force().empty());
  EXPECT_TRUE(store.events(10).empty());
}

TEST(Store, KnowsWhichRecordingsModelsCiteWhetherTheseAreInForceOrNot) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord first = record_of(drive()), second = record_of(drive()),
                other = record_of(drive(), "Y");
    store.promote(first, event_of("first"), {"a.csv", "b.csv"});
    store.promote(second, event_of("second"), {"b.csv", "c.csv"});
    store.promote(other, event_of("of another axis"), {"a.csv"});
    EXPECT_THAT(store.cited(), ElementsAre("a.csv", "b.csv", "c.csv"));
    ModelRecord third = record_of(drive());
    store.promote(third, event_of("third"), {"d.csv"});
  }
  const Store store(directory.path(), "mill");
  EXPECT_THAT(store.cited(), ElementsAre("a.csv", "b.csv", "c.csv", "d.csv"));
  EXPECT_THAT(Store(directory.path(), "lathe", StoreAccess::kRead).cited(), IsEmpty());
}

TEST(Store, EventsComeBackTheNewestFirst) {
  TemporaryDirectory directory;
  Store store(directory.path(), "mill");
  for (int i = 0; i < 5; ++i)
    store.add(event_of("event " + std::to_string(i), i % 2 == 0 ? "" : "X"));
  const std::vector<Event> events = store.events(3);
  ASSERT_EQ(events.size(), 3U);
  EXPECT_EQ(events[0].text, "event 4");
  EXPECT_EQ(events[1].axis, "X");
  EXPECT_EQ(events[2].text, "event 2");
}

StoredDiagnosis diagnosis(int number, const std::string& axis = "X") {
  return {"2026-01-31T12:00:00.000Z",
          axis,
          "on schedule",
          "explained",
          "{\"number\":" + std::to_string(number) + "}",
          "{}"};
}

TEST(Store, DiagnosesComeBackTheNewestFirstAfterARestart) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    for (int i = 1; i <= 3; ++i) store.add(diagnosis(i), event_of("diagnosis"));
    store.add(diagnosis(4, "Y"), event_of("diagnosis", "Y"));
  }
  const Store store(directory.path(), "mill");
  const std::vector<StoredDiagnosis> found = store.diagnoses("X", 2);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].json, R"({"number":3})");
  EXPECT_EQ(found[1].json, R"({"number":2})");
  EXPECT_EQ(found[0].time, "2026-01-31T12:00:00.000Z");
  EXPECT_EQ(found[0].axis, "X");
  EXPECT_EQ(found[0].reason, "on schedule");
  EXPECT_EQ(found[0].verdict, "explained");
  EXPECT_EQ(found[0].extended_model, "{}");
  EXPECT_EQ(store.diagnoses("X", 100).size(), 3U);
  EXPECT_EQ(store.diagnoses("Y", 100).size(), 1U);
  EXPECT_TRUE(store.diagnoses("Z", 100).empty());
  EXPECT_EQ(store.events(100).size(), 4U) << "each with its event";
}

TEST(Store, OfEveryAxisTheNewestDiagnosesAreKept) {
  TemporaryDirectory directory;
  { Store store(directory.path(), "mill"); }
  // As many as are kept, of two axes and of another machine, by SQL because it is faster.
  for (const char* whose : {"'mill', 'X'", "'mill', 'Y'", "'lathe', 'X'"}) {
    spoil(directory.path(),
          "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < " +
              std::to_string(Store::kDiagnosesKept) +
              ") INSERT INTO diagnoses (machine, axis, time, reason, verdict, json, "
              "extended_model) SELECT " +
              whose + ", '', '', '', i, '' FROM n; UPDATE diagnoses SET crc32 = " +
              checksum(kDiagnoses) + " WHERE crc32 IS NULL");
  }
  {
    Store store(directory.path(), "mill");
    store.add(diagnosis(1), event_of("diagnosis"));
    store.add(diagnosis(2), event_of("diagnosis"));
    const std::vector<StoredDiagnosis> kept = store.diagnoses("X", 1'000'000);
    ASSERT_EQ(kept.size(), static_cast<std::size_t>(Store::kDiagnosesKept));
    EXPECT_EQ(kept.front().json, R"({"number":2})");
    EXPECT_EQ(kept.back().json, "3") << "the two oldest are gone";
    EXPECT_EQ(store.diagnoses("Y", 1'000'000).size(), kept.size());
  }
  const Store lathe(directory.path(), "lathe");
  EXPECT_EQ(lathe.diagnoses("X", 1'000'000).size(),
            static_cast<std::size_t>(Store::kDiagnosesKept));
}

TEST(Store, IsReadBesideTheOneThatOwnsItAndNotWritten) {
  TemporaryDirectory directory;
  EXPECT_THAT(message_of([&] { Store store(directory.path(), "mill", StoreAccess::kRead); }),
              HasSubstr("does not exist; --store"));
  EXPECT_TRUE(std::filesystem::is_empty(directory.path())) << "nothing is made";
  Store owner(directory.path(), "mill");
  owner.add(diagnosis(1), event_of("diagnosis"));
  Store reader(directory.path(), "mill", StoreAccess::kRead);
  EXPECT_EQ(reader.diagnoses("X", 10).size(), 1U);
  owner.add(diagnosis(2), event_of("diagnosis"));
  EXPECT_EQ(reader.diagnoses("X", 10).size(), 2U);
  EXPECT_THAT(message_of([&] { reader.add(event_of("not mine")); }), HasSubstr("readonly"));
}

/// The tables of version 0.1.0, without checksums.
constexpr const char* kLayout1 = R"(
  PRAGMA journal_mode=WAL;
  CREATE TABLE models (
    machine TEXT NOT NULL, axis TEXT NOT NULL, version INTEGER NOT NULL,
    created TEXT NOT NULL, reason TEXT NOT NULL, json TEXT NOT NULL,
    PRIMARY KEY (machine, axis, version)) WITHOUT ROWID;
  CREATE TABLE events (
    id INTEGER PRIMARY KEY, time TEXT NOT NULL, machine TEXT NOT NULL, axis TEXT NOT NULL,
    kind TEXT NOT NULL, text TEXT NOT NULL, detail TEXT NOT NULL);
  PRAGMA user_version=1;
)";
constexpr const char* kDiagnosesOfLayout1 = R"(
  CREATE TABLE diagnoses (
    id INTEGER PRIMARY KEY, time TEXT NOT NULL, machine TEXT NOT NULL, axis TEXT NOT NULL,
    reason TEXT NOT NULL, verdict TEXT NOT NULL, json TEXT NOT NULL, extended_model TEXT NOT NULL);
)";

TEST(Store, OneWithoutChecksumsIsReadAndGetsThem) {
  TemporaryDirectory directory;
  ModelRecord record = record_of(drive());
  record.version = 4;
  spoil(directory.path(), kLayout1);
  spoil(directory.path(), kDiagnosesOfLayout1);
  spoil(directory.path(), "INSERT INTO models VALUES ('mill', 'X', 4, 'then', 'old', '" +
                              to_json(record).dump() +
                              "'); INSERT INTO events VALUES (7, 'then', 'mill', 'X', 'model', "
                              "'old', ''); INSERT INTO diagnoses VALUES (9, 'then', 'mill', 'X', "
                              "'on schedule', 'explained', '{\"number\":1}', '{}')");
  const auto content = [&](const Store& store) {
    EXPECT_EQ(store.in_force().size(), 1U);
    EXPECT_EQ(to_json(store.in_force().at(0).record), to_json(record));
    EXPECT_EQ(store.versions("X").size(), 1U);
    EXPECT_EQ(store.events(10).at(0).text, "old");
    EXPECT_EQ(store.diagnoses("X", 10).at(0).json, "{\"number\":1}");
  };
  content(Store(directory.path(), "mill", StoreAccess::kRead));
  {
    const Store store(directory.path(), "mill");
    EXPECT_EQ(store.lost(), "");
    content(store);
  }
  content(Store(directory.path(), "mill"));
  content(Store(directory.path(), "mill", StoreAccess::kRead));
  spoil(directory.path(), "UPDATE diagnoses SET json = '{\"number\":2}'");
  EXPECT_THAT(Store(directory.path(), "mill").lost(), HasSubstr("1 of diagnoses"));
}

TEST(Store, OneThatKnewNoDiagnosesIsOpened) {
  TemporaryDirectory directory;
  spoil(directory.path(), kLayout1);
  Store store(directory.path(), "mill");
  EXPECT_TRUE(store.diagnoses("X", 1).empty());
  store.add(diagnosis(1), event_of("diagnosis"));
  EXPECT_EQ(store.diagnoses("X", 1).size(), 1U);
}

TEST(Store, IsHeldByOneProcess) {
  TemporaryDirectory directory;
  Store store(directory.path(), "mill");
  EXPECT_THAT(message_of([&] { Store second(directory.path(), "mill"); }),
              HasSubstr("is in use by another servotwind"));
}

TEST(Store, WhereNothingCanBeWrittenIsNamed) {
  TemporaryDirectory directory;
  std::ofstream(directory.path() / "file") << "not a directory";
  const std::filesystem::path place = directory.path() / "file" / "store";
  EXPECT_THAT(message_of([&] { Store store(place, "mill"); }),
              testing::AllOf(HasSubstr(place.string()), HasSubstr("Not a directory")));
  if (geteuid() != 0) {
    std::filesystem::permissions(directory.path(), std::filesystem::perms::owner_read);
    EXPECT_THAT(message_of([&] { Store store(directory.path(), "mill"); }),
                HasSubstr("Permission denied"));
    std::filesystem::permissions(directory.path(), std::filesystem::perms::owner_all);
  }
}

TEST(Store, AFileThatIsNoDatabaseIsRefused) {
  TemporaryDirectory directory;
  std::ofstream(directory.path() / "servotwin.sqlite") << std::string(4096, 'x');
  EXPECT_THAT(message_of([&] { Store store(directory.path(), "mill"); }),
              HasSubstr("file is not a database"));
}

TEST(Store, ALayoutOfTheFutureIsRefused) {
  TemporaryDirectory directory;
  { Store store(directory.path(), "mill"); }
  spoil(directory.path(), "PRAGMA user_version=3");
  std::int64_t checksum = 0;
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((directory.path() / "servotwin.sqlite").c_str(), &database), SQLITE_OK);
  add_row_crc32(database);
  sqlite3_exec(
      database, layout_checksum().c_str(),
      [](void* to, int, char** values, char**) {
        *static_cast<std::int64_t*>(to) = std::stoll(values[0]);
        return 0;
      },
      &checksum, nullptr);
  sqlite3_close(database);
  spoil(directory.path(), "PRAGMA application_id=" + std::to_string(checksum));
  EXPECT_THAT(message_of([&] { Store store(directory.path(), "mill"); }),
              HasSubstr("newer servotwind (layout 3"));
}

TEST(Store, AModelThatCannotBeUsedIsNamedAndTheVersionBeforeIsInForce) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord record = record_of(drive());
    store.promote(record, event_of("first"));
    store.promote(record, event_of("second"));
  }
  struct Damage {
    const char* json;
    const char* what;
  };
  for (const Damage& damage : {
           Damage{"substr(json, 1, 200)", "parse error"},
           Damage{"'{\"schema\":\"servotwin.model/9\"}'", "schema"},
           Damage{"''", "parse error"},
       }) {
    spoil(directory.path(), other_models(damage.json, " WHERE version = 2"));
    const Store store(directory.path(), "mill");
    EXPECT_THAT(store.lost(), HasSubstr("model of axis X, version 2, cannot be used: "));
    EXPECT_THAT(store.lost(), HasSubstr(damage.what));
    EXPECT_THAT(store.lost(), HasSubstr("version 1 is in force"));
    EXPECT_EQ(store.lost().find('\n'), std::string::npos);
    ASSERT_EQ(store.in_force().size(), 1U);
    EXPECT_EQ(store.in_force()[0].record.version, 1);
    EXPECT_EQ(store.versions("X").size(), 1U);
    EXPECT_EQ(store.versions("X", 1).size(), 1U) << "the newest that can be used";
  }
  // The next model gets a new version number, and its parent is the model in force.
  ModelRecord next = record_of(drive());
  {
    Store store(directory.path(), "mill");
    store.promote(next, event_of("third"));
  }
  EXPECT_EQ(next.version, 3);
  EXPECT_EQ(next.parent, 1);
  spoil(directory.path(), other_models("'{'", ""));
  Store store(directory.path(), "mill");
  EXPECT_THAT(store.lost(), HasSubstr("the axis is identified again"));
  EXPECT_TRUE(store.in_force().empty());
  store.promote(next, event_of("fourth"));
  EXPECT_EQ(next.version, 4);
  EXPECT_EQ(next.parent, 0);
}

TEST(StoreOnAFullDisk, CannotBeMade) {
  TemporaryDirectory directory;
  const FullDisk full;
  EXPECT_THAT(message_of([&] { Store store(directory.path(), "mill"); }), HasSubstr("full"));
}

TEST(StoreOnAFullDisk, KeepsWhatItHadAndGoesOnWhenThereIsSpaceAgain) {
  TemporaryDirectory directory;
  Store store(directory.path(), "mill");
  ModelRecord first = record_of(drive(15.0)), second = record_of(drive(20.0));
  store.promote(first, event_of("first"));
  {
    const FullDisk full;
    EXPECT_THAT(message_of([&] { store.promote(second, event_of("second")); }), HasSubstr("full"));
    EXPECT_THAT(message_of([&] { store.add(event_of("not stored")); }), HasSubstr("full"));
    EXPECT_THAT(message_of([&] { store.add(diagnosis(1), event_of("not stored")); }),
                HasSubstr("full"));
    EXPECT_EQ(second.version, 0) << "it was not acknowledged";
    ASSERT_EQ(store.in_force().size(), 1U);
    EXPECT_EQ(store.in_force()[0].record.version, 1);
  }
  store.promote(second, event_of("second"));
  EXPECT_EQ(second.version, 2);
  EXPECT_TRUE(store.diagnoses("X", 1).empty());
  EXPECT_EQ(store.events(10).size(), 2U) << "one event per promotion, none of what was refused";
}

TEST(Store, TimesAreIso8601InUtc) {
  EXPECT_EQ(iso_time(0), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(iso_time(1'769'860'800'123'456'789), "2026-01-31T12:00:00.123Z");
}

}  // namespace
}  // namespace servotwin::daemon
