// Signals of several axes of a recording over the same rows: the command of one, the torque of
// another.
#pragma once

#include <Eigen/Core>
#include <cstdio>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "identification/recording/segments.h"

namespace servotwin::cli {

/// "X.torque".
struct Channel {
  std::string axis, name;
};

/// "torque" of `axis`, or "Y.torque" of another one, with the axis as `whole` spells it. Throws
/// UsageError if the name is not one of the known ones.
[[nodiscard]] Channel channel_of(const std::string& given, const std::string& axis,
                                 const std::vector<std::string>& known, const Recording& whole);

class AxisChannels {
 public:
  /// Every axis used later must have the same segments as `axis`; reports on reading go to
  /// `people`.
  AxisChannels(const Recording& recording, const std::string& axis, std::FILE* people);

  [[nodiscard]] const SegmentedAxis& segmented(const std::string& axis);
  [[nodiscard]] std::size_t segments() const { return axes_.front().segments.size(); }
  [[nodiscard]] double sample_time_s() const { return axes_.front().sample_time_s; }
  /// The "command", "position", "error" or "torque" of one segment. Throws std::runtime_error if
  /// the axis does not have it.
  [[nodiscard]] Eigen::ArrayXd values(const Channel& channel, std::size_t segment);

 private:
  const Recording& recording_;
  std::FILE* people_;
  std::vector<SegmentedAxis> axes_;
};

/// First row and number of rows of the stretches in which every signal has a value in every row.
[[nodiscard]] std::vector<std::pair<Eigen::Index, Eigen::Index>> finite_stretches(
    const std::vector<const Eigen::ArrayXd*>& signals);

}  // namespace servotwin::cli
