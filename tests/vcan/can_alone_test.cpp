#include "tests/daemon/can_alone.h"

#include "drivers/can/socketcan.h"

namespace servotwin {
namespace {

constexpr const char* kSource = "[source.can]\nmap = \"map.toml\"\ninterfaces = [\"vcan0\"]";
constexpr double kCycle_s = 0.01;

class LongCanAlone : public test::CanAlone {};

TEST_F(LongCanAlone, WhatRepeatsIsRecognisedLearnedAndFollowedBetter) {
  recognise(std::make_unique<SocketCan>("vcan0"), kSource, kCycle_s);
}

}  // namespace
}  // namespace servotwin
