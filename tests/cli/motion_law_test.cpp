// servotwin motion-law: the table it writes is the motion it describes.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "drivers/recordings/recording_file.h"
#include "program.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const std::vector<std::string> kThePapers{
    "motion-law", "--velocities", "poly:100e-7,100e-7,40e-7,3e-7:51", "--band", "2@3,5@6,10"};

std::vector<std::string> with(std::vector<std::string> words,
                              const std::vector<std::string>& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

TEST(MotionLawCommand, SaysWhatTheMotionIsAndWhatTheBandsSave) {
  const Answer answer = servotwin_says(kThePapers);
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, IsEmpty());
  EXPECT_THAT(answer.out, HasSubstr("51, 0.0243 to 50.7193 mm/s, each in both directions"));
  EXPECT_THAT(answer.out, HasSubstr("2 mm (1 to 3), 5 mm (4 to 6), 10 mm (7 to 51)"));
  EXPECT_THAT(answer.out, HasSubstr("30.2877 mm, from -15.1439 to 15.1439 mm"));
  EXPECT_THAT(answer.out, HasSubstr("15 min 24 s"));
  EXPECT_THAT(answer.out,
              HasSubstr("58.7 %: it would be 37 min 18 s with 10 mm for all velocities"));
  const Answer single = servotwin_says({"motion-law", "--velocities", "5,20"});
  ASSERT_EQ(single.status, 0) << single;
  EXPECT_THAT(single.out, Not(HasSubstr("saved")));  // one band: nothing to save
}

TEST(MotionLawCommand, ItsTableRunsEveryBandAtTheSpeedOfItsRamp) {
  const Folder folder;
  const std::string table = folder / "path.csv", ramps = folder / "ramps.json";
  const Answer answer = servotwin_says(
      {"motion-law", "--velocities", "2.5,10,40", "--band", "2@1,6", "--acceleration",
       "500",        "--settle",     "0.1",       "--rest", "0.5",   "--centre",
       "-120",       "--axis",       "Z",         "--rate", "250",   "--travel",
       "14",         "--out",        table,       "--json", ramps});
  ASSERT_EQ(answer.status, 0) << answer;
  const Recording written = read_recording(table);
  ASSERT_EQ(written.axes.size(), 1U);
  EXPECT_EQ(written.axes[0].name, "Z");
  const std::vector<double>& x = written.axes[0].command;

  const json law = json::parse(content_of(ramps));
  EXPECT_EQ(law["schema"], "servotwin.motion-law/1");
  EXPECT_EQ(law["axis"], "Z");
  EXPECT_EQ(x.size(), static_cast<std::size_t>(law["duration_s"].get<double>() * 250.0) + 1);
  ASSERT_EQ(law["ramps"].size(), 6U);
  std::size_t i = 0;
  for (const json& ramp : law["ramps"]) {
    const double speed = std::vector{2.5e-3, 10e-3, 40e-3}[i / 2] * (i % 2 == 0 ? 1.0 : -1.0);
    EXPECT_NEAR(ramp["velocity_mps"].get<double>(), speed, 1e-15);
    EXPECT_NEAR(ramp["band_m"].get<double>(), i < 2 ? 2e-3 : 6e-3, 1e-15);
    const double begin = ramp["band_begin_s"], end = ramp["band_end_s"];
    EXPECT_NEAR(end - begin, ramp["band_m"].get<double>() / std::abs(speed), 1e-9);
    const auto first = static_cast<std::size_t>(std::ceil(begin * 250.0));
    const auto last = static_cast<std::size_t>(std::floor(end * 250.0));
    for (std::size_t row = first; row < last; ++row) {
      ASSERT_NEAR(250.0 * (x[row + 1] - x[row]), speed, 1e-9) << row;
      ASSERT_LE(std::abs(x[row] + 0.120), ramp["band_m"].get<double>() / 2.0 + 1e-9);
    }
    ++i;
  }
  // 6 mm / 2 + 0.1 s x 40 mm/s = 7 mm on both sides.
  EXPECT_NEAR(*std::min_element(x.begin(), x.end()), -0.127, 1e-12);
  EXPECT_NEAR(*std::max_element(x.begin(), x.end()), -0.113, 1e-12);
}

