// The axis whose acceleration acts on another one, where several move with it: the one that
// explains most of what a model without it leaves. Screened (diagnosis/search/screen.h), not
// fitted: whether a coupling is there at all decides the fit that uses it.
//
// Any thread; no clock.
#pragma once

#include <string>
#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct Recording;

/// What it must explain, as a share of the squared error. Of axes that do not act at most 0.01
/// (tests/diagnosis/acting_axis_test.cpp).
inline constexpr double kMinShareOfActing = 0.05;

/// Share of the squared error on left-out blocks that the acceleration of another axis explains
/// beside the model without its coupling; at most 1, not above 0 where it explains nothing.
/// `beside`: the motion with the command of that axis as its neighbour. Errors:
/// std::invalid_argument of the simulation.
[[nodiscard]] double share_of_neighbour(const Model& model, const std::vector<Segment>& beside);

struct ActingAxis {
  bool sought = false;             ///< there were several to choose from
  std::string name;                ///< empty: none explains kMinShareOfActing
  double share = 0.0;              ///< share_of_neighbour()
  std::vector<std::string> apart;  ///< not looked at: their commands are of other times
};

/// The axis that acts on `axis`, beside models that are identified for this from at most 30 s of
/// the recording: some seconds. None where the recording has fewer than two other axes with
/// commands, or no model can be identified.
[[nodiscard]] ActingAxis acting_axis(const Recording& recording, const std::string& axis);

}  // namespace servotwin
