// Motor and load as two masses, identified from recordings of a machine that shares no code with
// the twin (tests/hidden_effects/rig.h): its load hangs on a spring and carries the friction.

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "drivers/recordings/recording_file.h"
#include "identification/loop/identify.h"
#include "tests/hidden_effects/brisk_moves.h"
#include "tests/hidden_effects/cases.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/two_masses.h"
#include "twin/two_mass_axis.h"

namespace servotwin {
namespace {

Identified identified(const hidden_effects::Case& machine, Masses masses, bool beyond_loop = true,
                      std::optional<std::size_t> friction = {}) {
  const test::TemporaryDirectory directory;
  const SegmentedAxis axis =
      segment_axis(read_recording(directory.file("recording.csv", machine.csv)), "X");
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.masses = masses;
  options.beyond_loop = beyond_loop;
  options.friction = friction;
  return identify(axis, options);
}

TEST(LongTwoMasses, AreFoundWithTheirFrequencyAndPredictHeldOutMotionToTheNoise) {
  const hidden_effects::Case machine = hidden_effects::single_case(
      hidden_effects::Part::kDev, "compliance", hidden_effects::Class::kClear, 43);
  // A filter of the control would take a part of the swing.
  const Identified rigid = identified(machine, Masses::kRigid, false);
  const Identified two = identified(machine, Masses::kTwo);
  EXPECT_TRUE(two.refusals.empty());
  const Effect* found = two_mass_of(two.record.model);
  ASSERT_NE(found, nullptr);
  EXPECT_EQ(two_mass_parameters(*found).width, 0.0) << "the machine has no play";
  const double truth = machine.hidden.front().parameters.at("frequency_hz");
  EXPECT_NEAR(found->shape[0] / truth, 1.0, 0.01);
  // The held-out data begin within a swing of the load.
  EXPECT_LT(two.record.holdout.rms, 1.3 * machine.noise_rms);
  EXPECT_LT(two.record.holdout.rms, 0.1 * rigid.record.holdout.rms);
}

TEST(LongTwoMasses, AreChosenWhereThereAreTwoAndOnlyThere) {
  const hidden_effects::Case soft = hidden_effects::single_case(
      hidden_effects::Part::kDev, "compliance", hidden_effects::Class::kClear, 43);
  const hidden_effects::Case clean = hidden_effects::clean_case(hidden_effects::Part::kDev, 0);
  EXPECT_NE(two_mass_of(identified(soft, Masses::kChosen).record.model), nullptr);
  EXPECT_EQ(two_mass_of(identified(clean, Masses::kChosen).record.model), nullptr);
}

// The spring is sought beside Coulomb friction as well, which may fit better.
TEST(LongTwoMasses, HaveTheLawOfFrictionThatIsAskedFor) {
  const hidden_effects::Case machine = hidden_effects::single_case(
      hidden_effects::Part::kDev, "compliance", hidden_effects::Class::kClear, 43);
  for (const std::size_t law : {kind_of<Presliding>(), kind_of<MaxwellSlip>()}) {
    const Identified two = identified(machine, Masses::kTwo, true, law);
    EXPECT_NE(two_mass_of(two.record.model), nullptr);
    EXPECT_NE(two.record.model.find(law), nullptr) << identity_of(law).id;
  }
}

// Of both orders the lower one is tried first, and is enough where only noise is left.
TEST(LongTwoMasses, HaveTheIntegratorOfTheMachineOrNone) {
  for (const double integral_time : {0.0, 0.02}) {
    hidden_effects::Rig rig =
        test::two_masses(hidden_effects::Friction::Family::kLuGre, 150.0, integral_time);
    rig.drive.position_from = rig.reading.recorded = hidden_effects::Encoder::kMotor;
    IdentifyOptions options;
    options.method = Method::kJoint;
    options.masses = Masses::kTwo;
    const ModelRecord found =
        identify(hidden_effects::recorded_brisk_moves(rig, 10), options).record;
    EXPECT_EQ(found.model.loop.order, integral_time > 0.0 ? 3 : 2);
    EXPECT_LT(found.holdout.rms,
              1.3 * std::hypot(rig.reading.noise, rig.reading.step / std::sqrt(12.0)));
  }
}

TEST(TwoMasses, AreRefusedBesideWhatTheyAreNotFittedWith) {
  const hidden_effects::Case clean = hidden_effects::clean_case(hidden_effects::Part::kDev, 0);
  const test::TemporaryDirectory directory;
  const SegmentedAxis axis =
      segment_axis(read_recording(directory.file("recording.csv", clean.csv)), "X");
  IdentifyOptions options;
  options.masses = Masses::kTwo;
  EXPECT_THROW((void)identify(axis, options), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin
