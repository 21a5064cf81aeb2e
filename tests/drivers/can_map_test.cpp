// Mappings: signals by hand, from DBC and EDS; units, gear, lead and sign; and the messages for
// errors.
#include "drivers/can/can_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "drivers/can/can_frame.h"
#include "tests/support/real_data.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::filesystem::path kEds =
    std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "tests/drivers/eds";

std::vector<std::string> problems_of(const std::string& text, const std::filesystem::path& folder) {
  std::vector<std::string> out;
  for (const ConfigProblem& problem : check_can_map(text, "m.toml", folder).problems)
    out.push_back(problem.message());
  return out;
}

CanMap map_of(const std::string& text, const std::filesystem::path& folder = "") {
  CheckedCanMap checked = check_can_map(text, "m.toml", folder);
  EXPECT_TRUE(checked.problems.empty()) << messages(checked.problems);
  return std::move(checked.map);
}

/// The signal's value of this number.
double value_of(const CanMap& map, CanChannel channel, double raw, std::size_t axis = 0) {
  const MappedSignal* signal = map.find(axis, channel);
  if (signal == nullptr) return std::nan("");
  return raw * signal->signal.scale + signal->signal.offset;
}

std::string by_hand(const std::string& axis, const std::string& command) {
  return "cycle_s = 0.002\n[[axis]]\nname = \"X\"\n" + axis +
         "\n[axis.command]\nid = 0x181\nstart_bit = 0\nlength = 32\n" + command;
}

TEST(CanMap, ByHand) {
  const CanMap map = map_of(by_hand("", "unit = \"um\"\nscale = 0.1\noffset = 5\n"));
  EXPECT_EQ(map.machine.cycle_s, 0.002);
  EXPECT_DOUBLE_EQ(map.deadline_s, 0.0018);
  EXPECT_EQ(map.start.id, 0x80U);
  EXPECT_THAT(map.buses, ElementsAre("can0"));
  ASSERT_EQ(map.messages.size(), 1U);
  EXPECT_EQ(map.messages[0].id, 0x181U);
  EXPECT_EQ(map.messages[0].length, 4);
  EXPECT_TRUE(map.messages[0].at_least);
  EXPECT_EQ(map.messages[0].name, "0x181 of axis X");
  EXPECT_NEAR(value_of(map, CanChannel::kCommand, 100.0), 15e-6, 1e-18);
  EXPECT_NEAR(map.find(0, CanChannel::kCommand)->turn, std::ldexp(1e-7, 32), 1e-9);
}

