// Whether a candidate effect improves a model enough to be added (docs/theory.md 10).
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "diagnosis/search/search.h"
#include "diagnosis/statistics/thresholds.h"

namespace servotwin {

// Share of the error that a law of friction explains which remains as misfit when the machine
// follows another law of friction.
inline constexpr double kLawMisfitShare = 0.1;
// Ratio of errors of a cause that explains nearly all that is left: no misfit of a law of friction
// follows another effect so closely.
inline constexpr double kMaxErrorRatioOfNearlyAll = 0.4;
// Share of the baseline's error: a law of friction is accurate to a few hundredths of the error, so
// that a smaller removed error may be its misfit.
inline constexpr double kMinRemovedShareOfCause = 0.02;
// Ratio of errors (RMS, or cost where costs are compared) below which a candidate explains a large
// part of the error.
inline constexpr double kMaxErrorRatioOfLargeGain = 0.7;
// In sampling times: a model does without a shorter delay where it can ..
inline constexpr double kMinDelaySamples = 0.25;
// .. and a delay that is shorter than this is no cause: command and encoder of one row may be read
// at different times within one cycle.
inline constexpr double kMinDelaySamplesOfCause = 0.5;

/// A candidate, and the model without it to compare with; both were fitted in the same way.
struct Tried {
  Hypothesis model;
  const Hypothesis* before;
  Screened screened;
  /// RMS with the candidate over RMS without it.
  [[nodiscard]] double left() const { return model.rms() / before->rms(); }
};

struct Judgement {
  double z = 0.0, p = 1.0;  ///< of the paired test; p is one-sided
  bool earned = false;      ///< the candidate may be added
};

/// What the error that a candidate removes is compared with.
struct Bar {
  double baseline = 0.0;       ///< RMS before anything was added [m | rad]
  double friction = 0.0;       ///< RMS that laws of friction have removed so far
  std::size_t candidates = 1;  ///< that were tried
};

/// Passes the paired block test, or the score test if the blocks do not contradict it; and removes
/// enough of the error.
[[nodiscard]] Judgement judged(const Tried& one, const Bar& bar);

/// The error that an addition removes: sqrt(before^2 - after^2) of the RMS [m | rad].
[[nodiscard]] double removed_rms(const Hypothesis& before, const Hypothesis& after);

/// Share of bootstrap resamples in which `best` removes a larger share of the squared error of its
/// own comparison model than `rival` of that of its own.
[[nodiscard]] double share_won(const Tried& best, const Tried& rival);

/// Whether the misfit of a law of friction can look like this effect, as it can for effects that
/// act at all reversals and low speeds. It cannot look like effects that are periodic, isolated in
/// time or driven by another signal, nor like a difference between the directions, since the laws
/// are symmetric.
[[nodiscard]] bool like_friction(std::size_t kind);

/// Whether the parameter with which this cause ends (`CauseNature::ends_at`) is at its limit, a
/// compliance does not vibrate, or a delay is shorter than kMinDelaySamplesOfCause, at its limit,
/// or an imitation of a velocity lag, or a law of friction at its least breakaway ratio, so that
/// the fit asks for something else. `length_scale`: of the axis
/// (identification/recording/motion_range.h). Throws std::invalid_argument for an unknown cause.
[[nodiscard]] bool at_end_of(std::string_view cause, const Model& model, const Effect& effect,
                             double length_scale);

/// For people: "damping ratio at its limit 0.2: more is a filter than a vibration"; empty if it is
/// not at its limit.
[[nodiscard]] std::string end_text(std::string_view cause, const Model& model, const Effect& effect,
                                   double length_scale);

struct Vibration {
  double frequency_hz = 0.0, damping_ratio = 0.0;
};
/// The vibration that a compliance of this model stands for. Where the fit has exchanged loop and
/// mode, so that the frequency of the mode is beyond what the samples show, it is the pair of poles
/// of the loop; nothing where that has none.
[[nodiscard]] std::optional<Vibration> vibration_of(const Model& model, const Effect& mode);

}  // namespace servotwin
