// servotwin characterize and sequence, as a user runs them, on tables with a known friction.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <regex>

#include "program.h"
#include "recordings.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

constexpr double kMass = 40.0;

struct Friction {
  double plus, minus, viscous;
};

/// N at a velocity, fully developed at 0.1 mm/s.
double friction(const Friction& f, double v) {
  const double level = std::min(1.0, std::abs(v) / 1e-4);
  return (v >= 0.0 ? f.plus : -f.minus) * level + f.viscous * v;
}

/// Ramps back and forth at these velocities with 0.2 s of rest between, at 1 kHz; the encoder
/// follows the command, the torque is friction, and the force of acceleration at the kinks.
std::string ramps_table(const std::vector<double>& velocities, const Friction& f,
                        const std::string& unit = "N") {
  std::string out = "time[s],X.command[mm],X.actual[mm],X.torque[" + unit + "]\n";
  double x = 0.0;
  int row = 0;
  const auto add = [&](double v, double a) {
    out += cell(1e-3 * row++) + "," + cell(1e3 * x) + "," + cell(1e3 * x) + "," +
           cell(friction(f, v) + kMass * a) + "\n";
    x += 1e-3 * v + 0.5e-6 * a;
  };
  for (const double speed : velocities) {
    for (const double v : {speed, -speed}) {
      for (int k = 0; k < 200; ++k) add(0.0, 0.0);
      for (int k = 0; k < 50; ++k) add(v * k / 50.0, v / 0.05);
      for (int k = 0; k < 400; ++k) add(v, 0.0);
      for (int k = 0; k < 50; ++k) add(v * (50 - k) / 50.0, -v / 0.05);
    }
  }
  return out;
}

const std::vector<double> kSpeeds{5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.015, 0.03, 0.05, 0.08, 0.1, 0.12};
const Friction kFriction{30.0, 36.0, 120.0};

/// The same ramps as the axis of this model follows them, with the torque of the motion it makes.
std::string followed_table(const std::vector<double>& velocities, const Friction& f,
                           const Model& axis) {
  Segment s;
  s.sample_time_s = 1e-3;
  std::vector<double> x{0.0};
  for (const double speed : velocities) {
    for (const double v : {speed, -speed}) {
      const auto go = [&](int count, auto&& velocity) {
        for (int k = 0; k < count; ++k) x.push_back(x.back() + 1e-3 * velocity(k));
      };
      go(200, [](int) { return 0.0; });
      go(50, [v](int k) { return v * k / 50.0; });
      go(400, [v](int) { return v; });
      go(50, [v](int k) { return v * (50 - k) / 50.0; });
    }
  }
  s.command = Eigen::Map<Eigen::ArrayXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  s.actual = s.command - simulate(axis, s);
  std::string out = "time[s],X.command[mm],X.actual[mm],X.torque[N]\n";
  for (Eigen::Index k = 1; k + 1 < s.size(); ++k) {
    const double v = (s.actual(k + 1) - s.actual(k - 1)) / 2e-3;
    const double a = (s.actual(k + 1) - 2.0 * s.actual(k) + s.actual(k - 1)) / 1e-6;
    out += cell(1e-3 * static_cast<double>(k)) + "," + cell(1e3 * s.command(k)) + "," +
           cell(1e3 * s.actual(k)) + "," + cell(friction(f, v) + kMass * a) + "\n";
  }
  return out;
}

