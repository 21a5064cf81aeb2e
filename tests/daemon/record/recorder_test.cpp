#include "daemon/record/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "drivers/recordings/recording_file.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;

class RecorderTest : public testing::Test {
 protected:
  /// Rows of two axes from cycle to cycle, through the ring.
  void feed(Recorder& recorder, std::int64_t from, std::int64_t to) {
    for (std::int64_t k = from; k < to; ++k) {
      CycleRow row;
      row.time_ns = k * 1'000'000;
      row.after_gap = false;
      row.axis_count = 2;
      const double t = static_cast<double>(k) * kCycle_s;
      row.axes[0] = {command_at(t), command_at(t) - 1e-6 / 3.0, 0.1 * t};
      row.axes[1] = {-command_at(t), kAbsent, kAbsent};
      ASSERT_TRUE(rows_.push(row));
      if (rows_.waiting() > 1000) recorder.drain();
    }
    recorder.drain();
  }
  [[nodiscard]] std::vector<std::filesystem::path> files() const {
    std::vector<std::filesystem::path> out;
    for (const auto& entry :
         std::filesystem::directory_iterator(directory_.path() / "recordings" / "mill")) {
      out.push_back(entry.path());
    }
    std::sort(out.begin(), out.end());
    return out;
  }
  Recorder recorder(double budget_mb) { return recorder(RecordingRoom{budget_mb}); }
  Recorder recorder(const RecordingRoom& room) {
    return {machine_, "mill", directory_.path(), room, rows_, memory_, watch_, events_};
  }
  [[nodiscard]] double megabytes() const {
    double bytes = 0.0;
    for (const auto& file : files()) bytes += static_cast<double>(std::filesystem::file_size(file));
    return 1e-6 * bytes;
  }
  [[nodiscard]] std::set<std::string> names() const {
    std::set<std::string> out;
    for (const auto& file : files()) out.insert(file.filename());
    return out;
  }
  [[nodiscard]] long times_said(const std::string& text) const {
    const std::string said = said_.str();
    long times = 0;
    for (std::size_t at = said.find(text); at != said.npos; at = said.find(text, at + 1)) ++times;
    return times;
  }

  TemporaryDirectory directory_;
  MachineDescription machine_{kCycle_s, {{"X", false, "V"}, {"B", true, ""}}};
  Ring<CycleRow> rows_{2048};
  MotionMemory memory_{machine_, 100.0};
  std::ostringstream said_;
  Store store_{directory_.path(), "mill"};
  EventLog events_{store_, said_};
  ResidualWatch watch_{machine_, DiagnoseConfig(), events_};
};

TEST_F(RecorderTest, FilesReadBackBitForBit) {
  Recorder recorder = this->recorder(100.0);
  feed(recorder, 5000, 7000);
  recorder.finish_file();
  ASSERT_EQ(files().size(), 1U);
  const Recording recording = read_recording(files()[0]);
  ASSERT_EQ(recording.time.size(), 2000U);
  ASSERT_EQ(recording.axes.size(), 2U);
  EXPECT_EQ(recording.axes[0].torque_unit, "V");
  EXPECT_TRUE(recording.axes[1].rotary);
  for (std::size_t i = 0; i < 2000; ++i) {
    const double t = static_cast<double>(5000 + i) * kCycle_s;
    ASSERT_EQ(recording.axes[0].command[i], command_at(t));
    ASSERT_EQ(recording.axes[0].actual[i], command_at(t) - 1e-6 / 3.0);
    ASSERT_EQ(recording.axes[0].torque[i], 0.1 * t);
    ASSERT_EQ(recording.axes[1].command[i], -command_at(t));
    ASSERT_NEAR(recording.time[i], static_cast<double>(i) * kCycle_s, 1e-12);
  }
}

