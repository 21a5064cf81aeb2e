// The columns of effects beside a loop that is held are those of a projection with that effect.
#include "identification/loop/effect_columns.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "identification/recording/segments.h"
#include "twin/catalogue.h"

namespace servotwin {
namespace {

Signals signals_of_some_motion() {
  Segment s;
  s.sample_time_s = 1e-3;
  const Eigen::ArrayXd t = Eigen::ArrayXd::LinSpaced(3000, 0.0, 2.999);
  s.command = 0.05 * (1.0 - (2.0 * std::numbers::pi * 0.7 * t).cos()) + 0.002 * (9.0 * t).sin();
  s.actual = s.command - 2e-5 * (2.0 * std::numbers::pi * 0.7 * t + 0.1).sin();
  return signals_of(s);
}

TEST(EffectColumns, AreThoseOfAProjectionWithTheEffect) {
  constexpr double kDelay_s = 0.003;
  Signals with_loop = signals_of_some_motion();
  with_loop.loop_position = with_loop.position + 1e-5;
  const Mode mode{.omega = 400.0, .zeta = 0.05, .gamma = 1e-4, .delta = 0.3};
  for (const int order : {2, 3}) {
    for (const std::size_t kind :
         {kind_of<CoulombFriction>(), kind_of<Presliding>(), kind_of<Cogging>(),
          kind_of<LeadError>(), kind_of<BacklashInLoop>()}) {
      std::vector<double> shapes;
      for (const Parameter& p : shapes_of(kind)) shapes.push_back(p.start);
      for (const bool vibrates : {false, true}) {
        for (const bool late : {false, true}) {
          for (const Signals& signals : {signals_of_some_motion(), with_loop}) {
            Structure structure{.order = order, .effects = {kind}, .modes = vibrates ? 1 : 0};
            Point at{{300.0, 4e4, order == 3 ? 5e5 : 0.0}, shapes, {}};
            Loop loop;
            loop.order = order;
            loop.denominator = at.denominator;
            if (vibrates) at.modes = loop.modes = {mode};
            if (late) {
              structure.effects.insert(structure.effects.begin(), kind_of<TimeDelay>());
              at.shapes.insert(at.shapes.begin(), kDelay_s);
            }
            const Eigen::MatrixXd all = Projection({signals}, structure).regressors(at);
            const Eigen::MatrixXd found =
                EffectColumns({signals}, loop, late ? kDelay_s : 0.0).of(kind, shapes);
            ASSERT_EQ(found.cols(), structure.coefficient_count());
            const Eigen::MatrixXd expected = all.middleCols(order, found.cols());
            EXPECT_GT(expected.norm(), 0.0);
            EXPECT_LE((found - expected).norm(), 1e-13 * expected.norm())
                << identity_of(kind).id << " order " << order << (vibrates ? " mode" : "")
                << (late ? " late" : "") << (signals.loop_position.size() > 0 ? " loop" : "");
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace servotwin
