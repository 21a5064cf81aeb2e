#include "daemon/correct/arming.h"

#include <gtest/gtest.h>

#include <sstream>
#include <thread>

#include "tests/support/temporary_directory.h"

namespace servotwin::daemon {
namespace {

class ArmingTest : public testing::Test {
 protected:
  test::TemporaryDirectory directory_;
  Store store_{directory_.path(), "mill"};
  std::ostringstream said_;
  EventLog events_{store_, said_};
  std::atomic<bool> armed_{false};
  Arming arming_{true, armed_, events_};
};

TEST_F(ArmingTest, WhatIsForbiddenStaysDisarmed) {
  EXPECT_EQ(arming_.arm(), "");
  EXPECT_TRUE(arming_.armed());
  arming_.forbid("another sender");
  EXPECT_FALSE(arming_.armed());
  EXPECT_EQ(arming_.arm(), "another sender");
  EXPECT_FALSE(arming_.armed());
  arming_.forbid("and again");
  EXPECT_EQ(arming_.arm(), "another sender") << "the first reason";
}

TEST_F(ArmingTest, ADaemonThatEndsIsNotArmedAgain) {
  EXPECT_EQ(arming_.arm(), "");
  arming_.end();
  EXPECT_FALSE(arming_.armed());
  EXPECT_NE(arming_.arm(), "");
  EXPECT_FALSE(arming_.armed());
}

TEST_F(ArmingTest, WhoLooksSeesAtOnceThatAnotherSenderWasDetected) {
  std::string detected;
  Arming arming(true, armed_, events_, [&] { return detected; });
  EXPECT_EQ(arming.arm(), "");
  detected = "another sender";
  EXPECT_FALSE(arming.armed());
  detected.clear();
  EXPECT_EQ(arming.arm(), "another sender") << "for good";
}

TEST_F(ArmingTest, ADaemonInStandbyIsDisarmedAndArmedOnlyWhenItIsActiveAgain) {
  std::string standby = "standby";
  Arming arming(
      true, armed_, events_, [] { return std::string(); }, [&] { return standby; });
  EXPECT_EQ(arming.arm(), "standby");
  EXPECT_FALSE(armed_);
  standby.clear();
  EXPECT_EQ(arming.arm(), "");
  standby = "standby";
  EXPECT_FALSE(arming.armed()) << "another one took over";
  standby.clear();
  EXPECT_FALSE(arming.armed()) << "a person decides";
  EXPECT_EQ(arming.arm(), "");
}

// Whoever comes first: what is forbidden at the end is not armed.
TEST_F(ArmingTest, ForbiddingBesideArmingNeverLeavesItArmed) {
  for (int round = 0; round < 200; ++round) {
    armed_ = false;
    Arming arming(true, armed_, events_);
    std::thread person([&] { (void)arming.arm(); });
    arming.forbid("another sender");
    person.join();
    EXPECT_FALSE(arming.armed()) << round;
  }
}

}  // namespace
}  // namespace servotwin::daemon
