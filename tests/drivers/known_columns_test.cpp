// Tables of programs whose names of columns say what they are. The samples of known_columns/ are
// sines in the units that the programs document; README.md there.
#include "drivers/recordings/table/known_columns.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>

#include "tests/drivers/table_fixture.h"
#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

using std::vector;
using test::expect_error;

struct KnownTable {
  const char* file;
  const char* axis;
  bool rotary;
  const char* torque_unit;  // empty: the program writes none
  const char* note;
};

class AKnownTable : public testing::TestWithParam<KnownTable> {};

TEST_P(AKnownTable, IsReadWithNoOptionButTheFile) {
  const KnownTable& known = GetParam();
  const Recording r = read_recording(std::filesystem::path(SERVOTWIN_SOURCE_DIR) /
                                     "tests/drivers/known_columns" / known.file);
  ASSERT_EQ(r.axes.size(), 1U);
  const AxisRecord& axis = r.axes[0];
  EXPECT_EQ(axis.name, known.axis);
  EXPECT_EQ(axis.rotary, known.rotary);
  ASSERT_EQ(r.time.size(), 300U);
  const bool has_torque = *known.torque_unit != '\0';
  EXPECT_EQ(axis.torque.size(), has_torque ? 300U : 0U);
  EXPECT_EQ(axis.torque_unit, known.torque_unit);
  const double turn = 2.0 * std::numbers::pi, si = known.rotary ? turn : 1e-3;
  for (std::size_t k = 0; k < r.time.size(); ++k) {
    const double t = 0.01 * static_cast<double>(k);
    EXPECT_NEAR(r.time[k] - r.time[0], t, 1e-6);
    EXPECT_NEAR(axis.command[k], si * 0.25 * std::sin(turn * t), si * 1e-6);
    EXPECT_NEAR(axis.actual[k], si * 0.25 * std::sin(turn * (t - 0.02)), si * 1e-6);
    if (has_torque) {
      EXPECT_NEAR(axis.torque[k], 0.5 * std::cos(turn * t), 1e-6);
    }
  }
  EXPECT_NE(r.notes.front().find(known.note), std::string::npos) << r.notes.front();
}

INSTANTIATE_TEST_SUITE_P(
    Programs, AKnownTable,
    testing::Values(
        KnownTable{"moteus_tview.csv", "servo", true, "Nm",
                   "columns of moteus (tview): read as --columns \"time=timestamp[s],"
                   "servo.command=control_position[rev],servo.actual=position[rev],"
                   "servo.torque=torque_Nm[Nm]\""},
        KnownTable{"moteus_csv_output.csv", "servo", true, "Nm", "moteus (csv_output.py)"},
        KnownTable{"odrive_gui.csv", "odrive0.axis1", true, "A", "in turns as from firmware 0.5.1"},
        KnownTable{"klipper_export.csv", "X", false, "", "Klipper (data_export.py)"}));

class KnownColumnsOfTables : public TableFixture {
 protected:
  void is_foreign(const std::string& header) const {
    std::string zeros = "0";
    for (const char c : header) zeros += c == ',' ? ",0" : "";
    expect_error<std::runtime_error>([&] { (void)read(header + "\n" + zeros + "\n"); },
                                     {"no column is named AXIS.channel[unit]", "--columns"});
  }
};

TEST_F(KnownColumnsOfTables, TwoAxesOfAnOdriveAreTwoAxes) {
  const Recording r = read(
      "time,odrive0.axis0.controller.pos_setpoint,odrive0.axis1.encoder.pos_estimate,"
      "odrive0.axis1.controller.pos_setpoint,odrive0.axis0.encoder.pos_estimate\n"
      "0,1,2,3,4\n0.01,1,2,3,4\n");
  ASSERT_EQ(r.axes.size(), 2U);
  const double turn = 2.0 * std::numbers::pi;
  EXPECT_EQ(r.axes[0].name, "odrive0.axis0");
  EXPECT_DOUBLE_EQ(r.axes[0].command[0], 1.0 * turn);
  EXPECT_DOUBLE_EQ(r.axes[0].actual[0], 4.0 * turn);
  EXPECT_EQ(r.axes[1].name, "odrive0.axis1");
  EXPECT_DOUBLE_EQ(r.axes[1].command[0], 3.0 * turn);
  EXPECT_DOUBLE_EQ(r.axes[1].actual[0], 2.0 * turn);
}

