// Lines of CAN logs of other programs. The lines are those that candump, python-can and PEAK's
// programs write; the files of real_data hold the same bus in four forms.
#include "drivers/recordings/can_log/can_log_form.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/recordings/can_log/can_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

using test::expect_error;

/// All frames of a text.
std::vector<CandumpLine> frames_of(const std::string& text) {
  CanLogLines lines(text);
  std::vector<CandumpLine> out;
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    if (auto frame = lines.parse(std::string_view(text).substr(begin, end - begin)))
      out.push_back(*frame);
    begin = end + 1;
  }
  return out;
}

std::vector<int> bytes_of(const CanFrame& frame) {
  return {frame.data.begin(), frame.data.begin() + frame.length};
}

TEST(CanLogForm, IsRecognisedByItsFirstLines) {
  const std::string asc = "date Thu May 16 06:16:50.884 pm 2024\nbase hex  timestamps absolute\n";
  EXPECT_EQ(can_log_form("(1.0) can0 181#00\n"), CanLogForm::kCandump);
  EXPECT_EQ(can_log_form(" (160.528012)  can0  080   [0]  \n"), CanLogForm::kTerminal);
  EXPECT_EQ(can_log_form("  can0  080   [0]  \n"), CanLogForm::kTerminal);
  EXPECT_EQ(can_log_form(asc), CanLogForm::kVectorAsc);
  EXPECT_EQ(can_log_form(";$FILEVERSION=2.1\n"), CanLogForm::kPeakTrc);
  EXPECT_EQ(can_log_form(";   trace\n     1)      1059.9 0300 8 00 00 00 00 04 00 00 00\n"),
            CanLogForm::kPeakTrc);
  for (const char* other : {"time[s],X.command[mm]\n", "date;value\n1;2\n", "0.1 1 181 Rx\n", "",
                            "1) first\n", "date Thu May 16\nvalue\n", "a b [c]\n"})
    EXPECT_EQ(can_log_form(other), std::nullopt) << other;
}

TEST(CanLogForm, ATerminal) {
  const auto frames = frames_of(
      " (1607120998.528112)  can0  181   [8]  00 01 02 03 04 05 06 FF\n"
      " (1607120998.528212)  can1  RX - -  18FF1234   [2]  19 00\n"
      " (1607120998.528312)  can0  123   [4]  remote request\n"
      " (1607120998.528412)  can0  20000040   [8]  00 00 00 00 00 00 00 00\n"
      " (1607120998.528512)  can0  181  [12]  00 01 02 03 04 05 06 07 08 09 0A 0B\n");
  ASSERT_EQ(frames.size(), 5U);
  EXPECT_EQ(frames[0].frame.time_ns, 1607120998528112000);
  EXPECT_EQ(frames[0].interface, "can0");
  EXPECT_EQ(frames[0].frame.id, 0x181U);
  EXPECT_EQ(bytes_of(frames[0].frame), (std::vector<int>{0, 1, 2, 3, 4, 5, 6, 255}));
  EXPECT_EQ(frames[1].interface, "can1");
  EXPECT_EQ(frames[1].frame.id, 0x18FF1234U);
  EXPECT_TRUE(frames[1].frame.extended);
  EXPECT_TRUE(frames[2].frame.remote);
  EXPECT_EQ(frames[2].frame.length, 4);
  EXPECT_TRUE(frames[3].frame.error);
  EXPECT_TRUE(frames[4].frame.fd);
  EXPECT_EQ(frames[4].frame.data[11], 0x0B);
}

