// Signals of the axes of a recording side by side: the command of one, the torque of another.
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

/// "torque" of `axis`, or "Y.torque" of another one. Throws UsageError where the name is none of
/// the known ones.
[[nodiscard]] Channel channel_of(const std::string& given, const std::string& axis,
                                 const std::vector<std::string>& known);

class AxisChannels {
 public:
  /// Every axis that is asked for must have the rows of this one; what was read is said.
  AxisChannels(const Recording& recording, const std::string& axis, std::FILE* people);

  [[nodiscard]] const SegmentedAxis& segmented(const std::string& axis);
  [[nodiscard]] std::size_t segments() const { return axes_.front().segments.size(); }
  [[nodiscard]] double sample_time_s() const { return axes_.front().sample_time_s; }
  /// "command", "position", "error" or "torque" of one segment. Throws std::runtime_error where the
  /// axis has none.
  [[nodiscard]] Eigen::ArrayXd values(const Channel& channel, std::size_t segment);

 private:
  const Recording& recording_;
  std::FILE* people_;
  std::vector<SegmentedAxis> axes_;
};

/// First row and number of rows of the unbroken stretches in which every signal has a value.
[[nodiscard]] std::vector<std::pair<Eigen::Index, Eigen::Index>> finite_stretches(
    const std::vector<const Eigen::ArrayXd*>& signals);

}  // namespace servotwin::cli
