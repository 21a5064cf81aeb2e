#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>

#include "drivers/csv.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using test::expect_error;

Recording recording(std::size_t rows) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(-1e3, 1e3);
  Recording r;
  AxisRecord x, c;
  x.name = "X";
  x.torque_unit = "Nm";
  c.name = "C";
  c.rotary = true;
  for (std::size_t i = 0; i < rows; ++i) {
    r.time.push_back(1e-3 * static_cast<double>(i));
    for (auto* channel : {&x.command, &x.actual, &x.torque, &c.command})
      channel->push_back(any(random));
    c.actual.push_back(kAbsent);
  }
  r.axes = {x, c};
  return r;
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](double x, double y) {
    return (std::isnan(x) && std::isnan(y)) ||
           std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
  });
}

std::size_t files_in(const std::filesystem::path& directory) {
  return static_cast<std::size_t>(
      std::distance(std::filesystem::directory_iterator(directory), {}));
}

TEST(WriteRecordingCsv, ARecordingOfNothingSaysOfWhatAndReadsBack) {
  const test::TemporaryDirectory directory;
  Recording written = recording(2);
  for (AxisRecord& axis : written.axes) {
    for (auto* channel : {&axis.command, &axis.actual, &axis.torque})
      std::fill(channel->begin(), channel->end(), kAbsent);
  }
  write_recording_csv(directory.path() / "nothing.csv", written);
  const Recording read = read_csv(directory.path() / "nothing.csv", {});
  ASSERT_EQ(read.axes.size(), 2U);
  EXPECT_EQ(read.axes[0].name, "X");
  EXPECT_TRUE(same_bits(read.time, written.time));
  EXPECT_TRUE(same_bits(read.axes[0].command, written.axes[0].command));
}

TEST(WriteRecordingCsv, ReadsBackBitForBit) {
  const test::TemporaryDirectory directory;
  Recording written = recording(30'000);  // more than a block of text
  written.axes[0].actual[5] = kAbsent;
  written.axes[0].torque[6] = -0.0;
  written.axes[0].torque[7] = 5e-324;
  const auto file = directory.path() / "out.csv";
  write_recording_csv(file, written);
  const Recording read = read_recording(file);
  EXPECT_TRUE(same_bits(read.time, written.time));
  ASSERT_EQ(read.axes.size(), 2U);
  for (std::size_t a = 0; a < 2; ++a) {
    EXPECT_EQ(read.axes[a].name, written.axes[a].name);
    EXPECT_EQ(read.axes[a].rotary, written.axes[a].rotary);
    EXPECT_EQ(read.axes[a].torque_unit, written.axes[a].torque_unit);
    EXPECT_TRUE(same_bits(read.axes[a].command, written.axes[a].command));
    EXPECT_TRUE(same_bits(read.axes[a].actual, written.axes[a].actual));
    EXPECT_TRUE(same_bits(read.axes[a].torque, written.axes[a].torque));
  }
  EXPECT_EQ(files_in(directory.path()), 1U);
}

TEST(WriteRecordingCsv, HeaderHasUnitsAndLeavesOutWhatIsAbsent) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "out.csv";
  write_recording_csv(file, recording(1));
  const std::string text = text_of(file);
  EXPECT_EQ(text.substr(0, text.find('\n')),
            "time[s],X.command[m],X.actual[m],X.torque[Nm],C.command[rad]");
}

TEST(WriteRecordingCsv, AFullDiskLeavesTheOldFileAndNothingElse) {
  const test::TemporaryDirectory directory;
  const auto file = directory.file("out.csv", "the old one");
  // A limit on the size of files acts like a disk that is full at that size.
  struct rlimit before {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const struct rlimit small { .rlim_cur = 4096, .rlim_max = before.rlim_max };
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  expect_error<std::runtime_error>([&] { write_recording_csv(file, recording(1000)); },
                                   {"out.csv: cannot be written: File too large"});
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(text_of(file), "the old one");
  EXPECT_EQ(files_in(directory.path()), 1U);
}

TEST(WriteRecordingCsv, ADirectoryThatIsNotThere) {
  const test::TemporaryDirectory directory;
  expect_error<std::runtime_error>(
      [&] { write_recording_csv(directory.path() / "none" / "out.csv", recording(3)); },
      {"none/out.csv: cannot be written: No such file or directory"});
}

TEST(WriteRecordingCsv, RefusesWhatWouldNotReadBack) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "out.csv";
  const auto refuses = [&](const Recording& bad, std::initializer_list<const char*> parts) {
    expect_error<std::invalid_argument>([&] { write_recording_csv(file, bad); }, parts);
  };
  Recording bad = recording(3);
  bad.axes[0].command.pop_back();
  refuses(bad, {"X.command has 2 values for 3 rows"});
  bad = recording(3);
  bad.axes[0].torque_unit.clear();
  refuses(bad, {"X.torque has no unit"});
  bad = recording(3);
  bad.axes[1].name = "C,D";
  refuses(bad, {"'C,D'"});
  EXPECT_EQ(files_in(directory.path()), 0U);
}

}  // namespace
}  // namespace servotwin
