// servotwin frequency-response, as a user runs it, on tables of a known oscillator.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "program.h"
#include "recordings.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

constexpr double kResonance_hz = 45.0, kResonanceDamping = 0.1;

/// A wandering command [mm] and an axis that follows it as a pair of poles at kResonance_hz, by the
/// exact step for a command that is held; the torque is their distance.
struct Recorded {
  std::vector<double> command, actual;
};
Recorded motion(int rows, double encoder_noise = 0.0) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  const double h = 1e-3, w = kTwoPi * kResonance_hz;
  const double damped = w * std::sqrt(1.0 - kResonanceDamping * kResonanceDamping),
               decay = std::exp(-kResonanceDamping * w * h);
  const double c = std::cos(damped * h), s = std::sin(damped * h);
  Recorded out;
  double r = 0.0, x = 0.0, v = 0.0;
  for (int k = 0; k < rows; ++k) {
    r += 0.01 * normal(random);
    out.command.push_back(r);
    out.actual.push_back(x + encoder_noise * normal(random));
    const double from = x - r, slope = (v + kResonanceDamping * w * from) / damped;
    x = r + decay * (from * c + slope * s);
    v = decay * (v * c - (w * w * from + kResonanceDamping * w * v) / damped * s);
  }
  return out;
}

std::string table(const std::string& header, const std::vector<std::vector<double>>& columns) {
  std::string out = header + "\n";
  for (std::size_t k = 0; k < columns[0].size(); ++k) {
    out += cell(1e-3 * static_cast<double>(k));
    for (const auto& column : columns) out += "," + cell(column[k]);
    out += "\n";
  }
  return out;
}

const std::string kHeader = "time[s],X.command[mm],X.actual[mm]";

