#include "tests/daemon/can_alone.h"

#include "tests/daemon/udp_bus.h"

namespace servotwin::daemon {
namespace {

class LongUdpCanAlone : public test::CanAlone {
 protected:
  static constexpr double kCycle_s = 0.001;
  test::UdpBus udp_;
};

TEST_F(LongUdpCanAlone, WhatRepeatsIsRecognisedLearnedAndFollowedBetter) {
  recognise(std::move(udp_.bus), udp_.source, kCycle_s);
}

TEST_F(LongUdpCanAlone, APathDroppedIntoTheFolderIsLearnedAndFollowedBetter) {
  drop(std::move(udp_.bus), udp_.source, kCycle_s);
}

TEST_F(LongUdpCanAlone, APathSentOverHttpIsLearnedAndFollowedBetter) {
  send(std::move(udp_.bus), udp_.source, kCycle_s);
}

}  // namespace
}  // namespace servotwin::daemon
