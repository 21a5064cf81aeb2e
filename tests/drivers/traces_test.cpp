// Traces of controllers: the sample in the folder of each format, written by its description, and
// recordings of real machines, where they are at hand.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using std::vector;
using test::expect_error;

/// The text of a sample, by its place in drivers/recordings.
std::string sample(const char* name) {
  const auto file = std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "drivers" / "recordings" / name;
  std::ifstream in(file);
  EXPECT_TRUE(in.good()) << file;
  return {std::istreambuf_iterator<char>(in), {}};
}

class Traces : public testing::Test {
 protected:
  [[nodiscard]] Recording read(std::string_view text, const char* columns = "") const {
    ReadOptions options;
    options.columns = columns;
    return read_recording(directory_.file("trace.txt", text), options);
  }
  void refuses(std::string_view text, std::initializer_list<const char*> parts,
               const char* columns = "") const {
    ReadOptions options;
    options.columns = columns;
    const auto file = directory_.file("bad.txt", text);
    expect_error<std::runtime_error>([&] { (void)read_recording(file, options); }, parts);
  }
  test::TemporaryDirectory directory_;
};

TEST_F(Traces, TncscopeNamesItsAxesAndChannels) {
  const Recording r = read(sample("tncscope/sample.sco"));
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_EQ(r.axes[0].name, "Y");
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.003}));
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.4, 0.4003}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.400001, 0.40025}));
  EXPECT_EQ(r.axes[0].torque, (vector<double>{3.815, -3.776}));
  EXPECT_EQ(r.axes[0].torque_unit, "A");
}

TEST_F(Traces, ATncscopeFileThatIsDamagedIsRefusedWithItsLine) {
  refuses("%TNCscopeNT data file\n%[CURVE1]\n%COLUMN=x\n%[DATA]\n", {"line 4", "COLUMN='x'"});
  refuses("%TNCscopeNT data file\n%[CURVE1]\n%COLUMN=99999999999\n%[DATA]\n",
          {"line 4", "COLUMN="});
  refuses("%TNCscopeNT data file\n%[CURVE1]\n", {"there is no %[DATA]"});
  refuses("%TNCscopeNT data file\n0;1\n", {"line 2", "before %[DATA]"});
}

TEST_F(Traces, TwincatScopeHasTimesBeforeEachGroupOfChannels) {
  const Recording r = read(sample("twincat_scope/sample.csv"));
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_EQ(r.axes[0].name, "X");
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.001, 0.002}));
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.0005, 0.0015, 0.0025}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.00025, 0.00125, 0.00225}));
  // The slower group, whose rows end earlier.
  const Recording slow =
      read(sample("twincat_scope/sample.csv"), "T.command=Motor temperature[mm]");
  EXPECT_EQ(slow.time, (vector<double>{0.0, 0.005}));
  EXPECT_EQ(slow.axes[0].command, (vector<double>{0.0315, 0.0316}));
}

TEST_F(Traces, TwincatChannelsOfUnlikeRatesAreNotMixed) {
  refuses(sample("twincat_scope/sample.csv"),
          {"'X.command[mm]' was sampled every 1 ms and 'Motor temperature' every 5 ms",
           "name columns of one rate"},
          "X.command=X.command[mm],X.torque=Motor temperature[A]");
}

TEST_F(Traces, ATableWhoseFirstColumnIsCalledNameIsNoTwincatTrace) {
  const Recording r = read("Name,t,Soll\nabc,0.5,1\n", "X.command=Soll[mm]");
  EXPECT_EQ(r.time, (vector<double>{0.5}));
  refuses("Name;a\nFile;b\n\nNothing;here\n", {"TwinCAT Scope", "no line Name"});
}

TEST_F(Traces, HalscopeHasNamesAndValuesInTurns) {
  const std::string log = sample("halscope/sample.log");
  const Recording r = read(log, "X.command=joint.0.cmd[mm],X.actual=joint.0.fb[mm]");
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.0005}));
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.0075, 0.0085}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.00725, -0.00825}));
  refuses(log, {"X.command=joint.0.cmd[unit],X.actual=joint.0.fb[unit]"});
  refuses("Sampling period is none\na 1\n", {"line 1", "gives no sampling period"});
  refuses("Sampling period is 5 nSec\na 1 b\n", {"line 2", "names and values in turns"});
}

// As write_log_file() of LinuxCNC 2.9.9 writes it, and that of its master with two more comments.
TEST_F(Traces, HalscopeOfLinuxcnc29IsATableWithItsPeriodInAComment) {
  const std::string settings = sample("halscope/sample.csv");
  std::string plain = settings;
  const std::size_t position = plain.find("# Position"), row = plain.find("7.5");
  plain.erase(position, row - position);
  for (const std::string& text : {plain, settings}) {
    const Recording r = read(text, "X.command=joint.0.cmd[mm],X.actual=joint.0.fb[mm]");
    EXPECT_EQ(r.time, (vector<double>{0.0, 0.001}));
    EXPECT_EQ(r.axes[0].command, (vector<double>{0.0075, 0.0085}));
    EXPECT_EQ(r.axes[0].actual, (vector<double>{0.00725, -0.00825}));
    EXPECT_EQ(r.notes.front(), "halscope recording at 1000 Hz");
  }
  refuses("# Sampling period is 0 ns\na;b\n1;2\n", {"no time column"}, "X.command=a[mm]");
}

