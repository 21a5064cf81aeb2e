// What becomes of the store when the process is killed, the power fails, or the disk loses a part
// of a file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>

#include "daemon/record/recorder.h"
#include "daemon/store/store.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
namespace fs = std::filesystem;

/// Models that differ.
ModelRecord numbered(int number) { return record_of(drive(10.0 + 0.01 * number)); }

void cut(const fs::path& file, std::uintmax_t size) { fs::resize_file(file, size); }

fs::path database(const fs::path& store) { return store / "servotwin.sqlite"; }

/// A store as it is on the disk while its process lives: the last transactions are in the WAL.
class LivingStore {
 public:
  explicit LivingStore(int promotions) {
    Store store(original_.path(), "mill");
    for (int i = 1; i <= promotions; ++i) {
      ModelRecord record = numbered(i);
      store.promote(record, event_of("promotion " + std::to_string(i)));
    }
    fs::copy(original_.path(), power_cut_.path() / "store", fs::copy_options::recursive);
  }
  [[nodiscard]] fs::path path() const { return power_cut_.path() / "store"; }
  /// A copy that a test may damage.
  [[nodiscard]] fs::path fresh_copy() const {
    fs::path copy = power_cut_.path() / "copy";
    fs::remove_all(copy);
    fs::copy(path(), copy, fs::copy_options::recursive);
    return copy;
  }

 private:
  TemporaryDirectory original_, power_cut_;
};

/// Every byte near the ends and at the borders of pages, and a sample of the rest.
std::vector<std::uintmax_t> lengths(std::uintmax_t size, std::uintmax_t step) {
  std::vector<std::uintmax_t> out;
  for (std::uintmax_t at = 0; at < size; ++at) {
    const std::uintmax_t in_page = at % 4096;
    if (at < 64 || at + 64 > size || in_page < 2 || in_page > 4094 || at % step == 0)
      out.push_back(at);
  }
  return out;
}

TEST(StoreAfterAPowerCut, AJournalThatEndsAnywhereGivesAPrefixOfWhatWasDone) {
  const LivingStore living(4);
  const fs::path journal = "servotwin.sqlite-wal";
  const std::uintmax_t size = fs::file_size(living.path() / journal);
  ASSERT_GT(size, 10'000U);
  int before = 0;
  for (const std::uintmax_t length : lengths(size, 331)) {
    const fs::path copy = living.fresh_copy();
    cut(copy / journal, length);
    fs::remove_all(copy / "models");
    const Store store(copy, "mill");
    const std::vector<StoredModel> versions = store.versions("X");
    const int last = versions.empty() ? 0 : versions[0].record.version;
    ASSERT_EQ(static_cast<int>(versions.size()), last) << "none is missing in between";
    ASSERT_EQ(store.events(100).size(), versions.size()) << "each with its event, at " << length;
    ASSERT_GE(last, before) << "a longer journal has no less, at " << length;
    before = last;
  }
  EXPECT_EQ(Store(living.fresh_copy(), "mill").versions("X").size(), 4U);
}

TEST(StoreAfterAPowerCut, TheModelThatAJournalHasLostComesBackFromItsCopy) {
  const LivingStore living(4);
  const fs::path journal = "servotwin.sqlite-wal";
  const std::uintmax_t size = fs::file_size(living.path() / journal);
  for (std::uintmax_t length = 0; length < size; length += 5003) {
    const fs::path copy = living.fresh_copy();
    cut(copy / journal, length);
    const Store store(copy, "mill");
    ASSERT_THAT(store.lost(), HasSubstr("models in force restored: 1")) << length;
    const std::vector<StoredModel> models = store.in_force();
    ASSERT_EQ(models.size(), 1U) << length;
    ASSERT_EQ(models[0].record.version, 4) << length;
    ModelRecord fourth = numbered(4);
    fourth.version = 4;
    fourth.parent = 3;
    ASSERT_EQ(to_json(models[0].record), to_json(fourth)) << length;
  }
}

TEST(StoreAfterDamage, OfADatabaseThatIsCutAnywhereTheModelInForceComesBack) {
  TemporaryDirectory directory;
  const fs::path whole = directory.path() / "whole", copy = directory.path() / "copy";
  {
    Store store(whole, "mill");
    for (int i = 1; i <= 3; ++i) {
      ModelRecord record = numbered(i);
      store.promote(record, event_of("promotion"));
    }
  }
  ASSERT_FALSE(fs::exists(whole / "servotwin.sqlite-wal")) << "all of it is in the database";
  for (const std::uintmax_t length : lengths(fs::file_size(database(whole)), 1009)) {
    fs::remove_all(copy);
    fs::copy(whole, copy, fs::copy_options::recursive);
    cut(database(copy), length);
    Store store(copy, "mill");
    ASSERT_THAT(store.lost(), HasSubstr("the store was damaged (")) << length;
    ASSERT_THAT(store.lost(), HasSubstr("models in force restored: 1")) << length;
    const std::vector<StoredModel> models = store.in_force();
    ASSERT_EQ(models.size(), 1U) << length;
    ASSERT_EQ(models[0].record.version, 3);
    ASSERT_EQ(to_json(models[0].record), to_json([] {
                ModelRecord third = numbered(3);
                third.version = 3;
                third.parent = 2;
                return third;
              }()));
    ASSERT_EQ(fs::file_size(copy / "servotwin.sqlite.damaged-1"), length) << "nothing is deleted";
    ModelRecord next = numbered(4);
    store.promote(next, event_of("goes on"));
    ASSERT_EQ(next.version, 4);
  }
}

TEST(StoreAfterDamage, ADatabaseThatIsGoneIsSaidAndTheModelComesBack) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord record = numbered(1);
    store.promote(record, event_of("first"));
  }
  fs::remove(database(directory.path()));
  const Store store(directory.path(), "mill");
  EXPECT_THAT(store.lost(), HasSubstr("the database file is missing"));
  EXPECT_EQ(store.in_force().size(), 1U);
}

