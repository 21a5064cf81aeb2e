// The suggested motion decides: on a machine with one effect, two rival causes fitted to an
// ordinary recording predict nearly the same error there, but different errors on the suggested
// motion, where the recorded error shows which is right.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <ostream>

#include "diagnosis/search/extension.h"
#include "diagnosis/search/search.h"
#include "diagnosis/search/suggested_motion.h"
#include "identification/loop/output_error.h"
#include "identification/recording/noise_floor.h"
#include "tests/hidden_effects/rig.h"
#include "twin/twin.h"

namespace servotwin::hidden_effects {
namespace {

constexpr double kNoise = 3e-8;  // of the encoder [m]
constexpr double kPeriod = 4e-3;
constexpr virtual_machine::Limits kLimits{0.06, 1.0, 20.0};

Segment recorded(const Rig& rig, const Command& command) {
  const Trace trace = simulate(rig, command);
  EXPECT_FALSE(trace.runaway);
  const auto n = static_cast<Eigen::Index>(trace.command.size());
  Segment s;
  s.sample_time_s = rig.reading.sample_time;
  s.command = Eigen::Map<const Eigen::ArrayXd>(trace.command.data(), n);
  s.actual = Eigen::Map<const Eigen::ArrayXd>(trace.actual.data(), n);
  return s;
}

/// The jerk-limited motion that a control generates from the test program.
Command run_by_control(const TestMotion& motion) {
  Command out(motion.start);
  double place = motion.start;
  for (const TestLeg& leg : motion.legs) {
    if (std::abs(leg.to - place) > 1e-9)
      out.move_to(leg.to,
                  {leg.velocity, leg.acceleration, 2.0 * leg.acceleration / motion.smoothing_s});
    if (leg.rest_s > 0.0) out.dwell(leg.rest_s);
    place = leg.to;
  }
  return out;
}

Rig machine() {
  Rig rig;
  rig.friction.level = 15.0;
  rig.friction.viscous = 100.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.position_gain = 60.0;
  rig.drive.velocity_gain = 20'000.0;
  rig.reading.noise = kNoise;
  rig.reading.step = 1e-8;
  return rig;
}

/// Strokes at one speed: enough to find an effect, not enough to distinguish it from its rival.
Command one_speed() {
  Command out(0.0);
  for (int i = 0; i < 4; ++i) {
    out.dwell(0.3);
    out.move_to(0.1, kLimits);
    out.dwell(0.3);
    out.move_to(0.0, kLimits);
  }
  out.dwell(0.5);
  return out;
}

struct Rivals {
  const char *truth, *rival;  // causes
  std::size_t truth_kind, rival_kind;
  void (*put)(Rig& rig);
};

void PrintTo(const Rivals& rivals, std::ostream* out) {
  *out << rivals.truth << " or " << rivals.rival;
}

class SuggestedMotion : public testing::TestWithParam<Rivals> {};

Model fitted(Search& search, std::size_t kind) {
  Hypothesis plain;
  plain.structure = {2, {kind_of<CoulombFriction>()}};
  EXPECT_TRUE(search.fit(plain, {}));
  search.follow(plain);
  Hypothesis h;
  h.structure = extended_by(plain.structure, kind);
  // By one of the two methods of the diagnosis, from the best point of the grid.
  const Screened screened = search.screen(plain, {kind}).front();
  EXPECT_TRUE(search.vary(h, plain.model, kind, screened.shapes));
  // Fully converged: the test is about the motion, not about the search.
  const auto polished = output_error(search.training(), h.structure, h.model);
  EXPECT_TRUE(polished);
  if (polished) h.model = polished->model;
  return h.model;
}

double rms(const Eigen::ArrayXd& values) { return std::sqrt(values.square().mean()); }

TEST_P(SuggestedMotion, Decides) {
  const Rivals& p = GetParam();
  Rig rig = machine();
  p.put(rig);
  const Segment ordinary = recorded(rig, one_speed());
  Search search({ordinary}, 1e300, PoleBounds{}, noise_floor({ordinary}));
  const Model truth = fitted(search, p.truth_kind), rival = fitted(search, p.rival_kind);

  const auto suggested = suggested_test({{p.truth, p.rival}}, seen_motion({ordinary}),
                                        {.period = kPeriod, .travel = 2e-5, .encoder_step = 1e-8});
  ASSERT_TRUE(suggested && suggested->motion);
  const Segment test = recorded(rig, run_by_control(*suggested->motion));
  const Eigen::ArrayXd by_truth = simulate(truth, test), by_rival = simulate(rival, test);
  const double apart_before = rms(simulate(truth, ordinary) - simulate(rival, ordinary)),
               apart = rms(by_truth - by_rival);
  const Eigen::ArrayXd error = test.command - test.actual;
  std::cout << p.truth << " or " << p.rival << ": predictions differ by " << apart_before / kNoise
            << " times the noise in the recording, " << apart / kNoise << " on the test motion ("
            << suggested->motion->duration_s()
            << " s); RMS residual over noise: " << rms(error - by_truth) / kNoise
            << ", of the rival " << rms(error - by_rival) / kNoise << '\n';
  EXPECT_LT(apart_before, 2.0 * kNoise);  // the ordinary recording does not decide
  EXPECT_GT(apart, 4.0 * std::max(kNoise, apart_before));
  EXPECT_LT(rms(error - by_truth), 1.5 * kNoise);
  EXPECT_GT(rms(error - by_rival), 3.0 * rms(error - by_truth));
}

INSTANTIATE_TEST_SUITE_P(
    Pairs, SuggestedMotion,
    testing::Values(Rivals{"cogging", "encoder_error", kind_of<Cogging>(), kind_of<EncoderError>(),
                           [](Rig& rig) {
                             rig.body.cogging = 1.0;
                             rig.body.cogging_period = kPeriod;
                           }},
                    Rivals{"encoder_error", "cogging", kind_of<EncoderError>(), kind_of<Cogging>(),
                           [](Rig& rig) {
                             rig.reading.cyclic_error = 3e-7;
                             rig.reading.cyclic_period = kPeriod;
                           }},
                    Rivals{"stribeck", "dwell_stiction", kind_of<FallingFriction>(),
                           kind_of<DwellStiction>(), [](Rig& rig) {
                             rig.friction.stribeck_rise = 0.15;
                             rig.friction.stribeck_velocity = 5e-3;
                           }}));

}  // namespace
}  // namespace servotwin::hidden_effects
