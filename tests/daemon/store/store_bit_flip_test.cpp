// One flipped bit in a store: what is read is unchanged, or the damage is reported and the models
// in force come back. SERVOTWIN_FLIPS: how many random bits, instead of 200.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "daemon/store/store.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uintmax_t kHeader = 100;  // bytes, of an SQLite database

int flips() {
  const char* asked = std::getenv("SERVOTWIN_FLIPS");
  return asked == nullptr ? 200 : std::atoi(asked);
}

void flip(const fs::path& file, std::uintmax_t bit) {
  std::fstream bytes(file, std::ios::in | std::ios::out | std::ios::binary);
  const auto at = static_cast<std::streamoff>(bit / 8);
  bytes.seekg(at);
  const int before = bytes.get();
  bytes.seekp(at);
  bytes.put(static_cast<char>(before ^ (1 << bit % 8)));
  ASSERT_TRUE(bytes.flush());
}

/// Two axes with three versions each, diagnoses and events.
void fill(Store& store) {
  for (int i = 1; i <= 3; ++i) {
    for (const char* axis : {"X", "Y"}) {
      ModelRecord record = record_of(drive(10.0 + i + (*axis == 'Y' ? 0.5 : 0.0)), axis);
      store.promote(record, event_of("promotion " + std::to_string(i), axis, R"({"detail":1})"),
                    {axis + std::to_string(i) + ".csv"});
      store.validate(axis, i, "2026-02-0" + std::to_string(i) + "T12:00:00.000Z");
      store.add(
          {"2026-01-31T12:00:00.000Z", axis, "on schedule", "explained",
           R"({"number":)" + std::to_string(i) + R"(,"text":")" + std::string(3000, 'd') + R"("})",
           to_json(record).dump()},
          event_of("diagnosis", axis, R"({"detail":1})"));
    }
  }
}

json models_in_force(const Store& store) {
  json out;
  for (const StoredModel& model : store.in_force()) out[model.record.axis] = to_json(model.record);
  return out;
}

/// Everything that a store returns.
json content(const Store& store) {
  json out{{"in force", models_in_force(store)}};
  for (const std::string& axis : store.axes()) {
    for (const StoredModel& model : store.versions(axis))
      out["versions"].push_back({to_json(model.record), model.reason});
    for (const StoredDiagnosis& one : store.diagnoses(axis, 1000))
      out["diagnoses"].push_back(
          {one.time, one.axis, one.reason, one.verdict, one.json, one.extended_model});
  }
  for (const StoredModel& model : store.in_force()) out["validated"].push_back(model.validated);
  for (const Event& one : store.events(1000))
    out["events"].push_back({one.time, one.axis, one.kind, one.text, one.detail});
  out["cited"] = store.cited();
  out["machines"] = store.machines();
  return out;
}

std::string bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class StoreBitFlip : public testing::Test {
 protected:
  StoreBitFlip() {
    Store store(whole_, "mill");
    fill(store);
    before_ = content(store);
    fs::copy(whole_, living_, fs::copy_options::recursive);
  }

  /// Flips one bit of a file of the store and checks the rule.
  void flip_and_check(const fs::path& store, const fs::path& file, std::uintmax_t bit) {
    const fs::path copy = directory_.path() / "copy";
    fs::remove_all(copy);
    fs::copy(store, copy, fs::copy_options::recursive);
    flip(copy / file, bit);
    const std::string flipped = bytes_of(copy / file);
    SCOPED_TRACE(file.string() + ", bit " + std::to_string(bit % 8) + " of byte " +
                 std::to_string(bit / 8));
    try {
      Store opened(copy, "mill");
      if (opened.lost().empty()) {
        ++unchanged_;
        ASSERT_EQ(content(opened), before_) << "changed, and nothing was said";
      } else {
        ++reported_;
        ASSERT_EQ(models_in_force(opened), before_["in force"]) << opened.lost();
      }
      ModelRecord next = record_of(drive());
      opened.promote(next, event_of("goes on"));
      ASSERT_EQ(next.version, 4) << opened.lost();
    } catch (const std::exception& error) {
      FAIL() << "cannot be used: " << error.what();
    }
    // Another start has nothing to report.
    const Store again(copy, "mill");
    ASSERT_EQ(again.lost(), "");
    ASSERT_EQ(models_in_force(again)["X"]["version"], 4);
    ASSERT_EQ(models_in_force(again)["Y"], before_["in force"]["Y"]);
  }

  void flip_at_random(const fs::path& store, const fs::path& file) {
    std::mt19937_64 random(20261125);
    const std::uintmax_t bits = 8 * fs::file_size(store / file);
    for (int i = 0; i < flips() && !HasFatalFailure(); ++i)
      flip_and_check(store, file, random() % bits);
    std::printf("%s, %ju bytes: %d bits flipped, %d reported and recovered, %d without effect\n",
                file.c_str(), static_cast<std::uintmax_t>(fs::file_size(store / file)),
                unchanged_ + reported_, reported_, unchanged_);
  }

  TemporaryDirectory directory_;
  fs::path whole_ = directory_.path() / "whole",
           living_ = directory_.path() / "living";  // with its journal, as after a power cut
  json before_;
  int unchanged_ = 0, reported_ = 0;
};