TEST(CanMap, PredictionsGoToAPlcInMessagesOfTheirOwn) {
  const auto with = [](const std::string& more, const std::string& root = "") {
    return root + by_hand("", "unit = \"um\"\n") + more;
  };
  const std::string figures =
      "[axis.predicted_error]\nid = 0x1A0\nstart_bit = 0\nlength = 16\nunit = \"um\"\n"
      "[axis.prediction_valid]\nid = 0x1A0\nstart_bit = 16\nlength = 1\n";
  const CanMap map = map_of(with(figures, "prediction_period_s = 0.02\n"));
  EXPECT_EQ(map.prediction_period_s, 0.02);
  EXPECT_THAT(prediction_messages(map), ElementsAre(1U));
  EXPECT_EQ(map.messages[1].name, "0x1A0 of axis X");
  EXPECT_FALSE(map.messages[1].from_machine);
  EXPECT_THAT(prediction_messages(map_of(with(""))), IsEmpty());

  const auto replaced = [](std::string text, const std::string& what, const std::string& by) {
    for (std::size_t at = 0; (at = text.find(what, at)) != text.npos; at += by.size())
      text.replace(at, what.size(), by);
    return text;
  };
  EXPECT_THAT(problems_of(with(replaced(figures, "0x1A0", "0x181")), ""),
              testing::Contains(HasSubstr("0x181 carries command of axis X as well; a message to a "
                                          "PLC needs an id of its own")));
  EXPECT_THAT(problems_of(with(replaced(figures, "0x1A0", "0x80")), ""),
              testing::Contains(HasSubstr("0x080 begins the cycles")));
  const std::string alone = figures.substr(0, figures.find("[axis.prediction_valid]"));
  EXPECT_THAT(problems_of(with(alone), ""),
              ElementsAre(HasSubstr("map prediction_valid of this axis into the same message")));
  EXPECT_THAT(problems_of(with(figures.substr(0, figures.rfind("id = 0x1A0")) + "id = 0x1A1\n" +
                               figures.substr(figures.rfind("start_bit"))),
                          ""),
              ElementsAre(HasSubstr("into the same message")));
  // 16 bits of 1 um that begin at 0, and from -32.768 mm on.
  EXPECT_THAT(
      problems_of(with(replaced(figures, "length = 16", "length = 16\nsigned = false")), ""),
      ElementsAre(HasSubstr("its bits hold 0 to 0.065535 m: make it signed")));
  EXPECT_THAT(
      prediction_messages(map_of(with(replaced(
          figures, "length = 16", "length = 16\nsigned = false\nscale = 1\noffset = -32768")))),
      ElementsAre(1U));
  for (const char* flag : {"offset = 1", "scale = 2"})
    EXPECT_THAT(
        problems_of(
            with(replaced(figures, "length = 1\n", std::string("length = 1\n") + flag + "\n")), ""),
        ElementsAre(HasSubstr("must be able to be 0 and 1")));
  EXPECT_THAT(problems_of(with("", "prediction_period_s = 0.02\n"), ""),
              ElementsAre(HasSubstr("has no effect")));
}

TEST(CanMap, TheMotorsAngleGoesThroughGearAndLead) {
  // 8192 steps per turn of the motor, 2 turns of it per turn of the screw, 10 mm per turn of that.
  const CanMap map =
      map_of(by_hand("lead_mm = 10\ngear_ratio = 2\ninvert = true", "unit = \"rev/8192\"\n"));
  EXPECT_NEAR(value_of(map, CanChannel::kCommand, 8192.0), -0.005, 1e-15);
  const CanMap rotary =
      map_of(by_hand("units = \"rad\"\ngear_ratio = 90", "unit = \"deg\"\nrollover = 360\n"));
  EXPECT_NEAR(value_of(rotary, CanChannel::kCommand, 90.0), std::numbers::pi / 180.0, 1e-15);
  EXPECT_NEAR(rotary.find(0, CanChannel::kCommand)->turn, 2.0 * std::numbers::pi / 90.0, 1e-12);
  EXPECT_TRUE(rotary.machine.axes[0].rotary);
}

TEST(CanMap, ARealDriveByItsConfigurationAndTheControllersMapping) {
  // As it is, the drive sends no position demand; the controller maps it when it starts.
  const std::string text = R"(
cycle_s = 0.001
[[node]]
id = 3
eds = "Elmo.dcf"
[[node.tpdo]]
number = 3
objects = [0x6062, 0x6064]
[[node.tpdo]]
number = 1
objects = [0x6041, 0x6077]
[[node.rpdo]]
number = 4
id = 0x503
objects = [0x60B0]
[[axis]]
name = "X"
node = 3
position_unit = "um"
)";
  const CanMap map = map_of(text, kEds);
  const MappedSignal* actual = map.find(0, CanChannel::kActual);
  ASSERT_NE(actual, nullptr);
  EXPECT_EQ(actual->signal.start, 32);
  EXPECT_EQ(actual->signal.coding, Coding::kSigned);
  EXPECT_EQ(map.messages[actual->message].id, 0x383U);
  EXPECT_EQ(map.messages[actual->message].length, 8);
  EXPECT_FALSE(map.messages[actual->message].at_least);
  EXPECT_THAT(map.messages[actual->message].name, AllOf(HasSubstr("0x383"), HasSubstr("TPDO3"),
                                                        HasSubstr("node 3"), HasSubstr("axis X")));
  // CiA 402: 0.1 % of rated torque.
  EXPECT_DOUBLE_EQ(value_of(map, CanChannel::kTorque, 1000.0), 100.0);
  EXPECT_EQ(map.machine.axes[0].torque_unit, "%");
  EXPECT_EQ(map.messages[map.find(0, CanChannel::kTarget)->message].id, 0x403U);  // RPDO3
  EXPECT_EQ(map.messages[map.find(0, CanChannel::kOffset)->message].id, 0x503U);
  EXPECT_EQ(map.messages[map.find(0, CanChannel::kControlWord)->message].id, 0x203U);
}