TEST(FrequencyResponseTool, FindsTheModeOfAnAxis) {
  const Folder folder;
  const Recorded m = motion(30000, 1e-4);
  const std::string file = folder.write("rec.csv", table(kHeader, {m.command, m.actual}));
  const Answer answer = servotwin_says({"frequency-response", file, "--axis", "X", "--json",
                                        folder / "r.json", "--plot", folder / "r.svg"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("averages    28 windows of 2 s"));
  EXPECT_THAT(answer.out, HasSubstr("response    command to position"));
  EXPECT_THAT(answer.out, HasSubstr("coherent  above 0.8: 0.5 to "));
  EXPECT_THAT(answer.out, HasSubstr("mode        45."));
  EXPECT_THAT(answer.out, Not(HasSubstr("declined")));
  const json result = json::parse(content_of(folder / "r.json"));
  EXPECT_EQ(result["schema"], "servotwin.frequency-response/1");
  EXPECT_TRUE(result["declined"].is_null());
  const json& pole = result["fit"]["poles"][0];
  EXPECT_NEAR(pole["frequency_hz"], kResonance_hz,
              4.0 * pole["frequency_sd_hz"].get<double>() + 0.01);
  EXPECT_NEAR(pole["damping"], kResonanceDamping, 4.0 * pole["damping_sd"].get<double>() + 0.001);
  // At 20 Hz, from the closed form; the command is held, half a sample later.
  const json& one = result["responses"][0];
  EXPECT_DOUBLE_EQ(result["frequency_hz"][39], 20.0);
  const std::complex<double> s(0.0, 20.0 / kResonance_hz), found(one["real"][39], one["imag"][39]);
  const std::complex<double> truth =
      std::polar(1.0, -kTwoPi * 20.0 * 5e-4) / (1.0 + 2.0 * kResonanceDamping * s + s * s);
  EXPECT_LT(std::abs(found - truth), 4.0 * one["sd"][39].get<double>() + 0.005);
  EXPECT_THAT(content_of(folder / "r.svg"), HasSubstr("<polygon"));
}

TEST(FrequencyResponseTool, TakesColumnsOfAnyFileAndRepetitions) {
  const Folder folder;
  const Recorded m = motion(8000);
  std::vector<double> minus(m.actual);
  for (double& x : minus) x = -x;
  const std::string file =
      folder.write("rec.csv", table("t_s,node 62,node 61,again", {m.command, m.actual, minus}));
  const Answer one = servotwin_says(
      {"frequency-response", file, "--input", "node 62", "--output", "node 61", "--json", "-"});
  ASSERT_EQ(one.status, 0) << one;
  const Answer two =
      servotwin_says({"frequency-response", file, "--input", "node 62", "--output", "node 61",
                      "--input", "node 62", "--output", "again", "--json", "-"});
  ASSERT_EQ(two.status, 0) << two;
  const json first = json::parse(one.out), both = json::parse(two.out);
  EXPECT_TRUE(first["axis"].is_null());
  EXPECT_NEAR(first["fit"]["poles"][0]["frequency_hz"], kResonance_hz, 0.1);
  // The second has the opposite sign: the mean of both is zero.
  EXPECT_EQ(both["windows"].get<int>() % 2, 0);
  EXPECT_TRUE(both["fit"].is_null());
  EXPECT_LT(std::abs(both["responses"][0]["real"][20].get<double>()), 1e-9);
}

TEST(FrequencyResponseTool, TellsTheAxesApart) {
  const Folder folder;
  const Recorded m = motion(30000, 1e-3);
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  std::vector<double> other;
  double own = 0.0;
  for (const double x : m.command) {
    own += 0.01 * normal(random);
    other.push_back(x + own);
  }
  const std::string file =
      folder.write("rec.csv", table(kHeader + ",Y.command[mm]", {m.command, m.actual, other}));
  const Answer answer = servotwin_says({"frequency-response", file, "--axis", "X", "--input",
                                        "command,Y.command", "--json", folder / "r.json"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("response    Y.command to position"));
  const json result = json::parse(content_of(folder / "r.json"));
  int apart = 0, chance = 0;
  for (std::size_t i = 1; i < 100; ++i) {  // up to 50 Hz
    apart += result["responses"][0]["significant"][i].get<bool>() ? 1 : 0;
    chance += result["responses"][1]["significant"][i].get<bool>() ? 1 : 0;
  }
  EXPECT_EQ(apart, 99);
  EXPECT_LT(chance, 8);  // 1 in a hundred
}

TEST(FrequencyResponseTool, DeclinesWhereThereIsNothing) {
  const Folder folder;
  Recorded m = motion(20000);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (double& x : m.actual) x = normal(random);
  const std::string file = folder.write("rec.csv", table(kHeader, {m.command, m.actual}));
  const Answer answer = servotwin_says({"frequency-response", file, "--axis", "X", "--plot",
                                        folder / "r.svg", "--json", folder / "r.json"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("declined    no fit: only "));
  EXPECT_THAT(answer.out, Not(HasSubstr("mode  ")));
  EXPECT_THAT(json::parse(content_of(folder / "r.json"))["declined"].get<std::string>(),
              HasSubstr("have significant coherence"));
}

TEST(FrequencyResponseTool, AnInputThatStandsStillExcitesNothing) {
  const Folder folder;
  const Recorded m = motion(5000);
  const std::string file = folder.write(
      "rec.csv", table(kHeader, {std::vector<double>(m.command.size(), 1.0), m.actual}));
  const Answer answer = servotwin_says({"frequency-response", file, "--axis", "X"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("excited   not at all: the input is constant"));
  EXPECT_THAT(answer.out, HasSubstr("declined    no fit"));
}

struct Wrong {
  std::vector<std::string> options;
  int status;
  std::string says;
};

TEST(FrequencyResponseTool, RefusesInOneLine) {
  const Folder folder;
  const Recorded m = motion(3000);
  const std::string file = folder.write("rec.csv", table(kHeader, {m.command, m.actual}));
  for (const auto& [options, status, says] : std::vector<Wrong>{
           {{}, 2, "give --axis, or columns of the file as --input and --output"},
           {{"--input", "X.command[mm]"}, 2, "one of each per repetition"},
           {{"--input", "a", "--output", "X.actual[mm]"}, 1, "no column 'a'"},
           {{"--input", "a", "--output", "b", "--columns", "X.command=a[m]"},
            2,
            "--columns needs --axis"},
           {{"--axis", "Z"}, 1, "no axis 'Z'; it has X"},
           {{"--axis", "X", "--input", "torqe"}, 2, "did you mean 'torque'?"},
           {{"--axis", "X", "--input", "torque"}, 1, "X has no torque"},
           {{"--axis", "X", "--input", "Y.command"}, 1, "no axis 'Y'"},
           {{"--axis", "X", "--output", "command"}, 2, "--input and --output are both 'command'"},
           {{"--axis", "X", "--output", "error", "--output", "position"}, 2, "given once"},
           {{"--axis", "X", "--order", "17"}, 2, "must be a whole number from 1 to 16"},
           {{"--axis", "X", "--window", "0"}, 2, "--window"},
           {{"--axis", "X", "--window", "2"}, 1, "1 window of 2 s gives 1.0 independent averages"},
           {{"--axis", "X", "--window", "0.005"}, 1, "has 4 samples, it needs 16"},
           {{"--axis", "X", "--delay", "nan"}, 2, "must be a number from 0 to 1"}}) {
    std::vector<std::string> arguments{"frequency-response", file};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Answer answer = servotwin_says(arguments);
    EXPECT_EQ(answer.status, status) << answer;
    ASSERT_EQ(answer.complaints().size(), 1u) << answer;
    EXPECT_THAT(answer.complaints()[0], HasSubstr(says));
  }
}

}  // namespace
}  // namespace servotwin
