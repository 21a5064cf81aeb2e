// Which structure an axis has: order, constant force, delay, law of friction, modes of vibration,
// another axis. Chosen within its training data, two thirds of which are fitted and the last third
// predicted in free simulation (docs/theory.md 4.6 to 4.8): the simplest one that no richer one
// beats by the required ratio of validation RMS.
#pragma once

#include <string>
#include <vector>

#include "identification/loop/identify.h"

namespace servotwin {

/// A friction law with free elements, and the loop of the other order, are tried only if the
/// residual RMS exceeds this multiple of the noise floor.
inline constexpr double kMinRmsOverFloorToGoOn = 2.0;
/// Validation RMS of friction with free elements, or of modes that change with position, over that
/// of the model before, at most, to accept it: they have six to nine parameters more.
inline constexpr double kMaxRmsRatioForRichModel = 0.85;

struct ChosenStructure {
  Structure structure;
  /// The end point of the chosen fit, if it contains modes or another axis: a new search might miss
  /// them.
  std::vector<Point> from;
  Loop moving;  ///< the loop with its modes that change with position, if they do
};

/// Chooses the structure of the axis `name`; appends every trial to `tried`. Throws
/// std::runtime_error if no structure fits the motion.
[[nodiscard]] ChosenStructure chosen_structure(const std::string& name, bool rotary,
                                               const std::vector<Segment>& training,
                                               const IdentifyOptions& options, double encoder_step,
                                               std::vector<StructureTrial>& tried);

/// A model as a point of a projection, in which modes are constant.
[[nodiscard]] Point point_of(const Model& model);
/// The structure that this model has.
[[nodiscard]] Structure structure_of(const Model& model);
/// The law of friction in it; Coulomb friction where it has none.
[[nodiscard]] std::size_t law_of(const Structure& structure);
/// The model whose modes change with position as those of another loop with as many modes.
[[nodiscard]] Model with_modes_moving_as(const Loop& as, Model model);

}  // namespace servotwin
