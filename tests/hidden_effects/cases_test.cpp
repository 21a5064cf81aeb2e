// The cases: the same seeds give the same recordings, and every case belongs to its class.
#include "tests/hidden_effects/cases.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

#include "tests/hidden_effects/motion.h"

namespace servotwin::hidden_effects {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

std::vector<std::vector<double>> columns_of(const std::string& csv) {
  std::istringstream in(csv);
  std::string line, cell;
  std::getline(in, line);
  std::vector<std::vector<double>> out(
      1 + static_cast<std::size_t>(std::count(line.begin(), line.end(), ',')));
  while (std::getline(in, line)) {
    std::istringstream cells(line);
    for (auto& column : out) {
      std::getline(cells, cell, ',');
      column.push_back(std::stod(cell));
    }
  }
  return out;
}

TEST(Cases, AreTheSameBitForBit) {
  const Case once = single_case(Part::kDev, "gravity_offset", Class::kClear, 1);
  const Case again = single_case(Part::kDev, "gravity_offset", Class::kClear, 1);
  EXPECT_EQ(once.csv, again.csv);
  EXPECT_EQ(once.hidden.front().parameters, again.hidden.front().parameters);
  EXPECT_NE(once.csv, single_case(Part::kDev, "gravity_offset", Class::kClear, 2).csv);
  EXPECT_NE(once.seed, single_case(Part::kTest, "gravity_offset", Class::kClear, 1).seed);
}

TEST(Cases, ContributeWhatTheirClassSays) {
  for (const char* id : {"lead_error", "periodic_disturbance"}) {
    const Case clear = single_case(Part::kDev, id, Class::kClear, 0);
    EXPECT_GE(clear.hidden.front().contribution_rms, 5.0 * clear.noise_rms) << id;
    EXPECT_TRUE(clear.hidden.front().clear && clear.hidden.front().observable);
    const Case faint = single_case(Part::kTest, id, Class::kFaint, 0);
    EXPECT_GE(faint.hidden.front().contribution_rms, faint.noise_rms) << id;
    EXPECT_LE(faint.hidden.front().contribution_rms, 3.0 * faint.noise_rms) << id;
    EXPECT_FALSE(faint.hidden.front().clear);
    EXPECT_GE(faint.hidden.front().difference_rms, faint.hidden.front().contribution_rms);
  }
}

TEST(Cases, WithoutEffectsHideNothing) {
  const Case clean = clean_case(Part::kTest, 0);
  EXPECT_THAT(clean.hidden, IsEmpty());
  EXPECT_GT(clean.noise_rms, 0.0);
  const auto columns = columns_of(clean.csv);
  ASSERT_GE(columns.size(), 3u);
  EXPECT_NEAR(columns[0][1], clean.sample_time_s, 1e-9);
  EXPECT_GE(columns[0].back(), 15.9);
  EXPECT_LE(columns[0].back(), 24.0);
}

TEST(Cases, OfWhatCannotBeSeenDifferInNothing) {
  for (const std::string& id : blind_ids()) {
    const Case blind = blind_case(Part::kDev, id, 0);
    EXPECT_FALSE(blind.hidden.front().observable) << id;
    EXPECT_LT(blind.hidden.front().contribution_rms, 1e-3 * blind.noise_rms) << id;
  }
}

TEST(Cases, WithTwoEffectsHaveBothClear) {
  const Case pair = pair_case(Part::kDev, 1);
  ASSERT_EQ(pair.hidden.size(), 2u);
  for (const Truth& truth : pair.hidden) {
    EXPECT_GE(truth.contribution_rms, 5.0 * pair.noise_rms) << truth.id;
  }
  EXPECT_THAT(pair.name, HasSubstr(pair.hidden[0].id + '+' + pair.hidden[1].id));
}

TEST(Cases, OfCrossCouplingRecordTheOtherAxis) {
  const Case made = single_case(Part::kDev, "cross_coupling", Class::kClear, 0);
  EXPECT_THAT(made.csv.substr(0, made.csv.find('\n')), HasSubstr("Y.command[mm],Y.actual[mm]"));
}

TEST(Cases, KnowEveryEffectOfTheContractButOne) {
  const std::set<std::string> known(effect_ids().begin(), effect_ids().end());
  EXPECT_EQ(known.size(), 23u);
  EXPECT_FALSE(known.contains("feedforward_mismatch"));
  EXPECT_THROW((void)single_case(Part::kDev, "witchcraft", Class::kClear, 0),
               std::invalid_argument);
}

TEST(Motion, RestsAndMovesFillTheTime) {
  Random random(7);
  Motion motion;
  motion.duration = 18.0;
  const virtual_machine::Trajectory path = motion_of(motion, random);
  EXPECT_DOUBLE_EQ(path.duration(), 18.0);
  double moved = 0.0, rested = 0.0;
  for (const Interval& i : moves(path)) moved += i.end - i.begin;
  for (const Interval& i : rests(path)) {
    rested += i.end - i.begin;
    EXPECT_NEAR(path.at(0.5 * (i.begin + i.end)).velocity, 0.0, 1e-12);
  }
  EXPECT_NEAR(moved + rested, 18.0, 0.01);
  EXPECT_GT(moved, 9.0);
  EXPECT_GT(rested, 0.3);
}

// A lead error is one between motor and load.
TEST(HiddenEffects, TheMotorsEncoderIsOneColumnMoreBesideThatOfTheLoad) {
  std::istringstream bare(single_case(Part::kDev, "lead_error", Class::kClear, 1).csv),
      both(single_case(Part::kDev, "lead_error", Class::kClear, 1, {Torque::kNone, true}).csv);
  std::string a, b;
  while (std::getline(bare, a)) {
    ASSERT_TRUE(std::getline(both, b));
    // time, command and load; then the motor.
    std::size_t comma = 0;
    for (int i = 0; i < 3; ++i) comma = b.find(',', comma + 1);
    const std::size_t load = b.rfind(',', comma - 1) + 1, end = b.find(',', comma + 1);
    const std::string motor = b.substr(comma + 1, end - comma - 1);
    if (a.front() == 't') {
      EXPECT_EQ(motor, "X.actual_motor[mm]");
    } else {
      ASSERT_NEAR(std::stod(motor), std::stod(b.substr(load)), 0.2);
    }
    ASSERT_EQ(b.erase(comma, motor.size() + 1), a);
  }
}

TEST(HiddenEffects, TheTorqueIsOneColumnMoreAndNothingElse) {
  const Case without = single_case(Part::kDev, "gravity_offset", Class::kClear, 1);
  const Case with = single_case(Part::kDev, "gravity_offset", Class::kClear, 1, Torque::kAll);
  EXPECT_FALSE(without.torque);
  EXPECT_TRUE(with.torque);
  std::istringstream plain(without.csv), more(with.csv);
  std::string left, right;
  std::getline(plain, left);
  std::getline(more, right);
  EXPECT_THAT(right, testing::HasSubstr(",X.torque["));
  int rows = 0;
  while (std::getline(plain, left)) {
    ASSERT_TRUE(std::getline(more, right));
    // time, command, actual; then the torque.
    std::size_t third = 0;
    for (int i = 0; i < 3; ++i) third = right.find(',', third + 1);
    ASSERT_EQ(right.substr(0, third), left.substr(0, third)) << rows;
    ++rows;
  }
  EXPECT_GT(rows, 1000);
  // Of many, about half.
  int torque = 0;
  for (int i = 0; i < 8; ++i) torque += clean_case(Part::kDev, i, Torque::kHalf).torque ? 1 : 0;
  EXPECT_GT(torque, 0);
  EXPECT_LT(torque, 8);
}

}  // namespace
}  // namespace servotwin::hidden_effects
