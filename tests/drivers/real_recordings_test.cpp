// Recordings of real machines, read as their owners published them.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "drivers/recordings/recording_file.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

ReadOptions mapped(const char* columns) {
  ReadOptions options;
  options.columns = columns;
  return options;
}

// The same record from both of its files: what the CSV's author rounded is the only difference.
TEST(RealRecording, EmpsFromMatlabAndFromText) {
  SERVOTWIN_REAL_DATA(mat, "emps/DATA_EMPS.mat");
  SERVOTWIN_REAL_DATA(csv, "emps/emps.csv");
  const Recording a =
      read_recording(mat, mapped("X.command=qg[m],X.actual=qm[m],X.torque=vir[V],time=t[s]"));
  const Recording b = read_recording(
      csv, mapped("X.command=pos_cmd_m[m],X.actual=pos_meas_m[m],X.torque=ctrl_V[V]"));
  ASSERT_EQ(a.time.size(), 24'841U);
  ASSERT_EQ(b.time.size(), 24'841U);
  for (std::size_t i = 0; i < a.time.size(); ++i) {
    ASSERT_NEAR(a.time[i], b.time[i], 2e-6);
    ASSERT_NEAR(a.axes[0].command[i], b.axes[0].command[i], 0.6e-9);
    ASSERT_NEAR(a.axes[0].actual[i], b.axes[0].actual[i], 0.6e-8);
    ASSERT_NEAR(a.axes[0].torque[i], b.axes[0].torque[i], 0.6e-7);
  }
  EXPECT_EQ(a.axes[0].torque_unit, "V");
}

TEST(RealRecording, EmpsFindsItsTime) {
  SERVOTWIN_REAL_DATA(mat, "emps/DATA_EMPS.mat");
  const Recording r =
      read_recording(mat, mapped("X.command=qg[m],X.actual=qm[m],X.torque=vir[N*35.15065188]"));
  EXPECT_NEAR(r.time.back() - r.time.front(), 24.84, 1e-6);
  EXPECT_EQ(r.axes[0].torque_unit, "N");
  EXPECT_NEAR(r.axes[0].torque[0], 35.15065188 * 2.5386281, 1e-5);
}

TEST(RealRecording, SinumerikAxisY1) {
  SERVOTWIN_REAL_DATA(csv, "sinumerik_edge_5axis/axis_Y1.csv");
  const Recording r = read_recording(
      csv, mapped("Y1.command=des_pos[mm],Y1.actual=enc_pos[mm],Y1.torque=torque[Nm],time=t_s[s]"));
  ASSERT_EQ(r.time.size(), 3818U);
  EXPECT_EQ(r.axes[0].name, "Y1");
  EXPECT_EQ(r.axes[0].command[0], 0.91);
  EXPECT_EQ(r.axes[0].actual[0], 910.000049 / 1000);
  EXPECT_EQ(r.axes[0].torque[0], -22.353412);
}

TEST(RealRecording, OdriveInEncoderCounts) {
  SERVOTWIN_REAL_DATA(csv, "odrive_cogging/slow_goodgains_2__nocomp_1.csv");
  const Recording r = read_recording(
      csv,
      mapped("M.command=pos_cmd_counts[rev/8192],M.actual=pos_counts[rev/8192],M.torque=iq_A[A]"));
  EXPECT_TRUE(r.axes[0].rotary);
  ASSERT_EQ(r.time.size(), 4388U);
  EXPECT_DOUBLE_EQ(r.axes[0].actual[0], 8157.313477 * 2 * std::numbers::pi / 8192);
}

TEST(RealRecording, MillingCentreWithTextInAColumn) {
  SERVOTWIN_REAL_DATA(csv, "umich_cnc_10hz/experiment_01_axes.csv");
  const Recording r = read_recording(
      csv, mapped("X.command=X1_CommandPosition[mm],X.actual=X1_ActualPosition[mm],"
                  "Y.command=Y1_CommandPosition[mm],Y.actual=Y1_ActualPosition[mm]"));
  ASSERT_EQ(r.axes.size(), 2U);
  EXPECT_EQ(r.time.size(), 1055U);
  EXPECT_EQ(r.axes[1].actual[1], 0.158);
}

}  // namespace
}  // namespace servotwin
