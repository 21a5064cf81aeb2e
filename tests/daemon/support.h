// What the daemon's tests share: a drive, a motion, a place on the disk.
#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>

#include "daemon/store/store.h"
#include "daemon/store/store_checksum.h"
#include "drivers/common/messages.h"
#include "identification/model/model_file.h"
#include "tests/support/temporary_directory.h"
#include "twin/model.h"

namespace servotwin::daemon {

inline constexpr std::int64_t kSecond_ns = 1'000'000'000;
inline constexpr double kCycle_s = 1e-3;

/// A P-P drive with Coulomb friction, similar to EMPS.
inline Model drive(double omega_hz = 20.0, double coulomb = 0.3) {
  Model model;
  model.sample_time_s = kCycle_s;
  model.loop.order = 2;
  model.loop.denominator = denominator_of({0.0, omega_hz * 2.0 * std::numbers::pi, 0.6}, 2);
  model.loop.numerator = {1.0, model.loop.denominator[0], 0.0};
  Effect friction = make_effect<CoulombFriction>();
  friction.coefficient[0] = coulomb;
  model.effects = {friction};
  return model;
}

/// An event of a store, of the kind of a promotion.
inline Event event_of(const std::string& text, const std::string& axis = "X",
                      const std::string& detail = "") {
  return {"2026-01-31T12:00:00.000Z", axis, "model_promoted", text, detail};
}

inline ModelRecord record_of(const Model& model, const std::string& axis = "X") {
  ModelRecord record;
  record.axis = axis;
  record.created = "2026-01-31T12:00:00.000Z";
  record.model = model;
  record.effect_deviations.resize(model.effects.size());
  record.method = "pole-search";
  record.training = {1.1e-6, 4.2e-6};
  record.holdout = {1.3e-6, 5.5e-6};
  record.noise_floor.rms = 0.4e-6;
  record.condition_number = 123.4;
  record.source = "test";
  record.rows = 8000;
  return record;
}

/// Two sines that never repeat within a minute, from rest.
inline double command_at(double t) {
  const double fade = t < 1.0 ? t * t * (3.0 - 2.0 * t) : 1.0;
  return fade * (0.03 * std::sin(2.1 * t) + 0.012 * std::sin(9.3 * t + 1.0));
}

inline MachineDescription one_axis(const std::string& name = "X") {
  return {kCycle_s, {{name, false, ""}}};
}

using test::TemporaryDirectory;

/// The message that `action` throws; fails the test if it throws none.
template <class Action>
std::string message_of(Action&& action) {
  try {
    action();
  } catch (const std::exception& error) {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

/// Puts SQL into the file of a store. Checksums are left as they are, unless the SQL sets them.
inline void spoil(const std::filesystem::path& store, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((store / "servotwin.sqlite").c_str(), &database), SQLITE_OK);
  add_row_crc32(database);
  char* error = nullptr;
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, &error), SQLITE_OK) << error;
  sqlite3_close(database);
}

/// SQL that makes a model something else, as a program with other rules would have stored it.
inline std::string other_models(const std::string& json, const std::string& where) {
  return "UPDATE models SET json = " + json + where +
         "; UPDATE models SET crc32 = " + checksum(kModels) + where;
}

}  // namespace servotwin::daemon
