// Errors of a comparison with an earlier model. Its results are tested in tests/hidden_effects.
#include "diagnosis/search/comparison.h"

#include <gmock/gmock.h>

namespace servotwin {
namespace {

using testing::HasSubstr;

SegmentedAxis axis(int samples) {
  SegmentedAxis out;
  out.axis = "X";
  out.sample_time_s = 1e-3;
  Segment s;
  s.sample_time_s = 1e-3;
  s.command = Eigen::ArrayXd::LinSpaced(samples, 0.0, 0.1);
  s.actual = s.command - 1e-4;
  out.segments = {s};
  return out;
}

ModelRecord earlier() {
  ModelRecord out;
  out.axis = "X";
  out.model.sample_time_s = 1e-3;
  out.model.loop.order = 2;
  out.model.loop.denominator = {400.0, 40'000.0, 0.0};
  out.model.loop.numerator = {1.0, 400.0, 0.0};
  return out;
}

std::string refusal_of(const SegmentedAxis& axis, const ModelRecord& model) {
  try {
    static_cast<void>(compare(axis, model));
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

TEST(Comparison, RefusesAModelOfAnotherAxisByTheirNames) {
  ModelRecord other = earlier();
  other.axis = "Z";
  EXPECT_THAT(refusal_of(axis(4000), other),
              HasSubstr("the model is of axis Z, the recording of axis X"));
}

TEST(Comparison, RefusesAModelOfAnotherKindOfAxis) {
  ModelRecord other = earlier();
  other.rotary = true;
  EXPECT_THAT(refusal_of(axis(4000), other), HasSubstr("the model is of a rotary axis"));
}

TEST(Comparison, RefusesAModelThatCannotBeSimulated) {
  ModelRecord other = earlier();
  other.model.loop.denominator[0] = -1.0;
  EXPECT_THAT(refusal_of(axis(4000), other), HasSubstr("X: the earlier model cannot be used: "));
}

}  // namespace
}  // namespace servotwin
