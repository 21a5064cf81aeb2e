#include "cli/common/axis_channels.h"

#include <algorithm>
#include <cmath>

#include "cli/common/command.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "drivers/common/text.h"

namespace servotwin::cli {

Channel channel_of(const std::string& given, const std::string& axis,
                   const std::vector<std::string>& known, const Recording& whole) {
  const std::size_t point = given.rfind('.');
  Channel out = point == std::string::npos
                    ? Channel{axis, given}
                    : Channel{given.substr(0, point), given.substr(point + 1)};
  if (std::find(known.begin(), known.end(), out.name) == known.end() || out.axis.empty()) {
    throw UsageError(
        in_quotes(given) + " is none of " + listed(known) +
        (axis.empty() ? " as AXIS.channel" : ", of --axis or as AXIS.channel") +
        (out.axis.empty() ? std::string("; of which axis?") : did_you_mean(out.name, known)));
  }
  out.axis = axis_of(whole, out.axis);
  return out;
}

AxisChannels::AxisChannels(const Recording& recording, const std::string& axis, std::FILE* people)
    : recording_(recording), people_(people) {
  axes_.reserve(recording.axes.size());  // references returned by `segmented` stay valid
  (void)segmented(axis);
}

const SegmentedAxis& AxisChannels::segmented(const std::string& axis) {
  for (const SegmentedAxis& one : axes_) {
    if (one.axis == axis) return one;
  }
  axes_.push_back(segment_axis(recording_, axis));
  for (const std::string& line : axes_.back().report.lines()) say(people_, line);
  return axes_.back();
}

Eigen::ArrayXd AxisChannels::values(const Channel& channel, std::size_t segment) {
  const SegmentedAxis& axis = segmented(channel.axis);
  const SegmentedAxis& first = axes_.front();
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(axis.source + ": " + channel.axis + " has no " + why);
  };
  if (axis.segments.size() != first.segments.size() ||
      axis.segments[segment].size() != first.segments[segment].size() ||
      axis.segments[segment].start_s != first.segments[segment].start_s)
    refuse("segments at the same times as " + first.axis +
           ": one axis alone has a gap; select a part without gaps with --from and --to");
  const Segment& of = axis.segments[segment];
  if (channel.name == "command") return of.command;
  if (channel.name == "torque") {
    if (of.torque.size() == 0) refuse("torque");
    return of.torque;
  }
  if (of.actual.size() == 0) refuse("encoder values");
  if (channel.name == "position") return of.actual;
  return of.command - of.actual;
}

std::vector<std::pair<Eigen::Index, Eigen::Index>> finite_stretches(
    const std::vector<const Eigen::ArrayXd*>& signals) {
  const auto finite = [&](Eigen::Index i) {
    return std::all_of(signals.begin(), signals.end(),
                       [i](const Eigen::ArrayXd* x) { return std::isfinite((*x)(i)); });
  };
  std::vector<std::pair<Eigen::Index, Eigen::Index>> out;
  const Eigen::Index size = signals.front()->size();
  for (Eigen::Index begin = 0; begin < size;) {
    Eigen::Index end = begin;
    while (end < size && finite(end)) ++end;
    if (end > begin) out.emplace_back(begin, end - begin);
    begin = end + 1;
  }
  return out;
}

}  // namespace servotwin::cli
