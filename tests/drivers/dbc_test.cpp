// DBC files: what is read, what is skipped, and what is refused with its line.
#include "drivers/can/dbc.h"

#include <gtest/gtest.h>

#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

using test::expect_error;

constexpr const char* kFile = R"(VERSION "1.0"

NS_ :
	NS_DESC_
	CM_
	SIG_VALTYPE_
	BO_TX_BU_

BS_:

BU_: Drive1 Cnc

BO_ 385 Drive1_Status: 8 Drive1
 SG_ Demand : 0|32@1- (0.1,0) [-214748364.8|214748364.7] "um" Cnc,Vector__XXX
 SG_ Actual : 39|32@0- (0.001,-5) [0|0] "mm"  Cnc

BO_ 2566834709 Mux : 16 Drive1
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" Cnc
 SG_ Torque m3 : 8|16@1- (0.1,0) [0|0] "%" Cnc
 SG_ Deep m3M : 24|8@1- (1,0) [0|0] "" Cnc
 SG_ Float : 32|32@1- (1,0) [1.#INF|-1.#INF] "rad" Cnc

BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX
 SG_ Loose : 0|8@1- (1,0) [0|0] "" Vector__XXX

CM_ BO_ 385 "A comment with a; semicolon,
BO_ 386 NotAMessage: 8 Drive1
and a \"quote\" over lines";
CM_ "ends in a backslash C:\";
BA_DEF_ BO_  "GenMsgCycleTime" INT 0 65535;
VAL_ 385 Demand 0 "zero" 1 "one" ;
SIG_VALTYPE_ 2566834709 Float : 1;
)";

TEST(Dbc, MessagesAndSignals) {
  const Dbc dbc = parse_dbc(kFile, "m.dbc");
  ASSERT_EQ(dbc.messages.size(), 2U);
  const DbcMessage& status = dbc.messages[0];
  EXPECT_EQ(status.name, "Drive1_Status");
  EXPECT_EQ(status.id, 385U);
  EXPECT_FALSE(status.extended);
  EXPECT_EQ(status.length, 8);
  ASSERT_EQ(status.signals.size(), 2U);
  const DbcSignal& demand = status.signals[0];
  EXPECT_EQ(demand.name, "Demand");
  EXPECT_EQ(demand.signal.start, 0);
  EXPECT_EQ(demand.signal.length, 32);
  EXPECT_EQ(demand.signal.order, ByteOrder::kLittle);
  EXPECT_EQ(demand.signal.coding, Coding::kSigned);
  EXPECT_EQ(demand.signal.scale, 0.1);
  EXPECT_EQ(demand.unit, "um");
  EXPECT_EQ(demand.line, 14);
  EXPECT_EQ(status.signals[1].signal.order, ByteOrder::kBig);
  EXPECT_EQ(status.signals[1].signal.offset, -5.0);
}

TEST(Dbc, ExtendedIdsMultiplexingAndFloats) {
  const DbcMessage mux = parse_dbc(kFile, "m.dbc").messages[1];
  EXPECT_TRUE(mux.extended);
  EXPECT_EQ(mux.id, 2566834709U - 2147483648U);
  ASSERT_EQ(mux.signals.size(), 4U);
  EXPECT_EQ(mux.signals[0].multiplexing, Multiplexing::kSelector);
  EXPECT_EQ(mux.signals[1].multiplexing, Multiplexing::kSelected);
  EXPECT_EQ(mux.signals[1].selected_by, 3U);
  EXPECT_EQ(mux.signals[2].multiplexing, Multiplexing::kExtended);
  EXPECT_EQ(mux.signals[3].signal.coding, Coding::kFloat);
  EXPECT_EQ(mux.signals[1].signal.coding, Coding::kSigned);
}

TEST(Dbc, RefusesWithTheLine) {
  const auto refused = [](const std::string& text, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { (void)parse_dbc(text, "m.dbc"); }, parts);
  };
  refused("hello world\n", {"m.dbc", "no DBC"});
  refused("BO_ 4096 A: 8 X\n", {"m.dbc:1", "'A'", "4096"});
  refused("BO_ 1 A: 65 X\n", {"m.dbc:1", "65"});
  refused("BO_ 1 A: 8 X\n SG_ s : 0|8@2+ (1,0) [0|0] \"\" X\n", {"m.dbc:2", "byte order"});
  refused("BO_ 1 A: 8 X\n SG_ s : 0|8@1? (1,0) [0|0] \"\" X\n", {"m.dbc:2", "unsigned"});
  refused("BO_ 1 A: 8 X\n SG_ s : 0|80@1+ (1,0) [0|0] \"\" X\n", {"m.dbc:2", "80 bits"});
  refused("BO_ 1 A: 8 X\n SG_ s : 0|8@1+ (0,0) [0|0] \"\" X\n", {"m.dbc:2", "factor"});
  refused("BO_ 1 A: 8 X\n SG_ s : x|8@1+ (1,0) [0|0] \"\" X\n", {"m.dbc:2", "'x'", "start bit"});
  refused("BU_: A\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" X\n", {"m.dbc:2", "BO_"});
  refused("BO_ 1 A: 8 X\n SG_ s : 0|16@1- (1,0) [0|0] \"\" X\nSIG_VALTYPE_ 1 s : 1;\n",
          {"m.dbc:3", "'s'", "32 bits"});
}

}  // namespace
}  // namespace servotwin
