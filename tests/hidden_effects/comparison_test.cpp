// Changes of a machine between two recordings, found by comparing the second with the model of the
// first.
#include <gmock/gmock.h>

#include "tests/hidden_effects/answer.h"
#include "tests/hidden_effects/changes.h"

namespace servotwin::hidden_effects {
namespace {

struct Expected {
  const char* id;
  const char* quantity;
  double tolerance;  // of the change itself
};

class AChangedMachine : public testing::TestWithParam<Expected> {};

TEST_P(AChangedMachine, IsToldByWhatChangedAndHowFar) {
  const Expected expected = GetParam();
  const ChangedMachine machine = changed_machine(Part::kDev, expected.id, 1);
  const Answer answer = ask_what_changed(machine.before_csv, machine.after_csv);
  ASSERT_EQ(answer.failure, "");
  EXPECT_EQ(answer.verdict, "explained");
  ASSERT_EQ(answer.causes.size(), 1u);
  EXPECT_EQ(answer.causes[0].id, expected.id);
  EXPECT_LT(answer.after_rms, 0.2 * answer.before_rms);
  const auto found = answer.causes[0].parameters.find(expected.quantity);
  ASSERT_NE(found, answer.causes[0].parameters.end());
  const double before = std::string(expected.quantity) == "ratio" ? 1.0 : 0.0;
  EXPECT_NEAR(found->second - before, machine.ratio - before,
              expected.tolerance * std::abs(machine.ratio - before));
}
INSTANTIATE_TEST_SUITE_P(Dev, AChangedMachine,
                         testing::Values(Expected{"gain_change", "ratio", 0.05}),
                         [](const auto& test) { return std::string(test.param.id); });
INSTANTIATE_TEST_SUITE_P(LongDev, AChangedMachine,
                         testing::Values(Expected{"feedforward_mismatch", "velocity_feedforward",
                                                  0.05},
                                         Expected{"inertia_change", "ratio", 0.05},
                                         Expected{"added_friction", "ratio", 0.05},
                                         Expected{"time_delay", "delay_s", 0.05}),
                         [](const auto& test) { return std::string(test.param.id); });

void expect_no_change(int index) {
  const ChangedMachine machine = changed_machine(Part::kDev, "", index);
  const Answer answer = ask_what_changed(machine.before_csv, machine.after_csv);
  ASSERT_EQ(answer.failure, "");
  EXPECT_EQ(answer.verdict, "nothing_significant");
  EXPECT_TRUE(answer.causes.empty());
}

TEST(AMachineThatDidNotChange, IsNotSaidTo) { expect_no_change(0); }
TEST(LongAMachineThatDidNotChange, IsNotSaidTo) { expect_no_change(1); }

TEST(LongAnEffectThatIsNew, IsNamedFromTheCatalogue) {
  const ChangedMachine machine = changed_machine(Part::kDev, "cogging", 0);
  const Answer answer = ask_what_changed(machine.before_csv, machine.after_csv);
  ASSERT_EQ(answer.failure, "");
  ASSERT_FALSE(answer.causes.empty());
  EXPECT_EQ(answer.causes[0].id, "cogging");
}

}  // namespace
}  // namespace servotwin::hidden_effects