TEST_F(Traces, ASinumerikCaptureCountsCycles) {
  const Recording r = read(sample("sinumerik_capture/sample.json"));
  ASSERT_EQ(r.axes.size(), 2U);
  EXPECT_EQ(r.axes[0].name, "Y1");
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.002, 0.02})) << "eight cycles were not captured";
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.91, 0.911, 0.912}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.9105, 0.9115, 0.9125}));
  EXPECT_EQ(r.axes[0].torque[0], -22.5);
  EXPECT_TRUE(std::isnan(r.axes[0].torque[1]));
  EXPECT_TRUE(r.axes[1].rotary);
  EXPECT_DOUBLE_EQ(r.axes[1].command[0], M_PI);
}

TEST_F(Traces, ACaptureThatIsDamagedIsRefused) {
  const std::string whole(sample("sinumerik_capture/sample.json"));
  refuses(whole.substr(0, 400), {"SINUMERIK capture cannot be read"});
  refuses(R"({"Header":{"CycleTimeMs":0,"SignalListHFData":[{"Name":"CYCLE"}]},"Payload":[]})",
          {"CycleTimeMs = 0 must be positive"});
  refuses(R"({"Header":{"CycleTimeMs":2,"SignalListHFData":[{"Name":"LOAD"}]},"Payload":[]})",
          {"is not CYCLE"});
  refuses(R"({"Header":{"CycleTimeMs":2},"Payload":[]})", {"SINUMERIK capture cannot be read"});
}

// Recordings of real machines; what they hold is in the READMEs beside them.

TEST(RealTraces, TheMachiningCentresAxisReversesTwentyOneTimes) {
  SERVOTWIN_REAL_DATA(file, "trace_formats/tncscope/axis_y_shaker_off.sco");
  const Recording r = read_recording(file);
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_EQ(r.axes[0].name, "Y");
  EXPECT_NEAR(r.time[1], 0.003, 1e-12);
  ASSERT_EQ(r.time.size(), 6848U);
  int reversals = 0;
  double direction = 0.0;
  for (std::size_t k = 1; k < r.time.size(); ++k) {
    const double step = r.axes[0].command[k] - r.axes[0].command[k - 1];
    if (step * direction < 0.0) ++reversals;
    if (step != 0.0) direction = step;
  }
  EXPECT_EQ(reversals, 21);
}

TEST(RealTraces, TheHalscopeLogHasItsNameAndItsPeriod) {
  SERVOTWIN_REAL_DATA(file, "trace_formats/halscope/halscope.log");
  ReadOptions options;
  options.columns = "Z.command=joint.3.motor-pos-cmd[mm]";
  const Recording r = read_recording(file, options);
  EXPECT_NEAR(r.time[1], 1e-4, 1e-12);
  EXPECT_NEAR(r.axes[0].command[0], 7.92000000061527e-3, 1e-15);
}

TEST(RealTraces, TheCaptureHasAGapOfSevenPointSevenSeconds) {
  SERVOTWIN_REAL_DATA(file, "trace_formats/sinumerik_capture/capture.json");
  const Recording r = read_recording(file);
  EXPECT_EQ(r.axes.at(0).name, "Y1");
  double longest = 0.0;
  for (std::size_t k = 1; k < r.time.size(); ++k)
    longest = std::max(longest, r.time[k] - r.time[k - 1]);
  EXPECT_NEAR(longest, 7.72, 0.005);
}

TEST(RealTraces, TheSpellingsOfOneTwincatExportHoldTheSameSignals) {
  for (const char* name :
       {"tc3_scope_3_4_3145_3-ContainEOF_true.csv", "tc3_scope_3_4_3145_3-DecimalMark_,.csv",
        "tc3_scope_3_4_3145_3-ExcludeDoubleTimestamp_false-SortChannels_false.csv",
        "tc3_scope_3_4_3145_3-ExcludeDoubleTimestamp_false-SortChannels_true.csv",
        "tc3_scope_3_4_3145_3-ExcludeDoubleTimestamp_true-SortChannels_false.csv",
        "tc3_scope_3_4_3145_3-Seperator_2.csv", "tc3_scope_3_4_3145_3-default.csv",
        "tc3_scope_3_4_3145_3_noOS.csv"}) {
    SERVOTWIN_REAL_DATA(file, std::filesystem::path("trace_formats/twincat_scope") / name);
    ReadOptions options;
    options.columns = "X.command=var_REAL64[mm],X.actual=var_REAL32[mm]";
    const Recording r = read_recording(file, options);
    // A counter from 0 to 999, once a millisecond, in two types.
    ASSERT_EQ(r.time.size(), 1000U) << name;
    EXPECT_NEAR(r.time[999] - r.time[0], 0.999, 1e-9) << name;
    EXPECT_DOUBLE_EQ(r.axes[0].command[700], 0.7) << name;
    EXPECT_DOUBLE_EQ(r.axes[0].actual[700], 0.7) << name;
  }
}

