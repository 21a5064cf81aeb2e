#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <future>
#include <iterator>
#include <string>

#include "drivers/common/file_handle.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

namespace fs = std::filesystem;

std::string content_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(AtomicFile, AppearsWholeOrNotAtAll) {
  const test::TemporaryDirectory folder;
  const fs::path file = folder.path() / "x";
  {
    AtomicFile given_up(file);
    given_up.write("half");
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
  AtomicFile whole(file);
  whole.write("all");
  EXPECT_FALSE(fs::exists(file));
  whole.commit();
  EXPECT_EQ(content_of(file), "all");
}

// A pipe stands for every device: renaming onto /dev/null would take it from the whole machine.
TEST(AtomicFile, WhatIsNoRegularFileIsWrittenToAndStays) {
  const test::TemporaryDirectory folder;
  const fs::path pipe = folder.path() / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  auto read = std::async(std::launch::async, [&] { return content_of(pipe); });
  {
    AtomicFile out(pipe);
    out.write("all");
    out.commit();
  }
  EXPECT_EQ(read.get(), "all");
  EXPECT_TRUE(fs::is_fifo(pipe));
  auto nothing = std::async(std::launch::async, [&] { return content_of(pipe); });
  { AtomicFile given_up(pipe); }
  EXPECT_EQ(nothing.get(), "");
  EXPECT_TRUE(fs::is_fifo(pipe));
}

}  // namespace
}  // namespace servotwin
