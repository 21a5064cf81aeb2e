#include "daemon/correct/program_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <sstream>

#include "tests/support/temporary_directory.h"

namespace servotwin::daemon {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
namespace fs = std::filesystem;

MachineDescription x_and_rotary_c() { return {1e-3, {{"X", false, ""}, {"C", true, ""}}}; }

/// A path of X in mm with this many rows.
std::string path_of(int rows, const std::string& header = "time[s],X.command[mm]") {
  std::ostringstream out;
  out << header << "\n";
  for (int k = 0; k < rows; ++k) out << 1e-3 * k << "," << 0.5 * k << "\n";
  return out.str();
}

class ProgramFolderTest : public testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) {
    std::ofstream(directory_.path() / name) << text;
    // Two files that are written within a tick of the clock would have the same time.
    written_ += std::chrono::seconds(1);
    fs::last_write_time(directory_.path() / name, written_);
  }
  ProgramFolder::News look() { return folder_.look(++now_); }
  /// Of two looks, so that what lies there is complete.
  ProgramFolder::News settled() {
    (void)look();
    return look();
  }

  test::TemporaryDirectory directory_;
  fs::file_time_type written_ = fs::file_time_type::clock::now();
  ProgramFolder folder_{directory_.path(), x_and_rotary_c()};
  std::int64_t now_ = 0;
};

TEST_F(ProgramFolderTest, AFileIsAProgramInMetresOnceItIsComplete) {
  write("part 7.csv", path_of(20));
  EXPECT_THAT(look().found, IsEmpty()) << "it may still be written";
  write("part 7.csv", path_of(2000));
  EXPECT_THAT(look().found, IsEmpty());
  const ProgramFolder::News news = look();
  ASSERT_EQ(news.found.size(), 1U);
  const ProgramFolder::Found& found = news.found.front();
  EXPECT_EQ(found.problem, "");
  EXPECT_EQ(found.program, "part_7");
  EXPECT_EQ(found.revision, 3U);
  std::size_t rows = 0;
  for (const ProgramChunk& chunk : found.chunks) {
    EXPECT_EQ(chunk.program, "part_7");
    EXPECT_EQ(chunk.revision, 3U);
    EXPECT_EQ(chunk.chunks, found.chunks.size());
    EXPECT_TRUE(chunk.learn);
    EXPECT_THAT(chunk.axes, ElementsAre("X"));
    ASSERT_EQ(chunk.command.size(), chunk.time_s.size());
    for (const double command : chunk.command)
      EXPECT_NEAR(command, 0.5e-3 * static_cast<double>(rows++), 1e-12);
  }
  EXPECT_EQ(rows, 2000U);
  EXPECT_THAT(look().found, IsEmpty()) << "it was found before";
}

TEST_F(ProgramFolderTest, AChangedFileIsANewRevisionAndOneThatIsGoneIsSaidOnce) {
  write("a.csv", path_of(20));
  ASSERT_EQ(settled().found.size(), 1U);
  write("a.csv", path_of(30));
  const ProgramFolder::News changed = settled();
  ASSERT_EQ(changed.found.size(), 1U);
  EXPECT_EQ(changed.found.front().chunks.front().time_s.size(), 30U);
  fs::remove(directory_.path() / "a.csv");
  EXPECT_THAT(look().gone, ElementsAre("a"));
  EXPECT_THAT(look().gone, IsEmpty());
}

TEST_F(ProgramFolderTest, WhatIsChangedAndThenRemovedIsGone) {
  write("a.csv", path_of(20));
  ASSERT_EQ(settled().found.size(), 1U);
  write("a.csv", path_of(30));
  (void)look();  // seen, and not yet read
  fs::remove(directory_.path() / "a.csv");
  EXPECT_THAT(look().gone, ElementsAre("a"));
}

TEST_F(ProgramFolderTest, IsFoundAgainOnlyWhereItIsAskedFor) {
  write("a.csv", path_of(20));
  write("b.csv", path_of(20));
  ASSERT_EQ(settled().found.size(), 2U);
  EXPECT_THAT(folder_.programs(), ElementsAre("a", "b"));
  folder_.find_again({"b", "nobody"});
  const ProgramFolder::News news = look();
  ASSERT_EQ(news.found.size(), 1U);
  EXPECT_EQ(news.found.front().program, "b");
  EXPECT_THAT(look().found, IsEmpty());
}

TEST_F(ProgramFolderTest, AFileWhoseNameCannotBeThatOfAProgramSaysSo) {
  write("a.csv", path_of(20));
  write("bad name.csv", path_of(20));
  const ProgramFolder::News news = settled();
  ASSERT_EQ(news.found.size(), 2U);
  EXPECT_EQ(news.found[0].renamed, "");
  EXPECT_EQ(news.found[1].program, "bad_name");
  EXPECT_EQ(news.found[1].renamed, "bad name.csv");
}

TEST_F(ProgramFolderTest, AHeaderThatIsNoneOfAPathSaysWhatItNeeds) {
  write("a.csv", "t,x\n0,1\n0.001,2\n");
  const ProgramFolder::News news = settled();
  ASSERT_EQ(news.found.size(), 1U);
  EXPECT_THAT(news.found[0].problem,
              HasSubstr("a.csv: the header of a program names its columns with their units, as "
                        "time[s],X.command[mm],Y.command[mm] does; the first line of this file is "
                        "'t,x'"));
}

TEST_F(ProgramFolderTest, OtherFilesAreLeftAlone) {
  write("notes.txt", "x");
  write(".part.csv.swp", "x");
  write(".hidden.csv", path_of(20));
  fs::create_directory(directory_.path() / "folder.csv");
  EXPECT_THAT(settled().found, IsEmpty());
  write("UPPER.CSV", path_of(20));
  ASSERT_EQ(settled().found.size(), 1U);
}

TEST_F(ProgramFolderTest, WhatIsWrongIsSaidWithTheFile) {
  write("empty.csv", "");
  write("degrees.csv", path_of(20, "time[s],X.command[deg]"));
  write("same name.csv", path_of(20));
  write("same_name.csv", path_of(20));
  const ProgramFolder::News news = settled();
  ASSERT_EQ(news.found.size(), 4U);
  EXPECT_THAT(news.found[0].problem, AllOf(HasSubstr("degrees.csv"), HasSubstr("X"),
                                           HasSubstr("rotary"), HasSubstr("linear")));
  EXPECT_THAT(news.found[0].chunks, IsEmpty());
  EXPECT_THAT(news.found[1].problem, HasSubstr("empty.csv"));
  EXPECT_EQ(news.found[2].problem, "");
  EXPECT_THAT(news.found[3].problem, AllOf(HasSubstr("same_name.csv"), HasSubstr("same name.csv")));
  EXPECT_THAT(folder_.programs(), ElementsAre("same_name"));
}

TEST_F(ProgramFolderTest, AFolderThatCannotBeReadIsSaidOnceAndItsProgramsAreNotGone) {
  write("a.csv", path_of(20));
  ASSERT_EQ(settled().found.size(), 1U);
  const fs::path away = directory_.path().string() + ".away";
  fs::rename(directory_.path(), away);
  const ProgramFolder::News first = look();
  EXPECT_THAT(first.problem, HasSubstr(directory_.path().string()));
  EXPECT_THAT(first.gone, IsEmpty());
  EXPECT_EQ(look().problem, "");
  fs::rename(away, directory_.path());
  const ProgramFolder::News back = look();
  EXPECT_THAT(back.found, IsEmpty());
  EXPECT_THAT(back.gone, IsEmpty());
}

}  // namespace
}  // namespace servotwin::daemon
