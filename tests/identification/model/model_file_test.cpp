#include "identification/model/model_file.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using nlohmann::json;
using test::expect_error;

ModelRecord random_record(std::mt19937_64& rng) {
  std::uniform_real_distribution<double> u(0.1, 0.9);
  ModelRecord record;
  record.axis = "X";
  record.version = 17;
  record.parent = 16;
  record.created = "2026-11-21T10:00:00Z";
  record.method = "pole-search";
  record.model.sample_time_s = 1e-3 * (1.0 + u(rng));
  Loop& loop = record.model.loop;
  loop.order = u(rng) < 0.5 ? 2 : 3;
  loop.denominator = denominator_of({100.0 * u(rng), 300.0 * u(rng), 1.5 * u(rng)}, loop.order);
  for (int i = 0; i < loop.order; ++i)
    loop.numerator[static_cast<std::size_t>(i)] = u(rng) * std::pow(100.0, i);
  Effect friction = make_effect<CoulombFriction>();
  friction.shape[0] = 1e-3 * u(rng);
  friction.coefficient = {u(rng), 0.0};
  Effect constant = make_effect<ConstantForce>();
  constant.coefficient[0] = -u(rng);
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 0.01 * u(rng);
  record.model.effects = {friction, constant, delay};
  record.effect_deviations.resize(3);
  if (u(rng) < 0.8) {
    LoopCovariance root = LoopCovariance::NullaryExpr([&] { return u(rng); });
    if (loop.order == 2) root.row(0).setZero(), root.row(5).setZero();
    const LoopCovariance square = root * root.transpose();
    record.loop_covariance = 0.5 * (square + square.transpose());
  }
  if (u(rng) < 0.8) {
    record.model.loop.modes = {{280.0 * u(rng), 0.05 * u(rng), u(rng), u(rng), 1e-4, u(rng)}};
    record.mode_deviations = {{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, kAbsent, kAbsent, kAbsent}};
    if (u(rng) < 0.8) {
      record.model.loop.travel = {-0.01, 0.01 * u(rng)};
      Mode& mode = record.model.loop.modes[0];
      mode.slope = 0.3 * u(rng), mode.curve = -0.1 * u(rng), mode.zeta_slope = 0.5 * u(rng);
      record.mode_deviations = {{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0}};
    }
  }
  if (u(rng) < 0.8) {
    record.torque = MotorTorque{"Nm", {u(rng), -u(rng), u(rng)}, {1e-3 * u(rng)}};
    record.torque->lag.filter = u(rng) < 0.5;
    record.torque->holdout_rms = u(rng);
  }
  record.training = {1e-6 * u(rng), 1e-5};
  record.holdout = {1e-6 * u(rng), 1e-5};
  record.source = "test";
  return record;
}

json valid() {
  std::mt19937_64 rng{4};
  return to_json(random_record(rng));
}

TEST(ModelFile, ReadsBackToTheSamePredictionsBitForBit) {
  const test::TemporaryDirectory directory;
  std::mt19937_64 rng{8};
  for (int round = 0; round < 50; ++round) {
    const ModelRecord record = random_record(rng);
    const ModelRecord back = read_model(directory.file("m.json", to_json(record).dump(2)));
    Twin a(record.model), b(back.model);
    for (int i = 0; i < 500; ++i) {
      const double command = 0.01 * std::sin(0.02 * i) * i / 500.0;
      ASSERT_EQ(a.follow(command), b.follow(command)) << round << " " << i;
    }
    EXPECT_EQ(to_json(record), to_json(back));
    EXPECT_EQ(record.loop_covariance, back.loop_covariance);
  }
}

TEST(ModelFile, ATruncatedFileIsRefusedAtEveryByte) {
  const test::TemporaryDirectory directory;
  const std::string text = valid().dump(2);
  for (std::size_t length = 0; length + 1 < text.size(); ++length) {
    const auto file = directory.file("m.json", text.substr(0, length));
    expect_error<std::runtime_error>([&] { (void)read_model(file); }, {"m.json", "model file"});
  }
}