TEST(CanMap, WhatADriveDoesNotSendIsNamedWithWhatItSends) {
  const std::string text =
      "cycle_s = 0.001\n[[node]]\nid = 3\neds = \"Schunk_0_63.dcf\"\n"
      "[[axis]]\nname = \"X\"\nnode = 3\nposition_unit = \"um\"\n";
  EXPECT_THAT(
      problems_of(text, kEds),
      ElementsAre(AllOf(HasSubstr("m.toml:5"), HasSubstr("'X'"), HasSubstr("following_error"),
                        HasSubstr("TPDO3 (0x383): 0x6064 32 bits, 0x606C 32 bits"))));
  EXPECT_THAT(problems_of(text + "[axis.command]\nobject = 0x6062\n", kEds),
              ElementsAre(AllOf(HasSubstr("m.toml:9"), HasSubstr("0x6062"), HasSubstr("TPDO3"),
                                HasSubstr(".dcf"))));
}

std::optional<double> timeout_of(const CanMap& map) {
  return map.find(0, CanChannel::kOffset)->timeout_s;
}

TEST(CanMap, WhatTheDriveDoesWhenOffsetsStop) {
  const std::string command = "unit = \"um\"\n";
  const std::string offset =
      "[axis.offset]\nid = 0x401\nstart_bit = 0\nlength = 32\nunit = \"um\"\n";
  const auto with = [&](const std::string& key) { return by_hand(key, command) + offset; };
  EXPECT_EQ(timeout_of(map_of(with(""))), std::nullopt) << "as in older files";
  EXPECT_EQ(timeout_of(map_of(with("offset_timeout_s = 0.025"))), 0.025);
  EXPECT_EQ(timeout_of(map_of(with("offset_timeout_s = 1"))), 1.0);
  EXPECT_EQ(timeout_of(map_of(with("offset_timeout_s = \"none\""))),
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(map_of(with("")).messages[1].rpdo, 0) << "not known by hand";
  for (const char* wrong : {"0", "-1", "inf", "nan", "66", "\"never\"", "true"}) {
    EXPECT_THAT(problems_of(with(std::string("offset_timeout_s = ") + wrong), ""),
                ElementsAre(AllOf(HasSubstr("m.toml:4"), HasSubstr("axis.offset_timeout_s"),
                                  HasSubstr("0.001 to 65.535 s, or \"none\""))))
        << wrong;
  }
  EXPECT_THAT(problems_of(by_hand("offset_timeout_s = 0.02", command), ""),
              ElementsAre(HasSubstr("no offset of this axis is mapped")));
  const CanMap node = map_of(
      "cycle_s = 0.001\n[[node]]\nid = 3\neds = \"Elmo.dcf\"\n[[node.tpdo]]\nnumber = 3\n"
      "objects = [0x6062, 0x6064]\n[[node.rpdo]]\nnumber = 4\nid = 0x503\nobjects = [0x60B0]\n"
      "[[axis]]\nname = \"X\"\nnode = 3\nposition_unit = \"um\"\noffset_timeout_s = 0.02\n",
      kEds);
  EXPECT_EQ(timeout_of(node), 0.02);
  EXPECT_EQ(node.messages[node.find(0, CanChannel::kOffset)->message].rpdo, 4);
  EXPECT_EQ(node.messages[node.find(0, CanChannel::kActual)->message].rpdo, 0);
}

class DbcMap : public testing::Test {
 protected:
  DbcMap() {
    (void)directory_.file("m.dbc", R"(BU_: D
BO_ 385 Status: 8 D
 SG_ Demand : 0|32@1- (0.1,0) [0|0] "um" X
 SG_ Actual : 39|32@0- (0.1,0) [0|0] "furlong" X
BO_ 641 Mux: 4 D
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" X
 SG_ Torque m3 : 8|16@1- (0.01,0) [0|0] "Nm" X
 SG_ Far : 24|16@1- (1,0) [0|0] "" X
)");
  }
  [[nodiscard]] std::string with(const std::string& rest) const {
    return "cycle_s = 0.001\n[[bus]]\nname = \"can0\"\ndbc = \"m.dbc\"\n[[axis]]\nname = \"X\"\n"
           "command = {message = \"Status\", signal = \"Demand\"}\n" +
           rest;
  }
  test::TemporaryDirectory directory_;
};

TEST_F(DbcMap, UnitsOfTheFileAndMultiplexing) {
  const CanMap map = map_of(with("actual = {message = \"Status\", signal = \"Actual\", unit = "
                                 "\"mm\"}\ntorque = {message = \"Mux\", signal = \"Torque\"}\n"),
                            directory_.path());
  EXPECT_NEAR(value_of(map, CanChannel::kCommand, 10.0), 1e-6, 1e-18);
  EXPECT_NEAR(value_of(map, CanChannel::kActual, 10.0), 1e-3, 1e-15);
  EXPECT_EQ(map.machine.axes[0].torque_unit, "Nm");
  const MappedMessage& mux = map.messages[map.find(0, CanChannel::kTorque)->message];
  ASSERT_TRUE(mux.selector);
  EXPECT_EQ(mux.selector->value, 3U);
}

TEST_F(DbcMap, MistakesAreNamedWithTheNearest) {
  const auto problem = [&](const std::string& rest) {
    const auto all = problems_of(with(rest), directory_.path());
    EXPECT_EQ(all.size(), 1U) << testing::PrintToString(all);
    return all.empty() ? std::string() : all[0];
  };
  EXPECT_THAT(problem("actual = {message = \"Status\", signal = \"Actual\"}\n"),
              AllOf(HasSubstr("m.toml:8"), HasSubstr("'furlong'")));
  EXPECT_THAT(problem("actual = {message = \"Statsu\", signal = \"Actual\"}\n"),
              HasSubstr("did you mean 'Status'?"));
  EXPECT_THAT(problem("actual = {message = \"Status\", signal = \"Actul\"}\n"),
              HasSubstr("did you mean 'Actual'?"));
  EXPECT_THAT(problem("torque = {message = \"Mux\", signal = \"Far\", unit = \"Nm\"}\n"),
              AllOf(HasSubstr("m.dbc:8"), HasSubstr("4 bytes")));
}

TEST(CanMap, SeveralBusesNodesAndAxes) {
  const CanMap map = map_of(R"(
cycle_s = 0.001
sync = 0x185
sync_bus = "b"
deadline_s = 0.0005
[[bus]]
name = "a"
[[bus]]
name = "b"
[[axis]]
name = "X"
command = {id = 0x185, start_bit = 0, length = 32, unit = "um"}
[[axis]]
name = "Y"
bus = "b"
command = {id = 0x185, start_bit = 0, length = 32, unit = "um"}
actual = {bus = "a", id = 0x18000000, start_bit = 7, length = 16, byte_order = "big", signed = false, unit = "um"}
)");
  EXPECT_EQ(map.start.bus, 1U);
  EXPECT_EQ(map.messages.size(), 3U);
  EXPECT_EQ(map.messages[map.find(0, CanChannel::kCommand)->message].bus, 0U);
  EXPECT_EQ(map.messages[map.find(1, CanChannel::kCommand)->message].bus, 1U);
  const MappedMessage& actual = map.messages[map.find(1, CanChannel::kActual)->message];
  EXPECT_EQ(actual.bus, 0U);
  EXPECT_TRUE(actual.extended);
  EXPECT_EQ(actual.name, "0x18000000 on a of axis Y");
}

TEST(CanMap, EveryMistakeHasItsPlaceAndItsCure) {
  const auto problem = [](const std::string& text, auto what) {
    EXPECT_THAT(problems_of(text, ""), testing::Contains(what)) << text;
  };
  problem("", AllOf(HasSubstr("cycle_s"), HasSubstr("missing")));
  problem("cycle_s = 2\n", AllOf(HasSubstr("m.toml:1"), HasSubstr("1e-05 to 1 s")));
  problem("cycle_s = 0.001\n", HasSubstr("at least one [[axis]]"));
  problem(by_hand("", ""), AllOf(HasSubstr("m.toml:5"), HasSubstr("no unit"), HasSubstr("um*0.1")));
  problem(by_hand("", "unit = \"parsec\"\n"), HasSubstr("'parsec'"));
  problem(by_hand("", "unit = \"rev/8192\"\n"), HasSubstr("give lead_mm"));
  problem(by_hand("units = \"rad\"", "unit = \"mm\"\n"), HasSubstr("needs an angle"));
  problem(by_hand("lead_mm = 5", "unit = \"mm\"\n"),
          AllOf(HasSubstr("m.toml:4"), HasSubstr("has no effect")));
  problem(by_hand("", "unit = \"Nm\"\n"), HasSubstr("a length or an angle"));
  problem(by_hand("", "unit = \"mm\"\nscale = 0\n"), HasSubstr("must not be 0"));
  problem(by_hand("", "unit = \"mm\"\nmessage_bytes = 2\n"), HasSubstr("byte 4"));
  problem(by_hand("", "unit = \"mm\"\nbyteorder = \"big\"\n"),
          HasSubstr("did you mean 'byte_order'?"));
  problem(by_hand("comand = 1", "unit = \"mm\"\n"), HasSubstr("did you mean 'command'?"));
  problem(by_hand("node = 4", "unit = \"mm\"\n"), HasSubstr("no [[node]]"));
  problem(by_hand("bus = \"x\"", "unit = \"mm\"\n"), HasSubstr("there is can0"));
  problem("cycle_s = 0.001\n[[node]]\nid = 1\neds = \"nowhere.eds\"\n[[axis]]\nname = \"X\"\n",
          AllOf(HasSubstr("m.toml:4"), HasSubstr("nowhere.eds")));
  problem(
      "cycle_s = 0.001\n[[axis]]\nname = \"X\"\ncommand = {id = 1, start_bit = 500, length = 32, "
      "unit = \"mm\"}\n",
      HasSubstr("beyond 64 bytes"));
  problem("cycle_s = \n", HasSubstr("m.toml:1"));
}

TEST(CanMap, AFollowingErrorStandsForTheCommand) {
  const CanMap map = map_of(
      "cycle_s = 0.001\n[[axis]]\nname = \"X\"\nactual = {id = 1, start_bit = 0, length = 32, unit "
      "= "
      "\"um\"}\nfollowing_error = {id = 1, start_bit = 32, length = 32, unit = \"um\"}\n");
  EXPECT_EQ(map.find(0, CanChannel::kCommand), nullptr);
  EXPECT_EQ(map.find(0, CanChannel::kFollowingError)->turn, 0.0);
  EXPECT_EQ(map.messages[0].length, 8);
}

TEST(CanMap, TheExampleIsOne) {
  const CanMap map =
      load_can_map(std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "examples/can_machine.toml");
  ASSERT_EQ(map.machine.axes.size(), 2U);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    for (const CanChannel channel :
         {CanChannel::kCommand, CanChannel::kActual, CanChannel::kTorque, CanChannel::kTarget}) {
      EXPECT_NE(map.find(axis, channel), nullptr) << name_of(channel);
    }
  }
}

}  // namespace
}  // namespace servotwin