// input_pos passes a filter before it is pos_setpoint, so the latter is the command.
TEST_F(KnownColumnsOfTables, TheSetpointOfAnOdriveComesBeforeItsInput) {
  const double turn = 2.0 * std::numbers::pi;
  const Recording both = read("time,input_pos,pos_setpoint,pos_estimate\n0,1,2,3\n0.01,1,2,3\n"),
                  input = read("time,input_pos,pos_estimate\n0,1,3\n0.01,1,3\n");
  EXPECT_DOUBLE_EQ(both.axes[0].command[0], 2.0 * turn);
  EXPECT_DOUBLE_EQ(input.axes[0].command[0], 1.0 * turn);
  EXPECT_NE(notes(input).find("PASSTHROUGH only"), std::string::npos);
}

TEST_F(KnownColumnsOfTables, TheBenchmarkOfEmps) {
  const Recording r = read("t,qg,qm,vir,pulses_N\n0,1,2,3,4\n0.001,1,2,3,4\n");
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_EQ(r.axes[0].command, (vector<double>{1.0, 1.0}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{2.0, 2.0}));
  EXPECT_EQ(r.axes[0].torque, (vector<double>{3.0, 3.0}));
  EXPECT_EQ(r.axes[0].torque_unit, "V");
}

TEST_F(KnownColumnsOfTables, SignalsOfSinumerikHaveItsUnits) {
  const Recording r =
      read("cycle,t_s,des_pos,enc_pos,cont_dev,torque\n1,0,5,4,1,3\n2,0.002,5,4,1,3\n");
  EXPECT_EQ(r.axes[0].command[0], 0.005);
  EXPECT_EQ(r.axes[0].actual[0], 0.004);
  EXPECT_EQ(r.axes[0].torque[0], 3.0);
}

TEST_F(KnownColumnsOfTables, RostopicOfAJointController) {
  const Recording r = read(
      "%time,field.header.seq,field.header.stamp,field.set_point,field.process_value,field."
      "command\n"
      "1354825672489194938,1,1,0.5,0.25,9\n1354825672490194938,1,1,0.5,0.25,9\n");
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_TRUE(r.axes[0].rotary);
  EXPECT_EQ(r.axes[0].command[0], 0.5);
  EXPECT_EQ(r.axes[0].actual[0], 0.25);
  EXPECT_TRUE(r.axes[0].torque.empty());
  EXPECT_NEAR(r.time[1] - r.time[0], 1e-3, 1e-6);
}

TEST_F(KnownColumnsOfTables, JointsOfARobotAreOneAxisEach) {
  const Recording r = read("t,q1,q2,qd1,qd2,i1,i2,tau1\n0,1,2,3,4,5,6,7\n0.01,1,2,3,4,5,6,7\n");
  ASSERT_EQ(r.axes.size(), 2U);
  EXPECT_EQ(r.axes[1].name, "joint2");
  EXPECT_TRUE(r.axes[1].rotary);
  EXPECT_EQ(r.axes[1].actual[0], 2.0);
  EXPECT_EQ(r.axes[1].torque[0], 6.0);
  EXPECT_EQ(r.axes[0].torque_unit, "A");
  const Recording commanded = read("time,q1,q_des1,tau1\n0,1,2,3\n0.01,1,2,3\n");
  EXPECT_EQ(commanded.axes[0].command[0], 2.0);
  EXPECT_EQ(commanded.axes[0].torque_unit, "Nm");
}

TEST_F(KnownColumnsOfTables, ColumnsThatTheUserAssignsAreReadAsHeSays) {
  const Recording r = read("time,pos_setpoint,pos_estimate\n0,8192,1\n0.01,8192,1\n",
                           mapped("X.command=pos_setpoint[rev/8192],X.actual=pos_estimate[rev]"));
  EXPECT_EQ(r.axes[0].name, "X");
  EXPECT_DOUBLE_EQ(r.axes[0].command[0], 2.0 * std::numbers::pi);
}

// Without all that the program writes, or with two columns for one channel, nobody knows.
TEST_F(KnownColumnsOfTables, WhatIsNotSureIsNotAssumed) {
  is_foreign("timestamp,control_position,position");
  is_foreign("time,MODE,POSITION,VELOCITY,TORQUE");
  is_foreign("POSITION,CONTROL_POSITION");
  is_foreign("t,qg,qm");
  is_foreign("t_s,des_pos,enc_pos,torque");
  is_foreign("t,q1,q2");
  is_foreign("q1,i1");
  is_foreign("time,a.axis0.encoder.pos_estimate,a.axis0.load.pos_estimate,a.axis0.pos_setpoint");
  is_foreign("time,odrive0.pos_setpoint,odrive0.pos_estimate");
  is_foreign("Time (s),stepper_x position (mm),stepper_y position (mm),my_sensor position (mm)");
  is_foreign("Time (s),toolhead x position (mm),Smoothed my_sensor position (mm)");
}

}  // namespace
}  // namespace servotwin
