// Tables as spreadsheets and recorders write them. What is true here is what the person who wrote
// the cells meant.
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <string>

#include "drivers/common/time_stamp.h"
#include "drivers/recordings/recording_file.h"
#include "tests/drivers/table_fixture.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

using std::vector;
using test::expect_error;

class ForeignTable : public TableFixture {
 protected:
  template <class Error = std::runtime_error>
  void refuses(std::string_view text, std::initializer_list<const char*> parts,
               const ReadOptions& options = {}) const {
    const auto file = directory_.file("bad.csv", text);
    expect_error<Error>([&] { (void)read_recording(file, options); }, parts);
  }
};

TEST_F(ForeignTable, SemicolonsWithADecimalComma) {
  const Recording r =
      read("time[s];X.command[mm];X.actual[mm]\n0,000;-1,5;2\n0,001;+3,25;1,5E-1\n0,002;4;0,25\n");
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.001, 0.002}));
  EXPECT_EQ(r.axes[0].command, (vector<double>{-0.0015, 0.00325, 0.004}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.002, 0.00015, 0.00025}));
}

TEST_F(ForeignTable, TheOtherMarkDividesThousands) {
  const Recording german = read("time[s];X.command[mm]\n0;0,5\n1;1.234,5\n2;1.234.567,25\n"),
                  english = read("time[s]\tX.command[mm]\n0\t0.5\n1\t1,234.5\n2\t1,234,567.25\n");
  for (const Recording* r : {&german, &english})
    EXPECT_EQ(r->axes[0].command, (vector<double>{0.0005, 1.2345, 1234.56725}));
}

TEST_F(ForeignTable, CommasThatMayDivideThousandsAreNoted) {
  const Recording counts = read("time[s];X.command[mm]\n0;0\n1;500\n2;1,250\n3;12,750\n"),
                  decimals = read("time[s];X.command[mm]\n0;0,500\n1;1,250\n");
  EXPECT_EQ(counts.axes[0].command[2], 0.00125);
  EXPECT_NE(notes(counts).find("if they divide thousands"), std::string::npos) << notes(counts);
  EXPECT_EQ(notes(decimals), "");
  EXPECT_EQ(read("time[s];X.command[mm]\n0;0,5\n1;1.250\n").axes[0].command[1], 1.25);
}

TEST_F(ForeignTable, NumbersThatAreNamesStayNames) {
  // As pandas writes a frame without names.
  const Recording r =
      read(",0,1,2\n0,5.0,6.0,7.0\n1,5.5,6.5,7.5\n", mapped("X.command=1[mm],time=0[s]"));
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.006, 0.0065}));
  const Recording exact = read("t,Pos,Pos (mm)\n0,1,2\n", mapped("X.command=Pos (mm)"));
  EXPECT_EQ(exact.axes[0].command, (vector<double>{0.002}));
}

TEST_F(ForeignTable, RowsOfNumbersWithDecimalCommasNeedNoHeader) {
  const Recording r =
      read("0,000;0,5;1,5\n0,001;0,75;2,5\n", mapped("X.command=2[mm],X.actual=3[mm],time=1[s]"));
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.001}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.0015, 0.0025}));
}

TEST_F(ForeignTable, AColumnHasOneDecimalMark) {
  refuses("time[s];X.command[mm]\n0;0,5\n1;1.25\n",
          {"line 3", "'1.25' is not a number", "the rows above have a decimal comma"});
  refuses("time[s];X.command[mm]\n0;0.5\n1;1,25\n",
          {"line 3", "'1,25' is not a number", "the rows above have a decimal point"});
  refuses("time[s];X.command[mm]\n0;0,5\n1;12.34,5\n", {"line 3", "'12.34,5' is not a number"});
  refuses("time[s],X.command[mm]\n0,\"0,5\"\n",
          {"line 2", "'0,5' is not a number", "decimals need a point"});
}

TEST_F(ForeignTable, AbsentValuesAsSpreadsheetsSayThem) {
  const Recording r =
      read("time[s],X.command[mm],X.actual[mm]\n0,1,N/A\n1,2,-\n2,3,#N/A\n3,4,null\n4,5,7\n");
  for (int k = 0; k < 4; ++k) EXPECT_TRUE(std::isnan(r.axes[0].actual[static_cast<size_t>(k)]));
  EXPECT_EQ(r.axes[0].actual[4], 0.007);
  EXPECT_NE(notes(r).find("X.actual: empty, NaN or infinite in 4 of 5 rows"), std::string::npos)
      << notes(r);
}

