// A large file needs memory for the columns that are read only.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/support/peak_memory.h"
#include "tests/support/temporary_directory.h"

// Not under the sanitizers: their shadow and freed blocks are memory of the process, too.
#if !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
namespace servotwin {
namespace {

constexpr long kManyRows = 500'000;
constexpr int kOtherColumns = 20;

std::filesystem::path write_wide_file(const test::TemporaryDirectory& directory) {
  auto file = directory.file("wide.csv", "");
  std::ofstream out(file);
  out << "time[s],X.command[mm],X.actual[mm]";
  for (int c = 0; c < kOtherColumns; ++c) out << ",other" << c;
  out << "\n";
  std::string others;
  for (int c = 0; c < kOtherColumns; ++c) others += ",1000.2345";
  others += '\n';
  char row[64];
  for (long i = 0; i < kManyRows; ++i) {
    const double time = 1e-3 * static_cast<double>(i);
    const int size = std::snprintf(row, sizeof row, "%.3f,%.6f,%.6f", time, time, time + 0.001);
    out.write(row, size) << others;
  }
  return file;
}

TEST(CsvMemory, GrowsByTheWantedColumnsOnly) {
  const test::TemporaryDirectory directory;
  const auto file = write_wide_file(directory);
  ASSERT_GT(std::filesystem::file_size(file), 100'000'000U);

  // In a process of its own, whose peak starts at what it has now.
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const long before = test::peak_kib();
    const Recording recording = read_recording(file);
    const long grown = recording.time.size() == static_cast<std::size_t>(kManyRows)
                           ? test::peak_kib() - before
                           : -1;
    const bool told = write(ends[1], &grown, sizeof grown) == sizeof grown;
    _exit(told ? 0 : 1);
  }
  close(ends[1]);
  long grown = -1;
  ASSERT_EQ(read(ends[0], &grown, sizeof grown), static_cast<ssize_t>(sizeof grown));
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);

  constexpr long kWanted = 3 * kManyRows * static_cast<long>(sizeof(double)) / 1024;  // 11.7 MB
  constexpr long kBlocks =
      6 * 1024;  // the block of text, the samples of the estimate, the heap's own
  EXPECT_GE(grown, kWanted * 9 / 10) << "the measurement sees nothing";
  // The kernel counts pages of memory in steps of 64 (percpu_counter, and TASK_RSS_EVENTS_THRESH
  // before Linux 6.2).
  constexpr long kCounted = 64 * 4;
  EXPECT_LE(grown, kWanted + kBlocks + kCounted);
  RecordProperty("grown_kib", std::to_string(grown));
}

}  // namespace
}  // namespace servotwin
#endif
