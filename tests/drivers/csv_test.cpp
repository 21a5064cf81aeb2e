#include "drivers/recordings/table/csv.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/drivers/table_fixture.h"
#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

class Csv : public TableFixture {};

TEST_F(Csv, ReadsTheFormatOfTheContract) {
  const Recording r = read(
      "# a comment\n"
      "time[ms],X.command[mm],X.actual[um],X.torque[Nm],C.command[deg],C.actual[rev]\n"
      "0,1,900,2.5,180,0.25\n"
      "# another, between the rows\n"
      "2,3,2900,-2.5,-180,0.5\n");
  ASSERT_EQ(r.axes.size(), 2U);
  EXPECT_EQ(r.time, (std::vector<double>{0.0, 0.002}));
  EXPECT_EQ(r.axes[0].name, "X");
  EXPECT_FALSE(r.axes[0].rotary);
  EXPECT_EQ(r.axes[0].command, (std::vector<double>{0.001, 0.003}));
  EXPECT_EQ(r.axes[0].actual, (std::vector<double>{0.0009, 0.0029}));
  EXPECT_EQ(r.axes[0].torque, (std::vector<double>{2.5, -2.5}));
  EXPECT_EQ(r.axes[0].torque_unit, "Nm");
  EXPECT_EQ(r.axes[1].name, "C");
  EXPECT_TRUE(r.axes[1].rotary);
  EXPECT_DOUBLE_EQ(r.axes[1].command[1], -std::numbers::pi);
  EXPECT_DOUBLE_EQ(r.axes[1].actual[1], std::numbers::pi);
  EXPECT_TRUE(r.axes[1].torque.empty());
  EXPECT_TRUE(r.notes.empty()) << notes(r);
}

TEST_F(Csv, ReadsForeignColumnsByTheirNames) {
  const Recording r =
      read("t_s,pos_cmd,pos_meas,ctrl\n0.5,1,2,3\n0.75,4,5,6\n",
           mapped("X.command=pos_cmd[mm], X.actual=pos_meas[mm], X.torque=ctrl[V]"));
  EXPECT_EQ(r.time, (std::vector<double>{0.5, 0.75}));
  EXPECT_EQ(r.axes.at(0).command, (std::vector<double>{0.001, 0.004}));
  EXPECT_EQ(r.axes.at(0).actual, (std::vector<double>{0.002, 0.005}));
  EXPECT_EQ(r.axes.at(0).torque_unit, "V");
  EXPECT_NE(notes(r).find("time is column 't_s'"), std::string::npos) << notes(r);
}

TEST_F(Csv, ATimeWithoutUnitIsSecondsAndSaysSo) {
  const Recording r = read("Time,a,b\n1,1,2\n2,4,5\n", mapped("X.command=a[m],X.actual=b[m]"));
  EXPECT_EQ(r.time, (std::vector<double>{1, 2}));
  EXPECT_NE(notes(r).find("'Time', read as seconds"), std::string::npos) << notes(r);
}

TEST_F(Csv, AMappedTimeIsTakenEvenIfAnotherColumnLooksLikeOne) {
  const Recording r =
      read("t,stamp,a\n7,1000,1\n8,2000,2\n", mapped("X.command=a[m],time=stamp[us]"));
  EXPECT_EQ(r.time, (std::vector<double>{0.001, 0.002}));
}

TEST_F(Csv, ARateStandsInForATimeThatIsNotThere) {
  ReadOptions options = mapped("X.command=a[m]");
  options.rate_hz = 500.0;
  EXPECT_EQ(read("a,b\n1,0\n2,0\n3,0\n", options).time, (std::vector<double>{0.0, 0.002, 0.004}));
}

TEST_F(Csv, AForeignUnitInTheHeaderIsPartOfTheNameOrNot) {
  const char* text = "time[s],pos[mm]\n0,1\n1,2\n";
  EXPECT_EQ(read(text, mapped("X.command=pos[mm]")).axes.at(0).command,
            (std::vector<double>{0.001, 0.002}));
  EXPECT_EQ(read(text, mapped("X.command=pos[mm][mm]")).axes.at(0).command,
            (std::vector<double>{0.001, 0.002}));
}

