// What another axis does to this one, found beside friction and a mode of vibration on two axes
// that push each other and share no code with the twin.
#include <gtest/gtest.h>

#include <cmath>

#include "identification/identify.h"
#include "tests/support/coupled_machine.h"
#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

Identified found(const SegmentedAxis& axis, int modes, bool coupling) {
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.friction = kind_of<Presliding>();
  options.order = 2;
  options.modes = modes;
  options.coupling = coupling;
  return identify(axis, options);
}

// The table has 30 of 100 kg: it feels 0.04 / 0.3 of the other's acceleration.
TEST(Coupling, AndVibrationAreFoundTogether) {
  const test::CoupledMachine machine = test::coupled_machine(0.0);
  const auto [x, y] = test::recorded(machine, test::production_of_both());
  const Identified with = found(x, 1, true), without = found(x, 1, false);
  EXPECT_LT(with.record.holdout.rms, 1e-6);
  EXPECT_GT(without.record.holdout.rms, 1.5 * with.record.holdout.rms);
  const auto truth = test::mode_of(machine.axes[0]);
  ASSERT_EQ(with.record.model.loop.modes.size(), 1u);
  const Mode& mode = with.record.model.loop.modes[0];
  EXPECT_NEAR(mode.omega, std::abs(truth), 0.002 * std::abs(truth));
  EXPECT_NEAR(mode.zeta, -truth.real() / std::abs(truth), 0.1 * -truth.real() / std::abs(truth));
  const Effect* coupling = with.record.model.find(kind_of<CrossCoupling>());
  ASSERT_NE(coupling, nullptr);
  EXPECT_NEAR(coupling->coefficient[0], -0.04 / 0.3, 0.03 * 0.04 / 0.3);

  // Of one body, pushed by a table that rings.
  const Identified other = found(y, 0, true);
  const Effect* back = other.record.model.find(kind_of<CrossCoupling>());
  ASSERT_NE(back, nullptr);
  EXPECT_NEAR(back->coefficient[0], 0.06, 0.1 * 0.06);
  EXPECT_LT(3.0 * other.record.holdout.rms, found(y, 0, false).record.holdout.rms);
}

TEST(Coupling, ThatIsNotThereIsNotTaken) {
  test::CoupledMachine machine = test::coupled_machine(0.0);
  machine.felt = {0.0, 0.0};
  const auto axes = test::recorded(machine, test::production_of_both());
  for (const SegmentedAxis& axis : axes)
    EXPECT_EQ(found(axis, 0, true).record.model.find(kind_of<CrossCoupling>()), nullptr)
        << axis.axis;
}

TEST(Coupling, NeedsAnotherAxis) {
  auto axes = test::recorded(test::coupled_machine(0.0), test::production_of_both());
  axes[0].segments[0].neighbour.resize(0);
  test::expect_error<std::runtime_error>([&] { (void)found(axes[0], 0, true); },
                                         {"X", "no other axis", "coupling"});
}

}  // namespace
}  // namespace servotwin