TEST_F(RecorderTest, EveryRowIsInExactlyOneFile) {
  Recorder recorder = this->recorder(100.0);
  feed(recorder, 0, 65'000);
  feed(recorder, 10, 500);  // the source starts again: another file
  recorder.finish_file();
  ASSERT_EQ(files().size(), 4U);
  std::vector<std::size_t> rows;
  for (const auto& file : files()) rows.push_back(read_recording(file).time.size());
  EXPECT_EQ(rows, (std::vector<std::size_t>{30'000, 30'000, 5'000, 490}));
}

TEST_F(RecorderTest, RowsThatShareACoarseStampStayInOneFile) {
  Recorder recorder = this->recorder(100.0);
  for (std::int64_t k = 0; k < 2000; ++k) {
    CycleRow row;
    row.time_ns = k / 4 * 1'000'000;  // 4 kHz, stamped in whole milliseconds
    row.axis_count = 2;
    row.axes[0].command = static_cast<double>(k);
    ASSERT_TRUE(rows_.push(row));
    recorder.drain();
  }
  recorder.finish_file();
  ASSERT_EQ(files().size(), 1U);
  EXPECT_EQ(read_recording(files()[0]).time.size(), 2000U);
}

// A link to itself cannot be examined, so that the oldest file cannot be found.
TEST_F(RecorderTest, WhatCannotBeDeletedIsSaidOnceAndTheRowsAreRecorded) {
  Recorder recorder = this->recorder(100.0);
  const std::filesystem::path loop = directory_.path() / "recordings" / "mill" / "loop.csv";
  std::filesystem::create_symlink(loop, loop);
  feed(recorder, 0, 65'000);
  recorder.finish_file();
  EXPECT_EQ(recorder.rows_not_recorded(), 0U);
  EXPECT_EQ(files().size(), 4U) << "three, and the link";
  const std::string said = said_.str();
  EXPECT_THAT(said, HasSubstr("the oldest recordings are not deleted: "));
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1);
}

TEST_F(RecorderTest, TheOldestGoWhereTheBudgetIsSpentAndItIsSaid) {
  Recorder recorder = this->recorder(2.0);
  feed(recorder, 0, 125'000);
  recorder.finish_file();
  double bytes = 0.0;
  for (const auto& file : files()) bytes += static_cast<double>(std::filesystem::file_size(file));
  EXPECT_LE(bytes, 2e6 * 1.5);
  EXPECT_LT(files().size(), 5U);
  EXPECT_EQ(read_recording(files().back()).time.size(), 5'000U) << "the newest is there";
  EXPECT_THAT(said_.str(), HasSubstr("the oldest recordings are deleted, to stay within 2 MB"));
}

TEST_F(RecorderTest, WhereItsFolderIsNoneAnyMoreItGoesOnAndCounts) {
  Recorder recorder = this->recorder(100.0);
  const std::filesystem::path place = directory_.path() / "recordings" / "mill";
  std::filesystem::remove_all(place);
  std::ofstream(place) << "in its place";
  feed(recorder, 0, 1000);
  recorder.finish_file();
  EXPECT_EQ(recorder.rows_not_recorded(), 1000U);
  EXPECT_NE(recorder.problem(), "");
  std::filesystem::remove(place);
  feed(recorder, 1000, 2000);
  recorder.finish_file();
  EXPECT_EQ(files().size(), 1U) << "and records again where it can";
}

// Where the clock was set back, the recording with the latest name is not the newest.
TEST_F(RecorderTest, TheOldestGoFirstAlsoWhereTheClockWasSetBack) {
  const std::filesystem::path place = directory_.path() / "recordings" / "mill";
  std::filesystem::create_directories(place);
  const std::string of_before = "2999-12-31T235959.000Z";
  std::ofstream(place / (of_before + ".csv")) << std::string(1'000'000, '#');
  std::ofstream(place / "zero.csv") << "none of ours";
  Recorder recorder = this->recorder(1.5);
  feed(recorder, 0, 25'000);
  EXPECT_EQ(names(), (std::set<std::string>{of_before + ".csv", "zero.csv"}))
      << "nothing is finished yet";
  recorder.finish_file();
  EXPECT_EQ(names(), (std::set<std::string>{of_before + "_000002.csv", "zero.csv"}))
      << "what is none of ours is left alone";
  feed(recorder, 25'000, 26'000);
  recorder.finish_file();
  EXPECT_TRUE(names().contains(of_before + "_000003.csv")) << "the newest stays";
}

// Five files of about a megabyte each; the first is of a model in force, the second of one before:
// the store does not tell them apart, because it keeps both models.
TEST_F(RecorderTest, WhatAnyModelCitesIsNeverDeleted) {
  Recorder recorder = this->recorder(100.0);
  recorder.spare([&] { return store_.cited(); });
  feed(recorder, 0, 150'000);
  recorder.finish_file();
  const std::vector<std::filesystem::path> all = files();
  ASSERT_EQ(all.size(), 5U);
  const double size = static_cast<double>(std::filesystem::file_size(all[0]));
  for (const auto& cited : {all[1], all[0]}) {
    ModelRecord record = record_of(drive());
    store_.promote(record, {record.created, "X", "model_promoted", "better", ""},
                   {cited.filename()});
  }

  recorder.keep({4.9e-6 * size});  // room for four, when the next one has come
  feed(recorder, 150'000, 180'000);
  recorder.finish_file();
  std::vector<std::filesystem::path> kept = files();
  ASSERT_EQ(kept.size(), 4U);
  EXPECT_EQ(kept[0], all[0]);
  EXPECT_EQ(kept[1], all[1]);
  EXPECT_EQ(kept[2], all[4]) << "the oldest that nobody cites are gone";

  recorder.keep({3.1e-6 * size});
  feed(recorder, 180'000, 210'000);
  recorder.finish_file();
  EXPECT_EQ(files().size(), 3U);
  EXPECT_THAT(said_.str(), testing::Not(HasSubstr("kept beyond")));

  for (const double room : {1.9, 0.5}) {
    recorder.keep({1e-6 * room * size});
    feed(recorder, 210'000, 240'000);
    recorder.finish_file();
    kept = files();
    ASSERT_EQ(kept.size(), 3U) << room;
    EXPECT_EQ(kept[0], all[0]);
    EXPECT_EQ(kept[1], all[1]) << "of a model that is not in force any more";
  }
  const std::string said = said_.str(), spared =
                                            ": 2 recordings that models were fitted to or "
                                            "judged on";
  const std::size_t first = said.find(spared);
  EXPECT_NE(first, said.npos) << said;
  EXPECT_EQ(said.find(spared, first + 1), said.npos) << "once is enough";
}

TEST_F(RecorderTest, WithoutCitationsTheNewestAloneMayBeMoreThanTheBudget) {
  Recorder recorder = this->recorder(0.001);
  recorder.spare([&] { return store_.cited(); });
  feed(recorder, 0, 35'000);
  recorder.finish_file();
  EXPECT_EQ(files().size(), 1U);
  EXPECT_THAT(said_.str(), testing::Not(HasSubstr("kept beyond")));
}

// No file of this machine is more than 4.5 MB, so that none is begun beyond 5.5 MB here; those that
// come are of 2 MB.
TEST_F(RecorderTest, AtTheCeilingItStopsAndGoesOnWhenThereIsRoom) {
  constexpr double kMost_mb = 10.0;
  Recorder recorder = this->recorder(RecordingRoom{1.0, kMost_mb});
  recorder.spare([&] { return names(); });  // models cite all of them
  feed(recorder, 0, 30'001);
  EXPECT_EQ(recorder.problem(), "");
  feed(recorder, 30'001, 200'000);
  EXPECT_LE(megabytes(), kMost_mb);
  const std::size_t kept = files().size();
  EXPECT_GE(kept, 2U);
  EXPECT_LT(kept, 6U);
  EXPECT_EQ(recorder.rows_not_recorded(), 200'000U - kept * 30'000U)
      << "every row is accounted for";
  EXPECT_EQ(times_said("recording stops: "), 1) << said_.str();
  EXPECT_THAT(recorder.problem(), HasSubstr("store.recordings_max_mb = 10"));
  EXPECT_NEAR(memory_.newest_s(), 199.999, 1e-9) << "the machine is watched as before";
  EXPECT_TRUE(recorder.files_with(190.0, 200.0).empty()) << "no model cites what is not there";

  std::filesystem::remove(files().front());  // by hand
  feed(recorder, 200'000, 232'000);
  EXPECT_EQ(recorder.problem(), "");
  EXPECT_EQ(times_said("recording resumed; "), 1) << said_.str();
  recorder.finish_file();
  std::uint64_t rows = 30'000U + recorder.rows_not_recorded();  // what was removed, and never there
  for (const auto& file : files()) rows += read_recording(file).time.size();
  EXPECT_EQ(rows, 232'000U);
}

TEST_F(RecorderTest, WhereNoModelCitesThemTheOldestMakeRoomBelowTheCeiling) {
  Recorder recorder = this->recorder(RecordingRoom{10.0, 10.0});
  feed(recorder, 0, 200'000);
  recorder.finish_file();
  EXPECT_EQ(recorder.rows_not_recorded(), 0U);
  EXPECT_LE(megabytes(), 10.0);
  EXPECT_EQ(recorder.problem(), "");
}

TEST_F(RecorderTest, WhatIsThereAtTheStartCounts) {
  {
    Recorder before = this->recorder(100.0);
    feed(before, 0, 150'000);
    before.finish_file();
  }
  Recorder recorder = this->recorder(RecordingRoom{1.0, 6.5});
  recorder.spare([&] { return names(); });
  feed(recorder, 0, 1000);
  EXPECT_EQ(recorder.rows_not_recorded(), 1000U);
  EXPECT_NE(recorder.problem(), "");
  recorder.keep({1.0, 100.0});
  feed(recorder, 1000, 31'000);
  EXPECT_EQ(recorder.rows_not_recorded(), 30'000U) << "it looks for room every 30 s";
  EXPECT_EQ(recorder.problem(), "");
}

TEST_F(RecorderTest, KnowsWhichFilesHaveTheRowsOfATime) {
  Recorder recorder = this->recorder(100.0);
  feed(recorder, 0, 65'000);
  EXPECT_EQ(recorder.files_with(0.0, 29.0).size(), 1U);
  EXPECT_EQ(recorder.files_with(29.0, 31.0).size(), 2U);
  const std::vector<std::string> open = recorder.files_with(64.0, 64.0);
  recorder.finish_file();
  ASSERT_EQ(open.size(), 1U) << "the file that is being collected has its name already";
  EXPECT_EQ(open[0], files().back().filename());
  EXPECT_TRUE(recorder.files_with(70.0, 80.0).empty());
}

TEST_F(RecorderTest, WithoutABudgetRemembersButWritesNothing) {
  Recorder recorder = this->recorder(0.0);
  feed(recorder, 0, 100);
  recorder.finish_file();
  EXPECT_FALSE(std::filesystem::exists(directory_.path() / "recordings"));
  EXPECT_NEAR(memory_.newest_s(), 0.099, 1e-12);
}

TEST_F(RecorderTest, RemovesWhatACrashLeftHalfWritten) {
  const std::filesystem::path place = directory_.path() / "recordings" / "mill";
  std::filesystem::create_directories(place);
  std::ofstream(place / "2026-01-31T120000.000Z.csv.part-77-1") << "time[s],X.com";
  std::ofstream(place / "2026-01-31T110000.000Z.csv") << "time[s],X.command[m]\n";
  const Recorder recorder = this->recorder(100.0);
  ASSERT_EQ(files().size(), 1U);
  EXPECT_EQ(files()[0].extension(), ".csv");
}

// The kernel refuses every byte of a larger file, as a full disk does.
TEST_F(RecorderTest, WhereTheDiskRefusesItGoesOnCountsAndSaysSoOnce) {
  Recorder recorder = this->recorder(100.0);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  auto* const signal_before = signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 300'000;  // room for the store's events
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  feed(recorder, 0, 65'000);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  signal(SIGXFSZ, signal_before);

  EXPECT_EQ(recorder.rows_not_recorded(), 60'000U);
  EXPECT_TRUE(files().empty()) << "no half of a file stays behind";
  EXPECT_NEAR(memory_.newest_s(), 64.999, 1e-9) << "the machine is watched as before";
  const std::string said = said_.str();
  EXPECT_THAT(said, HasSubstr("recordings are not stored: "));
  EXPECT_THAT(said, HasSubstr("File too large"));
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1);
  std::string last_error;
  events_.update_last_error(last_error);
  EXPECT_THAT(last_error, HasSubstr("recordings are not stored"));

  recorder.finish_file();
  EXPECT_EQ(files().size(), 1U);
  EXPECT_THAT(said_.str(), HasSubstr("recordings are stored again; missing: 60000 rows"));
}

}  // namespace
}  // namespace servotwin::daemon
