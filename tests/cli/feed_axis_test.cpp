// servotwin what-if and fit-axis, and the file of a feed axis' parts.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/recording/feed_axis_file.h"
#include "program.h"

namespace servotwin {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

const std::string kRig = std::string(SERVOTWIN_SOURCE_DIR) + "/examples/feed_axis.toml";

/// The example with one line in place of another.
std::string rig_with(const std::string& line, const std::string& other) {
  std::string text = content_of(kRig);
  const std::size_t at = text.find(line);
  EXPECT_NE(at, text.npos) << line;
  return text.replace(at, line.size(), other);
}

/// The one problem of a text.
std::string problem_of(const std::string& text) {
  const CheckedFeedAxis checked = check_feed_axis(text, "a.toml");
  EXPECT_EQ(checked.problems.size(), 1U) << messages(checked.problems);
  return checked.problems.empty() ? "" : checked.problems[0].message();
}

TEST(FeedAxisFile, TheExampleIsTheRigOfThePaper) {
  const FeedAxisParts parts = read_feed_axis(kRig);
  EXPECT_DOUBLE_EQ(parts.screw.diameter, 0.032);
  EXPECT_DOUBLE_EQ(parts.screw.axial.stiffness, 5e-6);
  EXPECT_DOUBLE_EQ(parts.bearing.stiffness, 19e8);
  EXPECT_DOUBLE_EQ(parts.nut.spring.stiffness, 3e8);
  EXPECT_DOUBLE_EQ(parts.nut.to, 0.65);
  EXPECT_DOUBLE_EQ(parts.coupling.inertia, 114e-6);
  EXPECT_DOUBLE_EQ(parts.motor_inertia, 593e-6);
  EXPECT_DOUBLE_EQ(parts.control.reset_time, 0.01);
  EXPECT_DOUBLE_EQ(parts.friction->stribeck_velocity, 2.53e-3);
  EXPECT_DOUBLE_EQ(parts.friction->stiffness, 9.37e6);
  EXPECT_DOUBLE_EQ(parts.cover->breakaway, 49.6);
  EXPECT_FALSE(parts.added_mass.has_value());
  EXPECT_TRUE(parts.control.band_stops.empty());
}

TEST(FeedAxisFile, EveryOptionalPartIsRead) {
  const CheckedFeedAxis checked = check_feed_axis(content_of(kRig) + R"(
    [control.current_loop]
    resistance_ohm = 1.2
    inductance_mh = 6.0
    gain_v_per_a = 15
    reset_time_ms = 5
    [[control.band_stop]]
    frequency_hz = 800
    bandwidth_hz = 200
    numerator_bandwidth_hz = 20
    [[control.band_stop]]
    frequency_hz = 300
    bandwidth_hz = 50
    [added_mass]
    mass_kg = 38
    stiffness_n_per_um = 40
    damping_n_s_per_m = 900)",
                                                  "a.toml");
  ASSERT_EQ(checked.problems.size(), 1U);  // the lag is still in [control]
  EXPECT_THAT(checked.problems[0].message(), AllOf(HasSubstr("control.current_loop_hz = 1000"),
                                                   HasSubstr("remove one of the two")));
  EXPECT_DOUBLE_EQ(checked.parts.control.current_loop->inductance, 6e-3);
  ASSERT_EQ(checked.parts.control.band_stops.size(), 2U);
  EXPECT_EQ(checked.parts.control.band_stops[0].numerator_bandwidth_hz, 20.0);
  EXPECT_EQ(checked.parts.control.band_stops[1].frequency_hz, 300.0);
  EXPECT_DOUBLE_EQ(checked.parts.added_mass->spring.stiffness, 40e6);
}

TEST(FeedAxisFile, AProblemHasItsPlaceItsValueAndTheRule) {
  EXPECT_THAT(problem_of(rig_with("lead_mm = 32", "lead_mm = -4")),
              AllOf(HasSubstr("a.toml:7:"), HasSubstr("screw.lead_mm = -4"),
                    HasSubstr("from 0.1 to 1000 mm")));
  EXPECT_THAT(problem_of(rig_with("mass_kg = 106", "")), HasSubstr("table.mass_kg: is missing"));
  EXPECT_THAT(problem_of(rig_with("at_zero_mm = 220", "at_zro_mm = 220")),
              AllOf(HasSubstr("nut.at_zro_mm: there is no such key"), HasSubstr("'at_zero_mm'")));
  EXPECT_THAT(problem_of(rig_with("[200, 650]", "[200, 900]")),
              AllOf(HasSubstr("nut.travel_mm"), HasSubstr("within 0 to 850 mm")));
  EXPECT_THAT(problem_of(rig_with("[motor]\ninertia_kg_cm2 = 5.93", "")),
              HasSubstr("[motor]: is missing"));
  EXPECT_THAT(problem_of(content_of(kRig) + "[[control.band_stop]]\nfrequency_hz = 9000\n"
                                            "bandwidth_hz = 10\n"),
              AllOf(HasSubstr("frequency_hz = 9000"), HasSubstr("half of rate_hz")));
  EXPECT_THAT(problem_of("screw = ["), HasSubstr("a.toml:1:"));
}

