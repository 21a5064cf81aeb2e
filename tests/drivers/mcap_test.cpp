// Recordings of ROS 2 in MCAP files. The files are written by tests/drivers/mcap_writer.h; what is
// true are the numbers that were written.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/drivers/mcap_writer.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using std::vector;
using test::Cdr, test::channel, test::chunk, test::expect_error, test::little, test::mcap,
    test::message, test::record, test::schema;

const std::string kSection = std::string(80, '=') + "\nMSG: ";
const std::string kHeader = kSection +
                            "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" +
                            kSection + "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const std::string kPoint =
    kSection +
    "trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\n"
    "float64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start\n" +
    kSection + "builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n";
constexpr const char* kStateType = "control_msgs/msg/JointTrajectoryControllerState";
constexpr const char* kJointType = "sensor_msgs/msg/JointState";
const std::string kNewState =
    "# state\nstd_msgs/Header header\n\nstring[] joint_names\n"
    "trajectory_msgs/JointTrajectoryPoint reference # set point\n"
    "trajectory_msgs/JointTrajectoryPoint feedback\n"
    "trajectory_msgs/JointTrajectoryPoint error\ntrajectory_msgs/JointTrajectoryPoint output\n"
    "float64 speed_scaling_factor\n" +
    kHeader + kPoint;
const std::string kOldState =
    "std_msgs/Header header\nstring[] joint_names\n"
    "trajectory_msgs/JointTrajectoryPoint desired\ntrajectory_msgs/JointTrajectoryPoint actual\n"
    "trajectory_msgs/JointTrajectoryPoint error\n" +
    kHeader + kPoint;
const std::string kJointState =
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    "float64[] effort\n" +
    kHeader;

