// CAN logs: every kind of line, messages for invalid lines, and round trips.
#include "drivers/recordings/can_log/can_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using test::expect_error;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(Candump, DataOfAStandardFrame) {
  const CandumpLine line = parse_candump_line("(1436509052.249713) vcan0 044#2A366C2BBA");
  EXPECT_EQ(line.interface, "vcan0");
  EXPECT_EQ(line.frame.time_ns, 1436509052249713000);
  EXPECT_EQ(line.frame.id, 0x44U);
  EXPECT_FALSE(line.frame.extended);
  ASSERT_EQ(line.frame.length, 5);
  EXPECT_EQ(line.frame.data[0], 0x2A);
  EXPECT_EQ(line.frame.data[4], 0xBA);
}

TEST(Candump, OtherKindsOfFrames) {
  const CanFrame extended = parse_candump_line("(0.000001) can1 1F334455#1122334455667788").frame;
  EXPECT_TRUE(extended.extended);
  EXPECT_EQ(extended.id, 0x1F334455U);
  EXPECT_EQ(extended.time_ns, 1000);
  const CanFrame remote = parse_candump_line("(1.5) can1 123#R4").frame;
  EXPECT_TRUE(remote.remote);
  EXPECT_EQ(remote.length, 4);
  const CanFrame fd =
      parse_candump_line("(1.123456789) can1 123##3112233445566778899AABBCC T").frame;
  EXPECT_TRUE(fd.fd && fd.fast && fd.passive);
  EXPECT_EQ(fd.length, 12);
  EXPECT_EQ(fd.time_ns, 1123456789);
  const CanFrame error = parse_candump_line("(1.0) can1 20000040#0000000000000000").frame;
  EXPECT_TRUE(error.error);
  EXPECT_TRUE(can_errors(error).bus_off);
  EXPECT_FALSE(can_errors(error).restarted);
  EXPECT_EQ(parse_candump_line("(1.0) can1 123#").frame.length, 0);
  EXPECT_EQ(parse_candump_line("(1.0) can1 123#1122334455667788_E\r").frame.length, 8);
}

TEST(Candump, WritesWhatItReads) {
  for (const char* line :
       {"(1436509052.249713001) vcan0 044#2A366C2BBA", "(0.000001000) can1 1F334455#11",
        "(1.500000000) can1 123#R4", "(1.123456789) can1 123##3112233445566778899AABBCC",
        "(1.000000000) can1 20000040#0000000000000000", "(1.000000000) can1 080#"}) {
    const CandumpLine read = parse_candump_line(line);
    EXPECT_EQ(candump_line(read.frame, read.interface), line);
  }
}

TEST(Candump, SaysWhereALineIsNone) {
  const auto refused = [](const char* line, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { (void)parse_candump_line(line); }, parts);
  };
  refused("  vcan0  123   [8]  11 22", {"column 3", "candump -l"});
  refused("(12x.0) can0 123#00", {"candump -l"});
  refused("(99999999999.0) can0 123#00", {"candump -l"});
  refused("(1.0) can0 1234#00", {"3 or 8", "'1234'"});
  refused("(1.0) can0 800#00", {"7FF", "'800'"});
  refused("(1.0) can0 123#0", {"two hexadecimal digits"});
  refused("(1.0) can0 123#112233445566778899", {"at most 8"});
  refused("(1.0) can0 123##", {"one digit of flags"});
  refused("(1.0) can0 123##0112233445566778899", {"9 bytes"});
  refused("(1.0) can0 123###0", {"XL"});
  refused("(1.0) can0 123#00 huh", {"beyond the end of the frame"});
  refused("", {"column 1"});
}

TEST(Candump, TellsALogFromATable) {
  EXPECT_TRUE(is_candump("# comment\n\n(1.0) can0 123#00\n(1."));
  EXPECT_FALSE(is_candump("time[s],X.command[mm]\n"));
  EXPECT_FALSE(is_candump(""));
  EXPECT_FALSE(is_candump("#\n"));
}

class CandumpFile : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& text) {
    auto file = directory_.path() / "a.log";
    std::ofstream(file, std::ios::binary) << text;
    return file;
  }
  test::TemporaryDirectory directory_;
};

TEST_F(CandumpFile, IsReadLineByLine) {
  CanLogReader reader(write("(1.0) can0 123#00\r\n\n# by hand\n(2.0) can0 124#01\n"));
  CandumpLine line;
  ASSERT_TRUE(reader.next(line));
  EXPECT_EQ(line.frame.id, 0x123U);
  ASSERT_TRUE(reader.next(line));
  EXPECT_EQ(line.frame.id, 0x124U);
  EXPECT_FALSE(reader.next(line));
  EXPECT_TRUE(reader.notes().empty());
}

TEST_F(CandumpFile, LongerThanItsBlocks) {
  std::string text;
  for (int i = 0; i < 20000; ++i) {
    CanFrame frame;
    frame.time_ns = i * 1000;
    frame.id = static_cast<std::uint32_t>(i % 2048);
    text += candump_line(frame, "can0") + "\n";
  }
  CanLogReader reader(write(text));
  CandumpLine line;
  int count = 0;
  for (; reader.next(line); ++count) ASSERT_EQ(line.frame.time_ns, count * 1000);
  EXPECT_EQ(count, 20000);
}

TEST_F(CandumpFile, ALastLineWithoutItsEndIsDroppedAndSaid) {
  for (const char* rest : {"(2.0) can0 124#01", "(2.0) can"}) {
    CanLogReader reader(write(std::string("(1.0) can0 123#00\n") + rest));
    CandumpLine line;
    EXPECT_TRUE(reader.next(line));
    EXPECT_FALSE(reader.next(line));
    EXPECT_THAT(reader.notes(), ElementsAre(HasSubstr("a.log:2")));
  }
}

TEST_F(CandumpFile, ALineInTheMiddleThatIsNoneIsAnErrorWithItsNumber) {
  CanLogReader reader(write("(1.0) can0 123#00\nnonsense\n(2.0) can0 124#01\n"));
  CandumpLine line;
  EXPECT_TRUE(reader.next(line));
  expect_error<std::runtime_error>([&] { reader.next(line); }, {"a.log:2", "'nonsense'"});
}

}  // namespace
}  // namespace servotwin
