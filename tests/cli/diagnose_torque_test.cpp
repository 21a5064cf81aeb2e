// servotwin diagnose on a test rig: position and force, and no command.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using testing::HasSubstr;

/// +-10 mm back and forth at increasing speed; 300 N through 2 mm of play and 500 N/mm.
std::string rig_table() {
  std::string out = "time[s],R.actual[mm],R.torque[N]\n";
  for (int k = 0; k < 12'000; ++k) {
    const double t = 1e-3 * k, phase = 0.8 * t + 0.04 * t * t, half = std::floor(phase);
    const double sign = std::fmod(half, 2.0) == 0.0 ? 1.0 : -1.0;
    const double travel = 0.01 * (1.0 - std::cos(std::numbers::pi * (phase - half)));
    const double released = travel - 300.0 / 5e5;
    const double force = released < 0.0     ? 5e5 * released
                         : released < 0.002 ? 0.0
                                            : std::min(300.0, 5e5 * (released - 0.002));
    out += cell(t) + "," + cell(sign * (1e3 * travel - 10.0)) + "," + cell(sign * force) + "\n";
  }
  return out;
}

TEST(DiagnoseTorque, APlayIsFoundWithoutACommand) {
  const Folder folder;
  const std::string file = folder.write("rig.csv", rig_table());
  const Answer answer = servotwin_says({"diagnose", file, "--axis", "R", "--json",
                                        folder / "d.json", "--report", folder / "d.html"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out,
              HasSubstr("alone: the recording has position and torque, but no command"));
  const auto result = nlohmann::json::parse(content_of(folder / "d.json"));
  EXPECT_EQ(result["schema"], "servotwin.diagnosis/1");
  EXPECT_EQ(result["verdict"], "explained");
  ASSERT_FALSE(result["causes"].empty()) << answer;
  EXPECT_EQ(result["causes"][0]["id"], "backlash");
  EXPECT_NEAR(result["causes"][0]["parameters"]["width_m"].get<double>(), 0.002, 1e-4);
  EXPECT_THAT(content_of(folder / "d.html"), HasSubstr("torque over position"));
  EXPECT_THAT(answer.out, HasSubstr("The torque of axis R shows play (backlash) (width "));
  EXPECT_THAT(answer.out, HasSubstr(" mm"));
}

/// A servo axis at 1 kHz whose command and encoder are written as `columns` says, with a torque.
std::string servo_table(const char* columns, double scale, int every) {
  std::string out = "time[s]," + std::string(columns) + ",R.torque[N]\n";
  const auto place = [](double t) { return 50.0 * std::sin(2.0 * t) + 10.0 * std::sin(9.0 * t); };
  for (int k = 0; k < 12'000; k += every) {
    const double t = 1e-3 * k;
    out += cell(t) + "," + cell(scale * place(t)) + "," + cell(scale * place(t - 0.01)) + "," +
           cell(std::cos(2.0 * t)) + "\n";
  }
  return out;
}

// What is wrong with the motion is wrong for the torque as well.
TEST(DiagnoseTorque, ARecordingThatCannotBeUsedIsNotDiagnosedByItsTorque) {
  const Folder folder;
  const auto says = [&](const std::string& table) {
    return servotwin_says({"diagnose", folder.write("r.csv", table), "--axis", "R"});
  };
  const Answer metres = says(servo_table("R.command[m],R.actual[m]", 1.0, 1));
  EXPECT_EQ(metres.status, 1) << metres;
  EXPECT_THAT(metres.err, HasSubstr("is its unit mm and not m?"));
  const Answer exchanged = says(servo_table("R.actual[mm],R.command[mm]", 1.0, 1));
  EXPECT_EQ(exchanged.status, 1) << exchanged;
  EXPECT_THAT(exchanged.err, HasSubstr("the two columns may be exchanged"));
  const Answer slow = says(servo_table("R.command[mm],R.actual[mm]", 1.0, 100));
  EXPECT_EQ(slow.status, 1) << slow;
  EXPECT_THAT(slow.err, HasSubstr("is too slow to identify"));
  for (const Answer* one : {&metres, &exchanged, &slow})
    EXPECT_THAT(one->out, testing::Not(HasSubstr("by torque")));
}

TEST(DiagnoseTorque, WhatShowsNothingInEitherWaySaysBothReasons) {
  std::string table = "time[s],R.command[mm],R.actual[mm],R.torque[N]\n";
  for (int k = 0; k < 200; ++k) table += cell(1e-3 * k) + ",0,0," + cell(k % 3) + "\n";
  const Folder folder;
  const Answer answer =
      servotwin_says({"diagnose", folder.write("short.csv", table), "--axis", "R"});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("R.command does not move"));
  EXPECT_THAT(answer.err,
              HasSubstr("; a diagnosis by torque fails too: there is no segment of 262 samples"));
}

TEST(DiagnoseTorque, WhatNeedsACommandSaysSo) {
  const Folder folder;
  const std::string file = folder.write("rig.csv", rig_table());
  const Answer identify = servotwin_says({"identify", file, "--axis", "R"});
  EXPECT_EQ(identify.status, 1) << identify;
  EXPECT_THAT(identify.err,
              HasSubstr("R.command has no values; the setpoint of the axis is needed"));
  const Answer model =
      servotwin_says({"diagnose", file, "--axis", "R", "--extended-model", folder / "m.json"});
  EXPECT_EQ(model.status, 1) << model;
  EXPECT_THAT(model.err, HasSubstr("there is no model of the position loop"));

  const std::string bare = folder.write("bare.csv", "time[s],R.actual[mm]\n0,1\n1,2\n");
  const Answer nothing = servotwin_says({"diagnose", bare, "--axis", "R"});
  EXPECT_EQ(nothing.status, 1) << nothing;
  EXPECT_THAT(nothing.err, HasSubstr("no column is the command of an axis"));
}

}  // namespace
}  // namespace servotwin
