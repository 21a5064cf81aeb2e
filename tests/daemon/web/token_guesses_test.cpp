#include "daemon/web/token_guesses.h"
#include "tests/daemon/support.h"

#include <gtest/gtest.h>

namespace servotwin::daemon {
namespace {

TEST(TokenGuesses, TheThirdWrongTokenSlowsItsAddressAndNobodyElse) {
  TokenGuesses guesses;
  for (int i = 0; i < 2; ++i) (void)guesses.add("a", kSecond_ns);
  EXPECT_FALSE(guesses.must_wait("a", kSecond_ns)) << "a person mistypes";
  (void)guesses.add("a", 2 * kSecond_ns);
  EXPECT_TRUE(guesses.must_wait("a", 2 * kSecond_ns));
  EXPECT_FALSE(guesses.must_wait("b", 2 * kSecond_ns));
  EXPECT_TRUE(guesses.must_wait("a", 62 * kSecond_ns));
  EXPECT_FALSE(guesses.must_wait("a", 62 * kSecond_ns + 1)) << "forgotten";
  (void)guesses.add("a", 63 * kSecond_ns);
  EXPECT_FALSE(guesses.must_wait("a", 63 * kSecond_ns)) << "it begins again";
}

TEST(TokenGuesses, AreLoggedOnceAMinuteWithTheirNumber) {
  TokenGuesses guesses;
  EXPECT_EQ(guesses.add("a", 0), "a request with a wrong token, from a");
  for (int i = 1; i <= 60; ++i) EXPECT_EQ(guesses.add("b", i * kSecond_ns), std::nullopt) << i;
  EXPECT_EQ(guesses.add("c", 61 * kSecond_ns), "61 requests with a wrong token, the last from c");
  EXPECT_EQ(guesses.add("a", 122 * kSecond_ns), "a request with a wrong token, from a");
}

TEST(TokenGuesses, OfVeryManyAddressesTheOldestIsForgotten) {
  TokenGuesses guesses;
  for (int i = 0; i < 3; ++i) (void)guesses.add("first", 1);
  for (int i = 0; i < 3; ++i) (void)guesses.add("second", 2);
  for (std::size_t i = 0; i < TokenGuesses::kMaxAddresses - 1; ++i)
    (void)guesses.add(std::to_string(i), 3);
  EXPECT_FALSE(guesses.must_wait("first", 3));
  EXPECT_TRUE(guesses.must_wait("second", 3));
}

}  // namespace
}  // namespace servotwin::daemon