// What other programs write: separators, line ends, byte order mark, quotes, a separator at the
// end.
TEST_F(Csv, IsTolerantOfForeignDialects) {
  const std::vector<double> command{0.0015, -0.002}, time{0.0, 1.0};
  for (const char* text : {
           "time[s];X.command[mm]\n0;1.5\n1;-2\n",
           "time[s]\tX.command[mm]\n0\t1.5\n1\t-2\n",
           "time[s],X.command[mm]\r\n0,1.5\r\n1,-2\r\n",
           "\xef\xbb\xbftime[s],X.command[mm]\n0,1.5\n1,-2\n",
           "\xef\xbb\xbf# comment\ntime[s],X.command[mm]\n0,1.5\n1,-2\n",
           "\"time[s]\",\"X.command[mm]\"\n0,1.5\n1,-2\n",
           "time[s],X.command[mm]\n\"0\",\"+1.5\"\n1,\"-2\"\n",
           "time[s],X.command[mm],\n0,1.5,\n1,-2,\n",
           "time[s],X.command[mm],\n0,1.5\n1,-2\n",
           "time[s],X.command[mm]\n0,1.5,\n1,\"-2\",\n",
           "time[s] , X.command[mm] \n 0 , +1.5 \n\n1,\t-2e0\n",
           "time[s],X.command[mm]\n0,1.5\n1,-2.0",
           "X.command[mm],time[s]\n1.5,0\n-2,1\n",
           "a,X.command[mm],b,time[s],c\nx,1.5,\"q, q\",0,\n,-2,,1,z\n",
       }) {
    SCOPED_TRACE(text);
    const Recording r = read(text);
    EXPECT_EQ(r.time, time);
    EXPECT_EQ(r.axes.at(0).command, command);
  }
}

TEST_F(Csv, OneColumnMayBeTwoChannels) {
  const Recording r =
      read("t,a,b\n0,1,2\n1,3,4\n", mapped("X.command=a[m],X.actual=b[m],Y.command=b[m]"));
  EXPECT_EQ(r.axes.at(0).actual, (std::vector<double>{2, 4}));
  EXPECT_EQ(r.axes.at(1).command, (std::vector<double>{2, 4}));
}

TEST_F(Csv, WhatIsNotReadIsNamed) {
  const Recording r = read(
      "cycle,time[s],X.command[m],X.actual[m],X.comand[m],X.velocity[mm/s],load\n"
      "1,0,1,2,3,4,text\n2,1,1,2,3,4,text\n");
  EXPECT_NE(notes(r).find("ignored columns: cycle, X.comand[m] (not X.command?), load"),
            std::string::npos)
      << notes(r);
  EXPECT_NE(notes(r).find("X.velocity is not used"), std::string::npos) << notes(r);
}

TEST_F(Csv, TheMotorsEncoderIsReadBesideThatOfTheLoad) {
  const Recording r = read(
      "time[s],X.command[m],X.actual[m],X.actual_motor[mm*-2],Y.command[m],Y.actual_motor[rad]\n"
      "0,1,2,3,4,5\n1,1,2,,4,5\n");
  EXPECT_EQ(r.axes.at(0).actual_motor.at(0), -0.006);
  EXPECT_TRUE(std::isnan(r.axes.at(0).actual_motor.at(1)));
  EXPECT_NE(notes(r).find("X.actual_motor: empty, NaN or infinite in 1 of 2 rows"),
            std::string::npos);
  EXPECT_NE(notes(r).find("Y.actual_motor is not used without Y.actual"), std::string::npos);
  EXPECT_TRUE(r.axes.at(1).actual_motor.empty());
  test::expect_error<std::runtime_error>(
      [&] { (void)read("time[s],X.command[m],X.actual[m],X.actual_motor[rad]\n0,1,2,3\n"); },
      {"axis 'X' has one position as a length and another as an angle"});
}

TEST_F(Csv, AChannelThatIsNotThereIsNanInEveryRow) {
  const Recording r = read("time[s],X.command[m]\n0,1\n1,2\n");
  ASSERT_EQ(r.axes.at(0).actual.size(), 2U);
  EXPECT_TRUE(std::isnan(r.axes[0].actual[0]) && std::isnan(r.axes[0].actual[1]));
  EXPECT_TRUE(r.axes[0].torque.empty());
}

