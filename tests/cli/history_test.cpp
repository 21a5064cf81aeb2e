// servotwin history, from a store that servotwind's own code has written.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "daemon/store.h"
#include "program.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;

/// Backlash that has grown from day to day.
void keep(Store& store, int day, double width_m) {
  const json diagnosis{
      {"schema", "servotwin.diagnosis/1"},
      {"baseline", {{"rms_m", 2e-6}}},
      {"extended", {{"rms_m", nullptr}}},
      {"causes", json::array({{{"id", "backlash"}, {"parameters", {{"width_m", width_m}}}}})}};
  const std::string time = "2026-01-0" + std::to_string(day) + "T12:00:00.000Z";
  store.add({time, "X", day == 3 ? "the residual has grown" : "on schedule", "explained",
             diagnosis.dump(), ""},
            {time, "X", "diagnosis", "", ""});
}

TEST(History, IsALinePerDiagnosisTheNewestLastBesideTheDaemon) {
  const Folder folder;
  Store store(folder / "store", "mill-7");
  for (int day = 1; day <= 3; ++day) keep(store, day, day * 1e-6);
  const std::vector<std::string> asked{
      "history", "--store", folder / "store", "--machine", "mill-7", "--axis", "X", "--last", "2"};
  const Answer answer = servotwin_says(asked);
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out,
              HasSubstr("\n2026-01-02T12:00:00.000Z  explained                  2 -> -         "
                        "backlash(width_m 2e-06)\n"
                        "2026-01-03T12:00:00.000Z  explained                  2 -> -         "
                        "backlash(width_m 3e-06)  [alarm]\n"));
  EXPECT_THAT(answer.out, testing::Not(HasSubstr("2026-01-01")));

  std::vector<std::string> as_json = asked;
  as_json.insert(as_json.end(), {"--json", "-"});
  const json told = json::parse(servotwin_says(as_json).out);
  EXPECT_EQ(told["schema"], "servotwin.history/1");
  EXPECT_EQ(told["machine"], "mill-7");
  ASSERT_EQ(told["diagnoses"].size(), 2U);
  EXPECT_EQ(told["diagnoses"][1]["causes"][0]["parameters"]["width_m"], 3e-6);
}

TEST(History, WhatIsSuspectedAndWhatCannotShowIsThere) {
  const Folder folder;
  Store store(folder / "store", "mill-7");
  const json diagnosis{
      {"schema", "servotwin.diagnosis/1"},
      {"baseline", {{"rms_m", 2e-6}}},
      {"extended", {{"rms_m", 2e-6}}},
      {"causes", json::array()},
      {"suspected", json::array({{{"id", "cogging"}, {"confidence", 0.4}}, {{"id", "backlash"}}})},
      {"not_observable", json::array({{{"id", "stribeck"}, {"why", "it never moves slowly"}}})}};
  const std::string time = "2026-01-01T12:00:00.000Z";
  store.add({time, "X", "on schedule", "nothing_significant", diagnosis.dump(), ""},
            {time, "X", "diagnosis", "", ""});
  const Answer answer = servotwin_says(
      {"history", "--store", folder / "store", "--machine", "mill-7", "--axis", "X"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("  suspected cogging, backlash  cannot show stribeck\n"));
}

TEST(History, WhatIsNotThereIsSaidAndNothingIsMade) {
  const Folder folder;
  Answer answer = servotwin_says({"history", "--store", folder / "store", "--axis", "X"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.out, IsEmpty());
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("servotwin.sqlite: cannot be opened"));
  EXPECT_THAT(folder.list(), IsEmpty());

  { Store store(folder / "store", "mill-7"); }
  answer = servotwin_says(
      {"history", "--store", folder / "store", "--axis", "Z", "--machine", "mill-7"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("no diagnosis of axis Z of machine mill-7"));
  EXPECT_EQ(answer.complaints().size(), 1U) << answer;
}

}  // namespace
}  // namespace servotwin
