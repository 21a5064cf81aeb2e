#include "daemon/correct/correction_rule.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "ilc/gate.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using What = CorrectionRuling::What;

const MachineDescription kTwoAxes{0.001, {{"X", false, ""}, {"Y", false, ""}}};

/// A program of Y alone, or of both axes.
LearnedProgram learned_of(bool path) {
  LearnedProgram out;
  out.program.name = "part";
  out.program.axes = path ? std::vector<std::size_t>{0, 1} : std::vector<std::size_t>{1};
  for (const std::size_t axis : out.program.axes) {
    out.axes.push_back({kTwoAxes.axes[axis].name, false, 1});
    out.holdout_rms.push_back(2e-6);
  }
  if (path) out.contour_before = Eigen::ArrayXd::Constant(10, 1e-5);
  return out;
}

/// A live run of 1000 cycles with these RMS of every axis and of the path [um].
OffsetRun run_of(double measured_um, double before_um, double after_um,
                 double contour_measured_um = 1.0) {
  const auto squares = [](double um) { return 1000.0 * um * um * 1e-12; };
  OffsetRun run;
  run.live = true;
  run.cycles = 1000;
  for (std::size_t n = 0; n < 2; ++n)
    run.axes[n] = {squares(measured_um), squares(before_um), squares(after_um)};
  run.contour = {squares(contour_measured_um), squares(10.0), squares(0.5)};
  return run;
}

struct AfterRuns {
  const char* name;
  bool path;
  OffsetRun run;
  What what;
  const char* reason;
};
OffsetRun with(OffsetRun run, const std::function<void(OffsetRun&)>& change) {
  change(run);
  return run;
}

class RulingAfter : public testing::TestWithParam<AfterRuns> {};

TEST_P(RulingAfter, IsAsTheRuleSays) {
  const AfterRuns& one = GetParam();
  const CorrectionRuling ruling = ruling_after(one.run, learned_of(one.path), kTwoAxes);
  EXPECT_EQ(ruling.what, one.what) << ruling.reason;
  EXPECT_THAT(ruling.reason, HasSubstr(one.reason));
}

INSTANTIATE_TEST_SUITE_P(
    , RulingAfter,
    testing::Values(
        AfterRuns{"AsPredicted", true, run_of(3.0, 100.0, 1.0), What::kKeep, "as predicted"},
        // sqrt(1 + 2^2) um is expected: three times that is 6.7 um.
        AfterRuns{"JustAsExpected", false, run_of(6.7, 100.0, 1.0), What::kKeep, "as predicted"},
        AfterRuns{"NotAsExpected", false, run_of(6.75, 100.0, 1.0), What::kLearnAnew,
                  "axis Y 6.75 um instead of the expected 2.236 um"},
        AfterRuns{"WorseThanWithout", false, run_of(100.0, 100.0, 1.0), What::kWithdraw,
                  "the error of axis Y was no smaller"},
        AfterRuns{"PathWorseThanWithout", true, run_of(3.0, 100.0, 1.0, 10.0), What::kWithdraw,
                  "the path error was no smaller"},
        AfterRuns{"NoEncoder", false,
                  with(run_of(3.0, 100.0, 1.0), [](OffsetRun& r) { r.axes[0].measured = kAbsent; }),
                  What::kWithdraw, "without an encoder value"},
        AfterRuns{"Residual", true,
                  with(run_of(3.0, 100.0, 1.0),
                       [](OffsetRun& r) {
                         r.end = RunEnd::kResidual;
                         r.axis = 1;
                         r.at_s = 1.25;
                       }),
                  What::kWithdraw, "the residual of axis Y left its band 1.25 s"},
        AfterRuns{"Contour", true,
                  with(run_of(3.0, 100.0, 1.0), [](OffsetRun& r) { r.end = RunEnd::kContour; }),
                  What::kWithdraw, "the path error was larger"},
        AfterRuns{"OtherModel", true,
                  with(run_of(3.0, 100.0, 1.0),
                       [](OffsetRun& r) {
                         r.end = RunEnd::kRefused;
                         r.axis = 0;
                         r.refusal = static_cast<std::uint8_t>(Refusal::kOtherAxisState);
                       }),
                  What::kLearnAnew,
                  "the gate refused the offset of axis X 0 s after the start of the program: "
                  "other_axis_state"},
        AfterRuns{"GateRefuses", true,
                  with(run_of(3.0, 100.0, 1.0),
                       [](OffsetRun& r) {
                         r.end = RunEnd::kRefused;
                         r.axis = 0;
                         r.refusal = static_cast<std::uint8_t>(Refusal::kRate);
                       }),
                  What::kWithdraw, "rate"},
        AfterRuns{
            "TooShort", false,
            with(run_of(100.0, 100.0, 1.0), [](OffsetRun& r) { r.cycles = kMinCountedCycles - 1; }),
            What::kKeep, "too few cycles"},
        AfterRuns{"DryAsPredicted", false,
                  with(run_of(105.0, 100.0, 1.0), [](OffsetRun& r) { r.live = false; }),
                  What::kKeep, "as predicted"},
        AfterRuns{"DryNotAsPredicted", false,
                  with(run_of(107.0, 100.0, 1.0), [](OffsetRun& r) { r.live = false; }),
                  What::kLearnAnew, "axis Y 107 um instead of the expected 100 um"}),
    [](const auto& one) { return one.param.name; });

TEST(GainDetail, IsJsonAlsoWhereNothingWasMeasured) {
  OffsetRun run = run_of(3.0, 100.0, 1.0);
  run.cycles = 0;
  run.axes[0].measured = kAbsent;
  const LearnedProgram learned = learned_of(true);
  const nlohmann::json none =
      nlohmann::json::parse(gain_detail(run, learned, ruling_after(run, learned, kTwoAxes)));
  EXPECT_TRUE(none["axes"][0]["measured_rms_m"].is_null());
  EXPECT_EQ(none["ruling"], "keep");
  const OffsetRun whole = run_of(3.0, 100.0, 1.0);
  const nlohmann::json some =
      nlohmann::json::parse(gain_detail(whole, learned, ruling_after(whole, learned, kTwoAxes)));
  EXPECT_NEAR(some["axes"][1]["measured_rms_m"].get<double>(), 3e-6, 1e-12);
  EXPECT_NEAR(some["contour"]["before_rms_m"].get<double>(), 1e-5, 1e-12);
  EXPECT_THAT(gain_text(whole, learned), HasSubstr("X RMS measured 3 um, predicted 100 um"));
}

}  // namespace
}  // namespace servotwin::daemon
