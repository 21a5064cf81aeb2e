#include "daemon/identify/promotion.h"

#include <cmath>
#include <sstream>

#include "twin/shown_units.h"

namespace servotwin::daemon {
namespace {

std::string seconds(double value) {
  std::ostringstream out;
  out.precision(3);
  out << value << " s";
  return out.str();
}

std::string the_other(int version) {
  return version == 0 ? "without a model" : "with model " + std::to_string(version);
}

}  // namespace

bool still_holds(const Candidacy& candidacy, double holdout_rms) {
  constexpr double kMaxRatioToHoldoutRms = 2.0;
  return candidacy.version_in_force > 0 &&
         candidacy.rms_in_force <= kMaxRatioToHoldoutRms * holdout_rms;
}

double significance(const Eigen::ArrayXd& left, const Eigen::ArrayXd& left_by_other) {
  constexpr Eigen::Index kBlocks = 16;
  const Eigen::Index each = left.size() / kBlocks;
  if (each == 0 || left_by_other.size() != left.size()) return kAbsent;
  const Eigen::ArrayXd less = left_by_other.square() - left.square();
  Eigen::ArrayXd parts(kBlocks);
  for (Eigen::Index k = 0; k < kBlocks; ++k) parts[k] = less.segment(k * each, each).mean();
  const double mean = parts.mean();
  const double variance = (parts - mean).square().sum() / (kBlocks - 1);
  return variance > 0.0 ? mean / std::sqrt(variance / kBlocks) : kAbsent;
}

Decision decide(const Candidacy& candidacy, const PromotionRule& rule) {
  if (!candidacy.invalid.empty()) return {Ruling::kInvalid, candidacy.invalid};
  if (!candidacy.refusals.empty()) {
    std::string all;
    for (const std::string& refusal : candidacy.refusals)
      all += (all.empty() ? "" : "; ") + refusal;
    return {Ruling::kRefused, all};
  }
  if (!(candidacy.judged_s >= rule.judge_s)) {
    return {Ruling::kNotJudged, "only " + seconds(candidacy.judged_s) +
                                    " of motion to judge on, needs " + seconds(rule.judge_s)};
  }
  if (!std::isfinite(candidacy.rms))
    return {Ruling::kNotJudged, "it cannot be simulated on held-out motion"};

  const std::string figures = "residual " + micro_text(candidacy.rms, candidacy.rotary, 3) +
                              " RMS on " + seconds(candidacy.judged_s) + " of held-out motion";
  // A candidate that can be simulated beats a model in force that cannot.
  if (!std::isfinite(candidacy.rms_in_force)) {
    return {Ruling::kPromoted,
            figures + "; simulation " + the_other(candidacy.version_in_force) + " fails"};
  }
  const std::string comparison = figures + ", " + the_other(candidacy.version_in_force) + " " +
                                 micro_text(candidacy.rms_in_force, candidacy.rotary, 3);
  if (candidacy.rms <= (1.0 - rule.min_improvement) * candidacy.rms_in_force &&
      candidacy.rms < candidacy.rms_in_force) {
    // Improvements as multiples of min_improvement. Above kTimesWithoutTest no test of significance
    // is needed. Otherwise the t statistic with 15 degrees of freedom must be 1.75 (5 % by chance)
    // for a large improvement, and 3.0 (0.5 %) for a smaller one, because most comparisons are of a
    // machine that has not changed.
    constexpr double kTimesToCountAsLarge = 5.0, kTimesWithoutTest = 10.0;
    constexpr double kMinStatisticIfLarge = 1.75, kMinStatistic = 3.0;
    const auto better_by = [&](double times) {
      return candidacy.rms <= (1.0 - times * rule.min_improvement) * candidacy.rms_in_force;
    };
    const double wanted = better_by(kTimesToCountAsLarge) ? kMinStatisticIfLarge : kMinStatistic;
    if (candidacy.version_in_force == 0 || better_by(kTimesWithoutTest) ||
        candidacy.significance >= wanted)
      return {Ruling::kPromoted, comparison};
    std::ostringstream sure;
    sure.precision(3);
    sure << "; better by " << candidacy.significance << " standard errors, not significant (needs "
         << wanted << ", or an RMS lower by " << 100.0 * kTimesWithoutTest * rule.min_improvement
         << " %)";
    return {Ruling::kByChance, comparison + sure.str()};
  }
  std::ostringstream wanted;
  wanted.precision(3);
  wanted << 100.0 * rule.min_improvement;
  return {Ruling::kNotBetter, comparison + "; must be better by " + wanted.str() + " %"};
}

}  // namespace servotwin::daemon