TEST(CanLogForm, ATerminalWithDates) {
  const auto frames = frames_of(
      " (2024-05-31 23:59:59.999000)  can0  181   [1]  07\n"
      " (2024-05-31 23:59:59.999500)  can0  181   [1]  08\n");
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[1].frame.time_ns - frames[0].frame.time_ns, 500'000);
  const auto month = frames_of(
      " (2024-02-29 23:59:59.500000)  can0  181   [1]  07\n"
      " (2024-03-01 00:00:00.500000)  can0  181   [1]  08\n");
  ASSERT_EQ(month.size(), 2U);
  EXPECT_EQ(month[0].frame.time_ns, 1'709'251'199'500'000'000);
  EXPECT_EQ(month[1].frame.time_ns, 1'709'251'200'500'000'000);
  for (const char* date : {"2024-02-30", "1969-12-31", "2024-13-01", "2024-00-01"})
    expect_error<std::runtime_error>(
        [&] { frames_of(" (" + std::string(date) + " 23:59:59.5)  can0  181   [1]  07\n"); },
        {"candump -tA"});
}

TEST(CanLogForm, ATerminalWithoutTimesIsRefusedWithWhatToDo) {
  expect_error<std::runtime_error>([] { frames_of("  can0  181   [1]  07\n"); },
                                   {"has no time", "candump -l"});
}

