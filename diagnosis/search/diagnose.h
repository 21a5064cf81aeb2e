// Finds what the simulation of an axis gets wrong, names the causes, extends the model by them, and
// measures their gain on held-out data (docs/theory.md 10).
//
// Starting from the baseline of `identify`, candidate effects of the catalogue are added one by
// one. Each is fitted together with the loop and all earlier effects by variable projection, so
// that neither absorbs a part of the other, and judged in free simulation by blocked
// cross-validation within the training data. It is added if the error falls by a minimum ratio
// (judgement.h) and significantly: a paired test over intervals of 0.25 s, whose threshold is
// divided by the number of candidates (Bonferroni), so that a cause is rarely added on a machine
// without effects (designed for 1 %; measured: docs/measurements.md 11). An effect that a later one
// has made unnecessary is removed again. Which effects are added is decided on the training data
// alone. The hold-out measures the gains; a cause without a clear gain on it is only suspected, all
// causes are discarded where they raise its error, and a recording whose error is not explained is
// divided again or fitted with the other loop order.
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/evidence/command_lag.h"
#include "diagnosis/search/gain.h"
#include "diagnosis/search/observability.h"
#include "diagnosis/search/suggested_motion.h"
#include "diagnosis/statistics/regressor.h"
#include "diagnosis/statistics/residual.h"
#include "diagnosis/statistics/spectrum.h"
#include "identification/loop/identify.h"
#include "identification/recording/noise_floor.h"

namespace servotwin {

enum class Verdict { kExplained, kNothingSignificant, kUnexplained };
[[nodiscard]] std::string_view name_of(Verdict verdict);

/// Least confidence of a named cause. Below it the cause is more likely wrong than right: it is
/// only suspected.
inline constexpr double kMinConfidenceToName = 0.5;

/// The place of a cause that has no effect in the model.
inline constexpr std::size_t kNoEffect = static_cast<std::size_t>(-1);

/// A quantity that has changed since an earlier model was identified.
struct Moved {
  std::string name, unit;
  double before = 0.0, after = 0.0;  ///< 1 and a ratio, or both values in the unit
  double deviation = kAbsent;        ///< standard deviation of `after`
};

/// What keeps a cause from being named, whatever its confidence.
enum class CauseDoubt {
  kNone,
  kGain,       ///< its gain on held-out data is small and may be zero
  kParameters  ///< a parameter is at the bound of what this cause can be
};

struct Cause {
  std::string id;         ///< identifier of the contract: "stribeck", "cogging", ..
  std::size_t place = 0;  ///< of its effect in the extended model; kNoEffect: none
  std::vector<std::pair<std::string, double>> counts;  ///< what was counted, where it has no effect
  double wins = 0.0;        ///< share of bootstrap samples in which it beats its nearest rival
  double confidence = 0.0;  ///< prior hit rate x wins x share that all causes explain; 1 if it
                            ///< was counted
  double statistic = 0.0;   ///< z of the paired test when it was added; 0: it was in the baseline
  double p = kAbsent;       ///< one-sided, before the correction for many candidates
  std::vector<std::string> ambiguous_with;  ///< causes that explain the recording nearly as well
  Gain gain;
  double worth = 0.0;  ///< squared error that it removes, the rest refitted [m^2 | rad^2]
  CauseDoubt doubt = CauseDoubt::kNone;
  std::string at_end;            ///< with CauseDoubt::kParameters: what is at its limit, for people
  std::vector<Moved> moved;      ///< in a comparison with an earlier model only
  std::optional<Model> without;  ///< the extended model refitted without it

  /// Whether it was counted in the recording, not inferred: the model does not contain it.
  [[nodiscard]] bool counted() const { return place == kNoEffect && moved.empty(); }
};

struct Diagnosis {
  Verdict verdict = Verdict::kNothingSignificant;
  bool against_earlier = false;  ///< the baseline is an earlier model; causes are changes
  double earlier_rms = kAbsent;  ///< RMS of that model on its own data [m | rad]
  ModelRecord baseline;          ///< judged on the hold-out
  ModelRecord extended;          ///< with all causes; the baseline if there is no cause
  std::vector<Cause> causes;     ///< named, sorted by the error that they explain
  /// Of too low a confidence to be named, or doubted. They are kept in the extended model, which
  /// predicts better with them.
  std::vector<Cause> suspected;
  std::vector<NotObservable> not_observable;  ///< without those that are named or suspected
  /// Place in the extended model of a term that improves the prediction but is not explained by a
  /// cause; kNoEffect: there is none.
  std::size_t not_understood = kNoEffect;
  RegimeShares regimes;             ///< of the residual on the hold-out
  RegressorShares regressors;       ///< of the same residual
  std::vector<SpectrumPeak> peaks;  ///< of the same residual
  double unexplained_share = 0.0;   ///< of the baseline's squared error beyond the noise floor
  CommandLag lag;                   ///< of the tracking error on the hold-out
  std::optional<SuggestedTest> suggested_test;  ///< where the recording leaves causes undecided
  /// The motor's limit and the moments at it, as text: "190 N in 6 moments (0.3 s in all)"; empty:
  /// none were seen.
  std::string at_limit;
  bool limit_left_out = false;     ///< the loop is identified without the moments at the limit
  int fits = 0;                    ///< number of fits of the search
  std::vector<std::string> steps;  ///< of the search, as text
};

struct DiagnoseOptions {
  IdentifyOptions identify;
  std::vector<std::string> leave_out;  ///< causes that are not searched for
  [[nodiscard]] bool leaves_out(std::string_view cause) const {
    return std::find(leave_out.begin(), leave_out.end(), cause) != leave_out.end();
  }
  /// The recorded encoder is the one that the position loop uses: its own errors are not
  /// observable. False: not known.
  bool encoder_in_loop = false;
  /// If the verdict is "unexplained" and nearly all of the error lies in one part of the recording,
  /// repeats the diagnosis with another division into training data and hold-out, so that both
  /// contain a part of the error. False: the division is by time alone.
  bool balance = true;
  /// Is told what is tried next ("cogging"), before every fit, and by several threads at once.
  std::function<void(std::string_view)> progress;

  /// Before a fit: tells, and throws Interrupted where the thread is interrupted.
  void begin(std::string_view what) const;
};

/// The diagnosis of an axis. Moments in which a recorded torque is at the limit of the motor are
/// left out (identification/torque/torque_limit.h). Throws std::runtime_error where `identify`
/// does, and Interrupted where the thread is interrupted (least_squares/interruption.h). Any
/// thread.
[[nodiscard]] Diagnosis diagnose(const SegmentedAxis& axis, const DiagnoseOptions& options = {});

/// The segments after this time, to judge a model on, with the motion before it as lead-in.
[[nodiscard]] std::vector<Segment> held_out(const std::vector<Segment>& segments, double from_s);

/// The simulation error of a model in each segment, from the sample at which its starting state has
/// been estimated.
[[nodiscard]] std::vector<ResidualStretch> residual_stretches(const Model& model,
                                                              const std::vector<Segment>& segments);

/// Makes the record of a baseline that of an extended model. The uncertainties of the baseline
/// belong to other parameters; of these none are estimated yet.
void set_extended(ModelRecord& record, const char* method, const Model& model,
                  const std::vector<Segment>& training, const std::vector<Segment>& holdout);

}  // namespace servotwin
