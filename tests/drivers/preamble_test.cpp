// Tables with lines above their header, as recorders and oscilloscopes write them. What is true
// here is what the person who wrote the cells meant.
#include "drivers/recordings/table/preamble.h"

#include <gtest/gtest.h>

#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/drivers/table_fixture.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

using std::vector;
using test::expect_error;

class PreambleTable : public TableFixture {
 protected:
  void refuses(std::string_view text, std::initializer_list<const char*> parts,
               const ReadOptions& options = {}) const {
    const auto file = directory_.file("bad.csv", text);
    expect_error<std::runtime_error>([&] { (void)read_recording(file, options); }, parts);
  }
};

constexpr const char* kColumns = "X.command=Soll,X.actual=Ist";

TEST_F(PreambleTable, TheHeaderIsTheLastLineOfNamesAboveTheRows) {
  const Recording r = read(
      "Device;DL850\nDate;2026-03-01 10:00\nAbtastzeit;0,002;s\n\nZeit;Soll;Ist\n"
      "ms;mm;um\n0,0;1,25;1240\n1,0;1,5;1490\n2,0;1,75;1740\n",
      mapped(kColumns));
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.001, 0.002})) << "its own times come first";
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.00125, 0.0015, 0.00175}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.00124, 0.00149, 0.00174}));
  EXPECT_NE(notes(r).find("names of the columns are in line 5; 4 other lines above the rows "
                          "skipped\nline 6 is read as the units"),
            std::string::npos)
      << notes(r);
  EXPECT_EQ(notes(r).find("sampling rate"), std::string::npos) << notes(r);
}

TEST_F(PreambleTable, GivesTheRateOfATableWithoutTimes) {
  const char* text =
      "Model,WT-1\nSampling interval,0.5,ms\nSoll,Ist\nmm,mm\n1,+2\n+3,4\n5,6\n7,8\n";
  const Recording r = read(text, mapped(kColumns));
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.0005, 0.001, 0.0015}));
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.001, 0.003, 0.005, 0.007}));
  EXPECT_NE(notes(r).find("2000 Hz, the sampling rate, is taken from line 2, "
                          "'Sampling interval,0.5,ms'"),
            std::string::npos)
      << notes(r);
  ReadOptions options = mapped(kColumns);
  options.rate_hz = 100.0;
  EXPECT_EQ(read(text, options).time[1], 0.01) << "--rate comes first";
}

TEST(SamplingLine, GivesTheRateInEnglishAndGerman) {
  struct Line {
    const char* text;
    char separator;
    double rate_hz;
  };
  for (const Line& line : {Line{"Sampling interval,0.001,s", ',', 1000.0},
                           {"Sampling time interval(ms),0.5", ',', 2000.0},
                           {"Sampling Period = 250 us", ' ', 4000.0},
                           {"\"SampleRate\",250", ',', 250.0},
                           {"Sample Rate: 10 kHz", ' ', 1e4},
                           {"Sampling frequency\t5\tkS/s", '\t', 5000.0},
                           {"Cycle time [ms];4", ';', 250.0},
                           {"Interval,1E-3,Interval,1E-3", ',', 1000.0},
                           {"Abtastzeit;0,5;ms", ';', 2000.0},
                           {"Abtastrate [kHz];2,5", ';', 2500.0},
                           {"Abtastfrequenz: 8000", ';', 8000.0},
                           {"Sampling rate;2 ms", ';', 500.0}}) {
    const auto rate_hz = sampling_rate_in(line.text, line.separator);
    ASSERT_TRUE(rate_hz) << line.text;
    EXPECT_DOUBLE_EQ(*rate_hz, line.rate_hz) << line.text;
  }
  for (const char* other : {"Number of sampling data,1024", "Sampling points,1000",
                            "Sampling interval,10 pts", "Sampling interval(points),10",
                            "Sampling interval,0", "Sampling interval,-1", "Sampling interval",
                            "Sampling rate,fast", "Sampling rate,\"10,000\"", "Frequency,50", ""}) {
    const auto rate_hz = sampling_rate_in(other, ',');
    EXPECT_FALSE(rate_hz) << other << ": " << rate_hz.value_or(0.0);
  }
}

