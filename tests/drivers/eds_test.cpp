// Object dictionaries: real ones compared with their own lines, and invented ones with typical
// faults.
#include "drivers/can/eds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

using test::expect_error;
using testing::HasSubstr;
using testing::IsEmpty;

EdsDevice fixture(const std::string& file, int node) {
  return read_eds(std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "tests/drivers/eds" / file, node);
}

const Pdo& pdo_of(const EdsDevice& device, bool transmit, int number) {
  for (const Pdo& pdo : device.pdos) {
    if (pdo.transmit == transmit && pdo.number == number) return pdo;
  }
  throw std::runtime_error("no such PDO");
}

TEST(Eds, SchunkConfigurationGoesBeforeItsDefaults) {
  const EdsDevice device = fixture("Schunk_0_63.dcf", 5);
  // 1800sub1 ParameterValue=$NODEID+0x180; 1400sub1 $NODEID+0x200.
  EXPECT_EQ(text_of(pdo_of(device, true, 1)), "TPDO1 (0x185): 0x6041 16 bits, 0x6061 8 bits");
  EXPECT_EQ(text_of(pdo_of(device, false, 1)), "RPDO1 (0x205): 0x6040 16 bits, 0x6042 16 bits");
  EXPECT_EQ(text_of(pdo_of(device, false, 2)), "RPDO2 (0x305): 0x607A 32 bits, 0x60C1:01 32 bits");
  EXPECT_EQ(pdo_of(device, true, 1).transmission, 1);
  EXPECT_EQ(pdo_of(device, true, 1).bytes(), 3);
}

TEST(Eds, TheNodeIdOfADcfHoldsWhereNoneIsGiven) {
  expect_error<std::runtime_error>([] { (void)fixture("ros2_cia402_slave.eds", 0); },
                                   {"ros2_cia402_slave.eds", "node id"});
}

TEST(Eds, ElmoSimplIqHasBitThirtyOfItsIds) {
  const EdsDevice device = fixture("ElmoSimplIQ.dcf", 1);
  const Pdo& first = pdo_of(device, true, 1);  // 1800sub1 DefaultValue=$NODEID+0x40000180
  EXPECT_TRUE(first.valid);
  EXPECT_EQ(first.id, 0x181U);
  EXPECT_FALSE(first.extended);
}

TEST(Eds, APdoIsSwitchedOffByBitThirtyOne) {
  const EdsDevice device = fixture("ros2_cia402_slave.eds", 2);
  EXPECT_TRUE(pdo_of(device, true, 1).valid);
  EXPECT_EQ(pdo_of(device, true, 1).id, 0x182U);
  EXPECT_FALSE(pdo_of(device, true, 3).valid);  // 1802sub1 $NODEID+0x80000380
  EXPECT_THAT(text_of(pdo_of(device, true, 3)), HasSubstr("switched off"));
}

TEST(Eds, EveryRealFileIsRead) {
  SERVOTWIN_REAL_DATA(folder, "eds");
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() == ".md") continue;
    ++files;
    const EdsDevice device = read_eds(entry.path(), 7);
    EXPECT_GE(device.pdos.size(), 4U) << entry.path();
    for (const Pdo& pdo : device.pdos) EXPECT_LE(pdo.bytes(), 8) << entry.path();
  }
  EXPECT_EQ(files, 6);
}

TEST(Eds, MaxonIsConfiguredForNodeOne) {
  SERVOTWIN_REAL_DATA(file, "eds/maxon_epos4_50_15_can.dcf");
  const EdsDevice device = read_eds(file, 7);
  // 1400sub1 ParameterValue=0x00000201 is for node 1, whatever node id is given.
  EXPECT_EQ(pdo_of(device, false, 1).id, 0x201U);
  EXPECT_EQ(text_of(pdo_of(device, false, 1)), "RPDO1 (0x201): 0x6040 16 bits, 0x60FF 32 bits");
}

