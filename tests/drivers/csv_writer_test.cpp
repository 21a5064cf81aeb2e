#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>

#include "drivers/common/checksum.h"
#include "drivers/recordings/table/csv.h"
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
    for (auto* channel : {&x.command, &x.actual, &x.torque, &c.command, &x.actual_motor})
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
    for (auto* channel : {&axis.command, &axis.actual, &axis.actual_motor, &axis.torque})
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
    EXPECT_TRUE(same_bits(read.axes[a].actual_motor, written.axes[a].actual_motor));
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
            "time[s],X.command[m],X.actual[m],X.actual_motor[m],X.torque[Nm],C.command[rad]");
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

// SERVOTWIN_FLIPS: how many random bits, instead of 200.
TEST(WriteRecordingCsv, AFlippedBitIsReportedWhenItIsRead) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "out.csv";
  write_recording_csv(file, recording(50));
  const Recording before = read_recording(file);
  const std::string text = text_of(file);
  const char* asked = std::getenv("SERVOTWIN_FLIPS");
  const int flips = asked == nullptr ? 200 : std::atoi(asked);
  std::mt19937_64 random(20261125);
  int reported = 0;
  for (int i = 0; i < flips; ++i) {
    const std::size_t bit = random() % (8 * text.size());
    std::string flipped = text;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
    const auto damaged = directory.file("flipped.csv", flipped);
    try {
      const Recording read = read_recording(damaged);
      ASSERT_EQ(read.axes.size(), before.axes.size()) << "bit " << bit;
      ASSERT_TRUE(same_bits(read.time, before.time)) << "bit " << bit;
      for (std::size_t a = 0; a < read.axes.size(); ++a) {
        ASSERT_EQ(read.axes[a].name, before.axes[a].name) << "bit " << bit;
        ASSERT_EQ(read.axes[a].rotary, before.axes[a].rotary) << "bit " << bit;
        ASSERT_TRUE(same_bits(read.axes[a].command, before.axes[a].command)) << "bit " << bit;
        ASSERT_TRUE(same_bits(read.axes[a].actual, before.axes[a].actual)) << "bit " << bit;
        ASSERT_TRUE(same_bits(read.axes[a].torque, before.axes[a].torque)) << "bit " << bit;
      }
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find("flipped.csv"), std::string::npos);
      ++reported;
    }
  }
  std::printf("recording of %zu bytes: %d bits flipped, %d reported, %d without effect\n",
              text.size(), flips, reported, flips - reported);
  EXPECT_GT(reported, flips / 2);
}

// Written by hand or by version 0.1.0.
TEST(WriteRecordingCsv, ARecordingWithoutAChecksumIsRead) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "out.csv";
  write_recording_csv(file, recording(3));
  const std::string text = text_of(file);
  const std::size_t last = text.rfind("# crc32 ");
  ASSERT_NE(last, std::string::npos);
  EXPECT_EQ(read_recording(directory.file("old.csv", text.substr(0, last))).time.size(), 3U);
  expect_error<std::runtime_error>(
      [&] { (void)read_recording(directory.file("changed.csv", "# by hand\n" + text)); },
      {"changed.csv: its checksum does not match", "if it was changed on purpose, delete"});
}

// The check value of CRC-32 in the catalogue of CRCs, and an empty text.
TEST(Checksum, IsThatOfTheStandard) {
  EXPECT_EQ(crc32_text(crc32_of("123456789")), "cbf43926");
  EXPECT_EQ(crc32_text(crc32_of("6789", crc32_of("12345"))), "cbf43926");
  EXPECT_EQ(crc32_text(crc32_of("")), "00000000");
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
