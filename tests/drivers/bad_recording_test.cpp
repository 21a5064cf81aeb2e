// Errors of bad recordings: the file, the place, the value and the remedy, on one line.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <random>
#include <stdexcept>
#include <string>

#include "drivers/common/memory.h"
#include "drivers/recordings/recording_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using test::expect_error;
using Parts = std::initializer_list<const char*>;

class BadRecording : public testing::Test {
 protected:
  void refuses(std::string_view text, Parts parts, const ReadOptions& options = {},
               const char* name = "rec.csv") const {
    const auto file = directory_.file(name, text);
    expect_error<std::runtime_error>([&] { (void)read_recording(file, options); }, parts);
    expect_error<std::runtime_error>([&] { (void)read_recording(file, options); }, {name});
  }
  void refuses_columns(const char* columns, Parts parts) const {
    ReadOptions options;
    options.columns = columns;
    const auto file = directory_.file("rec.csv", "t,qg,qm\n0,1,2\n1,2,3\n");
    expect_error<std::invalid_argument>([&] { (void)read_recording(file, options); }, parts);
  }
  static ReadOptions mapped(const char* columns) {
    ReadOptions options;
    options.columns = columns;
    return options;
  }

  test::TemporaryDirectory directory_;
};

// The file itself.

TEST_F(BadRecording, NotThere) {
  expect_error<std::runtime_error>([&] { (void)read_recording(directory_.path() / "none.csv"); },
                                   {"none.csv", "no such file"});
}
TEST_F(BadRecording, Directory) {
  expect_error<std::runtime_error>([&] { (void)read_recording(directory_.path()); },
                                   {"is a directory"});
}
TEST_F(BadRecording, Device) {
  expect_error<std::runtime_error>([] { (void)read_recording("/dev/null"); },
                                   {"/dev/null", "not a regular file"});
}
TEST_F(BadRecording, Empty) { refuses("", {"the file is empty"}); }
TEST_F(BadRecording, OnlyComments) { refuses("# one\n\n# two\n", {"no header line"}); }
TEST_F(BadRecording, HeaderOnly) {
  refuses("time[s],X.command[mm],X.actual[mm]\n", {"a header and no rows"});
}
TEST_F(BadRecording, Prose) {
  refuses("Dear operator\nthe axis makes a noise.\n",
          {"line 1", "text, but not CSV", "'Dear operator'", "time[s],X.command[mm],X.actual[mm]"});
}
TEST_F(BadRecording, Gcode) {
  for (const char* program : {"%\nO1000\n", "N10 G1 X10 Y0 F1000\nN20 X0\n", "g90\ng1 x10\n"})
    refuses(program,
            {"line 1", "text, but not CSV", "G-code has no times", "record what it commands"});
}
TEST_F(BadRecording, ProseWithCommas) {
  refuses("Dear operator, please, look\n",
          {"no column is named AXIS.channel[unit]", "Dear operator, please, look"});
}
TEST_F(BadRecording, BinaryGarbage) {
  std::mt19937_64 random(20);
  std::string bytes(100'000, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  refuses(bytes, {"binary file"});
}
// First bytes of real files of these formats.
TEST_F(BadRecording, FormatsThatAreNotReadAreNamedWithAWayToConvertThem) {
  using namespace std::string_view_literals;
  const std::pair<std::string_view, const char*> known[]{
      {"#ROSBAG V2.0\nE\0\0\0"sv, "PlotJuggler"},
      {"SQLite format 3\0\x10\0\x01\x01\0@  "sv, "bags of ROS 2"},
      {"MDF     4.10    asammdf\0\0\0\0\0\x9a\x01"sv, "asammdf"},
      {"LOGG\x90\0\0\0\x04\x02\x05\0"sv, "can.logconvert"},
      {"TDSm\x0e\0\0\0\x69\x12\0\0"sv, "nptdms"},
      {"PAR1\x15\x04\x15\xa0\x1f"sv, "read_parquet"},
      {"\x93NUMPY\x01\0v\0{'descr': '<f8'"sv, "Python module"},
      {"\x89HDF\r\n\x1a\n\0\0\0\0\0\x08\x08\0"sv, "HDF5"},
      {"PK\x03\x04\x14\0\x06\0\x08\0\0\0!\0"sv, "spreadsheet"},
      {"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0\0\0\0"sv, "spreadsheet"},
      {"\x1f\x8b\x08\0\0\0\0\0\0\x03"sv, "gunzip"},
      {"\xfd"
       "7zXZ\0\0\x04\xe6\xd6\xb4"sv,
       "unxz"},
      {"\x28\xb5\x2f\xfd\x04\x58\x81\0"sv, "unzstd"},
      {"%PDF-1.7\n1 0 obj\n<< /Type /Catalog >>\n"sv, "export the values"},
      {"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"sv, "export the values"},
      {"\xff\xd8\xff\xe0\0\x10JFIF\0"sv, "export the values"},
      {"\xd4\xc3\xb2\xa1\x02\0\x04\0\0\0\0\0"sv, "candump -l"},
      {"\x0a\x0d\x0d\x0a\xb8\0\0\0\x4d\x3c\x2b\x1a"sv, "candump -l"},
  };
  for (const auto& [bytes, advice] : known) refuses(bytes, {"which is not read", advice});
}
TEST_F(BadRecording, ATableMayHaveAColumnThatIsCalledLikeSuchAFormat) {
  for (const char* name : {"PAR1", "LOGG", "TDSm"})
    refuses(std::string(name) + ",LOGB\n1,2\n", {"no column is named AXIS.channel[unit]"});
}
TEST_F(BadRecording, AFileThatServotwinWroteIsCalledWhatItIs) {
  const std::string long_model = "{\n  \"axis\": \"" + std::string(5000, 'X') +
                                 "\",\n  \"schema\": \"servotwin.model/1\"\n}\n";
  refuses(long_model, {"is a file of Servotwin", "servotwin.model/1", "not a recording"});
  refuses("{\"schema\":\"servotwin.diagnosis/1\"}\n", {"servotwin.diagnosis/1"});
}
TEST_F(BadRecording, BinaryGarbageWithoutZeros) {
  std::mt19937_64 random(21);
  std::string bytes(3 << 20, '\0');
  for (char& byte : bytes) byte = static_cast<char>(128 + random() % 120);
  refuses(bytes, {"line 1", "longer than a megabyte"});
}
TEST_F(BadRecording, Utf16) {
  refuses(std::string_view("\xff\xfet\0i\0m\0e\0", 10), {"text, but not CSV", "'time'"});
}
TEST_F(BadRecording, CanLog) {
  refuses("  can0  181   00\n", {"first line is not that of a CAN log"}, {}, "run.log");
  refuses("  can0  181   [1]  00\n", {"run.log:1", "has no time", "candump -l"}, {}, "run.log");
  const auto file = directory_.file("run.log", "(0.1) can0 181#00\n");
  expect_error<std::invalid_argument>([&] { (void)read_recording(file); },
                                      {"run.log", "--can-map F.toml"});
}
TEST_F(BadRecording, NamedMatButText) {
  refuses("time[s],X.command[mm]\n0,1\n", {"not a MATLAB file"}, {}, "run.mat");
}
TEST_F(BadRecording, TooLargeForTheMemory) {
  // A sparse file with rows at its beginning: eight terabytes that need no space on the disk.
  std::string text = "time[s],X.command[m],X.actual[m]\n";
  for (int i = 0; i < 4000; ++i) text += std::to_string(i) + ".0,1.0000000,2.0000000\n";
  const auto file = directory_.file("huge.csv", text);
  std::filesystem::resize_file(file, std::uintmax_t{8} << 40);
  expect_error<std::runtime_error>([&] { (void)read_recording(file); },
                                   {"huge.csv (8796.09 GB)", "rows of 3 columns need",
                                    "GB of memory", "are free", "--from S --to S"});
}
TEST_F(BadRecording, MemoryIsRefusedExactlyAboveWhatIsFree) {
  EXPECT_NO_THROW(require_memory("a.csv", 1000, 4, 32'000));
  EXPECT_THROW(require_memory("a.csv", 1000, 4, 31'999), std::runtime_error);
}

// The header.

TEST_F(BadRecording, NoUnit) {
  refuses("time[s],X.command,X.actual[mm]\n0,1,2\n",
          {"'X.command' has no unit", "X.command[unit]", "mm"});
}
TEST_F(BadRecording, NoUnitOfTime) { refuses("time,X.command[mm]\n0,1\n", {"'time' has no unit"}); }
TEST_F(BadRecording, UnknownUnit) {
  refuses("time[s],X.command[furlong]\n0,1\n",
          {"'X.command[furlong]'", "unknown unit [furlong]", "um nm in"});
}
TEST_F(BadRecording, UnitOfAnotherQuantity) {
  refuses("time[s],X.command[V]\n0,1\n",
          {"'X.command' cannot be a torque", "a length or an angle"});
  refuses("time[mm],X.command[mm]\n0,1\n", {"'time' cannot be a length", "a time"});
}
TEST_F(BadRecording, LengthAndAngleOfOneAxis) {
  refuses("time[s],X.command[mm],X.actual[deg]\n0,1,2\n", {"axis 'X'", "length", "angle"});
}
TEST_F(BadRecording, DuplicateColumns) {
  refuses("time[s],X.command[mm],X.actual[mm],X.command[m]\n0,1,2,3\n",
          {"'X.command' occurs twice", "columns 2 and 4"});
}
TEST_F(BadRecording, NoCommand) {
  refuses("time[s],X.comand[mm],X.actual[mm]\n0,1,2\n",
          {"command of an axis", "X.command[mm]", "The file has: time[s], X.comand[mm]"});
}
TEST_F(BadRecording, NoTime) {
  refuses("X.command[mm],X.actual[mm]\n1,2\n", {"no time column", "time[s]", "--rate"});
}
TEST_F(BadRecording, RateAndTime) {
  ReadOptions options;
  options.rate_hz = 100.0;
  refuses("time[s],X.command[mm]\n0,1\n", {"--rate", "'time[s]'"}, options);
}
TEST_F(BadRecording, MoreAxesThanAMachineHas) {
  std::string header = "time[s]", row = "0";
  for (int i = 0; i < 33; ++i) {
    header += ",A" + std::to_string(i) + ".command[m]";
    row += ",0";
  }
  refuses(header + "\n" + row + "\n", {"more than 32 axes"});
}

// The rows.

TEST_F(BadRecording, TooFewFields) {
  refuses("time[s],X.command[mm],X.actual[mm]\n0,1,2\n1,2\n2,3,4\n",
          {"line 3", "2 fields", "header has 3"});
}
TEST_F(BadRecording, TooManyFields) {
  refuses("# comment\ntime[s],X.command[mm]\n0,1\n1,2,3\n", {"line 4", "3 fields", "header has 2"});
  refuses("time[s],X.command[mm]\n0,1,,\n", {"line 2", "4 fields"});
}
TEST_F(BadRecording, ALastLineWithTooManyFieldsIsNotCutOff) {
  refuses("time[s],X.command[mm]\n0,1\n1,2,3", {"line 3", "3 fields", "header has 2"});
}
TEST_F(BadRecording, FieldsAfterTheWantedOnesAreCountedToo) {
  refuses("time[s],X.command[mm],a,b\n0,1,2,3\n1,2,3\n2,3,4,5\n", {"line 3", "3 fields"});
}
TEST_F(BadRecording, NotANumber) {
  refuses("time[s],X.command[mm]\n0,1\n1,fast\n", {"line 3", "'X.command[mm]'", "'fast'"});
  refuses("time[s],X.command[mm]\n0,1\n1,12mm\n", {"line 3", "'12mm'"});
  refuses("time[s],X.command[mm]\n0,1\n1,0x10\n", {"line 3", "'0x10'"});
  refuses("time[s],X.command[mm]\n0,1\nnow,1\n", {"line 3", "'time[s]'", "'now'"});
}
TEST_F(BadRecording, DecimalComma) {
  refuses("time[s],X.command[mm],X.actual[mm]\n0,\"1,5\",2\n",
          {"line 2", "'X.command[mm]'", "'1,5'", "decimals need a point"});
}
TEST_F(BadRecording, AValueThatWouldBreakTheLineOfTheMessage) {
  refuses("time[s],X.command[mm]\n0,1\n1,a\x01\x1b" + std::string(500, 'b') + "\n",
          {"'a??bbbb", "...'"});
}

// The options.

TEST_F(BadRecording, ForeignFileWithoutMapping) {
  refuses("t_s,pos_cmd,pos_meas\n0,1,2\n",
          {"AXIS.channel[unit]", "--columns", "t_s, pos_cmd, pos_meas"});
}
TEST_F(BadRecording, MappedColumnMissing) {
  refuses("t,qg,qm,vir\n0,1,2,3\n",
          {"no column 'qgg' for X.command", "did you mean 'qg'", "t, qg, qm, vir"},
          mapped("X.command=qgg[m]"));
  refuses("t,qg,qm,vir\n0,1,2,3\n", {"no column 'position' for X.command. The file has: t, qg"},
          mapped("X.command=position[m]"));
}
TEST_F(BadRecording, MappedColumnTwiceInTheFile) {
  refuses("t,qg,qm,qg\n0,1,2,3\n", {"'qg' occurs twice", "columns 2 and 4"},
          mapped("X.command=qg[m]"));
}
TEST_F(BadRecording, TwoColumnsThatCouldBeTheTime) {
  refuses("t,time,qg\n0,1,2\n", {"'t' and 'time'", "time=time[s]"}, mapped("X.command=qg[m]"));
}
TEST_F(BadRecording, RangeBesideTheRecording) {
  ReadOptions options;
  options.from_s = 100.0;
  options.to_s = 200.0;
  refuses("time[s],X.command[mm]\n5,1\n7.5,1\n", {"between 100 s and 200 s", "2.5 s long"},
          options);
}

TEST_F(BadRecording, MappingSyntax) {
  refuses_columns("X.command", {"--columns", "'X.command'", "X.command=NAME[unit]"});
  refuses_columns("X.command=qg[m],", {"''", "X.command=NAME[unit]"});
  refuses_columns("=qg[m]", {"'=qg[m]'"});
  refuses_columns("X.command=", {"names no column"});
  refuses_columns("X.command=[m]", {"names no column"});
  refuses_columns("X.command=qg", {"'X.command=qg' has no unit", "X.command=qg[unit]"});
  refuses_columns("X.command=qg[]", {"unknown unit []"});
  refuses_columns("X.command=qg[parsec]", {"unknown unit [parsec]"});
  refuses_columns("X.command=qg[unit]", {"replace [unit] by the unit of its values", "mm um"});
  refuses_columns("X.command=qg[V]", {"'X.command' cannot be a torque"});
  refuses_columns("X.comand=qg[m]", {"'X.comand'", "did you mean 'command'", "following_error"});
  refuses_columns("command=qg[m]", {"'command'", "AXIS.channel"});
  refuses_columns("X.command=qg[m],X.command=qm[m]", {"'X.command' is given twice"});
  refuses_columns("time=t[s]", {"names no channel"});
}
TEST_F(BadRecording, Options) {
  const auto file = directory_.file("rec.csv", "time[s],X.command[mm]\n0,1\n1,2\n");
  const auto refuses_options = [&](ReadOptions options, Parts parts) {
    expect_error<std::invalid_argument>([&] { (void)read_recording(file, options); }, parts);
  };
  ReadOptions options;
  options.rate_hz = 0.0;
  refuses_options(options, {"--rate 0", "above 0 Hz"});
  options = {};
  options.from_s = 3.0;
  options.to_s = 2.0;
  refuses_options(options, {"--from 3 --to 2"});
  options = {};
  options.from_s = -1.0;
  refuses_options(options, {"--from -1"});
}

}  // namespace
}  // namespace servotwin
