// A model as text: which deviations are worth printing.
#include "cli/common/model_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/cli/recordings.h"

namespace servotwin::cli {
namespace {

using testing::Contains;
using testing::Each;
using testing::HasSubstr;
using testing::Not;

TEST(ModelText, HasDeviationsWhereNoiseDecidesThem) {
  ModelRecord record = known_axis();
  record.pole_deviation.omega = 0.5;
  record.numerator_deviation[0] = 0.01;
  record.effect_deviations.assign(record.model.effects.size(), {});
  if (!record.effect_deviations.empty()) record.effect_deviations[0].coefficient[0] = 0.02;
  record.noise_floor.rms = 1e-7;
  record.training.rms = 2.9e-7;
  EXPECT_THAT(parameter_lines(record), Contains(HasSubstr("+-")));
  record.training.rms = 3.1e-7;
  EXPECT_THAT(parameter_lines(record), Each(Not(HasSubstr("+-"))));
  record.noise_floor.rms = kAbsent;
  EXPECT_THAT(parameter_lines(record), Contains(HasSubstr("+-"))) << "nothing is known against it";
}

}  // namespace
}  // namespace servotwin::cli
