// What several parts of the diagnosis decide alike: from when on an improvement counts, and from
// when on two candidates are told apart.
#pragma once

namespace servotwin {

// RMS with a cause over RMS without it, both from cross-validation: a smaller improvement than 2 %
// is not worth a parameter.
inline constexpr double kMaxRmsRatioToAdd = 0.98;
// Expected number of false causes in the diagnosis of a machine without any; divided by the number
// of candidates (Bonferroni).
inline constexpr double kFalseAlarmRate = 0.01;
// z of the paired test above which it does not contradict the score test: one-sided 5 %.
inline constexpr double kMinBlockZ = 1.64;
// A candidate is fitted only with a p from screening of at most this, ..
inline constexpr double kMaxScreenP = 0.05;
// .. and if it lowers the squared error at least by this share.
inline constexpr double kMinScreenGain = 0.004;
inline constexpr double kScreenStep_s = 2e-3;  // sampling time of the data for screening
// A rival that loses in a smaller share of the bootstrap resamples is reported as ambiguous.
inline constexpr double kMinShareToExcludeRival = 0.95;
// Shares of the best gain: above which a candidate counts as a rival, and with which one with fewer
// parameters is preferred.
inline constexpr double kMinGainShareOfRival = 0.8, kMinGainShareOfSimpler = 0.9;
// Share of the friction level by which friction must fall or rise with speed to be named.
inline constexpr double kMinStribeckShare = 0.12;
// Share of the squared error explained with a period that half the period must reach to replace it.
inline constexpr double kMinShareOfHalfPeriod = 0.9;
// Standard deviations: half of a 95 % confidence interval.
inline constexpr double kOf95 = 1.96;
inline constexpr int kMaxCauses = 6;

// RMS of a rigid axis with a loop of the other order over that with this one, above which the loop
// is not of the other order: of 104 recordings of the development part at most 1.5 where it is.
inline constexpr double kMaxRmsRatioOfOtherOrder = 3.0;

}  // namespace servotwin
