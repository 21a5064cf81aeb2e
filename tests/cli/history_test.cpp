// servotwin history, from a store that servotwind's own code has written.
#include <gmock/gmock.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "daemon/store/store.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;

/// Backlash that has grown from day to day.
void keep(daemon::Store& store, int day, double width_m) {
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
  daemon::Store store(folder / "store", "mill-7");
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
  daemon::Store store(folder / "store", "mill-7");
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
  EXPECT_THAT(answer.out,
              HasSubstr("  suspected cogging, backlash  not observable here: stribeck\n"));
}

TEST(History, WhatIsNotThereIsSaidAndNothingIsMade) {
  const Folder folder;
  Answer answer = servotwin_says({"history", "--store", folder / "store", "--axis", "X"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.out, IsEmpty());
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("servotwin.sqlite: does not exist; --store"));
  EXPECT_THAT(folder.list(), IsEmpty());

  const auto asked = [&](const std::string& machine, const std::string& axis) {
    Answer told = servotwin_says(
        {"history", "--store", folder / "store", "--axis", axis, "--machine", machine});
    EXPECT_EQ(told.status, 1) << told;
    EXPECT_EQ(told.complaints().size(), 1U) << told;
    return told.err;
  };
  { daemon::Store store(folder / "store", "mill-7"); }
  EXPECT_THAT(asked("mill-7", "X"), HasSubstr("no model and no diagnosis of any machine yet"));
  {
    daemon::Store store(folder / "store", "mill-7");
    keep(store, 1, 1e-6);
    ModelRecord y = known_axis("Y");
    store.promote(y, {"2026-01-01T12:00:00.000Z", "Y", "model_promoted", "first", ""});
  }
  EXPECT_THAT(asked("mill-8", "X"), HasSubstr("knows no machine 'mill-8'; it has mill-7"));
  EXPECT_THAT(asked("mill-7", "Z"), HasSubstr("has no axis 'Z' there; it has X, Y"));
  EXPECT_THAT(asked("mill-7", "Y"), HasSubstr("axis Y of machine 'mill-7' has not been diagnosed"));
}

TEST(History, TheModelOfADiagnosisIsThereAndWhatOnlyTheTorqueShowsIsMarked) {
  const Folder folder;
  daemon::Store store(folder / "store", "mill-7");
  const json diagnosis = json::parse(
      R"({"baseline": {"rms_m": 2e-6}, "extended": {"rms_m": 2e-6}, "causes": [
          {"id": "cogging", "parameters": {"period_m": 0.01}, "gain": {"holdout_rms_before_m": null, "holdout_rms_before_Nm": 0.1}},
          {"id": "dropped_samples", "parameters": {"gaps": 1}, "gain": {"holdout_rms_before_m": null}},
          {"id": "backlash", "parameters": {"width_m": 1e-6}, "gain": {"holdout_rms_before_m": 2e-6}}]})");
  store.add({"2026-01-01T12:00:00.000Z", "X", "on schedule", "explained", diagnosis.dump(),
             R"({"schema": "servotwin.model/1"})"},
            {"2026-01-01T12:00:00.000Z", "X", "diagnosis", "", ""});
  const std::vector<std::string> asked{"history",   "--store", folder / "store",
                                       "--machine", "mill-7",  "--axis",
                                       "X",         "--json",  folder / "h"};
  const Answer answer = servotwin_says(asked);
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("  cogging(period_m 0.01) by torque  dropped_samples(gaps 1)  "
                                    "backlash(width_m 1e-06)\n"));
  std::ifstream file(folder / "h");
  EXPECT_EQ(json::parse(file)["diagnoses"][0]["model"]["schema"], "servotwin.model/1");
}

}  // namespace
}  // namespace servotwin
