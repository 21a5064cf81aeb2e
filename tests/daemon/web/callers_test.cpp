#include "daemon/web/callers.h"
#include "tests/daemon/support.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

namespace servotwin::daemon {
namespace {

using Phase = Caller::Phase;

Caller from(const char* address) {
  Caller caller;
  sockaddr_in four{};
  four.sin_family = AF_INET;
  sockaddr_in6 six{};
  six.sin6_family = AF_INET6;
  if (inet_pton(AF_INET, address, &four.sin_addr) == 1) {
    set_address(caller, reinterpret_cast<const sockaddr&>(four));
  } else {
    EXPECT_EQ(inet_pton(AF_INET6, address, &six.sin6_addr), 1) << address;
    set_address(caller, reinterpret_cast<const sockaddr&>(six));
  }
  return caller;
}

TEST(Caller, AnAddressIsAHostOrAnIpv6Network) {
  EXPECT_EQ(from("192.168.7.9").address, "192.168.7.9");
  EXPECT_EQ(from("::ffff:192.168.7.9").address, "192.168.7.9");
  EXPECT_EQ(from("2001:db8:0:1:2:3:4:5").address, "2001:db8:0:1::/64");
  EXPECT_EQ(from("2001:db8:0:1:ffff::9").address, "2001:db8:0:1::/64");
  EXPECT_NE(from("2001:db8:0:2::1").address, "2001:db8:0:1::/64");
  for (const char* here : {"127.0.0.1", "127.9.8.7", "::1", "::ffff:127.0.0.1"})
    EXPECT_TRUE(from(here).local) << here;
  for (const char* elsewhere : {"128.0.0.1", "10.0.0.1", "::2", "::ffff:10.0.0.1", "fe80::1"})
    EXPECT_FALSE(from(elsewhere).local) << elsewhere;
}

class CallersTest : public testing::Test {
 protected:
  Caller& open(const std::string& address, Phase phase = Phase::kRequest, bool local = false) {
    Caller& caller = callers_.open(nullptr, ++now_ns_);
    caller.address = address;
    caller.local = local;
    caller.phase = phase;
    return caller;
  }
  /// As many as there may be, of an address each.
  void fill(int count = Callers::kMaxConnections) {
    for (int i = 0; i < count; ++i) open("filler " + std::to_string(i));
  }
  Callers callers_;
  std::int64_t now_ns_ = 0;
};

TEST_F(CallersTest, NobodyGoesAsLongAsThereIsRoom) {
  fill();
  EXPECT_EQ(callers_.surplus(), nullptr);
}

TEST_F(CallersTest, OfManyAddressesTheOneGoesThatHasWaitedForTheLongestTime) {
  Caller& oldest = open("a");
  fill();
  EXPECT_EQ(callers_.surplus(), &oldest);
  oldest.dropped = true;
  EXPECT_EQ(callers_.surplus(), nullptr) << "one is enough";
  oldest.dropped = false;
  oldest.enter(Phase::kAnswer, oldest.since_ns);
  EXPECT_EQ(callers_.surplus()->address, "filler 0") << "a complete request is not dropped for it";
}

TEST_F(CallersTest, TheAddressThatHasMostLosesFirst) {
  Caller& oldest = open("a");
  fill(Callers::kMaxConnections - 2);
  Caller& one_of_two = open("many");
  open("many");
  EXPECT_EQ(callers_.surplus(), &one_of_two) << "although it is younger";
  EXPECT_FALSE(oldest.dropped);
}

TEST_F(CallersTest, AnAddressHasItsOwnLimitAndPaysForItItself) {
  open("another");
  Caller& oldest = open("many");
  for (int i = 1; i < Callers::kMaxPerAddress; ++i) open("many");
  EXPECT_EQ(callers_.surplus(), nullptr);
  open("many");
  EXPECT_EQ(callers_.surplus(), &oldest);
}

TEST_F(CallersTest, WhoIsOnThisHostGoesLast) {
  for (int i = 0; i < Callers::kMaxPerAddress; ++i) open("here", Phase::kRequest, true);
  fill(Callers::kMaxConnections - Callers::kMaxPerAddress);
  Caller& newest = open("elsewhere");
  ASSERT_NE(callers_.surplus(), nullptr);
  EXPECT_EQ(callers_.surplus()->address, "filler 0");
  EXPECT_FALSE(newest.dropped);
}

TEST_F(CallersTest, StreamsTakeNoPlaceOfOthers) {
  for (unsigned i = 0; i < Callers::kMaxStreams; ++i) open("streams", Phase::kStream);
  fill();
  EXPECT_EQ(callers_.streams(), Callers::kMaxStreams);
  EXPECT_EQ(callers_.surplus(), nullptr);
  open("one more");
  EXPECT_EQ(callers_.surplus()->address, "filler 0");
}

TEST_F(CallersTest, WhatTakesTooLongIsOverdue) {
  const auto at = [](Phase phase, std::int64_t passed_ns, bool suspended = false) {
    Caller caller;
    caller.suspended = suspended;
    caller.enter(phase, kSecond_ns);
    return Callers::is_overdue(caller, kSecond_ns + passed_ns);
  };
  EXPECT_FALSE(at(Phase::kRequest, 10 * kSecond_ns));
  EXPECT_TRUE(at(Phase::kRequest, 10 * kSecond_ns + 1));
  EXPECT_FALSE(at(Phase::kBody, 120 * kSecond_ns));
  EXPECT_TRUE(at(Phase::kBody, 120 * kSecond_ns + 1));
  EXPECT_FALSE(at(Phase::kAnswer, 30 * kSecond_ns));
  EXPECT_TRUE(at(Phase::kAnswer, 30 * kSecond_ns + 1));
  EXPECT_FALSE(at(Phase::kStream, 10 * kSecond_ns));
  EXPECT_TRUE(at(Phase::kStream, 10 * kSecond_ns + 1));
  EXPECT_FALSE(at(Phase::kStream, 3600 * kSecond_ns, true)) << "it has taken everything";
}

}  // namespace
}  // namespace servotwin::daemon
