// Any damaged file gives a recording, or one line with the reason.
#include <gtest/gtest.h>

#include <random>
#include <stdexcept>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

std::string valid_text(std::mt19937_64& random) {
  constexpr const char* kSeparators = ",;\t";
  const char s = kSeparators[random() % 3];
  const auto cell = [&] { return std::to_string(static_cast<double>(random() % 100'000) * 1e-3); };
  std::string text = "# comment\ntime[s]";
  text += s;
  text += "X.command[mm]";
  text += s;
  text += "X.actual[mm]";
  text += s;
  text += "X.torque[Nm]\n";
  for (int i = 0; i < 12; ++i) {
    text += std::to_string(i) + s + cell() + s + cell() + s + cell() + "\n";
  }
  return text;
}

void mutate(std::string& text, std::mt19937_64& random) {
  constexpr std::string_view kLikely = ",;\t\n\r\"#.[]+-eE0123456789nainf \0\xff\xef";
  const auto at = [&] { return static_cast<std::size_t>(random() % (text.size() + 1)); };
  const std::size_t begin = at(), length = random() % 20;
  switch (random() % 6) {
    case 0:
      if (begin < text.size()) text[begin] = kLikely[random() % kLikely.size()];
      break;
    case 1:
      text.insert(begin, 1, kLikely[random() % kLikely.size()]);
      break;
    case 2:
      text.erase(begin, length);
      break;
    case 3:
      text.insert(at(), text.substr(begin, length));
      break;
    case 4:
      text.resize(begin);
      break;
    default:
      if (begin < text.size()) text[begin] = static_cast<char>(random());
      break;
  }
}

TEST(CsvFuzz, AMutatedFileIsReadOrRefusedInOneLine) {
  const test::TemporaryDirectory directory;
  std::mt19937_64 random(20);
  int read = 0, refused = 0;
  for (int round = 0; round < 5000; ++round) {
    std::string text = valid_text(random);
    for (auto left = random() % 6; left > 0; --left) mutate(text, random);
    const auto file = directory.file("mutant.csv", text);
    SCOPED_TRACE("round " + std::to_string(round) + ":\n" + text);
    try {
      const Recording recording = read_recording(file);
      ++read;
      ASSERT_FALSE(recording.time.empty());
      ASSERT_FALSE(recording.axes.empty());
      for (const AxisRecord& axis : recording.axes) {
        ASSERT_EQ(axis.command.size(), recording.time.size());
        ASSERT_EQ(axis.actual.size(), recording.time.size());
        ASSERT_TRUE(axis.torque.empty() || axis.torque.size() == recording.time.size());
      }
    } catch (const std::runtime_error& error) {
      ++refused;
      const std::string message = error.what();
      ASSERT_NE(message.find("mutant.csv: "), std::string::npos) << message;
      ASSERT_EQ(message.find('\n'), std::string::npos) << message;
    }
  }
  // Both outcomes must occur, otherwise the mutations are too weak or too strong for this test.
  EXPECT_GT(read, 500);
  EXPECT_GT(refused, 500);
}

TEST(CsvFuzz, AMutatedMappingIsTakenOrRefused) {
  const test::TemporaryDirectory directory;
  const auto file = directory.file("rec.csv", "t,qg,qm,vir\n0,1,2,3\n1,2,3,4\n");
  std::mt19937_64 random(21);
  int taken = 0, refused = 0;
  for (int round = 0; round < 5000; ++round) {
    ReadOptions options;
    options.columns = "X.command=qg[m],X.actual=qm[m],X.torque=vir[V],time=t[s]";
    for (auto left = random() % 3; left > 0; --left) mutate(options.columns, random);
    SCOPED_TRACE(options.columns);
    try {
      (void)read_recording(file, options);
      ++taken;
    } catch (const std::runtime_error&) {
      ++refused;
    } catch (const std::invalid_argument&) {
      ++refused;
    }
  }
  EXPECT_GT(taken, 500);
  EXPECT_GT(refused, 500);
}

}  // namespace
}  // namespace servotwin
