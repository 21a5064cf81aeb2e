// The fit of an axis of two masses in place of a rigid one (twin/two_mass_axis.h).
//
// A loop that was fitted as if the axis were rigid has taken over a part of the vibration. Springs
// are sought in the phases of sliding (two_mass_search.h), gaps from when the load hits
// (gap_scan.h) and over a grid of widths; they are fitted to a part of the recording, the best of
// those to all.
// Units: SI, rad for m on rotary axes. Any thread.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "identification/loop/coordinates.h"
#include "identification/loop/free_elements.h"
#include "identification/loop/projection.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct TwoMassFit {
  Structure structure;
  Model model;
  double rms = 0.0;  ///< on the segments; geometric mean of both encoders [m | rad]
  /// The drive without play as it shows where the axis slides, with friction of a first guess;
  /// absent where it does not show.
  std::optional<Model> sliding = {};
};

/// Whether a model is physically plausible beyond the bounds of its single parameters.
using Plausible = std::function<bool(const Model&)>;

/// The best plausible one of these kinds of effects that make an axis one of two masses, beside the
/// effects of `rigid`. One with play must be clearly better than the same without it. `to_beat`:
/// the best model without two masses, which may be `rigid`; what stays far behind it after some
/// rounds is not fitted on. `most`: the RMS [m | rad] above which two masses are of no use. A
/// spring whose fit to the phases of sliding leaves clearly more is not fitted, nor one that leaves
/// more there than another leaves of all, where no causes are beside them; neither is asked where
/// both encoders are recorded. The law of friction may have become that of Coulomb. Nothing if none
/// is valid, or better than `rigid`.
[[nodiscard]] std::optional<TwoMassFit> fit_two_masses(
    const std::vector<Segment>& segments, const Structure& structure, const Model& rigid,
    const Model& to_beat, double most, const std::vector<std::size_t>& kinds, double encoder_step,
    const Plausible& plausible);

/// Laws of friction that are tried on the load: the friction of a rigid axis that was fitted to a
/// load on a spring stands for a part of the spring.
inline constexpr std::array kLawsOnLoad{kind_of<Presliding>(), kind_of<LuGre>(),
                                        kind_of<PreslidingStribeck>()};

/// The same two masses with another law of friction, from its level and travel, not fitted again
/// (`rms` is that of the old law); nothing if it is that law already. `form`: of free elements
/// (free_elements.h), which may begin again from such elements.
[[nodiscard]] std::optional<TwoMassFit> with_law(TwoMassFit fit, std::size_t law,
                                                 double form = kFormsOfFreeElements[1]);

/// The drive as it shows where the axis slides with this law of friction, whose shapes are those of
/// the catalogue, not fitted: those of the rigid axis were fitted as if there were no spring.
/// Nothing where the drive does not show.
[[nodiscard]] std::optional<TwoMassFit> sliding_with_law(const TwoMassFit& fit, std::size_t law,
                                                         double form = kFormsOfFreeElements[1]);

/// Fitted to the segments in free simulation from where it is, in at most so many rounds a pass
/// (fewer with play, output_error.h); `held` is not fitted. Nothing without a valid
/// fit.
[[nodiscard]] std::optional<TwoMassFit> refined(TwoMassFit fit,
                                                const std::vector<Segment>& segments,
                                                double encoder_step, int rounds, int passes,
                                                const Held& held = {});

/// Rounds and passes to see whether a law of friction is worth more, and to fit it.
inline constexpr int kTryRounds = 6, kTryPasses = 1, kFitRounds = 20, kFitPasses = 2;
/// Rounds in which the friction alone is fitted beside a drive that is known, or starts are ranked.
inline constexpr int kFrictionRounds = 8;

/// The same axis without its play, if the gap is as narrow as it may be: then there is none.
[[nodiscard]] TwoMassFit without_empty_gap(TwoMassFit fit);

}  // namespace servotwin