TEST(ModelFile, RefusalsNameTheField) {
  const auto refused = [](const char* pointer, const json& value,
                          std::initializer_list<const char*> parts) {
    json j = valid();
    j[json::json_pointer(pointer)] = value;
    SCOPED_TRACE(pointer);
    expect_error<std::runtime_error>([&] { (void)model_from_json(j); }, parts);
  };
  refused("/schema", "servotwin.model/2", {"schema", "servotwin.model/2", "servotwin.model/1"});
  refused("/schema", 3, {"schema", "string"});
  refused("/axis", "", {"axis", "empty"});
  refused("/kind", "round", {"kind", "round"});
  refused("/sample_time_s", -1.0, {"sample_time_s", "-1", "positive"});
  refused("/sample_time_s", 1e-300, {"sample_time_s", "1e-300", "outside 1e-06 .. 1"});
  refused("/sample_time_s", 1e300, {"sample_time_s", "1e+300", "outside 1e-06 .. 1"});
  for (const char* field : {"version", "parent", "data/rows"}) {
    for (const double value : {1e300, -1e300, -1.0, 1.5})
      refused(("/" + std::string(field)).c_str(), value, {"must be a whole number from 0 to "});
  }
  refused("/version", 1e300, {"version: must be a whole number from 0 to 1000000000, is 1e+300"});
  for (const char* field : {"from", "to", "training_to"})
    refused(("/data/" + std::string(field)).c_str(), 1e300, {field, "1e+300", "1e+12 s"});
  for (const char* field : {"training/rms_m", "training/max_m", "holdout/rms_m", "holdout/max_m"}) {
    refused(("/fit/" + std::string(field)).c_str(), 1e300, {"between 0 and 1e+06", "1e+300"});
    refused(("/fit/" + std::string(field)).c_str(), -1.0, {"between 0 and 1e+06", "-1"});
  }
  refused("/data/motion/speed_m_per_s", 1e300, {"data.motion.speed_m_per_s", "at most 1e+06"});
  refused("/loop/denominator/0", 1e300, {"loop.denominator[0] = 1e+300 is more than 1e+09"});
  refused("/loop/tracking_error_numerator/0", -1e300, {"loop.tracking_error_numerator[0]", "+-"});
  refused("/loop/covariance/0/0", 1e300, {"loop.covariance[0]", "1e+60"});
  refused("/sample_time_s", "fast", {"sample_time_s", "number", "fast"});
  refused("/loop/order", 7, {"loop.order", "7"});
  refused("/loop/denominator", json::array({1.0}), {"loop.denominator", "list of"});
  refused("/loop/denominator/0", -5.0, {"loop.denominator", "unstable"});
  refused("/loop/tracking_error_numerator/1", nullptr,
          {"loop.tracking_error_numerator[1]", "number"});
  refused("/loop/poles/0/0", -1.0, {"loop.poles", "contradicts"});
  refused("/loop/disturbance_gain", 99.0, {"loop.disturbance_gain", "contradicts"});
  refused("/loop/damping_ratio", -0.2, {"loop.damping_ratio", "contradicts", "would agree"});
  refused("/loop/natural_frequency_hz", 1e4, {"loop.natural_frequency_hz", "contradicts"});
  refused("/loop/covariance", 1.0, {"loop.covariance", "list of"});
  refused("/loop/covariance/1", json::array({1.0}), {"loop.covariance[1]", "numbers"});
  refused("/loop/covariance/1/0", nullptr, {"loop.covariance[1]", "null"});
  refused("/loop/covariance/1/0", 7.0, {"loop.covariance", "symmetric"});
  refused("/loop/covariance/0/0", -1e-9, {"loop.covariance", "negative"});
  refused("/effects", 1, {"effects", "list"});
  refused("/effects/0/id", "phlogiston", {"effects[0].id", "phlogiston"});
  refused("/effects/0/parameters/velocity_limit/value", 7.0,
          {"velocity_limit of coulomb_friction", "7", "outside"});
  refused("/effects/0/parameters/colour", json::object(), {"effects[0].parameters.colour"});
  refused("/effects/0/parameters/coulomb/unit", "mm/s^2",
          {"effects[0].parameters.coulomb.unit", "mm/s^2", "m/s^2"});
  refused("/effects/2/parameters/delay_s/unit", "ms",
          {"effects[2].parameters.delay_s.unit", "ms", "s"});
  refused("/effects/2/parameters/delay_s/unit", 1, {"effects[2].parameters.delay_s.unit", "1"});
  for (const char* key : {"schema", "axis", "sample_time_s", "loop", "effects"}) {
    json j = valid();
    j.erase(key);
    expect_error<std::runtime_error>([&] { (void)model_from_json(j); }, {key, "missing"});
  }
  expect_error<std::runtime_error>([] { (void)model_from_json(json::array()); }, {"schema"});
  EXPECT_NO_THROW((void)model_from_json(valid()));
}

TEST(ModelFile, UnitsAreThoseOfTheKindOfAxisAndMayBeLeftOut) {
  json j = valid();
  j["kind"] = "rotary";
  expect_error<std::runtime_error>([&] { (void)model_from_json(j); }, {"unit", "rad/s"});
  std::mt19937_64 rng{4};
  ModelRecord record = random_record(rng);
  record.rotary = true;
  EXPECT_NO_THROW((void)model_from_json(to_json(record)));
  j = valid();
  j["effects"][0]["parameters"]["coulomb"].erase("unit");
  EXPECT_NO_THROW((void)model_from_json(j));
}