TEST_F(StoreBitFlip, InTheDatabaseIsReportedOrChangesNothing) {
  ASSERT_FALSE(fs::exists(whole_ / "servotwin.sqlite-wal")) << "all of it is in the database";
  flip_at_random(whole_, "servotwin.sqlite");
  EXPECT_GT(reported_, flips() / 4);
}

TEST_F(StoreBitFlip, InACopyOfAModelIsReportedOrChangesNothing) {
  const fs::path copy_of_y = fs::path("models") / "mill" / "Y.json";
  flip_at_random(whole_, copy_of_y);
  EXPECT_GT(reported_, flips() / 2);
}

// Together with a database that is gone: a changed copy never comes into force.
TEST_F(StoreBitFlip, InACopyOfAModelChangesNoModelThatComesBack) {
  const fs::path file = fs::path("models") / "mill" / "Y.json";
  std::mt19937_64 random(20261125);
  const std::uintmax_t bits = 8 * fs::file_size(whole_ / file);
  int refused = 0;
  for (int i = 0; i < flips(); ++i) {
    const fs::path copy = directory_.path() / "copy";
    fs::remove_all(copy);
    fs::copy(whole_, copy, fs::copy_options::recursive);
    fs::remove(copy / "servotwin.sqlite");
    const std::uintmax_t bit = random() % bits;
    flip(copy / file, bit);
    const Store store(copy, "mill");
    const json after = models_in_force(store);
    ASSERT_EQ(after["X"], before_["in force"]["X"]) << bit << ": " << store.lost();
    if (after.contains("Y")) {
      ASSERT_EQ(after["Y"], before_["in force"]["Y"]) << bit << ": changed, and nothing was said";
    } else {
      ASSERT_THAT(store.lost(), HasSubstr("a model in force could not be restored: ")) << bit;
      ASSERT_THAT(store.lost(), HasSubstr("Y.json")) << bit;
      ++refused;
    }
  }
  EXPECT_GT(refused, flips() / 2);
}

// SQLite takes a flipped bit for the end of the journal. It cannot be told from a journal that ends
// there if it is in what marks the last frame as the end of a transaction: its number of pages and
// its salts.
TEST_F(StoreBitFlip, InTheJournalIsReportedOrChangesNothing) {
  const fs::path journal = "servotwin.sqlite-wal";
  constexpr std::uintmax_t kLogHeader = 32, kFrame = 24 + 4096;  // bytes
  const std::uintmax_t bytes = fs::file_size(living_ / journal), last = bytes - kFrame;
  std::string lost;
  const auto flip_one = [&](std::uintmax_t bit) {
    const fs::path copy = directory_.path() / "copy";
    fs::remove_all(copy);
    fs::copy(living_, copy, fs::copy_options::recursive);
    fs::remove(copy / "servotwin.sqlite-shm");
    const std::uintmax_t byte = bit / 8;
    flip(copy / journal, bit);
    {
      const Store store(copy, "mill");
      ASSERT_EQ(models_in_force(store), before_["in force"]) << bit << ": " << store.lost();
      lost = store.lost();
      if (!lost.empty()) {
        ++reported_;
      } else if (content(store) == before_) {
        ++unchanged_;
      } else {
        ASSERT_TRUE(last + 4 <= byte && byte < last + 16) << byte << " of " << bytes;
      }
    }
    ASSERT_EQ(Store(copy, "mill").lost(), "");
  };
  std::mt19937_64 random(20261125);
  for (int i = 0; i < flips() && !HasFatalFailure(); ++i) flip_one(random() % (8 * bytes));
  std::printf("%s, %ju bytes: %d bits flipped, %d reported, %d without effect\n", journal.c_str(),
              bytes, flips(), reported_, unchanged_);
  for (std::uintmax_t byte = 0; byte < kLogHeader && !HasFatalFailure(); ++byte) {
    flip_one(8 * byte + byte % 8);
    EXPECT_THAT(lost, HasSubstr("the journal of the database was damaged")) << byte;
  }
}