std::string new_state(int nanoseconds, const vector<double>& command, const vector<double>& actual,
                      const vector<double>& effort = {}, bool big_endian = false) {
  const auto zero = vector<double>(command.size(), 0.0);
  return Cdr(big_endian)
      .header(1'700'000'000, static_cast<std::uint32_t>(nanoseconds))
      .texts({"shoulder", "elbow"})
      .point(command)
      .point(actual, effort)
      .point(zero)
      .point(zero)
      .number(1.0)
      .bytes();
}
std::string joint_state(int nanoseconds, const vector<std::string>& names,
                        const vector<double>& position, const vector<double>& effort,
                        std::int32_t seconds = 1'700'000'000) {
  return Cdr()
      .header(seconds, static_cast<std::uint32_t>(nanoseconds))
      .texts(names)
      .doubles(position)
      .doubles({})
      .doubles(effort)
      .bytes();
}

const std::string kStateTopic = schema(1, kStateType, kNewState) + channel(1, 1, "/arm/state");
const std::string kJointTopic = schema(2, kJointType, kJointState) + channel(2, 2, "/joint_states");
const std::string kThreeStates =
    message(1, 7, new_state(1'000'000, {1.0, 2.0}, {0.5, 1.5}, {3.0, 4.0})) +
    message(1, 8, new_state(2'000'000, {1.25, 2.25}, {0.75, 1.75}, {3.5, 4.5})) +
    message(1, 9, new_state(3'000'000, {1.5, 2.5}, {1.0, 2.0}, {-3.0, -4.0}));

class Mcap : public testing::Test {
 protected:
  [[nodiscard]] Recording read_bytes(const std::string& bytes, const char* columns = "") const {
    ReadOptions options;
    options.columns = columns;
    return read_recording(directory_.file("bag.mcap", bytes), options);
  }
  [[nodiscard]] Recording read(const std::string& data, const char* columns = "") const {
    return read_bytes(mcap(data), columns);
  }
  template <class Error = std::runtime_error>
  void refuses(const std::string& bytes, std::initializer_list<const char*> parts,
               const char* columns = "") const {
    expect_error<Error>([&] { (void)read_bytes(bytes, columns); }, parts);
  }
  static std::string notes(const Recording& recording) {
    std::string all;
    for (const std::string& note : recording.notes) all += note + "\n";
    return all;
  }
  static void expect_three_states(const Recording& r) {
    ASSERT_EQ(r.axes.size(), 2U);
    ASSERT_EQ(r.time.size(), 3U);
    EXPECT_EQ(r.time[0], 0.0);
    EXPECT_DOUBLE_EQ(r.time[1], 0.001);
    EXPECT_DOUBLE_EQ(r.time[2], 0.002);
    EXPECT_EQ(r.axes[0].name, "shoulder");
    EXPECT_EQ(r.axes[1].name, "elbow");
    EXPECT_TRUE(r.axes[0].rotary && r.axes[1].rotary);
    EXPECT_EQ(r.axes[0].command, (vector<double>{1.0, 1.25, 1.5}));
    EXPECT_EQ(r.axes[1].command, (vector<double>{2.0, 2.25, 2.5}));
    EXPECT_EQ(r.axes[0].actual, (vector<double>{0.5, 0.75, 1.0}));
    EXPECT_EQ(r.axes[1].actual, (vector<double>{1.5, 1.75, 2.0}));
    EXPECT_EQ(r.axes[0].torque, (vector<double>{3.0, 3.5, -3.0}));
    EXPECT_EQ(r.axes[1].torque, (vector<double>{4.0, 4.5, -4.0}));
    EXPECT_EQ(r.axes[0].torque_unit, "Nm");
  }

  test::TemporaryDirectory directory_;
};

TEST_F(Mcap, EachJointOfAControllersStateIsAnAxis) {
  expect_three_states(read(kStateTopic + kThreeStates));
}

TEST_F(Mcap, ChunksAreUnpacked) {
  for (const char* compression : {"", "lz4", "zstd"}) {
    SCOPED_TRACE(compression);
    expect_three_states(read(chunk(kStateTopic, compression) + chunk(kThreeStates, compression)));
  }
}

TEST_F(Mcap, RecordsThatAreNotMessagesAreSkipped) {
  const std::string large(std::size_t{3} << 20, 'a');
  expect_three_states(read(record(9, large) +
                           chunk(kStateTopic + record('\x90', large) + kThreeStates, "") +
                           record(7, "index")));
}

TEST_F(Mcap, TheOldNamesOfTheStateAreReadByItsDefinition) {
  const auto state = Cdr()
                         .header(1'700'000'000, 5)
                         .texts({"j"})
                         .point({0.25})
                         .point({0.125}, {7.0})
                         .point({0.125})
                         .bytes();
  const Recording r =
      read(schema(1, kStateType, kOldState) + channel(3, 1, "/arm/state") + message(3, 1, state));
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_EQ(r.axes[0].command, (vector<double>{0.25}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.125}));
  EXPECT_EQ(r.axes[0].torque, (vector<double>{7.0}));
}

TEST_F(Mcap, BigEndianMessagesAreRead) {
  const Recording r =
      read(kStateTopic + message(1, 1, new_state(5, {1.5, -2.5}, {1.25, -2.25}, {}, true)));
  EXPECT_EQ(r.axes[1].command, (vector<double>{-2.5}));
  EXPECT_EQ(r.axes[1].actual, (vector<double>{-2.25}));
  EXPECT_TRUE(r.axes[1].torque.empty());
}

TEST_F(Mcap, TheLayoutIsThatOfTheStoredDefinition) {
  // Every kind of field before the positions; constants and default values take no bytes.
  const std::string definition =
      "uint8 MODE_A=1\nstring NAME = \"a # b = c\"\nbool flag true\nint16[3] triple [1, 2, 3]\n"
      "string<=5 label \"x\"\nstring<=5[<=2] labels\nNested[<=4]\tnested\n"
      "float32[<=2] pair\r\nuint64 big\nchar c\nother_msgs/Empty none\n"
      "string[] joint_names\nfloat32[2] positions\ntest_msgs/msg/Pair reference\n" +
      kSection + "test_msgs/Nested\nint8 a -1\nfloat64 b\n" + kSection +
      "test_msgs/msg/Pair\nfloat64[2] positions\n" + kSection + "other_msgs/Empty\n# nothing\n";
  const auto one = Cdr()
                       .number(std::uint8_t{1})
                       .number(std::int16_t{1})
                       .number(std::int16_t{2})
                       .number(std::int16_t{3})
                       .text("abcde")
                       .texts({"p", "qrs"})
                       .number(std::uint32_t{2})
                       .number(std::int8_t{1})
                       .number(2.0)
                       .number(std::int8_t{3})
                       .number(4.0)
                       .number(std::uint32_t{1})
                       .number(5.0F)
                       .number(std::uint64_t{6})
                       .number('c')
                       .number(std::uint8_t{0})
                       .texts({"u", "v"})
                       .number(0.5F)
                       .number(0.25F)
                       .number(10.0)
                       .number(20.0)
                       .bytes();
  const Recording r = read(schema(1, "test_msgs/msg/State", definition) + channel(1, 1, "/s") +
                               message(1, 1'000'000'000, one) + message(1, 3'000'000'000, one),
                           "V.command=/s:reference.positions.v[m],V.actual=/s:positions.v[mm]");
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_FALSE(r.axes[0].rotary);
  EXPECT_EQ(r.axes[0].command, (vector<double>{20.0, 20.0}));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{0.00025, 0.00025}));
  EXPECT_EQ(r.time, (vector<double>{0.0, 2.0}));
  EXPECT_NE(notes(r).find("the time is that of the recorder"), std::string::npos) << notes(r);
}