TEST(Characterize, FindsFrictionOnRampsAndPutsItIntoTheModel) {
  const Folder folder;
  // An axis with the friction of kFriction (without the viscous share, which the poles contain),
  // and a model with wrong friction.
  ModelRecord truth = known_axis(), wrong = truth;
  truth.model.effects[0].coefficient[0] = 0.5 * (kFriction.plus + kFriction.minus) / kMass;
  truth.model.effects[0].shape[0] = 1e-4;
  truth.model.effects[1].coefficient[0] = 0.5 * (kFriction.plus - kFriction.minus) / kMass;
  wrong.model.effects[0].coefficient[0] = 0.2;
  const std::string file =
      folder.write("ramps.csv", followed_table(kSpeeds, kFriction, truth.model));
  const std::string model = folder / "model.json", result = folder / "out.json",
                    plot = folder / "plot.svg";
  write_model(model, wrong);
  const double before = wrong.model.effects[0].coefficient[0];
  const Answer answer = servotwin_says(
      {"characterize", file, "--axis", "X", "--model", model, "--json", result, "--plot", plot});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("22 at 0.474 to 120 mm/s"));
  EXPECT_THAT(answer.out, HasSubstr("none: every ramp moves steadily"));

  const json found = json::parse(content_of(result));
  EXPECT_EQ(found["schema"], "servotwin.characterization/1");
  EXPECT_EQ(found["ramps"].size(), 22U);
  ASSERT_EQ(found["trials"].size(), 4U);
  for (const json& pair : found["ramps"]) {
    const double v = pair["velocity"];
    EXPECT_NEAR(pair["torque"].get<double>(), friction(kFriction, v), 0.05);
  }
  EXPECT_NEAR(found["moved_mass"]["value"].get<double>(), kMass, 0.05 * kMass);
  EXPECT_EQ(found["moved_mass"]["unit"], "kg");
  // The simplest sufficient model, with which the table was made.
  EXPECT_EQ(found["trials"][0]["chosen"], true);
  EXPECT_LT(found["trials"][0]["held_out"]["rms"].get<double>(), 0.05);
  const json& symmetric = found["effects"][0]["parameters"];
  EXPECT_NEAR(symmetric["coulomb"]["value"].get<double>(), 33.0, 0.05);
  EXPECT_NEAR(symmetric["viscous"]["value"].get<double>(), 120.0, 1.0);
  EXPECT_NEAR(found["effects"][1]["parameters"]["coulomb_difference"]["value"].get<double>(), -3.0,
              0.05);
  EXPECT_THAT(content_of(plot), HasSubstr("</svg>"));

  // Per moved mass, without the viscous share that the poles contain.
  const json written = json::parse(content_of(model));
  const std::string chosen = found["effects"][0]["id"];
  bool there = false;
  for (const json& effect : written["effects"]) {
    EXPECT_NE(effect["parameters"].value("coulomb", json::object()).value("value", 0.0), before);
    there = there || effect["id"] == chosen;
  }
  EXPECT_TRUE(there);
  EXPECT_TRUE(written["fit"]["holdout"]["rms_m"].is_null());
  EXPECT_THAT(answer.out, HasSubstr("new model "));
  // Viscous friction is in the poles, equal in both directions.
  for (const json& effect : written["effects"]) {
    for (const char* viscous : {"viscous", "viscous_plus", "viscous_minus"}) {
      if (effect["parameters"].contains(viscous)) {
        EXPECT_NEAR(effect["parameters"][viscous]["value"].get<double>(), 0.0, 0.02) << viscous;
      }
    }
  }
  EXPECT_EQ(servotwin_says({"simulate", file, "--model", model}).status, 0);
}

TEST(Characterize, FitsInertiaAndFrictionToAnyMotion) {
  const Folder folder;
  const std::string file = folder.write("ramps.csv", ramps_table(kSpeeds, kFriction));
  const std::string result = folder / "out.json";
  const Answer answer = servotwin_says({"characterize", file, "--axis", "X", "--method", "motion",
                                        "--friction", "coulomb_friction", "--json", result});
  ASSERT_EQ(answer.status, 0) << answer;
  const json found = json::parse(content_of(result));
  EXPECT_NEAR(found["mass"]["value"].get<double>(), kMass, 0.03 * kMass);
  ASSERT_EQ(found["effects"].size(), 2U);
  const json& symmetric = found["effects"][0]["parameters"];
  EXPECT_NEAR(symmetric["coulomb"]["value"].get<double>(), 33.0, 1.0);
  EXPECT_NEAR(symmetric["viscous"]["value"].get<double>(), 120.0, 12.0);
  EXPECT_LT(found["trials"][0]["held_out"]["relative"].get<double>(), 0.2);
}

