#include "daemon/store/journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstring>

#include "daemon/store/event_log.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

/// Where a journal would listen.
class JournalTest : public testing::Test {
 protected:
  JournalTest() : path_(directory_.path() / "journal"), socket_(socket(AF_UNIX, SOCK_DGRAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path_.c_str(), sizeof address.sun_path - 1);
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~JournalTest() override { close(socket_); }
  std::string next() const {
    std::array<char, 100'000> entry{};
    const ssize_t size = recv(socket_, entry.data(), entry.size(), MSG_DONTWAIT);
    return size < 0 ? "nothing" : std::string(entry.data(), static_cast<std::size_t>(size));
  }

  TemporaryDirectory directory_;
  std::string path_;
  int socket_;
};

TEST_F(JournalTest, AnEntryIsOneDatagramOfFields) {
  const Journal journal(path_);
  ASSERT_TRUE(journal.send(Priority::kWarning, "X: hot", {{"AXIS", "X"}, {"DETAIL", ""}}));
  EXPECT_EQ(next(), "PRIORITY=4\nSYSLOG_IDENTIFIER=servotwind\nMESSAGE=X: hot\nAXIS=X\n");
}

// The format of the protocol's document: the name, a newline, 64 bits little endian, the value.
TEST_F(JournalTest, AValueOfSeveralLinesGoesWithItsLength) {
  const Journal journal(path_);
  ASSERT_TRUE(journal.send(Priority::kInfo, "one\ntwo"));
  const std::string length("\7\0\0\0\0\0\0\0", 8);
  EXPECT_EQ(next(), "PRIORITY=6\nSYSLOG_IDENTIFIER=servotwind\nMESSAGE\n" + length + "one\ntwo\n");
}

TEST_F(JournalTest, AFieldThatIsTooLongIsCutAndTheEntryIsTaken) {
  const Journal journal(path_);
  ASSERT_TRUE(journal.send(Priority::kInfo, "short", {{"DETAIL", std::string(1'000'000, 'd')}}));
  EXPECT_EQ(next().size(), 32 * 1024 + std::string("PRIORITY=6\nSYSLOG_IDENTIFIER=servotwind\n"
                                                   "MESSAGE=short\nDETAIL=\n")
                                           .size());
}

TEST_F(JournalTest, EventsGoThereWithWhatTheyAre) {
  Store store(directory_.path(), "mill");
  const Journal journal(path_);
  std::ostringstream out;
  EventLog events(store, out, &journal, "mill");
  events.note("model_promoted", "X", "model 2 is in force");
  EXPECT_EQ(next(),
            "PRIORITY=5\nSYSLOG_IDENTIFIER=servotwind\nMESSAGE=X: model 2 is in force\n"
            "MACHINE=mill\nAXIS=X\nEVENT=model_promoted\n");
  events.error("recording", "", "disk full");
  EXPECT_THAT(next(), testing::StartsWith("PRIORITY=3\n"));
  EXPECT_EQ(out.str(), "") << "once is enough";
  EXPECT_EQ(store.events(10).size(), 2U);
}

TEST_F(JournalTest, WhereNobodyListensEventsAreLines) {
  Store store(directory_.path(), "mill");
  const Journal journal(directory_.path() / "nobody");
  std::ostringstream out;
  EventLog events(store, out, &journal, "mill");
  events.note("source", "", "waiting");
  EXPECT_EQ(out.str(), "servotwind: waiting\n");
}

TEST(JournalStream, IsWhatTheServiceManagerNamed) {
  struct stat status {};
  ASSERT_EQ(fstat(STDERR_FILENO, &status), 0);
  const std::string mine = std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino);
  unsetenv("JOURNAL_STREAM");
  EXPECT_FALSE(Journal::is_behind(STDERR_FILENO));
  setenv("JOURNAL_STREAM", mine.c_str(), 1);
  EXPECT_TRUE(Journal::is_behind(STDERR_FILENO));
  setenv("JOURNAL_STREAM", (mine + "0").c_str(), 1);
  EXPECT_FALSE(Journal::is_behind(STDERR_FILENO));
  unsetenv("JOURNAL_STREAM");
}

}  // namespace
}  // namespace servotwin::daemon