// Version 0.1.0 wrote rad only where a unit begins with "m/": velocity_limit was "rad/s" and a
// deflection "m".
TEST(ModelFile, ARotaryAxisUnitsOfVersion010AreRead) {
  std::mt19937_64 rng{4};
  ModelRecord record = random_record(rng);
  record.rotary = true;
  record.model.effects[0] = make_effect<Dahl>();
  record.model.effects[0].coefficient[0] = 0.3;
  json j = to_json(record);
  json& deflection = j["effects"][0]["parameters"]["deflection"];
  ASSERT_EQ(deflection["unit"], "rad");
  deflection["unit"] = "m";
  EXPECT_EQ(to_json(model_from_json(j)), to_json(record));
  deflection["unit"] = "mm";
  expect_error<std::runtime_error>([&] { (void)model_from_json(j); }, {"unit", "rad", "mm"});
}

TEST(ModelFile, TheMotionItWasFoundOnIsOptional) {
  json file = valid();
  EXPECT_TRUE(std::isnan(model_from_json(file).motion.speed)) << "not known";
  file["data"]["motion"] = {{"speed_m_per_s", 0.25}, {"acceleration_m_per_s2", 3.0}};
  const ModelRecord record = model_from_json(file);
  EXPECT_EQ(record.motion.speed, 0.25);
  EXPECT_EQ(record.motion.acceleration, 3.0);
  EXPECT_EQ(to_json(record)["data"]["motion"], file["data"]["motion"]);
  file["data"].erase("motion");
  EXPECT_TRUE(std::isnan(model_from_json(file).motion.acceleration)) << "a file from before";
  file["data"]["motion"] = {{"speed_m_per_s", -1.0}};
  expect_error<std::runtime_error>([&] { (void)model_from_json(file); },
                                   {"data.motion.speed_m_per_s", "-1"});
}

TEST(ModelFile, TheTorqueIsOptionalAndChecked) {
  json file = valid();
  file.erase("torque");
  EXPECT_FALSE(model_from_json(file).torque) << "a file from before";
  file["torque"] = {{"unit", "N"},
                    {"per_acceleration", 100.0},
                    {"per_velocity", 20.0},
                    {"offset", -3.0},
                    {"lag_s", 1e-3}};
  const std::optional<MotorTorque> torque = model_from_json(file).torque;
  ASSERT_TRUE(torque);
  EXPECT_EQ(torque->by.scale, 100.0);
  EXPECT_EQ(torque->lag.s, 1e-3);
  EXPECT_TRUE(std::isnan(torque->holdout_rms));
  const auto refused = [&](const char* key, const json& value,
                           std::initializer_list<const char*> parts) {
    json bad = file;
    bad["torque"][key] = value;
    expect_error<std::runtime_error>([&] { (void)model_from_json(bad); }, parts);
  };
  refused("unit", "lbf", {"torque.unit", "lbf", "N, Nm, A, V or %"});
  refused("per_acceleration", "much", {"torque.per_acceleration", "number", "much"});
  refused("offset", 1e300, {"torque.offset", "+-1e+12", "1e+300"});
  refused("lag_s", 7.0, {"torque.lag_s", "7"});
  refused("lag_is_filter", "yes", {"torque.lag_is_filter", "true or false", "yes"});
  file["torque"] = 3;
  expect_error<std::runtime_error>([&] { (void)model_from_json(file); }, {"torque", "object"});
}

TEST(ModelFile, TheIntervalOfTheNoiseFloorIsOptional) {
  json file = valid();
  file["fit"]["noise_floor_interval_m"] = {2e-8, 3e-8};
  const ModelRecord record = model_from_json(file);
  EXPECT_EQ(record.noise_floor.low, 2e-8);
  EXPECT_EQ(record.noise_floor.high, 3e-8);
  EXPECT_EQ(to_json(record)["fit"]["noise_floor_interval_m"],
            file["fit"]["noise_floor_interval_m"]);
  file["fit"].erase("noise_floor_interval_m");
  EXPECT_TRUE(std::isnan(model_from_json(file).noise_floor.low)) << "a file from before";
}

// x = a sin(w t), read in steps of 1 um.
TEST(MotionRange, IsTheSpeedAndAccelerationOfAMotionThatIsReadInSteps) {
  Segment segment;
  segment.sample_time_s = 1e-3;
  segment.command.resize(3000);
  const double a = 0.02, w = 2.0 * std::numbers::pi * 1.5;
  for (Eigen::Index k = 0; k < 3000; ++k)
    segment.command(k) = 1e-6 * std::round(1e6 * a * std::sin(w * 1e-3 * static_cast<double>(k)));
  const MotionRange range = motion_range({&segment, 1});
  EXPECT_NEAR(range.speed, a * w, 0.005 * a * w);
  EXPECT_NEAR(range.acceleration, a * w * w, 0.02 * a * w * w);
}

}  // namespace
}  // namespace servotwin
