// Which structure an axis has: order, constant force, delay, law of friction, modes of vibration,
// another axis. Chosen within its training data, two thirds of which are fitted and the last third
// predicted in free simulation (docs/theory.md 4.6 to 4.8): the simplest one that no other beats by
// what its parameters are worth.
#pragma once

#include <string>
#include <vector>

#include "identification/loop/identify.h"

namespace servotwin {

struct ChosenStructure {
  Structure structure;
  /// Where the fit that won ended, where modes or another axis are in it: a search anew might miss
  /// them.
  std::vector<Point> from;
  Loop moving;  ///< with the modes as they were found to move, where they are
};

/// Of the axis `name`; all that was tried goes to `tried`. Throws std::runtime_error where nothing
/// follows the motion.
[[nodiscard]] ChosenStructure chosen_structure(const std::string& name,
                                               const std::vector<Segment>& training,
                                               const IdentifyOptions& options, double encoder_step,
                                               std::vector<StructureTrial>& tried);

/// A model as a point of a projection, in which modes stand.
[[nodiscard]] Point point_of(const Model& model);
/// The model with its modes moving as those of another loop of as many.
[[nodiscard]] Model with_modes_moving_as(const Loop& as, Model model);

}  // namespace servotwin