// Otherwise the recorder would delete the recordings that the restored model was fitted to.
TEST(StoreAfterDamage, TheModelThatComesBackStillCitesItsRecordings) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord record = numbered(1);
    store.promote(record, event_of("first"), {"a.csv"});
    store.promote(record, event_of("second"), {"b.csv", "c.csv"});
  }
  fs::remove(database(directory.path()));
  {
    const Store store(directory.path(), "mill");
    ASSERT_THAT(store.lost(), HasSubstr("the database file is missing"));
    EXPECT_THAT(store.cited(), ElementsAre("b.csv", "c.csv"));
  }
  fs::remove(directory.path() / "models" / "mill" / "X.json");
  { const Store completes_the_copy(directory.path(), "mill"); }
  fs::remove(database(directory.path()));
  EXPECT_THAT(Store(directory.path(), "mill").cited(), ElementsAre("b.csv", "c.csv"));
}

TEST(StoreAfterDamage, ACopyThatIsDamagedTooIsNamed) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord record = numbered(1), other = record_of(drive(), "Y");
    store.promote(record, event_of("first"));
    store.promote(other, event_of("first"));
  }
  cut(database(directory.path()), 5000);
  cut(directory.path() / "models" / "mill" / "Y.json", 100);
  const Store store(directory.path(), "mill");
  EXPECT_THAT(store.lost(), HasSubstr("a model in force could not be restored: "));
  EXPECT_THAT(store.lost(), HasSubstr("Y.json"));
  EXPECT_THAT(store.lost(), HasSubstr("models in force restored: 1"));
  ASSERT_EQ(store.in_force().size(), 1U);
  EXPECT_EQ(store.in_force()[0].record.axis, "X");
}

TEST(StoreAfterDamage, AStoreThatIsWellLosesNothingAndIsCopied) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    ModelRecord record = numbered(1);
    store.promote(record, event_of("first"));
  }
  const fs::path copy = directory.path() / "models" / "mill" / "X.json";
  fs::remove(copy);  // as in a store that knew no copies, or where a crash came in between
  const Store store(directory.path(), "mill");
  EXPECT_EQ(store.lost(), "");
  EXPECT_EQ(read_model(copy).version, 1);
}

/// A disk on which no file becomes larger than this.
class SmallDisk {
 public:
  explicit SmallDisk(std::uintmax_t bytes) : signal_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit small{bytes, before_.rlim_max};
    EXPECT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, signal_);
  }

 private:
  void (*signal_)(int);
  rlimit before_{};
};

bool anything_kept(const fs::path& store) {
  return std::any_of(fs::directory_iterator(store), fs::directory_iterator(),
                     [](const auto& entry) {
                       return entry.path().filename().string().find("damaged") != std::string::npos;
                     });
}

