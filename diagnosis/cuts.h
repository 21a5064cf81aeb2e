// When the tool was in the cut, from the tone that is heard then and not otherwise.
//
// The envelope of a line of the spectrum of what a model leaves: a pump is heard all the time,
// teeth only in the cut. Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// The frequencies [Hz] that stand out most from their neighbourhood in a signal of this step.
[[nodiscard]] std::vector<double> lines_of(const Eigen::Ref<const Eigen::VectorXd>& signal,
                                           double h, std::size_t most);

/// Those that have most power: a tone that is there a part of the time is broader than a line.
[[nodiscard]] std::vector<double> strongest_of(const Eigen::Ref<const Eigen::VectorXd>& signal,
                                               double h);

/// Sets `in_cut` of every segment, where `left` has a tone that comes and goes. False: there is
/// none.
bool find_cuts(std::vector<Segment>& segments, const std::vector<Eigen::ArrayXd>& left);

}  // namespace servotwin