TEST_F(ForeignTable, TimesAsDatesAndAsTimesOfDay) {
  const auto times = [&](const std::string& a, const std::string& b, const std::string& c) {
    return read("time[s];X.command[mm]\n" + a + ";1\n" + b + ";2\n" + c + ";3\n").time;
  };
  const auto near = [](const vector<double>& time, double start) {
    ASSERT_EQ(time.size(), 3U);
    EXPECT_NEAR(time[0], start, 1e-9);
    EXPECT_NEAR(time[1], start + 0.001, 1e-9);
    EXPECT_NEAR(time[2], start + 0.002, 1e-9);
  };
  const double start = 6 * 3600 + 16 * 60 + 50.0;
  near(times("2024-05-16T06:16:50.000", "2024-05-16T06:16:50.001", "2024-05-16T06:16:50.002"),
       start);
  near(times("2024-05-16 06:16:50,000Z", "2024-05-16 06:16:50,001Z", "2024-05-16 06:16:50,002Z"),
       start);
  near(times("16.05.2024 06:16:50.000", "16.05.2024 06:16:50.001", "16.05.2024 06:16:50.002"),
       start);
  near(times("06:16:50.000", "06:16:50.001", "06:16:50.002"), start);
  near(times("06:16:50,000", "06:16:50,001", "06:16:50,002"), start);
  // Over midnight, at the end of a leap year's February.
  near(times("2024-02-29T23:59:59.999", "2024-03-01T00:00:00.000", "2024-03-01T00:00:00.001"),
       86'399.999);
  near(times("23:59:59.999", "00:00:00.000", "00:00:00.001"), 86'399.999);
}

TEST(TimeStampTest, WhatIsNoTimeIsNotRead) {
  for (const char* text :
       {"", "1.5", "06:16", "6:61:00", "24:00:00", "2023-02-29T00:00:00", "05/16/2024 06:16:50",
        "2024-05-16", "2024-05-16T06:16:50x", "16-05-24 06:16:50", "2024-13-01 00:00:00"}) {
    const auto stamp = parse_time_stamp(text);
    EXPECT_FALSE(stamp) << text;
  }
}

TEST_F(ForeignTable, ARowOfUnitsUnderTheNames) {
  const Recording r = read("Time,Position Command,Position Actual,Mode\ns,mm,um,\n0,1,900,2\n",
                           mapped("X.command=Position Command,X.actual=Position Actual"));
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.001}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.0009}));
  EXPECT_NE(notes(r).find("line 2 is read as the units"), std::string::npos) << notes(r);
  // A unit that is given comes before that of the file.
  EXPECT_EQ(read("t,a\ns,mm\n0,1\n", mapped("X.command=a[m]")).axes[0].command,
            (vector<double>{1.0}));
}

TEST_F(ForeignTable, UnitsInParentheses) {
  const Recording r = read("Time (ms),Ref (mm),Pos (left) (mm)\n1,2,3\n",
                           mapped("X.command=Ref,X.actual=Pos (left)"));
  EXPECT_EQ(r.time, (vector<double>{0.001}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.003}));
}

TEST_F(ForeignTable, ColumnsDividedByBlanks) {
  const Recording named = read("# t  xcmd  xact\n0.0   1.0   2.0\n 0.5\t 3.0   4.0 \n",
                               mapped("X.command=xcmd[mm],X.actual=xact[mm]"));
  EXPECT_EQ(named.time, (vector<double>{0.0, 0.5}));
  EXPECT_EQ(named.axes[0].actual, (vector<double>{0.002, 0.004}));
  const Recording headed =
      read("t xcmd xact\n0.0 1.0 2.0\n", mapped("X.command=xcmd[mm],X.actual=xact[mm]"));
  EXPECT_EQ(headed.axes[0].command, (vector<double>{0.001}));
  ReadOptions sampled = mapped("X.command=2[mm],X.actual=3[mm]");
  sampled.rate_hz = 1000.0;
  const Recording unnamed = read("0 1.0 2.0 \n1 3.0 4.0 \n", sampled);
  EXPECT_EQ(unnamed.time, (vector<double>{0.0, 0.001}));
  EXPECT_EQ(unnamed.axes[0].command, (vector<double>{0.001, 0.003}));
  EXPECT_NE(notes(unnamed).find("columns are called 1 to 3"), std::string::npos);
  refuses("# t a b\n0 1 2\n0 1\n", {"line 3", "2 fields where the header has 3"},
          mapped("X.command=a[mm]"));
}

