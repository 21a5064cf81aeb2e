// Detects when the tool was cutting, from a tone in the residual that is present only then.
//
// The detector uses the envelope of a spectral line of the residual: a pump is present all the
// time, the tooth frequency only during a cut. Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// The frequencies [Hz] of the spectral lines that are highest above their neighbourhood, at most
/// `most` of them. `h`: sampling time of the signal [s].
[[nodiscard]] std::vector<double> lines_of(const Eigen::Ref<const Eigen::VectorXd>& signal,
                                           double h, std::size_t most);

/// The frequencies [Hz] of highest power. They include intermittent tones, which are broader than a
/// line. `h`: sampling time of the signal [s].
[[nodiscard]] std::vector<double> strongest_of(const Eigen::Ref<const Eigen::VectorXd>& signal,
                                               double h);

/// Sets `in_cut` of every segment to 1 where the residual `left` contains an intermittent tone and
/// 0 elsewhere. False: there is no such tone, and nothing is set.
bool find_cuts(std::vector<Segment>& segments, const std::vector<Eigen::ArrayXd>& left);

}  // namespace servotwin