TEST(Characterize, SaysWhatIsMissing) {
  const Folder folder;
  const std::string still = folder.write(
      "no_torque.csv", "time[s],X.command[mm],X.actual[mm]\n" + [] {
        std::string rows;
        for (int k = 0; k < 2000; ++k)
          rows += cell(1e-3 * k) + "," + cell(std::sin(0.01 * k)) + "," + cell(std::sin(0.01 * k)) +
                  "\n";
        return rows;
      }());
  Answer answer = servotwin_says({"characterize", still, "--axis", "X"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("has no torque; add a column X.torque"));

  const std::string few = folder.write("few.csv", ramps_table({1e-3, 1e-2}, kFriction));
  answer = servotwin_says({"characterize", few, "--axis", "X"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("2 steady ramps in the positive direction, needs at least 8"));

  answer = servotwin_says({"characterize", few, "--axis", "X", "--lead", "20"});
  EXPECT_EQ(answer.status, 2);
  EXPECT_THAT(answer.err, HasSubstr("--lead needs a linear axis whose torque is in Nm"));
  answer = servotwin_says({"characterize", few, "--axis", "X", "--method", "guess"});
  EXPECT_EQ(answer.status, 2);
  answer = servotwin_says(
      {"characterize", few, "--axis", "X", "--method", "reversals", "--travel", "1e9"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("there is no reversal"));
}

TEST(Sequence, FindsWhatThePartAddsItsShareAndItsDirections) {
  const Folder folder;
  const std::vector<double> speeds{0.02, 0.05, 0.1, 0.15};
  const Friction with{30.0 + 20.0, 36.0 + 26.0, 120.0};
  const std::string bare = folder.write("bare.csv", ramps_table(speeds, kFriction)),
                    covered = folder.write("covered.csv", ramps_table(speeds, with)),
                    other = folder.write("other.csv", ramps_table({0.03, 0.07}, with)),
                    result = folder / "out.json", plot = folder / "plot.svg";
  const Answer answer =
      servotwin_says({"sequence", "--bare", bare, "--covered", covered, "--axis", "X", "--friction",
                      "stribeck", "--verify", other, "--json", result, "--plot", plot});
  ASSERT_EQ(answer.status, 0) << answer;
  const json found = json::parse(content_of(result));
  EXPECT_EQ(found["schema"], "servotwin.sequence/1");
  EXPECT_NEAR(found["direction_ratio"].get<double>(), 1.3, 0.02);
  ASSERT_EQ(found["share"].size(), 12U);  // two directions of six speeds
  for (const json& share : found["share"]) {
    const double v = share["velocity"];
    const double truth = (friction(with, v) - friction(kFriction, v)) / friction(with, v);
    EXPECT_NEAR(share["measured"].get<double>(), truth, 0.01) << v;
    EXPECT_NEAR(share["modelled"].get<double>(), truth, 0.02) << v;
  }
  ASSERT_EQ(found["verified"].size(), 1U);
  EXPECT_LT(found["verified"][0]["relative"].get<double>(), 0.1);
  EXPECT_THAT(content_of(plot), HasSubstr("share of the torque at steady speed"));
}

TEST(Characterize, LeavesAModelAloneThatItsFrictionWouldMakeWorse) {
  const Folder folder;
  const std::string file = folder.write("ramps.csv", ramps_table(kSpeeds, kFriction));
  const std::string model = folder / "model.json", result = folder / "out.json";
  write_model(model, known_axis());
  const std::string content = content_of(model);
  Answer answer =
      servotwin_says({"characterize", file, "--axis", "X", "--model", model, "--json", result});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("with this friction the model predicts worse"));
  write_model(folder / "y.json", known_axis("Y"));
  answer = servotwin_says({"characterize", file, "--axis", "X", "--model", folder / "y.json"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("is the model of axis Y, not of X"));
  EXPECT_EQ(content_of(model), content);
  EXPECT_THAT(folder.list(), Not(Contains("out.json")));
  answer =
      servotwin_says({"characterize", file, "--axis", "X", "--json", result, "--plot", result});
  EXPECT_EQ(answer.status, 2);
  EXPECT_THAT(answer.err, HasSubstr("is named for two results"));
}

TEST(Characterize, NoticesATorqueThatIsTurnedRoundOrDead) {
  const Folder folder;
  std::string table = ramps_table(kSpeeds, kFriction);
  const Friction turned{-kFriction.plus, -kFriction.minus, -kFriction.viscous};
  const std::string file = folder.write("turned.csv", ramps_table(kSpeeds, turned));
  Answer answer = servotwin_says({"characterize", file, "--axis", "X"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("the torque acts against the motion"));
  EXPECT_THAT(answer.err, HasSubstr("--invert-torque"));
  answer = servotwin_says({"characterize", file, "--axis", "X", "--invert-torque"});
  EXPECT_EQ(answer.status, 0) << answer;
  const std::size_t rows = table.find('\n') + 1;
  const std::string dead = folder.write(
      "dead.csv", table.substr(0, rows) +
                      std::regex_replace(table.substr(rows), std::regex(",[^,\n]*\n"), ",1.5\n"));
  answer = servotwin_says({"characterize", dead, "--axis", "X", "--to", "3"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("X.torque never changes"));
}

TEST(Sequence, NoticesRecordingsThatAreExchanged) {
  const Folder folder;
  const std::vector<double> speeds{0.02, 0.05, 0.1, 0.15};
  const std::string bare = folder.write("bare.csv", ramps_table(speeds, kFriction)),
                    covered = folder.write("covered.csv", ramps_table(speeds, {50.0, 62.0, 120.0}));
  const Answer answer = servotwin_says(
      {"sequence", "--bare", covered, "--covered", bare, "--axis", "X", "--friction", "stribeck"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("are --bare and --covered exchanged"));
}

TEST(Sequence, RefusesRecordingsThatDoNotBelongTogether) {
  const Folder folder;
  const std::string newton = folder.write("n.csv", ramps_table({0.02, 0.05}, kFriction)),
                    volt = folder.write("v.csv", ramps_table({0.02, 0.05}, kFriction, "V"));
  Answer answer = servotwin_says({"sequence", "--bare", newton, "--covered", volt, "--axis", "X"});
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.err, HasSubstr("its torque is in V, that of " + newton + " in N"));
  answer = servotwin_says({"sequence", "--bare", newton, "--axis", "X"});
  EXPECT_EQ(answer.status, 2);
}

}  // namespace
}  // namespace servotwin