TEST(StoreAfterDamage, WhereThereIsNoRoomForTheDatabaseWithTheDamagedRowsTheStoreOpensWithoutIt) {
  TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    store.add(event_of("damaged"));
    store.add(event_of(std::string(400'000, 'x')));
    ModelRecord record = numbered(1);
    store.promote(record, event_of("first"));
  }
  spoil(directory.path(), "UPDATE events SET text = 'other' WHERE text = 'damaged'");
  std::optional<Store> store;
  {
    const SmallDisk disk(fs::file_size(database(directory.path())) / 2);
    store.emplace(directory.path(), "mill");
    store->add(event_of("goes on"));
  }
  EXPECT_THAT(store->lost(), HasSubstr("1 of events"));
  EXPECT_THAT(store->lost(), HasSubstr("the database with them could not be kept: "));
  EXPECT_FALSE(anything_kept(directory.path()));
  EXPECT_EQ(store->events(10).size(), 3U);
  EXPECT_EQ(store->in_force().size(), 1U);
}

TEST(StoreAfterDamage, WhereThereIsNoRoomForTheDamagedJournalTheStoreOpensWithoutIt) {
  const LivingStore living(4);
  const fs::path journal = living.path() / "servotwin.sqlite-wal";
  const std::uintmax_t size = fs::file_size(journal);
  {
    std::fstream file(journal, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(size / 2));
    file.write("damage", 6);
  }
  std::optional<Store> store;
  {
    const SmallDisk disk(size - 1);
    store.emplace(living.path(), "mill");
    store->add(event_of("goes on"));
  }
  EXPECT_THAT(store->lost(), HasSubstr("the journal of the database was damaged"));
  EXPECT_THAT(store->lost(), HasSubstr("; the journal could not be kept: "));
  EXPECT_FALSE(anything_kept(living.path()));
  EXPECT_EQ(store->in_force()[0].record.version, 4) << "from its copy";
}

/// Promotes, records with a small budget and logs events until it is killed; prints what is stored.
[[noreturn]] void work_until_killed(const fs::path& directory, int acknowledge) {
  Store store(directory, "mill");
  std::ostringstream out;
  EventLog events(store, out);
  const MachineDescription machine = one_axis();
  Ring<CycleRow> rows(64);
  MotionMemory memory(machine, 10.0);
  ResidualWatch watch(machine, DiagnoseConfig(), events);
  Recorder recorder(machine, "mill", directory, RecordingRoom{0.02}, rows, memory, watch, events);
  recorder.spare([&] { return store.cited(); });
  for (std::int64_t i = 0;; ++i) {
    for (std::int64_t file : {2 * i, 2 * i + 1}) {
      for (std::int64_t k = 0; k < 50; ++k) {
        CycleRow row;
        row.time_ns = (50 * file + k) * 1'000'000;
        row.axis_count = 1;
        rows.push(row);
      }
      recorder.drain();
      recorder.finish_file();
    }
    ModelRecord record = numbered(static_cast<int>(i));
    store.promote(record, event_of("better"), recorder.files_with(memory.newest_s(), 1e9));
    if (write(acknowledge, &record.version, sizeof record.version) != sizeof record.version)
      _exit(1);
  }
}

// One store, killed a hundred times: whatever was acknowledged is there each time.
TEST(StoreAfterKill, NothingAcknowledgedIsLostInAHundredKillsAtRandomMoments) {
  TemporaryDirectory directory;
  std::mt19937_64 random(7);
  int acknowledged = 0;
  for (int kill_number = 1; kill_number <= 100; ++kill_number) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) work_until_killed(directory.path(), ends[1]);
    close(ends[1]);
    int version = 0;
    const auto hear = [&] {
      if (read(ends[0], &version, sizeof version) != sizeof version) return false;
      acknowledged = version;
      return true;
    };
    // After some promotions, at any moment of the next one.
    for (std::uint64_t count = random() % 4; count > 0; --count) ASSERT_TRUE(hear());
    usleep(static_cast<useconds_t>(random() % 20'000));
    kill(child, SIGKILL);
    while (hear()) {
    }
    close(ends[0]);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status)) << "it did not end by itself";

    const Store store(directory.path(), "mill");
    ASSERT_EQ(store.lost(), "");
    const std::vector<StoredModel> models = store.in_force();
    ASSERT_EQ(models.size(), acknowledged > 0 || !models.empty() ? 1U : 0U);
    const int last = models.empty() ? 0 : models[0].record.version;
    ASSERT_GE(last, acknowledged) << "kill " << kill_number;
    ASSERT_LE(last, acknowledged + 1);
    ASSERT_EQ(store.versions("X").size(), static_cast<std::size_t>(last));
    acknowledged = last;
    if (last > 0) {
      const int copied = read_model(directory.path() / "models" / "mill" / "X.json").version;
      ASSERT_EQ(copied, last);
    }
    // The recordings that the models cite exist, and all recordings are complete.
    const fs::path recordings = directory.path() / "recordings" / "mill";
    const std::set<std::string> cited = store.cited();
    ASSERT_EQ(cited.size(), static_cast<std::size_t>(last)) << "one each";
    for (const std::string& name : cited) ASSERT_TRUE(fs::exists(recordings / name)) << name;
    for (const auto& entry : fs::directory_iterator(recordings)) {
      if (entry.path().extension() != ".csv") continue;
      std::ifstream file(entry.path());
      std::string line;
      int lines = 0;
      while (std::getline(file, line)) ++lines;
      ASSERT_GE(lines, 51) << entry.path();
    }
  }
  EXPECT_GT(acknowledged, 100);
}

}  // namespace
}  // namespace servotwin::daemon
