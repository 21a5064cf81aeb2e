#include "recordings.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "twin/two_pi.h"

namespace servotwin {

ModelRecord known_axis(const std::string& name) {
  ModelRecord record;
  record.axis = name;
  record.version = 1;
  record.created = "2024-01-01T00:00:00Z";
  record.source = "known";
  record.method = "pole-search";
  record.motion = {0.2, 5.0};
  Model& model = record.model;
  model.sample_time_s = 0.001;
  model.loop.order = 2;
  model.loop.denominator = denominator_of({0.0, 2 * std::numbers::pi * 25.0, 0.45}, 2);
  model.loop.numerator = {0.98, 120.0, 0.0};
  Effect friction = make_effect<CoulombFriction>();
  friction.coefficient[0] = 0.25;
  Effect constant = make_effect<ConstantForce>();
  constant.coefficient[0] = -0.04;
  model.effects = {friction, constant};
  record.effect_deviations.resize(2);
  return record;
}

void write_model(const std::string& file, const ModelRecord& record) {
  std::ofstream(file) << to_json(record).dump(2);
}

double rich_motion(double t) {
  const double swell = 0.5 - 0.5 * std::cos(kTwoPi * t / 12.0);
  return swell * (0.02 * std::sin(kTwoPi * 0.5 * t) + 0.002 * std::sin(kTwoPi * 3.1 * t) +
                  0.0004 * std::sin(kTwoPi * 11.0 * t));
}

std::string cell(double value) {
  std::array<char, 32> digits{};
  return {digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr};
}

std::string command_table(double seconds, const std::function<double(double)>& motion) {
  std::string table = "time[s],X.command[mm]\n";
  for (int k = 0; k <= std::lround(seconds * 1000.0); ++k) {
    table += cell(k / 1000.0) + "," + cell(1e3 * motion(k / 1000.0)) + "\n";
  }
  return table;
}

std::string recording(int rows, const std::function<std::string(int)>& command,
                      const std::function<std::string(int)>& actual) {
  std::string table = "time[s],X.command[mm],X.actual[mm]\n";
  for (int k = 0; k < rows; ++k)
    table += cell(k / 1000.0) + "," + command(k) + "," + actual(k) + "\n";
  return table;
}

}  // namespace servotwin