TEST_F(ForeignTable, NamesThatAreLatin1AndTextThatIsUtf16) {
  const Recording latin =
      read("Zeit [ms];Soll\xfcngswert [mm]\n1,0;2,5\n", mapped("X.command=Soll\xc3\xbcngswert"));
  EXPECT_EQ(latin.time, (vector<double>{0.001}));
  EXPECT_EQ(latin.axes[0].command, (vector<double>{0.0025}));
  const std::string text = "time[s],X.command[\xc2\xb5m]\r\n0,1\r\n1,2500\r\n";
  for (const bool little : {true, false}) {
    std::string utf16 = little ? "\xff\xfe" : "\xfe\xff";
    for (std::size_t i = 0; i < text.size(); ++i) {
      const char low = text[i] == '\xc2' ? '\xb5' : text[i];
      if (text[i] == '\xc2') ++i;
      utf16 += little ? std::string{low, '\0'} : std::string{'\0', low};
    }
    const Recording r = read(utf16);
    EXPECT_EQ(r.axes[0].command, (vector<double>{1e-6, 2.5e-3})) << little;
  }
}

TEST_F(ForeignTable, OneCommandAndOneEncoderWithUnitsAreReadByTheirNames) {
  const Recording german = read(
      "Zeit [ms];v_Sollwert;Lagesollwert [mm];Lageistwert [mm];Drehmoment [Nm]\n1;9;2,5;2,4;0,3\n");
  EXPECT_EQ(german.time, (vector<double>{0.001}));
  ASSERT_EQ(german.axes.size(), 1U);
  EXPECT_EQ(german.axes[0].command, (vector<double>{0.0025}));
  EXPECT_EQ(german.axes[0].actual, (vector<double>{0.0024}));
  EXPECT_EQ(german.axes[0].torque, (vector<double>{0.3}));
  EXPECT_NE(notes(german).find("read as --columns \"X.command=Lagesollwert[mm],X.actual=Lageistwert"
                               "[mm],X.torque=Drehmoment[Nm]\""),
            std::string::npos)
      << notes(german);
  const Recording named = read("t_s,pos_cmd_m,pos_meas_m,iq_A\n0,0.5,0.25,2\n");
  EXPECT_EQ(named.axes[0].command, (vector<double>{0.5}));
  EXPECT_EQ(named.axes[0].actual, (vector<double>{0.25}));
}

TEST_F(ForeignTable, TheCommandAndEncoderOfAnAxisAreCalledAlike) {
  const Recording two = read(
      "t_s,X1_ActualPosition[mm],X1_ActualVelocity,X1_CommandPosition[mm],X1_CurrentFeedback[A],"
      "Y1_CommandPosition[mm],Y1_CurrentFeedback[A],Y1_ActualPosition[mm]\n0,1,2,3,4,5,6,7\n");
  ASSERT_EQ(two.axes.size(), 2U);
  EXPECT_EQ(two.axes[0].name, "X1");
  EXPECT_EQ(two.axes[0].command, (vector<double>{0.003}));
  EXPECT_EQ(two.axes[0].actual, (vector<double>{0.001}));
  EXPECT_EQ(two.axes[0].torque, (vector<double>{4.0}));
  EXPECT_EQ(two.axes[1].name, "Y1");
  EXPECT_EQ(two.axes[1].command, (vector<double>{0.005}));
  EXPECT_EQ(two.axes[1].actual, (vector<double>{0.007}));
  EXPECT_EQ(two.axes[1].torque, (vector<double>{6.0}));
  const Recording numbered = read(
      "t,Lagesollwert 1 [deg],Lagesollwert 2 [deg],Lageistwert 2 [deg],Lageistwert 1 [deg]\n"
      "0,180,0,0,90\n");
  ASSERT_EQ(numbered.axes.size(), 2U);
  EXPECT_EQ(numbered.axes[0].name, "1");
  EXPECT_DOUBLE_EQ(numbered.axes[0].actual[0], 0.5 * std::numbers::pi);
}

