#include "diagnosis/diagnosis_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::Not;

/// A diagnosis with torque saturation and a loop of this order.
Diagnosis saturated(int order) {
  Diagnosis diagnosis;
  diagnosis.extended.model.loop.order = order;
  diagnosis.extended.model.effects = {make_effect<TorqueSaturation>()};
  diagnosis.extended.model.effects[0].shape[1] = 77.0;
  Cause cause;
  cause.id = "torque_saturation";
  diagnosis.causes = {cause};
  return diagnosis;
}

TEST(DiagnosisFile, WithoutAnIntegratorNothingIsSaidOfItsReset) {
  const Diagnosis with = saturated(3), without = saturated(2);
  EXPECT_THAT(cause_text(with, with.causes[0]), HasSubstr("reset 77 1/s"));
  EXPECT_THAT(cause_text(without, without.causes[0]), Not(HasSubstr("reset")));
  EXPECT_THAT(cause_text(without, without.causes[0]), HasSubstr("limit_mps2"));
  EXPECT_EQ(to_json(with, "")["causes"][0]["parameters"]["reset"], 77.0);
  const nlohmann::json parameters = to_json(without, "")["causes"][0]["parameters"];
  ASSERT_TRUE(parameters.contains("reset")) << "the key is always present";
  EXPECT_TRUE(parameters["reset"].is_null());
}

}  // namespace
}  // namespace servotwin