constexpr const char* kDrive = R"([DeviceInfo]
ProductName=Drive
[1800]
ObjectType=9
[1800sub1]
DefaultValue=0x180+$NodeId
[1800sub2]
DefaultValue=01
[1A00sub0]
DefaultValue=3
[1A00Sub1]
DefaultValue=0x60410010
[1a00sub2]
DefaultValue=0x00050008
[1a00sub3]
DefaultValue=0x60640020
ParameterValue=
[6041]
DataType=0x0006
[6064]
DataType=0x0004
ParameterName=Position actual value
)";

TEST(Eds, GapsTypesAndBothOrdersOfTheNodeId) {
  const EdsDevice device = parse_eds(kDrive, "d.eds", 3);
  ASSERT_EQ(device.pdos.size(), 1U);
  const Pdo& pdo = device.pdos[0];
  EXPECT_EQ(pdo.id, 0x183U);
  EXPECT_EQ(pdo.transmission, 1);
  ASSERT_EQ(pdo.objects.size(), 3U);
  EXPECT_EQ(pdo.objects[0].coding, Coding::kUnsigned);
  EXPECT_EQ(pdo.objects[1].index, 5);  // a gap of eight bits
  EXPECT_EQ(pdo.objects[2].start, 24);
  EXPECT_EQ(pdo.objects[2].coding, Coding::kSigned);
  EXPECT_EQ(pdo.objects[2].name, "Position actual value");
  EXPECT_EQ(pdo.bytes(), 7);
}

TEST(Eds, CompactSubObjects) {
  const EdsDevice device = parse_eds(R"([1800sub1]
DefaultValue=0x20000180
[1A00]
CompactSubObj=2
[1A00Value]
NrOfEntries=2
1=0x60640020
2=0x60770010
)",
                                     "d.eds", 3);
  EXPECT_EQ(text_of(device.pdos.at(0)), "TPDO1 (0x00000180): 0x6064 32 bits, 0x6077 16 bits");
}

TEST(Eds, OddThingsAreNoted) {
  const EdsDevice device = parse_eds(
      "[a]\nhuh\n[1800sub1]\nDefaultValue=0x181\n[1A00sub0]\n"
      "DefaultValue=1\n[1a00sub1]\nDefaultValue=0x60640000\n[A]\n",
      "d.eds", 1);
  ASSERT_EQ(device.notes.size(), 3U);
  EXPECT_THAT(device.notes[0], HasSubstr("d.eds:2"));
  EXPECT_THAT(device.notes[1], HasSubstr("d.eds:9"));
  EXPECT_THAT(device.notes[2], HasSubstr("0 bits"));
  EXPECT_THAT(device.pdos.at(0).objects, IsEmpty());
}

TEST(Eds, RefusesWithLineSectionAndKey) {
  const auto refused = [](const std::string& text, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { (void)parse_eds(text, "d.eds", 1); }, parts);
  };
  refused("", {"d.eds", "not an EDS"});
  refused("time[s],X\n1,2\n", {"d.eds"});
  refused("[1800sub1\n", {"d.eds:1", "]"});
  refused("a=1\n[b]\n", {"d.eds:1", "[section]"});
  refused("[1A00sub0]\nDefaultValue=one\n[1A00]\n", {"d.eds:2", "1a00sub0", "'one'"});
  refused("[1A00]\n[1800sub1]\nDefaultValue=$NODEID+$NODEID\n", {"d.eds:3", "$NODEID"});
  refused("[1A00]\n[1800sub1]\nDefaultValue=0x1FFFFFFFF\n", {"d.eds:3", "32 bits"});
  expect_error<std::runtime_error>(
      [] { (void)parse_eds("[DeviceComissioning]\nNodeID=200\n", "d.dcf", 0); },
      {"d.dcf:2", "1 to 127"});
}

}  // namespace
}  // namespace servotwin
