#include "identification/least_squares/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

namespace servotwin {
namespace {

class Parallel : public testing::TestWithParam<std::size_t> {
 protected:
  Parallel() { use_threads(GetParam()); }
  ~Parallel() override { use_threads(1); }
};

TEST_P(Parallel, EveryPieceIsDoneOnce) {
  for (const std::size_t count : {0U, 1U, 2U, 57U}) {
    std::vector<std::atomic<int>> done(count);
    in_parallel(count, [&](std::size_t i) { ++done[i]; });
    for (const auto& one : done) EXPECT_EQ(one, 1);
  }
}

TEST_P(Parallel, TheFirstErrorByIndexIsThrownAfterAllHaveEnded) {
  std::atomic<int> ended{0};
  try {
    in_parallel(20, [&](std::size_t i) {
      ++ended;
      if (i == 7 || i == 11) throw std::runtime_error(std::to_string(i));
    });
    FAIL() << "nothing was thrown";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "7");
  }
  if (GetParam() > 1) {
    EXPECT_EQ(ended, 20);
  }
}

TEST_P(Parallel, APieceOfAPieceStaysOnItsThread) {
  std::atomic<int> strangers{0};
  in_parallel(8, [&](std::size_t) {
    const auto here = std::this_thread::get_id();
    in_parallel(8, [&](std::size_t) { strangers += std::this_thread::get_id() != here; });
  });
  EXPECT_EQ(strangers, 0);
}

INSTANTIATE_TEST_SUITE_P(Threads, Parallel, testing::Values(1, 2, 5));

}  // namespace
}  // namespace servotwin