TEST_F(PreambleTable, LinesThatDoNotTellTheRateAreNamed) {
  const char* rows = "Soll;Ist\nmm;mm\n1;2\n3;4\n5;6\n";
  const auto with = [&](const char* settings) { return std::string("Rec;1\n") + settings + rows; };
  const ReadOptions options = mapped(kColumns);
  // A thousand or one; a unit that is none; two that differ.
  refuses(with("Abtastrate;1.000;Hz\nInterval;2;pts\n"),
          {"--rate HZ", "line 2, 'Abtastrate;1.000;Hz'; line 3, 'Interval;2;pts'"}, options);
  refuses(with("Abtastrate;1000;Hz\nInterval;2;ms\n"),
          {"line 2, 'Abtastrate;1000;Hz'; line 3, 'Interval;2;ms'"}, options);
  EXPECT_EQ(read(with("Abtastrate;1.000;Hz\nInterval;2;ms\n"), options).time[1], 0.002);
  EXPECT_EQ(read(with("Abtastrate;3000;Hz\nInterval;0,3333;ms\n"), options).time[1], 1.0 / 3000);
}

TEST_F(PreambleTable, RowsMayHaveWords) {
  const char* rows = "0,0;1,25;1240;Auto\n1,0;1,5;1490;Auto\n2,0;-;1740;Hand\n";
  for (const char* settings : {"DL850\nAbtastrate;1000;Hz\n", "Rec;DL850;;\nMode;3;V;\n"}) {
    const Recording r =
        read(std::string(settings) + "Zeit;Soll;Ist;Art\nms;mm;um;\n" + rows, mapped(kColumns));
    EXPECT_EQ(r.time, (vector<double>{0.0, 0.001, 0.002}));
    EXPECT_EQ(r.axes[0].actual, (vector<double>{0.00124, 0.00149, 0.00174}));
    EXPECT_NE(notes(r).find("names of the columns are in line 3"), std::string::npos) << notes(r);
  }
  const Recording one =
      read("Recorder 4\ntime[s],X.command[mm],Mode\n0,1,Auto\n1,2,Auto\n2,3,Auto\n");
  EXPECT_EQ(one.axes[0].command, (vector<double>{0.001, 0.002, 0.003}));
  EXPECT_NE(notes(one).find("1 other line above"), std::string::npos) << notes(one);
}

TEST_F(PreambleTable, MayHaveAsManyFieldsAsTheHeader) {
  const Recording cells =
      read("Start,2020-03-16 17:04:51\nInterval,0.01\nSoll,Ist\nmm,mm\n1,2\n3,4\n5,6\n",
           mapped(kColumns));
  EXPECT_EQ(cells.time, (vector<double>{0.0, 0.01, 0.02}));
  // A spreadsheet that saves the file again fills all lines up.
  const Recording filled = read(
      "Recorder;;;\nAbtastrate;1;kHz;\n;;;\nSoll;Ist;Strom;Modus\nmm;mm;A;\n1;2;3;4\n5;6;7;8\n",
      mapped("X.command=Soll,X.actual=Ist,X.torque=Strom"));
  EXPECT_EQ(filled.time, (vector<double>{0.0, 0.001}));
  EXPECT_EQ(filled.axes[0].torque, (vector<double>{3.0, 7.0}));
}