TEST_F(ForeignTable, TheTorqueIsThatOfTheAxis) {
  const auto torques = [&](const std::string& header, const std::string& row) {
    std::vector<double> out;
    for (const AxisRecord& axis : read(header + "\n" + row + "\n").axes)
      out.push_back(axis.torque.empty() ? -1.0 : axis.torque[0]);
    return out;
  };
  EXPECT_EQ(torques("t,X_cmd[mm],X_act[mm],X2_cmd[mm],X2_act[mm],X2_torque[Nm],X_torque[Nm]",
                    "0,1,1,2,2,22,11"),
            (vector<double>{11.0, 22.0}));
  EXPECT_EQ(
      torques("t,X1_cmd[mm],X1_act[mm],X10_cmd[mm],X10_act[mm],X10_torque[Nm]", "0,1,1,2,2,10"),
      (vector<double>{-1.0, 10.0}));
  EXPECT_EQ(torques("t,SetPos1[mm],ActPos1[mm],SetPos2[mm],ActPos2[mm],Torque1[%],Torque2[%]",
                    "0,1,1,2,2,5,6"),
            (vector<double>{5.0, 6.0}));
  // What was asked for is not what was measured; a load of the computer is no torque of the axis.
  EXPECT_EQ(torques("t,Y_cmd[mm],Y_act[mm],Y_torque_cmd[Nm],Y_torque_act[Nm]", "0,1,1,3,4"),
            (vector<double>{4.0}));
  EXPECT_EQ(torques("t,X_cmd[mm],X_act[mm],cpu_load[%],X_current[A]", "0,1,1,90,2"),
            (vector<double>{2.0}));
  EXPECT_EQ(torques("t,X_cmd[mm],X_act[mm],Y_torque[Nm]", "0,1,1,2"), (vector<double>{-1.0}));
}

TEST_F(ForeignTable, AMappingLeavesWhatTheHeaderNamesOfItsAxes) {
  const Recording r =
      read("t,pos_cmd,X.actual[mm],X.torque[Nm],Y.command[mm],Y.actual[mm]\n0,1,2,3,4,5\n",
           mapped("X.command=pos_cmd[mm],X.torque=Y.command[Nm]"));
  ASSERT_EQ(r.axes.size(), 1u);
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.002}));
  EXPECT_EQ(r.axes[0].torque, (vector<double>{4.0}));  // what the mapping says comes first
  EXPECT_THAT(notes(r), testing::HasSubstr("X.actual[mm]"));
  // What was not asked for and cannot be read is left out: without a unit, with an unknown one, of
  // another kind of axis.
  for (const char* actual : {"X.actual", "X.actual[raw]", "X.actual[deg]", "X.actual[Nm]"}) {
    const Recording without =
        read("t,pos_cmd," + std::string(actual) + "\n0,1,2\n", mapped("X.command=pos_cmd[mm]"));
    EXPECT_TRUE(std::isnan(without.axes[0].actual.at(0))) << actual;
  }
}

TEST_F(ForeignTable, WhatMayBeReadInTwoWaysIsAsked) {
  refuses("t,cmd[mm],motor_encoder[mm],load_encoder[mm]\n0,0,0,0\n", {"X.command=cmd[mm]"});
  refuses("t,X_cmd[mm],X_pos[mm],Y_actual[mm]\n0,0,0,0\n", {"X.command=X_cmd[mm]"});
  refuses("t,X_setpoint[mm],X_setpoint_filtered[mm],X_act[mm],X_act_filtered[mm]\n0,0,0,0,0\n",
          {"X.command=X_setpoint[mm]"});
}

