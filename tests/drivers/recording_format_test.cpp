// A format that is named comes before what a file looks like.
#include "drivers/recordings/recording_format.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using std::vector;
using test::expect_error;

class NamedFormat : public testing::Test {
 protected:
  static ReadOptions named(const char* id, const char* columns = "") {
    ReadOptions options;
    options.format = format_named(id);
    options.columns = columns;
    return options;
  }
  void refuses(std::string_view text, const char* id, std::initializer_list<const char*> parts) {
    const auto file = directory_.file("bad.txt", text);
    expect_error<std::runtime_error>([&] { (void)read_recording(file, named(id)); }, parts);
  }
  test::TemporaryDirectory directory_;
};

constexpr const char* kRows = "time[s],X.command[mm]\n0,1\n0.001,2\n";

TEST_F(NamedFormat, IsReadWhateverTheFileIsCalled) {
  // The name is that of a CAN log, and the first line is not the header.
  const auto log = directory_.file("run.log", "Axis1\nSampling rate;1;kHz\na;b\n1;2\n3;4\n");
  expect_error<std::runtime_error>([&] { (void)read_recording(log); }, {"is named .log"});
  EXPECT_EQ(read_recording(log, named("csv", "X.command=a[mm],X.actual=b[mm]")).time,
            (vector<double>{0.0, 0.001}));
  EXPECT_EQ(read_recording(directory_.file("run.mat", kRows), named("csv")).axes[0].command,
            (vector<double>{0.001, 0.002}));
}

TEST_F(NamedFormat, AHalscopeFileOfEitherForm) {
  const auto read = [&](std::string_view text) {
    return read_recording(directory_.file("a.txt", text), named("halscope", "X.command=a[mm]"));
  };
  EXPECT_EQ(read("Sampling period is 500000 nSec\na +1 b +2\na +3 b +4\n").time[1], 0.0005);
  EXPECT_EQ(read("# Sampling period is 500000 ns\na;b\n1.0;2.0\n3.0;4.0\n").time[1], 0.0005);
}

TEST_F(NamedFormat, ATableMayHaveOneColumn) {
  const auto halscope = directory_.file("a.csv", "# Sampling period is 500000 ns\na\n1.5\n2.5\n");
  ReadOptions options;
  options.columns = "X.command=a[mm]";
  EXPECT_EQ(read_recording(halscope, options).axes[0].command, (vector<double>{0.0015, 0.0025}));
  EXPECT_EQ(read_recording(halscope, options).time[1], 0.0005);
  options = {};
  options.rate_hz = 10.0;
  const auto table = directory_.file("b.csv", "X.command[mm]\n1.5\n2.5\n");
  EXPECT_EQ(read_recording(table, options).axes[0].command, (vector<double>{0.0015, 0.0025}));
}

TEST_F(NamedFormat, AFileOfAnotherFormatIsRefusedByItsReader) {
  refuses(kRows, "twincat",
          {"line 1", "--format twincat", "'time[s],X.command[mm]'", "TwinCAT Scope CSV",
           "'Name;ScopeProject'"});
  refuses(kRows, "tncscope", {"--format tncscope", "'%TNCscopeNT data file'"});
  refuses(kRows, "halscope", {"--format halscope", "'Sampling period is 1000000 nSec'"});
  refuses("%TNCscopeNT data file\n", "twincat", {"--format twincat", "'%TNCscopeNT data file'"});
  for (const char* format : {"matlab", "mcap", "sinumerik-capture", "sinumerik-trace"})
    refuses(kRows, format,
            {"--format", format, "this is no such file",
             "looks like text that begins with 'time[s],X.command[mm]'"});
  refuses(std::string_view("\xff\xfet\0", 4), "mcap", {"looks like text in UTF-16"});
  refuses("{\"Header\": 1", "sinumerik-capture", {"SINUMERIK capture cannot be read"});
  refuses("<traceSession", "sinumerik-trace", {"SINUMERIK trace cannot be read"});
  refuses("(1.0) can0 181#00\n", "matlab", {"no such file", "'candump -l', --format candump"});
  refuses("PK\x03\x04 a sheet", "mcap", {"no such file", "a spreadsheet", "save the sheet as CSV"});
  refuses(std::string("MATLAB 5.0 MAT-file\0", 20), "csv",
          {"--format csv", "no such file", "'MATLAB 5 and 7.3', --format matlab"});
  refuses(kRows, "candump", {":1:", "must be"});
  refuses(kRows, "asc", {"has no frame in the lines of Vector ASC"});
  refuses(kRows, "trc", {":1:"});
  refuses("(1.0) can0 181#00\n", "csv",
          {"text, but not CSV", "looks like 'candump -l', --format candump"});
}

TEST_F(NamedFormat, BothFormsOfCandumpHaveOneName) {
  for (const char* line : {"(1.0) can0 181#00\n", " (1.0)  can0  181   [1]  00\n"}) {
    const auto file = directory_.file("a.txt", line);
    expect_error<std::invalid_argument>([&] { (void)read_recording(file, named("candump")); },
                                        {"--can-map F.toml is required"});
  }
}

TEST(RecordingFormats, HaveIdentifiersAndAreRefusedByTheirList) {
  expect_error<std::invalid_argument>(
      [] { (void)format_named("excel"); },
      {"'excel' is no format of recordings",
       "csv, matlab, mcap, candump, asc, trc, twincat, tncscope, halscope, sinumerik-capture, "
       "sinumerik-trace"});
  vector<std::string> ids = format_ids();
  std::sort(ids.begin(), ids.end());
  EXPECT_EQ(std::adjacent_find(ids.begin(), ids.end()), ids.end());
}

}  // namespace
}  // namespace servotwin