TEST(CanLogForm, TimesSinceTheFrameBeforeAreAddedUp) {
  std::string differences = "(000.000000) can0 080#\n", zero_based = differences;
  const int steps_us[] = {100, 50, 50, 800};
  int sum_us = 0;
  for (int k = 0; k < 400; ++k) {
    sum_us += steps_us[k % 4];
    char line[64];
    std::snprintf(line, sizeof line, "(000.%06d) can0 181#%02X\n", steps_us[k % 4], k % 256);
    differences += line;
    std::snprintf(line, sizeof line, "(000.%06d) can0 181#%02X\n", sum_us, k % 256);
    zero_based += line;
  }
  for (const std::string& text : {differences, zero_based}) {
    const auto frames = frames_of(text);
    ASSERT_EQ(frames.size(), 401U);
    EXPECT_EQ(frames.back().frame.time_ns, 100'000'000);
    EXPECT_EQ(frames[3].frame.time_ns, 200'000);
  }
}

TEST(CanLogForm, VectorAsc) {
  const auto frames = frames_of(
      "date Thu May 16 06:16:50.884 pm 2024\n"
      "base hex  timestamps absolute\n"
      "internal events logged\n"
      "// version 8.2.0\n"
      "Begin Triggerblock Thu May 16 06:16:50.884 pm 2024\n"
      "   0.000000 Start of measurement\n"
      "   0.000100 1  181             Rx   d 2 0A FF  Length = 0 BitCount = 64 ID = 385\n"
      "   0.000150 CAN 1 Status:chip status error active\n"
      "   1.000000 1  Statistic: D 14 R 0 XD 0 XR 0 E 0 O 0 B 1.66%\n"
      "   2.500000 2  18FF1234x       Tx   d 1 07\n"
      "   2.600000 1  123             Rx   r\n"
      "   2.700000 1  ErrorFrame\n"
      "   2.800000 CANFD   1 Rx        300  Name  1 0 9 12 00 01 02 03 04 05 06 07 08 09 0A 0B "
      "130000  130 1000 0 0 0 0 0\n"
      "   2.900000 CANFD   1 Rx        300  0 1 8 8 00 01 02 03 04 05 06 07 130000 130\n"
      "End TriggerBlock\n");
  ASSERT_EQ(frames.size(), 6U);
  EXPECT_EQ(frames[0].frame.time_ns, 100'000);
  EXPECT_EQ(frames[0].interface, "1");
  EXPECT_EQ(frames[0].frame.id, 0x181U);
  EXPECT_EQ(bytes_of(frames[0].frame), (std::vector<int>{10, 255}));
  EXPECT_EQ(frames[1].interface, "2");
  EXPECT_TRUE(frames[1].frame.extended);
  EXPECT_EQ(frames[1].frame.id, 0x18FF1234U);
  EXPECT_TRUE(frames[2].frame.remote);
  EXPECT_TRUE(frames[3].frame.error);
  EXPECT_TRUE(frames[4].frame.fd);
  EXPECT_TRUE(frames[4].frame.fast);
  EXPECT_EQ(frames[4].frame.length, 12);
  EXPECT_EQ(frames[4].frame.data[11], 0x0B);
  EXPECT_TRUE(frames[5].frame.passive);
}

TEST(CanLogForm, VectorAscInDecimalWithTimesSinceTheLineBefore) {
  const auto frames = frames_of(
      "date Thu May 16 06:16:50.884 pm 2024\n"
      "base dec  timestamps relative\n"
      "   0.001000 1  385             Rx   d 2 10 255\n"
      "   0.000500 1  Statistic: D 14 R 0 XD 0 XR 0 E 0 O 0 B 1.66%\n"
      "   0.000500 1  385             Rx   d 2 11 255\n");
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[0].frame.id, 385U);
  EXPECT_EQ(bytes_of(frames[1].frame), (std::vector<int>{11, 255}));
  EXPECT_EQ(frames[1].frame.time_ns, 2'000'000);
}

TEST(CanLogForm, PeakTrc) {
  for (const char* text :
       {";$FILEVERSION=1.0\n     2)      1059.9 0300 2 0A FF\n     3)   1060.0 18FF1234 1 07\n",
        ";$FILEVERSION=1.1\n     1)   1058.0  Warng  FFFFFFFF  4  00 00 00 04  BUSHEAVY\n"
        "     2)      1059.9  Rx         0300  2  0A FF\n     3)   1060.0  Tx  18FF1234  1  07\n",
        ";$FILEVERSION=1.3\n     2)      1059.900 1  Rx         0300 -  2    0A FF\n"
        "     3)      1060.0 1  Rx  18FF1234 -  1    07\n",
        ";$FILEVERSION=2.0\n;$COLUMNS=N,O,T,I,d,l,D\n      1      1058.0 ST        Rx    00 00 00 "
        "04\n"
        "      2      1059.900 DT     0300 Rx 2  0A FF\n      3   1060.000 DT 18FF1234 Rx 1  07\n",
        ";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
        "      2      1059.900 DT 1      0300 Rx -  2    0A FF\n"
        "      3      1060.000 DT 1  18FF1234 Rx -  1    07\n"}) {
    const auto frames = frames_of(text);
    ASSERT_EQ(frames.size(), 2U) << text;
    EXPECT_EQ(frames[0].frame.time_ns, 1'059'900'000) << text;
    EXPECT_EQ(frames[0].frame.id, 0x300U) << text;
    EXPECT_FALSE(frames[0].frame.extended) << text;
    EXPECT_EQ(bytes_of(frames[0].frame), (std::vector<int>{10, 255})) << text;
    EXPECT_EQ(frames[0].interface, "1") << text;
    EXPECT_TRUE(frames[1].frame.extended) << text;
    EXPECT_EQ(frames[1].frame.id, 0x18FF1234U) << text;
  }
}

TEST(CanLogForm, PeakTrcWithItsStartFdAndRemoteRequests) {
  const auto frames = frames_of(
      ";$FILEVERSION=2.1\n;$STARTTIME=25569.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
      "      1         0.000 FB 2      0300 Rx -  9    00 01 02 03 04 05 06 07 08 09 0A 0B\n"
      "      2         1.000 RR 1      0123 Rx -  4\n");
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[0].frame.time_ns, 43'200'000'000'000);
  EXPECT_TRUE(frames[0].frame.fd);
  EXPECT_TRUE(frames[0].frame.fast);
  EXPECT_EQ(frames[0].frame.length, 12);
  EXPECT_EQ(frames[0].interface, "2");
  EXPECT_TRUE(frames[1].frame.remote);
  EXPECT_EQ(frames[1].frame.length, 4);
}

TEST(CanLogForm, WhatIsWrongWithAFrameIsSaid) {
  const std::string asc = "date today\nbase hex  timestamps absolute\n",
                    trc = ";$FILEVERSION=2.0\n";
  const auto refuses = [](const std::string& text, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { frames_of(text); }, parts);
  };
  refuses(asc + "0.1 1 800 Rx d 1 00\n", {"'800'", "no id of 11 bits"});
  refuses(asc + "0.1 1 181 Rx d 2 00\n", {"has 2 bytes, but fewer are here"});
  refuses(asc + "0.1 1 181 Rx d 9 00 00 00 00 00 00 00 00 00\n", {"no number of bytes"});
  refuses(asc + "0.1 1 181 Rx d 1 100\n", {"'100'", "is no byte"});
  refuses(trc + "1 x DT 0181 Rx 1 00\n", {"'x'", "time in ms"});
  refuses(trc + "1 1.0 DT 0181\n", {"shorter than its columns"});
  refuses(trc + ";$COLUMNS=N,O,T,I,d,l\n1 1.0 DT 0181 Rx 1\n", {"has no D"});
  refuses("(1.0)  can0  181   [1]  00\n(1.0) nonsense\n", {"must be a line of candump"});
  refuses("(1.0)  can0  181   [08]  remote request\n", {"FD frame cannot ask"});
}

