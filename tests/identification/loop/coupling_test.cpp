// Coupling to another axis, identified together with friction and a mode of vibration on a machine
// of two coupled axes that shares no code with the twin.
#include <gtest/gtest.h>

#include <cmath>

#include "identification/loop/identify.h"
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

// The table has 30 of 100 kg: the other's acceleration acts on it with the factor 0.04 / 0.3.
TEST(LongCoupling, AndVibrationAreFoundTogether) {
  const test::CoupledMachine machine = test::coupled_machine(0.0);
  const auto [x, y] = test::recorded(machine, test::production_of_both());
  const Identified with = found(x, 1, true), without = found(x, 1, false);
  EXPECT_LT(with.record.holdout.rms, 1e-6);
  EXPECT_GT(without.record.holdout.rms, 1.5 * with.record.holdout.rms);
  const auto truth = test::modes_of(machine)[0];
  ASSERT_EQ(with.record.model.loop.modes.size(), 1u);
  const Mode& mode = with.record.model.loop.modes[0];
  EXPECT_NEAR(mode.omega, std::abs(truth), 0.002 * std::abs(truth));
  EXPECT_NEAR(mode.zeta, -truth.real() / std::abs(truth), 0.1 * -truth.real() / std::abs(truth));
  const Effect* coupling = with.record.model.find(kind_of<CrossCoupling>());
  ASSERT_NE(coupling, nullptr);
  EXPECT_NEAR(coupling->coefficient[0], -0.04 / 0.3, 0.03 * 0.04 / 0.3);

  // One body, pushed by a vibrating table, whose friction does not follow from its command.
  const Identified other = found(y, 0, true);
  const Effect* back = other.record.model.find(kind_of<CrossCoupling>());
  ASSERT_NE(back, nullptr);
  EXPECT_NEAR(back->coefficient[0], -0.04, 0.25 * 0.04);
  EXPECT_LT(3.0 * other.record.holdout.rms, found(y, 0, false).record.holdout.rms);
}

// Each axis has the mode of the whole machine (44.35 Hz, 63.68 Hz), not the one that it would have
// alone (44.74 Hz, 62.56 Hz).
TEST(LongCoupling, OfTwoAxesThatBothVibrate) {
  const test::CoupledMachine machine = test::coupled_machine(62.0);
  const auto axes = test::recorded(machine, test::production_of_both());
  const auto truths = test::modes_of(machine);
  for (std::size_t i = 0; i < 2; ++i) {
    const Identified with = found(axes[i], 1, true);
    EXPECT_LT(with.record.holdout.rms, 2e-6) << axes[i].axis;
    EXPECT_NE(with.record.model.find(kind_of<CrossCoupling>()), nullptr) << axes[i].axis;
    ASSERT_EQ(with.record.model.loop.modes.size(), 1u) << axes[i].axis;
    const Mode& mode = with.record.model.loop.modes[0];
    const double omega = std::abs(truths[i]), zeta = -truths[i].real() / omega;
    EXPECT_NEAR(mode.omega, omega, 0.002 * omega) << axes[i].axis;
    EXPECT_NEAR(mode.zeta, zeta, 0.05 * zeta) << axes[i].axis;
  }
}

TEST(LongCoupling, ThatIsNotThereIsNotTaken) {
  test::CoupledMachine machine = test::coupled_machine(0.0);
  machine.common_mass = 0.0;
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