TEST_F(Mcap, AJointStateGivesEncoderAndTorqueInTheOrderOfItsStamps) {
  const Recording r =
      read(kJointTopic + message(2, 1, joint_state(2'000, {"a", "b"}, {3, 4}, {7, 8})) +
           message(2, 2, joint_state(1'000, {"b", "a"}, {2, 1}, {6, 5})));
  ASSERT_EQ(r.axes.size(), 2U);
  EXPECT_EQ(r.axes[0].name, "a");
  EXPECT_TRUE(std::isnan(r.axes[0].command[0]));
  EXPECT_EQ(r.axes[0].actual, (vector<double>{1, 3}));
  EXPECT_EQ(r.axes[0].torque, (vector<double>{5, 7}));
  EXPECT_EQ(r.axes[1].actual, (vector<double>{2, 4}));
  EXPECT_NE(notes(r).find("in the order of their stamps"), std::string::npos) << notes(r);
}

TEST_F(Mcap, TheStateOfAControllerIsPreferredAndJoinedByItsStamps) {
  std::string data = kStateTopic + kJointTopic;
  for (int i = 1; i <= 3; ++i) {
    const double x = i;
    data +=
        message(2, 1, joint_state(1'000'000 * i, {"elbow", "wrist"}, {x + 50, x}, {10 * x, 99}));
    data += message(1, 1, new_state(1'000'000 * i, {x, -x}, {x, -x}));
  }
  const Recording r = read(data);
  ASSERT_EQ(r.axes.size(), 2U);  // the wrist has no command
  EXPECT_EQ(r.axes[1].name, "elbow");
  EXPECT_EQ(r.axes[1].actual, (vector<double>{-1, -2, -3}));
  EXPECT_EQ(r.axes[1].torque, (vector<double>{10, 20, 30}));
  EXPECT_TRUE(r.axes[0].torque.empty());
  EXPECT_NE(notes(r).find("torque from /joint_states"), std::string::npos) << notes(r);
}

TEST_F(Mcap, ATopicWithOtherStampsIsNotMixedIn) {
  std::string data = kStateTopic + kJointTopic + kThreeStates;
  for (int i = 1; i <= 3; ++i)
    data += message(2, 1, joint_state(1'000'000 * i + 17, {"elbow"}, {1}, {2}));
  EXPECT_NE(notes(read(data)).find("is not read: its stamps are not those of /arm/state"),
            std::string::npos);
  refuses<std::invalid_argument>(mcap(data), {"E.torque", "/joint_states", "stamps"},
                                 "E.command=/arm/state:reference.positions.elbow,"
                                 "E.torque=/joint_states:effort.elbow");
  const Recording chosen = read(data,
                                "E.actual=/joint_states:position.elbow[mm],"
                                "E.torque=/joint_states:effort.elbow[N]");
  EXPECT_EQ(chosen.axes[0].actual, (vector<double>{0.001, 0.001, 0.001}));
  EXPECT_EQ(chosen.axes[0].torque_unit, "N");
}

TEST_F(Mcap, ATopicOfTwoPublishersIsDividedByTheirJoints) {
  std::string data = kJointTopic;
  for (int i = 1; i <= 4; ++i) {
    data += message(2, 1, joint_state(1'000 * i, {"a"}, {1.0 * i}, {5}));
    if (i < 4) data += message(2, 1, joint_state(1'000 * i + 500, {"gripper"}, {9}, {9}));
  }
  const Recording r = read(data);
  ASSERT_EQ(r.axes.size(), 1U);
  EXPECT_EQ(r.axes[0].actual, (vector<double>{1, 2, 3, 4}));
}

TEST_F(Mcap, TheTimeIsThatOfTheRecorderWhereNoMessageHasAStamp) {
  const Recording r = read(kJointTopic + message(2, 1'000, joint_state(0, {"a"}, {1}, {2}, 0)) +
                           message(2, 501'000, joint_state(0, {"a"}, {3}, {4}, 0)));
  EXPECT_DOUBLE_EQ(r.time[1], 0.0005);
  EXPECT_NE(notes(r).find("the time is that of the recorder"), std::string::npos);
  const Recording one = read(kJointTopic + message(2, 1'000, joint_state(0, {"a"}, {1}, {2}, 0)) +
                             message(2, 501'000, joint_state(0, {"a"}, {3}, {4}, 1)));
  EXPECT_EQ(one.axes[0].actual, (vector<double>{3}));
  EXPECT_NE(notes(one).find("left out: 1 message with the stamp 0"), std::string::npos);
}

TEST_F(Mcap, APartIsSelectedByTheTimeAfterTheFirstStamp) {
  ReadOptions options;
  options.from_s = 0.0015;
  const auto file = directory_.file("bag.mcap", mcap(kStateTopic + kThreeStates));
  EXPECT_EQ(read_recording(file, options).axes[0].command, (vector<double>{1.5}));
  options.from_s = 5;
  expect_error<std::runtime_error>([&] { (void)read_recording(file, options); },
                                   {"no rows between 5 s", "0.002 s long"});
}

TEST_F(Mcap, AFileThatIsCutOffIsReadAsFarAsItIsComplete) {
  const std::string begin = mcap(kStateTopic + kThreeStates);
  const std::size_t end = begin.find(record(15, "").substr(0, 1) + little(std::uint64_t{4}));
  ASSERT_NE(end, std::string::npos);
  const Recording unclosed = read_bytes(begin.substr(0, end));
  expect_three_states(unclosed);
  EXPECT_NE(notes(unclosed).find("its end is missing"), std::string::npos) << notes(unclosed);

  const std::string whole = begin.substr(0, end);
  const Recording zeros = read_bytes(whole + std::string(100, '\0'));
  expect_three_states(zeros);
  EXPECT_NE(notes(zeros).find("the last 100 bytes"), std::string::npos) << notes(zeros);

  const std::string packed = chunk(kThreeStates, "zstd");
  const Recording cut = read_bytes(whole + packed.substr(0, packed.size() - 10));
  expect_three_states(cut);
  const std::string lost = std::to_string(packed.size() - 10) + " bytes from byte " +
                           std::to_string(end) + " on are not read";
  EXPECT_NE(notes(cut).find(lost), std::string::npos) << notes(cut);
  for (const std::size_t size : {std::size_t{8}, std::size_t{12}, std::size_t{60}})
    refuses(begin.substr(0, size), {"no message has positions of joints", "cut off"});
}

TEST_F(Mcap, DamageIsRefusedWithItsPlace) {
  const std::string good = mcap(kStateTopic + kThreeStates);
  std::string flipped = good;
  flipped[good.size() / 2] = static_cast<char>(flipped[good.size() / 2] ^ 1);
  refuses(flipped, {"CRC-32", "damaged", "mcap recover"});
  const std::string records = kStateTopic + kThreeStates;
  const auto crc32 = test::crc32_by_zlib(records);
  refuses(mcap(chunk("", records, records.size(), crc32 ^ 1U)),
          {"record at byte 33", "CRC-32", "damaged"});
  expect_three_states(read(chunk("", records, records.size(), 0)));
  for (const char* compression : {"lz4", "zstd"}) {
    const std::string packed = test::packed_by(compression, records);
    for (const std::uint64_t size : {records.size() - 1, records.size() + 1})
      refuses(mcap(chunk(compression, packed, size, 0)), {"should unpack to", "damaged"});
    refuses(mcap(chunk(compression, packed.substr(0, packed.size() / 2), records.size(), 0)),
            {"should unpack to", "damaged"});
    refuses(mcap(chunk(compression, packed, std::uint64_t{1} << 40, 0)),
            {"would become", "mcap decompress"});
  }
  refuses(mcap(chunk("", records, records.size() + 1, 0)), {"should unpack to"});
  refuses(mcap(chunk("snappy", records, records.size(), 0)),
          {"unknown compression 'snappy'", "'lz4' and 'zstd'"});
  refuses(mcap(chunk(records.substr(0, records.size() - 3), "")), {"longer than its record"});
  refuses(mcap(kStateTopic + message(9, 1, "")), {"channel 9", "not declared"});
  refuses(mcap(kStateTopic + channel(1, 1, "/other")), {"'/other'", "'/arm/state'"});
  refuses("\x89MCAP1\r\n" + good.substr(8), {"MCAP file of version 0"});
}

TEST_F(Mcap, AMessageThatDoesNotFitItsDefinitionIsRefusedWithItsTopic) {
  const std::string state = new_state(1, {1, 2}, {3, 4});
  refuses(mcap(kStateTopic + message(1, 1, state.substr(0, state.size() - 1))),
          {"/arm/state", "ends in 'speed_scaling_factor'"});
  std::string counted = state;
  counted.replace(4 + 8 + 4 + 8, 4, "\xff\xff\xff\xff");  // the number of names
  refuses(mcap(kStateTopic + message(1, 1, counted)), {"/arm/state", "ends in 'joint_names'"});
  refuses(mcap(kStateTopic + message(1, 1, "\x28\xb5\x2f\xfd")), {"not in CDR"});
}

TEST_F(Mcap, TopicsThatAreNotReadAreListedWithTheReason) {
  const std::string definition = "string data\n";
  refuses(mcap(schema(1, "std_msgs/msg/String", definition) + channel(1, 1, "/chatter") +
               message(1, 1, Cdr().text("hello").bytes()) + schema(2, kJointType, "", "ros2idl") +
               channel(2, 2, "/idl") + message(2, 1, "") +
               schema(3, kJointType, kJointState, "ros2idl") + channel(3, 3, "/other") +
               message(3, 1, "") + channel(4, 1, "/text", "json") + message(4, 1, "") +
               channel(5, 0, "/bare") +
               schema(6, kJointType, "std_msgs/Header header\nstring[] name\n") +
               channel(6, 6, "/short") + message(6, 1, "") + channel(7, 3, "/silent") +
               schema(8, "a/A", "A a\n") + channel(8, 8, "/endless") + message(8, 1, "")),
          {"/chatter (std_msgs/msg/String)", "/idl (sensor_msgs/msg/JointState: the file has no",
           "/other (sensor_msgs/msg/JointState: its definition is 'ros2idl', not 'ros2msg')",
           "/text (std_msgs/msg/String: its messages are 'json', not 'cdr')", "/bare (no type",
           "/short (sensor_msgs/msg/JointState: its definition names 'std_msgs/Header'",
           "/silent (sensor_msgs/msg/JointState: no message)", "contains itself"});
}

TEST_F(Mcap, ColumnsAreNamedByTopicFieldAndJoint) {
  refuses(mcap(kStateTopic + kThreeStates),
          {"no column 'elbow'", "/arm/state:reference.positions.elbow[rad]",
           "/arm/state:feedback.effort.shoulder[Nm]"},
          "E.command=elbow[rad]");
}

}  // namespace
}  // namespace servotwin