TEST_F(PreambleTable, SettingsBetweenNamesAndRowsAreSkipped) {
  const Recording r = read(
      "\"Model Name\",\"DL850\"\n\"TraceName\",\"Soll\",\"Ist\"\n\"VUnit\",\"mm\",\"mm\"\n"
      "\"SampleRate\",500,500\n\"Date\",\"2026/03/01\",\"2026/03/01\"\n\n"
      "\"\",1,2\n\"\",3,4\n\"\",5,6\n",
      mapped(kColumns));
  EXPECT_EQ(r.time, (vector<double>{0.0, 0.002, 0.004}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.002, 0.004, 0.006}));
}

TEST_F(PreambleTable, IsNotLookedForBelowAHeader) {
  // Words in the rows, also in the first ones only.
  const Recording words =
      read("time[s],X.command[mm],Mode\n0,1,Auto\n1,2,Auto\n2,3,\n3,4,\n4,5,\n5,6,\n");
  EXPECT_EQ(words.time.size(), 6U);
  EXPECT_EQ(notes(words), "ignored columns: Mode\n");
  const Recording absent =
      read("time[s],X.command[mm],State\n0,-,on\n1,2.5,on\n2,3,1\n3,4,1\n4,5,1\n");
  EXPECT_EQ(absent.time.size(), 5U);
  const Recording unknown =
      read("time[s],X.command[mm],Mode,By,Of\n,,Auto,hand,Ada\n0,1,,,\n1,2,,,\n2,3,,,\n");
  EXPECT_EQ(unknown.axes[0].command.size(), 4U);
  // A line that is damaged.
  refuses("time[s],X.command[mm]\n0,1\nend\n2,3\n3,4\n4,5\n",
          {"line 3", "1 field where the header has 2"});
  refuses("time[s],X.command[mm],Mode\n0,1,Auto\n1,Auto,Auto\n2,3,1\n3,4,1\n4,5,1\n",
          {"line 3", "column 'X.command[mm]'", "'Auto' is not a number"});
}

TEST_F(PreambleTable, WithoutAHeaderIsRefusedAsBefore) {
  refuses("Axis1\n2026-03-01\n1,2\n3,4\n5,6\n", {"line 1", "text, but not CSV", "'Axis1'"});
  // Numbers that are settings are no rows.
  refuses("Axis1\nGain,Offset\n1,2\n", {"no column is named AXIS.channel[unit]", "Gain, Offset"});
  const Recording r =
      read("Axis1\nGain,Offset\n1,2\nRate check\nSoll,Ist,Modus\n1,2,3\n3,4,5\n5,6,7\n", [] {
        ReadOptions options = mapped("X.command=Soll[mm],X.actual=Ist[mm]");
        options.rate_hz = 1.0;
        return options;
      }());
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.002, 0.004, 0.006}));
}

// Cut from recordings of two recorders; the values are those that a text editor shows.
TEST(RealPreambles, OfAServoToolAndADataLogger) {
  SERVOTWIN_REAL_DATA(servo, "field_formats/min_mr_configurator.csv");
  ReadOptions options;
  options.columns = "X.command=Analog 3[um],X.torque=Analog 2[%],X.actual=Analog 1[um]";
  const Recording mitsubishi = read_recording(servo, options);
  ASSERT_EQ(mitsubishi.time.size(), 35U);
  EXPECT_DOUBLE_EQ(mitsubishi.time[1], 0.666666e-3);
  EXPECT_DOUBLE_EQ(mitsubishi.axes[0].command[6], 3e-6);
  EXPECT_EQ(mitsubishi.axes[0].torque[6], -1.1);
  SERVOTWIN_REAL_DATA(logger, "field_formats/min_ni.csv");
  options.columns = "X.command=Force[mm],X.actual=Input 1[mm]";
  const Recording volts = read_recording(logger, options);
  ASSERT_EQ(volts.time.size(), 36U);
  EXPECT_DOUBLE_EQ(volts.time[35], 0.0175);
  EXPECT_DOUBLE_EQ(volts.axes[0].actual[1], -3.2207498360957043e-3);
}

}  // namespace
}  // namespace servotwin
