#include "daemon/identify/held_out.h"

#include <algorithm>
#include <cmath>

#include "daemon/loop/real_time_loop.h"
#include "drivers/common/text.h"
#include "twin/catalogue.h"
#include "twin/neighbour.h"
#include "twin/twin.h"

namespace servotwin::daemon {
namespace {

// Relative tolerance of the sampling time: a model of another sampling time cannot be used.
constexpr double kCycleTolerance = 0.01;

/// The residual of the tracking error with this model, or the tracking error itself without a
/// model; the lead-in of every segment, and its first `skip_s`, are left out.
Eigen::ArrayXd left_by(const Model* model, const std::vector<Segment>& segments, double skip_s) {
  std::vector<Eigen::ArrayXd> parts;
  Eigen::Index count = 0;
  for (const Segment& segment : segments) {
    const auto skip = std::max(
        segment.lead, static_cast<Eigen::Index>(std::ceil(skip_s / segment.sample_time_s)));
    if (segment.size() <= skip) continue;
    Eigen::ArrayXd left = segment.command - segment.actual;
    if (model != nullptr) left -= simulate(*model, segment);
    parts.emplace_back(left.tail(segment.size() - skip));
    count += parts.back().size();
  }
  Eigen::ArrayXd out(count);
  Eigen::Index at = 0;
  for (const Eigen::ArrayXd& part : parts) {
    out.segment(at, part.size()) = part;
    at += part.size();
  }
  return out;
}

ErrorFigures figures_of(const Eigen::ArrayXd& left) {
  if (left.size() == 0) return {};
  return {std::sqrt(left.square().mean()), left.abs().maxCoeff()};
}

}  // namespace

ErrorFigures judge_on(const std::vector<Segment>& motion, const Model& candidate,
                      const std::vector<Segment>& motion_in_force, const Model* in_force,
                      Candidacy& candidacy) {
  const double skip_s = std::max(starting_state_s(candidate),
                                 in_force != nullptr ? starting_state_s(*in_force) : 0.0);
  const Eigen::ArrayXd left = left_by(&candidate, motion, skip_s);
  const Eigen::ArrayXd left_in_force = left_by(in_force, motion_in_force, skip_s);
  if (left.size() != left_in_force.size())
    throw std::invalid_argument("the two models would be judged on different samples");
  candidacy.rms = figures_of(left).rms;
  candidacy.rms_in_force = figures_of(left_in_force).rms;
  candidacy.significance = significance(left, left_in_force);
  return figures_of(left);
}

int neighbour_in(const MachineDescription& machine, std::size_t axis, const ModelRecord& record) {
  if (coupling_of(record.model) == nullptr) return -1;
  for (std::size_t other = 0; other < machine.axes.size(); ++other) {
    if (other != axis && (record.neighbour.empty() || machine.axes[other].name == record.neighbour))
      return static_cast<int>(other);
  }
  return -1;
}

std::string why_no_neighbour(const ModelRecord& record, const MachineDescription& machine,
                             std::size_t axis) {
  if (coupling_of(record.model) == nullptr || neighbour_in(machine, axis, record) >= 0) return {};
  return std::string("needs the ") + (coupled_by_motion(record.model) ? "motion" : "command") +
         " of " + (record.neighbour.empty() ? "another axis" : "axis '" + record.neighbour + "'") +
         ", which the machine does not have";
}

TwinInForce twin_in_force(const ModelRecord& record, const MachineDescription& machine,
                          std::size_t axis) {
  return {Twin(record.model),
          record.version,
          record.holdout.rms,
          settling_cycles(record.model),
          neighbour_in(machine, axis, record),
          coupled_by_motion(record.model)};
}

std::string why_not_for(const ModelRecord& record, const MachineDescription& machine,
                        std::size_t axis) {
  const bool rotary = machine.axes[axis].rotary;
  const double cycle_s = machine.cycle_s;
  if (record.rotary != rotary) {
    return rotary ? "is for a linear axis, this one is rotary"
                  : "is for a rotary axis, this one is linear";
  }
  if (std::abs(record.model.sample_time_s - cycle_s) > kCycleTolerance * cycle_s) {
    return "is for a cycle of " + number(record.model.sample_time_s) + " s, the machine runs at " +
           number(cycle_s) + " s";
  }
  for (const Effect& effect : record.model.effects) {
    if (identity_of(effect.kind).of_its_recording)
      return "contains " + std::string(identity_of(effect.kind).id) +
             ", which is of its recording and predicts no other motion";
  }
  return why_no_neighbour(record, machine, axis);
}

void see_as_live(std::vector<Segment>& motion, const ModelRecord& record,
                 const ModelRecord* other) {
  if (!coupled_by_motion(record.model)) return;
  for (Segment& segment : motion) {
    if (other != nullptr) {
      predict_neighbour(segment, record.model, other->model, pushed_by(*other, record.axis));
    } else {
      segment.neighbour_motion.resize(0);
    }
  }
}

std::string printable(const std::string& text) {
  constexpr std::size_t kMostCharacters = 200;
  std::string out = text.substr(0, kMostCharacters);
  std::replace_if(
      out.begin(), out.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return out;
}

std::string by_hand(const std::string& origin) {
  return "from " + printable(origin) + ", proposed by hand";
}

void admit(ModelRecord& record, bool judged, const std::string& now, double cycle_s) {
  record.model.sample_time_s = cycle_s;
  record.created = judged ? now : "";
  if (!judged) record.holdout = {};
}

}  // namespace servotwin::daemon
