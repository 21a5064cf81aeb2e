// What the simulation gets wrong: finds it, names it, extends the model, and measures the gain on
// data that it has not seen (docs/theory.md 10).
//
// From a baseline (identify's) candidates of the catalogue are added one by one. Each is fitted
// with the loop and all effects before it by variable projection, so that the loop does not absorb
// the effect nor the effect the loop, and judged in free simulation by blocked cross-validation
// within the training data. It earns its place if the error falls by kWorthIt, in most blocks, and
// by more than chance: a paired test over quarter-second pieces whose threshold is divided by the
// number of candidates (Bonferroni), so that a clean machine gets no cause. An effect that another
// one has made needless is taken out again. The hold-out decides nothing but where it begins; gains
// are measured on it.
#pragma once

#include <stop_token>
#include <string>
#include <vector>

#include "diagnosis/gain.h"
#include "diagnosis/observability.h"
#include "diagnosis/regressor.h"
#include "diagnosis/residual.h"
#include "diagnosis/spectrum.h"
#include "diagnosis/suggested_motion.h"
#include "identification/loop/identify.h"
#include "identification/recording/noise_floor.h"

namespace servotwin {

enum class Verdict { kExplained, kNothingSignificant, kUnexplained };
[[nodiscard]] std::string_view name_of(Verdict verdict);

/// A cause that is more likely wrong than right is no answer: it is suspected.
inline constexpr double kNamed = 0.5;

inline constexpr std::size_t kNoEffect = static_cast<std::size_t>(-1);

/// A quantity of the machine against an earlier model.
struct Moved {
  std::string name, unit;
  double before = 0.0, after = 0.0;  ///< both 1 and a ratio, or both in the unit
  double deviation = kAbsent;        ///< standard deviation of `after`
};

struct Cause {
  std::string id;         ///< of the contract: "stribeck", "cogging", ..
  std::size_t place = 0;  ///< of the effect in the extended model; kNoEffect: of the record alone
  std::vector<std::pair<std::string, double>> counts;  ///< where there is no effect
  double beaten = 0.0;      ///< share of bootstrap samples in which it beats its nearest rival
  double confidence = 0.0;  ///< the same times the share that all causes explain and the share of
                            ///< such causes that were right; 1: it is counted
  double statistic = 0.0;   ///< of the paired test when it was added; 0: it was in the baseline
  double p = kAbsent;       ///< one-sided, before the correction for many candidates
  std::vector<std::string> ambiguous_with;
  Gain gain;
  double worth = 0.0;    ///< squared error that it takes away, the rest fitted again [m^2 | rad^2]
  bool doubted = false;  ///< on data not seen it gains little, and perhaps nothing
  std::vector<Moved> moved;      ///< against an earlier model only
  std::optional<Model> without;  ///< the extended model fitted again without it
};

struct Diagnosis {
  Verdict verdict = Verdict::kNothingSignificant;
  bool against_earlier = false;  ///< the baseline is an earlier model: causes are what changed
  double earlier_rms = kAbsent;  ///< of that model where it was identified [m | rad]
  ModelRecord baseline;          ///< judged on the hold-out
  ModelRecord extended;          ///< with all causes; the baseline where there is none
  std::vector<Cause> causes;     ///< by their share of the error explained
  /// Too unsure to be named: in the extended model, where they predict better, and no answer.
  std::vector<Cause> suspected;
  std::vector<NotObservable> not_observable;  ///< of what is neither named nor suspected
  /// Place in the extended model of a term that predicts and explains nothing; kNoEffect: none.
  std::size_t not_understood = kNoEffect;
  RegimeShares regimes;             ///< of what is left on the hold-out
  RegressorShares regressors;       ///< likewise
  std::vector<SpectrumPeak> peaks;  ///< likewise
  double unexplained_share = 0.0;   ///< of the baseline's squared error beyond the noise floor
  std::optional<SuggestedTest> suggested_test;  ///< where something is left in doubt
  int fits = 0;
  std::vector<std::string> steps;  ///< what was tried, added and taken out, for people
};

struct DiagnoseOptions {
  IdentifyOptions identify;
  std::vector<std::string> leave_out;  ///< causes that are not looked for
  /// The recorded encoder is the one that the position loop uses, which cannot show what the loop
  /// makes right; false: not known.
  bool encoder_in_loop = false;
  /// Where too much is left and nearly all of it in one part, the recording is divided anew, so
  /// that what happens late in it is in the training data; false: by time alone.
  bool balance = true;
  std::stop_token stop;  ///< ends a diagnosis before its next fit: it throws
};

/// Throws std::runtime_error as `identify` does. Any thread.
[[nodiscard]] Diagnosis diagnose(const SegmentedAxis& axis, const DiagnoseOptions& options = {});

/// What follows this time, to judge a model on. Of one with a limit of the motor the motion before
/// it comes as lead: a control that holds its integrator there does not forget.
[[nodiscard]] std::vector<Segment> holdout_for(const Model& model,
                                               const std::vector<Segment>& segments, double from_s);

/// What a model gets wrong of each segment, from where its starting state is found.
[[nodiscard]] std::vector<ResidualStretch> residual_stretches(const Model& model,
                                                              const std::vector<Segment>& segments);

/// Orders the causes of a search and says what is left: verdict, regimes, regressors, lines of the
/// spectrum, unexplained share, what could not show, and the motion that would decide what is in
/// doubt. `holdout` with its cuts.
void conclude(Diagnosis& diagnosis, const SegmentedAxis& axis, const std::vector<Segment>& holdout,
              const NoiseFloor& floor, const DiagnoseOptions& options);

}  // namespace servotwin