TEST_F(Csv, MissingValuesAreNanAndCounted) {
  const Recording r = read(
      "time[s],X.command[m],X.actual[m]\n0,1,1\n1,nan,1\n2,,inf\n3,-Infinity,1e999\n4,5,1e-999\n");
  const auto& x = r.axes.at(0);
  EXPECT_TRUE(std::isnan(x.command[1]) && std::isnan(x.command[2]) && std::isnan(x.command[3]));
  EXPECT_TRUE(std::isnan(x.actual[2]) && std::isnan(x.actual[3]));
  EXPECT_EQ(x.actual[4], 0.0);
  EXPECT_NE(notes(r).find("X.command: empty, NaN or infinite in 3 of 5 rows, the first in line 3"),
            std::string::npos)
      << notes(r);
  EXPECT_NE(notes(r).find("X.actual: empty, NaN or infinite in 2 of 5"), std::string::npos)
      << notes(r);
}

TEST_F(Csv, ALastLineThatIsCutOffIsDroppedAndNamed) {
  const Recording r = read("time[s],X.command[m],X.actual[m]\n0,1,1\n1,2,2\n2,3");
  EXPECT_EQ(r.time.size(), 2U);
  EXPECT_NE(notes(r).find("line 4, the last one, is cut off"), std::string::npos) << notes(r);
}

// A download that broke off inside its last number: 64 instead of 64.5678.
TEST_F(Csv, ALastNumberThatIsCutOffIsNoValue) {
  const std::string whole = "time[s],X.command[mm],X.actual[mm]\n0,61.25,61.2678\n1,63.5,63.2678\n";
  for (const char* cut : {"2,65.5,64.567", "2,65.5,64.", "2,65.5,64", "2,65.5,-", "2,65.5,"}) {
    SCOPED_TRACE(cut);
    const Recording r = read(whole + cut);
    EXPECT_EQ(r.time, (std::vector<double>{0, 1}));
    EXPECT_NE(notes(r).find("line 4, the last one, has no line end"), std::string::npos)
        << notes(r);
    EXPECT_NE(notes(r).find("dropped as cut off"), std::string::npos) << notes(r);
  }
}

TEST_F(Csv, AWholeLastLineWithoutItsEndIsTakenAndNamed) {
  const std::string rows = "0,61.25,61.2678\n1,63.5,63.2678\n2,65.5,64.5678";
  // Only the last cell can be cut off; if it is not read, no row is dropped.
  for (const char* names :
       {"time[s],X.command[mm],X.actual[mm]\n", "time[s],X.command[mm],load\n"}) {
    SCOPED_TRACE(names);
    const Recording r = read(names + rows);
    EXPECT_EQ(r.time, (std::vector<double>{0, 1, 2}));
    EXPECT_NE(notes(r).find("line 4, the last one, has no line end; kept as complete"),
              std::string::npos)
        << notes(r);
  }
  EXPECT_EQ(read("time[s],X.command[mm],load\n0,1.5,3.25\n1,1.5,3").time.size(), 2U);
  EXPECT_EQ(notes(read("time[s],X.command[m],X.actual[m]\n" + rows + "\n")), "");
}

TEST_F(Csv, ReadsThePartThatIsAskedFor) {
  ReadOptions options;
  options.from_s = 0.5;
  options.to_s = 1.0;
  const Recording r = read("time[s],X.command[m]\n10,1\n10.5,2\n10.75,3\n11,4\n11.5,5\n", options);
  EXPECT_EQ(r.time, (std::vector<double>{10.5, 10.75, 11}));
  EXPECT_EQ(r.axes.at(0).command, (std::vector<double>{2, 3, 4}));
  EXPECT_NE(notes(r).find("outside --from and --to: 2 of 5 rows"), std::string::npos) << notes(r);
}

// The text is read in blocks that end within a line; no line may be damaged by that.
TEST_F(Csv, LinesAcrossBlocksAreWhole) {
  std::string text = "time[s],X.command[m],note\n";
  constexpr int kRows = 60'000;
  for (int i = 0; i < kRows; ++i) {
    text += std::to_string(i) + "," + std::to_string(3 * i) + "," +
            std::string(static_cast<std::size_t>(i % 97), 'n') + "\n";
  }
  ASSERT_GT(text.size(), 3U << 20);
  const Recording r = read(text);
  ASSERT_EQ(r.time.size(), static_cast<std::size_t>(kRows));
  for (int i = 0; i < kRows; ++i) {
    ASSERT_EQ(r.time[static_cast<std::size_t>(i)], i);
    ASSERT_EQ(r.axes[0].command[static_cast<std::size_t>(i)], 3 * i);
  }
}

}  // namespace
}  // namespace servotwin
