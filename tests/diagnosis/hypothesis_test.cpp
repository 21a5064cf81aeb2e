// A model to begin with: what two structures share stays, the rest starts from nothing.
#include "diagnosis/search/hypothesis.h"

#include <gtest/gtest.h>

#include "twin/catalogue.h"

namespace servotwin {
namespace {

Model rubbing() {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop.order = 2;
  model.loop.denominator = {60.0, 4000.0};
  Effect friction = make_effect<Presliding>();
  friction.shape[0] = 2e-5;
  friction.coefficient[0] = 0.3;
  Effect ripple = make_effect<Cogging>();
  ripple.shape[0] = 8e-3;
  ripple.coefficient[0] = 0.05;
  model.effects = {friction, ripple};
  return model;
}

TEST(BegunFrom, AnotherLawOfFrictionHasTheLevelOfTheOld) {
  const Model model = rubbing();
  for (const std::size_t law : {kind_of<CoulombFriction>(), kind_of<LuGre>(), kind_of<Gms>()}) {
    const Model begun = begun_from(model, {2, {law, kind_of<Cogging>()}});
    ASSERT_EQ(begun.effects.size(), 2U);
    EXPECT_EQ(begun.effects[0].kind, law);
    EXPECT_NEAR(level_of(begun.effects[0]), 0.3, 1e-12) << law;
    EXPECT_EQ(why_invalid(begun), "") << law;
    EXPECT_EQ(begun.effects[1].shape, model.effects[1].shape);
    EXPECT_EQ(begun.effects[1].coefficient, model.effects[1].coefficient);
  }
}

TEST(BegunFrom, WhatTheModelLacksDoesNothingYet) {
  const Model begun =
      begun_from(rubbing(), {2, {kind_of<Presliding>(), kind_of<FallingFriction>()}});
  ASSERT_EQ(begun.effects.size(), 2U);
  EXPECT_EQ(begun.effects[0].shape[0], 2e-5);
  for (const double coefficient : begun.effects[1].coefficient) EXPECT_EQ(coefficient, 0.0);
  EXPECT_EQ(begun.loop.denominator, rubbing().loop.denominator);
}

}  // namespace
}  // namespace servotwin