/// What `--set` changes.
FeedAxisParts changed(const std::vector<std::string>& changes) {
  return read_feed_axis(kRig, changes);
}

TEST(FeedAxisFile, ChangesReachEveryPart) {
  EXPECT_EQ(changed({"coupling.stiffness_nm_per_rad=30000"}).coupling.spring.stiffness, 30000.0);
  EXPECT_DOUBLE_EQ(changed({"nut.travel_mm = [100, 300]"}).nut.to, 0.3);
  const FeedAxisParts two = changed({"table.mass_kg=150", "screw.diameter_mm=40"});
  EXPECT_EQ(two.table_mass, 150.0);
  EXPECT_DOUBLE_EQ(two.screw.diameter, 0.04);
  EXPECT_EQ(changed({"control.low_pass_hz=500"}).control.low_pass_hz, 500.0);
}

TEST(WhatIf, SaysBeforeAndAfter) {
  const Folder folder;
  const Answer answer =
      servotwin_says({"what-if", kRig, "--set", "coupling.stiffness_nm_per_rad=36000", "--json",
                      folder / "o.json", "--plot", folder / "p.svg"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, AllOf(HasSubstr("before"), HasSubstr("after"),
                                HasSubstr("299.7 809.2 1797 Hz"), HasSubstr("99.10 N/um")));
  const auto json = nlohmann::json::parse(content_of(folder / "o.json"));
  EXPECT_EQ(json["schema"], "servotwin.what-if/1");
  const auto& before = json["before"];
  const auto& after = json["after"];
  // The share of table 1 of the paper at 50 mm/s, by hand.
  EXPECT_NEAR(before["cover_share"][1]["share"], 0.3679330241300513, 1e-9);
  // A stiffer coupling in series: 1/k falls by R^2 (1/17800 - 1/36000).
  const double radius = 0.032 / (2.0 * M_PI);
  EXPECT_NEAR(1.0 / before["places"][1]["static_stiffness_n_per_m"].get<double>() -
                  1.0 / after["places"][1]["static_stiffness_n_per_m"].get<double>(),
              radius * radius * (1.0 / 17800.0 - 1.0 / 36000.0), 1e-15);
  EXPECT_TRUE(before["motions"][0]["stable"]);
  EXPECT_EQ(before["motions"].size(), 3U);
  EXPECT_THAT(content_of(folder / "p.svg"), AllOf(HasSubstr("<svg"), HasSubstr("after")));
}

TEST(WhatIf, AMotionOfOnesOwnAndAnotherFile) {
  const Folder folder;
  std::string table = "time[s],Z.command[mm]\n";
  for (int k = 0; k <= 400; ++k)
    table += std::to_string(0.002 * k) + "," +
             std::to_string(20.0 - 20.0 * std::cos(M_PI * k / 200.0)) + "\n";
  const std::string heavy = folder.write("heavy.toml", rig_with("mass_kg = 106", "mass_kg = 212"));
  const Answer answer =
      servotwin_says({"what-if", kRig, "--change", heavy, "--motion", folder.write("z.csv", table),
                      "--axis", "Z", "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const auto json = nlohmann::json::parse(answer.out);
  ASSERT_EQ(json["before"]["motions"].size(), 1U);
  const double light = json["before"]["motions"][0]["torque_rms_nm"],
               doubled = json["after"]["motions"][0]["torque_rms_nm"];
  // a = 20 mm (pi / 0.4 s)^2 cos: 1.234 m/s^2 x 106 kg x R / sqrt(2) more in quadrature or so.
  EXPECT_GT(doubled, light + 0.05);
  EXPECT_LT(doubled, light + 0.5);
}

TEST(WhatIf, ALoopThatIsNotStableIsSaidAndNotSimulated) {
  const Answer answer = servotwin_says({"what-if", kRig, "--set", "control.low_pass_hz=150",
                                        "--set", "control.velocity_gain_nm_s_per_rad=15"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, AllOf(HasSubstr("NO"), HasSubstr("unstable"), Not(HasSubstr("nan"))));
}

/// Exit status and one of the lines: a file may have several problems.
void expect_refusal(const std::vector<std::string>& words, int status,
                    const testing::Matcher<std::string>& what) {
  const Answer answer = servotwin_says(words);
  EXPECT_EQ(answer.status, status) << answer;
  EXPECT_THAT(answer.complaints(), testing::Contains(what));
}

TEST(WhatIf, RefusesWhatCannotBe) {
  const Folder folder;
  const auto set = [](const std::string& change) {
    return std::vector<std::string>{"what-if", kRig, "--set", change};
  };
  expect_refusal(set("coupling.stiffness_nm_per_rad=-3"), 2,
                 AllOf(HasSubstr("coupling.stiffness_nm_per_rad = -3"), HasSubstr("from 1 to")));
  expect_refusal(set("coupling.stifness_nm_per_rad=3e4"), 2, HasSubstr("did you mean"));
  expect_refusal(set("coupling"), 2, HasSubstr("must be section.key=value"));
  expect_refusal(set("coupling.stiffness_nm_per_rad=stiff"), 2,
                 HasSubstr("must be a number, [from, to] or a text in quotes"));
  expect_refusal(set("control.band_stop.1.frequency_hz=300"), 2, HasSubstr("band_stop"));
  expect_refusal(set("screw.lead_mm.x=3"), 2, HasSubstr("is not a section"));
  expect_refusal({"what-if", folder / "none.toml"}, 1, HasSubstr("none.toml"));
  expect_refusal({"what-if", folder.write("bad.toml", "[screw]\n")}, 1,
                 AllOf(HasSubstr("bad.toml"), HasSubstr("screw.diameter_mm: is missing")));
  const std::string far =
      folder.write("far.csv",
                   "time[s],X.command[mm]\n0,0\n0.001,1\n0.002,2\n0.003,4\n0.004,700\n0.005,700\n"
                   "0.006,700\n0.007,700\n0.008,700\n0.009,700\n0.010,700\n0.011,700\n");
  expect_refusal({"what-if", kRig, "--motion", far}, 2, HasSubstr("go together"));
  expect_refusal({"what-if", kRig, "--motion", far, "--axis", "X", "--json", "-"}, 1,
                 AllOf(HasSubstr("X goes from 0 to 700 mm"), HasSubstr("[200, 650]")));
}

TEST(FitAxis, WritesAnAxisThatWhatIfReads) {
  const Folder folder;
  // The response of the example, starting from a softer coupling: one line of closed_velocity_loop
  // each.
  std::string response = "frequency[Hz],gain[dB],phase[deg]\n";
  for (int k = 0; k < 40; ++k) {
    const double f = 5.0 * std::pow(1.2, 0.5 * k);
    response += std::to_string(f) + "," +
                std::to_string(-20.0 * std::log10(std::hypot(1.0, f / 70.0))) + "," +
                std::to_string(-std::atan(f / 70.0) * 180.0 / M_PI) + "\n";
  }
  const Answer answer =
      servotwin_says({"fit-axis", kRig, "--response", folder.write("r.csv", response), "--out",
                      folder / "fitted.toml"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, AllOf(HasSubstr("stage 1"), HasSubstr("coupling.stiffness")));
  const FeedAxisParts before = read_feed_axis(kRig), after = read_feed_axis(folder / "fitted.toml");
  EXPECT_NE(after.coupling.spring.stiffness, before.coupling.spring.stiffness);
  EXPECT_DOUBLE_EQ(after.cover->stiffness, before.cover->stiffness);
  EXPECT_DOUBLE_EQ(after.screw.length, before.screw.length);
}

TEST(FitAxis, RefusesWhatCannotBe) {
  const Folder folder;
  expect_refusal({"fit-axis", kRig}, 2, HasSubstr("nothing to fit to"));
  expect_refusal({"fit-axis", kRig, "--bare", "x.csv"}, 2, HasSubstr("--axis"));
  const std::string head = "frequency[Hz],gain[dB],phase[deg]\n";
  const auto response = [&](const std::string& text) {
    return std::vector<std::string>{"fit-axis", kRig, "--response", folder.write("r.csv", text)};
  };
  expect_refusal(response(head + "10,0,0\n20,x,0\n"), 1,
                 AllOf(HasSubstr("r.csv:3: '20,x,0'"), HasSubstr("'x', which is not a number")));
  expect_refusal(response(head + "10,0,0\n9,0,0\n"), 1, HasSubstr("a higher frequency"));
  expect_refusal(response(head + "10,0\n"), 1, HasSubstr("must be frequency[Hz]"));
  expect_refusal(response(head + "10,0,0\n"), 1, HasSubstr("10 frequencies or more"));
}

}  // namespace
}  // namespace servotwin