TEST_F(ForeignTable, ColumnsThatNobodyAssignedAreGuessedForTheUser) {
  // An encoder only because it is the other position.
  refuses("t_s,pos_cmd_m,pos_m\n0,0,0\n", {"X.command=pos_cmd_m[m],X.actual=pos_m[m]\" (a guess)"});
  // Two axes: which one is meant is not clear.
  refuses("Zeit [ms];Lagesollwert 1 [mm];Lagesollwert 2 [mm];Lageistwert 1 [mm]\n0;0;0;0\n",
          {"--columns \"X.command=Lagesollwert 1[mm],X.actual=Lageistwert 1[mm]\" (a guess)"});
  refuses("Time,Position Command,Position Actual\n0,0,0\n",
          {"X.command=Position Command[unit],X.actual=Position Actual[unit]"});
  // One of them has a unit: the other may have another.
  refuses("t,pos_cmd [mm],pos_act\n0,0,0\n", {"X.command=pos_cmd[mm],X.actual=pos_act[unit]"});
  refuses("t,a_cmd,a_act,b_cmd,b_act,b_load\n0,0,0,0,0,0\n",
          {"--columns \"a.command=a_cmd[unit],a.actual=a_act[unit],b.command=b_cmd[unit],b.actual="
           "b_act[unit],b.torque=b_load[unit]\" (a guess"});
  refuses("t,speed command\n0,0\n", {"X.command=NAME[unit]"});
  refuses("t,torDes,posDes,posErr,posAct,torAct\n0,0,0,0,0,0\n",
          {"X.command=posDes[unit],X.actual=posAct[unit],X.torque=torAct[unit]"});
  // What a control puts out counts as a torque; what feeds it does not.
  refuses("n,pos_cmd,pos_act,ctrl_V\n0,0,0,0\n", {"X.torque=ctrl_V[V]"});
  refuses("n,pos_cmd,pos_act,bus_voltage_V\n0,0,0,0\n",
          {"--columns \"X.command=pos_cmd[unit],X.actual=pos_act[unit]\" (a guess"});
  // What is the position and not the command.
  refuses("n,pos_cmd_counts,pos_counts\n0,0,0\n",
          {"X.command=pos_cmd_counts[unit],X.actual=pos_counts[unit]",
           "for counts by rev/8192 or mm/1000), with time=NAME[s]"});
  refuses("0 1.5 2.5\n1 1.5 2.5\n", {"The file has no names, so the columns are called: 1, 2, 3"});
}

TEST_F(ForeignTable, ATableNamedLogIsRead) {
  const auto file = directory_.file("run.log", "\"time[s]\",\"X.command[mm]\"\n0,1\n");
  EXPECT_EQ(read_recording(file).axes[0].command, (vector<double>{0.001}));
}

// Cut from one recording in many spellings: all have the motion of our example's first second.
TEST(FieldFormats, HoldTheSameMotion) {
  struct Spelling {
    const char* name;
    const char* columns;
    double rate_hz;
  };
  for (const Spelling& one :
       {Spelling{"csv_named.log", "", 0},
        {"epoch_ms.csv", "", 0},
        {"hms.csv", "", 0},
        {"iso.csv", "", 0},
        {"quoted.csv", "", 0},
        {"semi_comma.csv", "", 0},
        {"semi_comma_bom.csv", "", 0},
        {"tab_trailing.txt", "", 0},
        {"thousands.csv", "", 0},
        {"utf16.csv", "", 0},
        {"latin1_german.csv", "X.command=Lagesollwert,X.actual=Lageistwert", 0},
        {"space.txt", "X.command=xcmd[mm],X.actual=xact[mm]", 0},
        {"units_row.csv", "X.command=Position Command,X.actual=Position Actual", 0},
        {"halsampler.txt", "X.command=2[mm],X.actual=3[mm]", 1000.0}}) {
    SERVOTWIN_REAL_DATA(file, std::filesystem::path("field_formats") / one.name);
    ReadOptions options;
    options.columns = one.columns;
    if (one.rate_hz > 0.0) options.rate_hz = one.rate_hz;
    const Recording r = read_recording(file, options);
    ASSERT_GT(r.time.size(), 400U) << one.name;
    // Its row 400, as semi_comma.csv and its brothers show it.
    EXPECT_NEAR(r.time[400] - r.time[0], 0.4, 1e-6) << one.name;
    EXPECT_NEAR(r.axes[0].command[400], 7.241919e-3, 1e-9) << one.name;
    EXPECT_NEAR(r.axes[0].actual[400], 5.2136e-3, 1e-9) << one.name;
  }
}

}  // namespace
}  // namespace servotwin