// One bit of every byte of the header of the database, which the random ones of the file seldom
// hit.
TEST_F(StoreBitFlip, InTheHeaderOfTheDatabaseIsReportedOrChangesNothing) {
  for (std::uintmax_t byte = 0; byte < kHeader && !HasFatalFailure(); ++byte)
    flip_and_check(whole_, "servotwin.sqlite", 8 * byte + byte % 8);
}

using LongStoreBitFlip = StoreBitFlip;
TEST_F(LongStoreBitFlip, EveryBitOfTheHeaderIsReportedOrChangesNothing) {
  for (std::uintmax_t bit = 0; bit < 8 * kHeader && !HasFatalFailure(); ++bit)
    flip_and_check(whole_, "servotwin.sqlite", bit);
}

// Also where only rows are damaged, and the structure of the database is not.
TEST_F(StoreBitFlip, OnlyTheDamagedRowsAreLost) {
  for (const char* sql :
       {"UPDATE diagnoses SET json = replace(json, '\"number\":2', '\"number\":6') WHERE axis = "
        "'X'",
        "UPDATE models SET json = replace(json, '0.', '1.') WHERE axis = 'X' AND version = 3",
        "UPDATE citations SET recording = 'X7.csv' WHERE axis = 'X' AND version = 1"})
    spoil(whole_, sql);
  const Store store(whole_, "mill");
  EXPECT_THAT(store.lost(), HasSubstr("rows that do not match their checksums: 1 of models, 1 of "
                                      "diagnoses, 1 of citations"));
  EXPECT_THAT(store.lost(), HasSubstr("models in force restored: 1"));
  const json after = content(store);
  EXPECT_EQ(after["in force"], before_["in force"]);
  EXPECT_EQ(after["events"], before_["events"]);
  EXPECT_EQ(after["cited"], before_["cited"]);
  EXPECT_EQ(after["versions"].size(), before_["versions"].size());
  EXPECT_EQ(after["diagnoses"].size(), before_["diagnoses"].size() - 1);
  EXPECT_TRUE(fs::exists(whole_ / "servotwin.sqlite.damaged-1")) << "nothing is deleted";
}

// A bit that flips while the daemon runs.
TEST_F(StoreBitFlip, ARowIsCheckedWheneverItIsRead) {
  Store store(whole_, "mill");
  const Store reader(whole_, "mill", StoreAccess::kRead);
  spoil(whole_,
        "UPDATE diagnoses SET verdict = 'explaimed' WHERE axis = 'X'; UPDATE events SET text = "
        "'demotion' WHERE id = 1; UPDATE models SET json = replace(json, '0.', '1.') WHERE axis = "
        "'X' AND version = 3");
  for (const Store* one : {static_cast<const Store*>(&store), &reader}) {
    EXPECT_THAT(message_of([&] { (void)one->diagnoses("X", 10); }),
                HasSubstr("of diagnoses is damaged: its checksum does not match; restart"));
    EXPECT_THAT(message_of([&] { (void)one->events(1000); }),
                HasSubstr("row 1 of events is damaged"));
    EXPECT_EQ(one->diagnoses("Y", 10).size(), 3U);
    EXPECT_EQ(one->versions("X").size(), 2U);
    EXPECT_EQ(models_in_force(*one)["X"]["version"], 2);
  }
}

TEST_F(StoreBitFlip, ACopyWithoutAChecksumIsReadAndGetsOne) {
  const fs::path file = whole_ / "models" / "mill" / "X.json";
  json copy = json::parse(bytes_of(file));
  EXPECT_EQ(copy["crc32"].get<std::string>().size(), 8U);
  copy.erase("crc32");
  std::ofstream(file) << copy.dump(2);
  fs::remove(whole_ / "servotwin.sqlite");
  {
    const Store store(whole_, "mill");
    EXPECT_THAT(store.lost(), HasSubstr("models in force restored: 2"));
    EXPECT_EQ(models_in_force(store), before_["in force"]);
  }
  EXPECT_TRUE(json::parse(bytes_of(file)).contains("crc32"));
  EXPECT_EQ(read_model(file).version, 3) << "a copy is a model file";
}

}  // namespace
}  // namespace servotwin::daemon
