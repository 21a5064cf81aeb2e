// What Cyclone DDS reports goes to standard error, and not without limit.
#include "drivers/dds/dds_log.h"

#include <dds/dds.h>
#include <dds/ddsrt/log.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace servotwin {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

TEST(LineLimit, LetsTenLinesAMinutePassAndCountsTheOthers) {
  LineLimit limit;
  for (int k = 0; k < 9; ++k) EXPECT_EQ(limit.pass("no route", k), "no route\n");
  EXPECT_EQ(limit.pass("no route\n", 9),
            "no route\nCyclone DDS: more than 10 lines in a minute; the next ones are counted\n");
  for (int k = 0; k < 116'000; ++k) EXPECT_EQ(limit.pass("no route", 10 + k), "");
  EXPECT_EQ(limit.pass("no route", 59 * kSecond_ns), "");
  EXPECT_EQ(limit.pass("at last", 60 * kSecond_ns),
            "Cyclone DDS: 116001 lines left out\nat last\n");
  // A minute begins with a line, and the count with it.
  for (int k = 0; k < 8; ++k) EXPECT_EQ(limit.pass("again", 119 * kSecond_ns), "again\n");
  EXPECT_EQ(limit.pass("later", 120 * kSecond_ns), "later\n");
}

TEST(LineLimit, IsWhatCycloneReportsThrough) {
  limit_dds_log();
  limit_dds_log();
  testing::internal::CaptureStderr();
  for (int k = 0; k < 1000; ++k)
    dds_log(DDS_LC_ERROR, __FILE__, __LINE__, "test", "the network is gone %d\n", k);
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_LE(std::count(said.begin(), said.end(), '\n'), LineLimit::kMaxLines + 2) << said;
  EXPECT_NE(said.find("the network is gone"), std::string::npos) << said;
}

}  // namespace
}  // namespace servotwin