// Found by fuzzing: a line that holds nothing but the ends of lines of DOS.
TEST(CanLogForm, EmptyLinesAreSkippedHoweverTheyEnd) {
  const std::string empty = "\r\n\r\r\n \t\r\r\n";
  for (const std::string& before :
       {std::string("(1.0) can0 181#00\n"), std::string("(1.0)  can0  181   [1]  00\n"),
        std::string("date today\nbase hex  timestamps absolute\n0.1 1 181 Rx d 1 00\n"),
        std::string(";$FILEVERSION=2.0\n1 1.0 DT 0181 Rx 1 00\n")}) {
    const std::string frame = before.substr(before.rfind('\n', before.size() - 2) + 1);
    EXPECT_EQ(frames_of(before + empty + frame).size(), 2U) << before;
  }
}

// Found by fuzzing: a terminal's log may hold any bytes where the name is, which a recording of the
// same frames (candump -l) cannot hold.
TEST(CanLogForm, ANameThatNoInterfaceHasIsRefused) {
  const std::string longest(32, 'c'), trc = ";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,l,D\n";
  const auto terminal = [](const std::string& name) {
    return "(1.0)  can0  181   [1]  00\n(1.1)  " + name + "  181   [1]  00\n";
  };
  EXPECT_EQ(frames_of(terminal(longest)).back().interface, longest);
  for (const std::string& text :
       {terminal(longest + "c"), terminal(std::string("ca\0n", 4)), terminal("ca\x7fn"),
        trc + "1 1.0 DT " + std::string(40, '0') + "1 0181 Rx 1 00\n",
        "date today\nbase hex  timestamps absolute\n0.1 " + std::string(40, '0') +
            "1 181 Rx d 1 00\n"})
    expect_error<std::runtime_error>([&] { frames_of(text); }, {"no name of an interface"});
}

/// All frames of a file.
std::vector<CandumpLine> read(const std::filesystem::path& file) {
  CanLogReader reader(file);
  std::vector<CandumpLine> out;
  CandumpLine line;
  while (reader.next(line)) out.push_back(line);
  return out;
}

TEST(CanLogForm, TheSameBusInFourForms) {
  SERVOTWIN_REAL_DATA(folder, "field_can");
  const auto terminal = read(folder / "candump_ta.txt");
  ASSERT_GT(terminal.size(), 300U);
  for (const char* name : {"candump_td.log", "vector.asc", "pcan.trc"}) {
    const auto other = read(folder / name);
    ASSERT_GT(other.size(), 300U) << name;
    for (std::size_t i = 0; i < std::min(terminal.size(), other.size()); ++i) {
      const CanFrame &a = terminal[i].frame, &b = other[i].frame;
      EXPECT_EQ(a.id, b.id) << name << " " << i;
      EXPECT_EQ(bytes_of(a), bytes_of(b)) << name << " " << i;
      EXPECT_NEAR(1e-3 * static_cast<double>(a.time_ns - terminal[0].frame.time_ns),
                  1e-3 * static_cast<double>(b.time_ns - other[0].frame.time_ns), 2.0)
          << name << " " << i;
    }
  }
}

}  // namespace
}  // namespace servotwin