TEST(MotionLawCommand, AResultOnStandardOutputIsAllThereIs) {
  const Answer table = servotwin_says({"motion-law", "--velocities", "20", "--out", "-"});
  ASSERT_EQ(table.status, 0) << table;
  EXPECT_THAT(table.out, testing::StartsWith("time[s],X.command[mm]\n0,-9\n"));
  EXPECT_THAT(table.err, HasSubstr("total time"));
  const Answer ramps = servotwin_says(with(kThePapers, {"--json", "-"}));
  ASSERT_EQ(ramps.status, 0) << ramps;
  EXPECT_EQ(json::parse(ramps.out)["ramps"].size(), 102U);
}

struct Refused {
  std::vector<std::string> words;
  std::string complaint;
};
void PrintTo(const Refused& refused, std::ostream* out) {
  for (const std::string& word : refused.words) *out << word << ' ';
}

class MotionLawRefuses : public testing::TestWithParam<Refused> {};

TEST_P(MotionLawRefuses, InOneLineWithStatusTwo) {
  const Folder folder;
  const Answer answer =
      servotwin_says(with(with({"motion-law"}, GetParam().words), {"--out", folder / "path.csv"}));
  EXPECT_EQ(answer.status, 2) << answer;
  EXPECT_THAT(answer.out, IsEmpty());
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr(GetParam().complaint));
  EXPECT_THAT(folder.list(), Not(Contains("path.csv")));
}

const std::vector<Refused> kRefused{
    {{}, "--velocities is required"},
    {{"--velocities", "1,,3"}, "--velocities: '' of '1,,3' is not a number"},
    {{"--velocities", "1,fast"}, "'fast' of '1,fast' is not a number"},
    {{"--velocities", "1,-2"}, "velocity 2 (-2 mm/s) must be positive"},
    {{"--velocities", "1,0"}, "velocity 2 (0 mm/s) must be positive"},
    {{"--velocities", "poly:1e-3,1e-3"}, "does not have the form poly:A0,A1,..:N"},
    {{"--velocities", "poly:1e-3:2.5"},
     "'2.5' of 'poly:1e-3:2.5' must be a whole number from 1 to"},
    {{"--velocities", "poly:1e-3,-1e-3:3"}, "velocity 1 (0 mm/s) must be positive"},
    {{"--velocities", "1,2", "--band", "2@3,4"},
     "'3' of '2@3,4' must be a whole number from 1 to 2"},
    {{"--velocities", "1,2", "--band", "2,4"},
     "'2' of '2,4' needs the number of the last velocity that it is for"},
    {{"--velocities", "1,2", "--band", "2@2"},
     "is the last band, for all remaining velocities, and takes no @K"},
    {{"--velocities", "1,2", "--band", "2@2,4"}, "'4' of '2@2,4' has no velocity left"},
    {{"--velocities", "1,2,3", "--band", "2@2,3@1,4"},
     "'3@1' of '2@2,3@1,4' does not extend beyond"},
    {{"--velocities", "1", "--band", "0"}, "the band of velocity 1 (1 mm/s) is 0 mm"},
    {{"--velocities", "1", "--band", "wide"}, "--band: 'wide' of 'wide' is not a number"},
    {{"--velocities", "50", "--acceleration", "100"}, "settle for at least 0.25 s"},
    {{"--velocities", "50", "--acceleration", "-1"}, "acceleration is -1 mm/s^2"},
    {{"--velocities", "50", "--settle", "-1"}, "settle is -1 s"},
    {{"--velocities", "50", "--rest", "nan"}, "rest is nan s"},
    {{"--velocities", "50", "--centre", "inf"}, "centre is inf"},
    {{"--velocities", "50", "--travel", "25"}, "needs 30 mm of travel and there are 25 mm"},
    {{"--velocities", "50", "--travel", "0"}, "travel is 0 mm"},
    {{"--velocities", "50", "--rate", "0"}, "--rate is 0 Hz, must be positive"},
    {{"--velocities", "50", "--axis", "a,b"}, "--axis: 'a,b' cannot be used in the header"},
    {{"--velocities", "1e-9"}, "rows, more than 10000000"},
    {{"--velocites", "50"}, "did you mean '--velocities'?"},
};
INSTANTIATE_TEST_SUITE_P(Typed, MotionLawRefuses, testing::ValuesIn(kRefused));

}  // namespace
}  // namespace servotwin
