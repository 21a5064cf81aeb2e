#include "daemon/correct/correction_rule.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "drivers/common/text.h"
#include "identification/model/json_number.h"
#include "ilc/gate.h"
#include "twin/shown_units.h"

namespace servotwin::daemon {
namespace {

using What = CorrectionRuling::What;

double rms(double squares, const OffsetRun& run) {
  return std::sqrt(squares / static_cast<double>(run.cycles));
}

/// Why the run ended early through a fault of model, path or offset; empty if it did not.
std::string failure_of(const OffsetRun& run, const std::string& axis) {
  const std::string at = " " + number(run.at_s) + " s after the start of the program";
  switch (run.end) {
    case RunEnd::kResidual:
      return "the residual of axis " + axis + " left its band" + at;
    case RunEnd::kContour:
      return "the path error was larger than predicted without a correction" + at;
    case RunEnd::kRefused:
      return "the gate refused the offset of axis " + axis + at + ": " +
             std::string(name_of(static_cast<Refusal>(run.refusal)));
    default:
      return {};
  }
}

}  // namespace

CorrectionRuling ruling_after(const OffsetRun& run, const LearnedProgram& learned,
                              const MachineDescription& machine) {
  const std::string axis =
      run.axis >= 0 ? machine.axes[static_cast<std::size_t>(run.axis)].name : std::string();
  if (const std::string why = failure_of(run, axis); !why.empty()) {
    const auto refusal = static_cast<Refusal>(run.refusal);
    const bool of_model = run.end == RunEnd::kRefused &&
                          (refusal == Refusal::kOtherAxisState || refusal == Refusal::kModelStale);
    return {of_model ? What::kLearnAnew : What::kWithdraw, why};
  }
  if (run.cycles < kMinCountedCycles) return {What::kKeep, "too few cycles to judge"};

  if (run.live && learned.contour_before.size() > 0 && run.contour.measured >= run.contour.before)
    return {What::kWithdraw, "the path error was no smaller than predicted without a correction"};
  std::string off;
  for (std::size_t n = 0; n < learned.axes.size(); ++n) {
    const RunSquares& squares = run.axes[n];
    const std::string& name = learned.axes[n].name;
    if (!std::isfinite(squares.measured))
      return {What::kWithdraw, "axis " + name + " has cycles without an encoder value"};
    if (run.live && squares.measured >= squares.before)
      return {What::kWithdraw,
              "the error of axis " + name + " was no smaller than predicted without a correction"};
    const double predicted = rms(run.live ? squares.after : squares.before, run);
    const double expected = run.live ? std::hypot(predicted, learned.holdout_rms[n]) : predicted;
    const double measured = rms(squares.measured, run);
    const bool as_predicted = run.live ? measured <= kMaxRatioToExpectedRms * expected
                                       : std::abs(measured - predicted) <=
                                             kMaxRatioToExpectedRms * learned.holdout_rms[n];
    if (!as_predicted)
      off += (off.empty() ? "axis " : ", axis ") + name + " " +
             rounded_micro_text(measured, learned.axes[n].rotary) + " instead of the expected " +
             rounded_micro_text(expected, learned.axes[n].rotary);
  }
  if (!off.empty()) return {What::kLearnAnew, off};
  return {What::kKeep, "as predicted"};
}

std::string gain_text(const OffsetRun& run, const LearnedProgram& learned) {
  std::string out = run.live ? "sent" : "dry run";
  if (run.end != RunEnd::kFinished) out += ", ended by " + std::string(name_of(run.end));
  if (run.cycles == 0) return out;
  const auto add = [&](const std::string& what, const RunSquares& squares, bool rotary) {
    out += "; " + what + " RMS measured " + rounded_micro_text(rms(squares.measured, run), rotary) +
           ", predicted " + rounded_micro_text(rms(squares.before, run), rotary) + " without and " +
           rounded_micro_text(rms(squares.after, run), rotary) + " with correction";
  };
  for (std::size_t n = 0; n < learned.axes.size(); ++n)
    add(learned.axes[n].name, run.axes[n], learned.axes[n].rotary);
  if (learned.contour_before.size() > 0) add("contour", run.contour, false);
  return out;
}

std::string gain_detail(const OffsetRun& run, const LearnedProgram& learned,
                        const CorrectionRuling& ruling) {
  using nlohmann::json;
  const auto figures = [&](const RunSquares& squares, const std::string& unit) {
    const auto value = [&](double sum) {
      const double one = rms(sum, run);
      return number_or_null(one);
    };
    return json{{"measured_rms" + unit, value(squares.measured)},
                {"before_rms" + unit, value(squares.before)},
                {"after_rms" + unit, value(squares.after)}};
  };
  json axes = json::array();
  for (std::size_t n = 0; n < learned.axes.size(); ++n) {
    axes.push_back(figures(run.axes[n], learned.axes[n].rotary ? "_rad" : "_m"));
    axes.back()["axis"] = learned.axes[n].name;
    axes.back()["model_version"] = learned.axes[n].model_version;
  }
  json out{{"program", learned.program.name},
           {"revision", learned.program.revision},
           {"live", run.live},
           {"ended", name_of(run.end)},
           {"cycles", run.cycles},
           {"ruling", ruling.what == What::kKeep        ? "keep"
                      : ruling.what == What::kLearnAnew ? "learn_anew"
                                                        : "withdraw"},
           {"reason", ruling.reason},
           {"axes", std::move(axes)}};
  if (learned.contour_before.size() > 0) out["contour"] = figures(run.contour, "_m");
  return out.dump();
}

}  // namespace servotwin::daemon