// Axis 7 has its position setpoint and current every 2 ms, its encoders every 4 ms, from 2 ms on.
constexpr const char* kSinumerikColumns =
    "C.command=CmdPos2ndEnc64_7[mm],C.actual=measPos2_7[mm],C.torque=ActCurr32_7[A]";

TEST_F(Traces, ASinumerikTraceHasARowWhereItsSlowestSignalIsSampled) {
  const Recording r = read(sample("sinumerik_trace/sample.xml"), kSinumerikColumns);
  ASSERT_EQ(r.axes.size(), 1U);
  // From 6 to 14 ms only the current changes: its value is then missing.
  ASSERT_EQ(r.time.size(), 4U);
  for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(r.time[k], 0.004 * static_cast<double>(k), 1e-12);
  EXPECT_EQ(r.axes[0].command, (vector<double>{1.5e-3, 2.5e-3, 2.5e-3, 4e-3}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.9e-3, 1.9e-3, 1.9e-3, 3.9e-3}));
  ASSERT_EQ(r.axes[0].torque.size(), 4U);
  EXPECT_EQ(r.axes[0].torque[0], -0.5);
  EXPECT_EQ(r.axes[0].torque[2], 0.25);
  EXPECT_TRUE(std::isnan(r.axes[0].torque[3]));
  std::string notes;
  for (const std::string& note : r.notes) notes += note + "\n";
  EXPECT_NE(notes.find("a row every 4 ms"), std::string::npos) << notes;
  EXPECT_NE(notes.find("lost data 2 times"), std::string::npos) << notes;
}

TEST_F(Traces, ASinumerikTraceWithFastSignalsAloneHasThatRate) {
  const Recording r = read(sample("sinumerik_trace/sample.xml"), "C.command=CmdPos2ndEnc64_7[deg]");
  ASSERT_EQ(r.time.size(), 8U);
  EXPECT_TRUE(r.axes[0].rotary);
  EXPECT_NEAR(r.axes[0].command[1], 1.5 * M_PI / 180.0, 1e-15);
  EXPECT_NEAR(r.time[7], 0.014, 1e-12);
}

TEST_F(Traces, ASinumerikTraceIsReadUpToItsSecondFrame) {
  std::string two = sample("sinumerik_trace/sample.xml");
  two.insert(two.find("</traceData>"),
             " <dataFrame>\n  <dataSignal interval=\"0.002\" id=\"f9\" name=\"/x/late [u1, 8]\"/>\n"
             "  <rec time=\"0.0\" f9=\"1\" f1=\"7\"/>\n </dataFrame>\n");
  const Recording r = read(two, kSinumerikColumns);
  EXPECT_EQ(r.time.size(), 4U);
  EXPECT_EQ(r.axes[0].command.back(), 4e-3);
  std::string notes;
  for (const std::string& note : r.notes) notes += note + "\n";
  EXPECT_NE(notes.find("only the first data frame"), std::string::npos) << notes;
}

TEST_F(Traces, ASinumerikTraceProposesItsColumns) {
  refuses(sample("sinumerik_trace/sample.xml"),
          {"X.command=CmdPos2ndEnc64_7[unit],X.actual=measPos2_7[unit],X.torque="
           "ActCurr32_7[unit]"});
}

TEST_F(Traces, ASinumerikTraceThatIsDamagedIsRefusedWithItsLine) {
  const std::string whole = sample("sinumerik_trace/sample.xml");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string out = whole;
    out.replace(out.find(from), from.size(), to);
    return out;
  };
  refuses(whole.substr(0, whole.find("</dataFrame>")), {"bad.txt:", "no element found"},
          kSinumerikColumns);
  refuses(with("<rec time=\"0.006000\"", "<rec time=\"0.001\""), {"'0.001'", "not decrease"},
          kSinumerikColumns);
  refuses(with("<rec time=\"0.014000\"", "<rec time=\"1e15\""), {"1e+15", "follows one at"},
          kSinumerikColumns);
  refuses(with("interval=\"0.004000\"", "interval=\"0\""), {"interval", "must be positive"},
          kSinumerikColumns);
  // 28 hours of rows from six records.
  refuses(with("<rec time=\"0.014000\"", "<rec time=\"1e5\""), {"follows one at"},
          kSinumerikColumns);
  const std::size_t records = whole.find("  <rec"), end = whole.find(" </dataFrame>");
  refuses(whole.substr(0, records) + whole.substr(end), {"has no records", "packed"},
          kSinumerikColumns);
}

}  // namespace
}  // namespace servotwin
