#include "daemon/correct/learned_program.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>

#include "drivers/common/text.h"
#include "identification/model/motion_reach.h"
#include "identification/model/stated_deviations.h"
#include "ilc/gate.h"
#include "ilc/path_ends.h"
#include "ilc/prepared_axis.h"
#include "twin/shown_units.h"

namespace servotwin::daemon {
namespace {

using Eigen::ArrayXd;

/// Parses "2026-01-31T12:00:00.000Z" [ns since 1970]; 0 if the text is not such a time.
std::int64_t wall_ns_of(const std::string& iso) {
  std::tm at{};
  int ms = 0;
  if (std::sscanf(iso.c_str(), "%d-%d-%dT%d:%d:%d.%dZ", &at.tm_year, &at.tm_mon, &at.tm_mday,
                  &at.tm_hour, &at.tm_min, &at.tm_sec, &ms) != 7)
    return 0;
  at.tm_year -= 1900;
  at.tm_mon -= 1;
  return timegm(&at) * 1'000'000'000 + ms * 1'000'000;
}

const ModelRecord& model_of(const std::vector<StoredModel>& in_force, const std::string& axis,
                            double cycle_s) {
  for (const StoredModel& stored : in_force) {
    const ModelRecord& record = stored.record;
    if (record.axis != axis) continue;
    if (std::abs(record.model.sample_time_s - cycle_s) > 1e-9 * cycle_s)
      throw std::runtime_error("axis " + axis + ": its model is for a cycle of " +
                               number(record.model.sample_time_s) + " s, the machine runs at " +
                               number(cycle_s) + " s");
    return record;
  }
  throw std::runtime_error("axis " + axis + " has no model in force yet");
}

/// Limits within which the gate lets a correction pass.
CorrectionLimits limits_of(const std::optional<OffsetLimits>& limits) {
  if (!limits) return {};
  const double omega = 2.0 * std::numbers::pi * limits->bandwidth_hz;
  return {limits->peak, std::min(limits->rate, omega * limits->peak)};
}

/// Reason and time at which the gate would refuse this offset; empty if it lets all of it pass.
std::string refused_by_gate(const ArrayXd& offset, const OffsetLimits& limits,
                            const LearningRules& rules) {
  Gate gate({limits.peak, limits.rate, limits.bandwidth_hz, rules.ilc.ramp_s, 1.0, 1.0, true});
  GateRequest request;
  request.expires_ns = std::numeric_limits<std::int64_t>::max();
  request.model_validated = request.axis_state_matches = true;
  for (Eigen::Index k = 0; k < offset.size(); ++k) {
    const double time_s = static_cast<double>(k) * rules.machine.cycle_s;
    request.now_ns = request.model_validated_ns = std::llround(1e9 * time_s);
    request.offset = offset(k);
    if (const GateOutput out = gate.pass(request); out.refusal != Refusal::kNone)
      return std::string(name_of(out.refusal)) + " at " + number(time_s) + " s";
  }
  return {};
}

std::string summary_of(const LearnedProgram& learned) {
  const bool corrected = learned.program.learn;
  std::string out;
  const auto add = [&](const std::string& what, double before, double after, bool rotary) {
    out += (out.empty() ? "" : ", ") + what + " " + rounded_micro_text(before, rotary) +
           (corrected ? " -> " + rounded_micro_text(after, rotary) : "");
  };
  for (const AxisCorrectionFigures& axis : learned.axes)
    add(axis.name, axis.before_rms, axis.after_rms, axis.rotary);
  if (learned.contour_before.size() > 0)
    add("contour", learned.contour_size_before.rms, learned.contour_size_after.rms, false);
  return "predicted RMS " + out;
}

/// The error to expect on the machine: the predicted one and the residual of the model on held-out
/// data, added as squares. `beyond`: axes that are left out, because the path exceeds their data.
std::string expected_of(const LearnedProgram& learned, const std::vector<bool>& beyond) {
  std::string out;
  for (std::size_t i = 0; i < learned.axes.size(); ++i) {
    const AxisCorrectionFigures& axis = learned.axes[i];
    if (beyond[i] || learned.holdout_rms[i] == 0.0) continue;
    out += (out.empty() ? "expect at least " : ", ") + axis.name + " " +
           rounded_micro_text(std::hypot(axis.after_rms, learned.holdout_rms[i]), axis.rotary);
  }
  return out.empty() ? out : out + " RMS on the machine";
}

}  // namespace

namespace {

/// Throws std::runtime_error with the axis if there is no bandwidth at which it may learn.
LearnAxis learning_axis(const ModelRecord& record, const Segment& path,
                        const std::optional<OffsetLimits>& limits) {
  CorrectionWish wish;
  wish.limits = limits_of(limits);
  if (limits) wish.most_hz = limits->bandwidth_hz;
  return prepared_axis(record.axis, record.rotary, record.model, stated_deviations(record), path,
                       wish)
      .learning;
}

}  // namespace

LearningRules learning_rules(const Config& config, const MachineDescription& machine) {
  LearningRules out{machine, {}, config.ilc};
  out.limits.resize(machine.axes.size());
  for (std::size_t i = 0; i < std::min(machine.axes.size(), config.axes.size()); ++i)
    out.limits[i] = config.axes[i].correction;
  return out;
}

OffsetRules offset_rules(const LearningRules& rules, bool in_command, double drive_timeout_s) {
  const IlcConfig& ilc = rules.ilc;
  OffsetRules out;
  out.cycle_s = rules.machine.cycle_s;
  for (const std::optional<OffsetLimits>& limits : rules.limits) {
    const OffsetLimits given = limits.value_or(OffsetLimits());
    out.limits.push_back({given.peak, given.rate, given.bandwidth_hz, ilc.ramp_s, ilc.validity_s,
                          ilc.model_age_s, ilc.live, out.cycle_s});
  }
  out.ramp_s = ilc.ramp_s;
  out.validity_s = ilc.validity_s;
  out.drive_timeout_s = drive_timeout_s;
  out.drive_ramp_s = ilc.drive_ramp_s;
  out.match_tolerance = ilc.match_tolerance;
  out.residual_band = ilc.residual_band;
  out.delay_cycles = ilc.delay_cycles;
  out.live = ilc.live;
  out.in_command = in_command;
  return out;
}

LearnedProgram learned(const CommandedPath& program, const LearningRules& rules,
                       const std::vector<StoredModel>& in_force, std::int64_t wall_ns,
                       const std::stop_token& stop) {
  LearnedProgram out;
  out.program = program;
  out.created_ns = out.validated_ns = wall_ns;
  std::vector<LearnAxis> axes;
  std::vector<std::string> neighbours;
  std::vector<bool> beyond;  // per axis: the path exceeds the motion of the model's data
  std::ptrdiff_t linear = 0;
  for (std::size_t i = 0; i < program.axes.size(); ++i) {
    const std::size_t number_in_machine = program.axes[i];
    const AxisDescription& axis = rules.machine.axes[number_in_machine];
    const ModelRecord& record = model_of(in_force, axis.name, rules.machine.cycle_s);
    Segment path;
    path.sample_time_s = rules.machine.cycle_s;
    path.command = program.command[i];
    const std::optional<OffsetLimits>& limits = rules.limits[number_in_machine];
    const MotionReach reach = motion_reach(record, {&path, 1});
    beyond.push_back(reach.beyond());
    const std::string jump = jump_in(path, axis.name, axis.rotary);
    if (program.learn && !jump.empty()) throw std::runtime_error(jump);
    if (program.learn && reach.far_beyond())
      throw std::runtime_error(reach.words + "; " + kFarBeyondAdvice);
    for (const std::string& note : {jump, reach.words}) {
      if (!note.empty()) out.notes.push_back(note);
    }
    if (program.learn) {
      axes.push_back(learning_axis(record, path, limits));
    } else {
      axes.emplace_back();
      axes.back().model = record.model;
      axes.back().path = path;
      axes.back().law.model = transfer_of(record.model);
    }
    axes.back().name = axis.name;
    neighbours.push_back(record.neighbour);
    axes.back().rotary = axis.rotary;
    out.axes.push_back({axis.name, axis.rotary, record.version});
    const auto known = [](double value) { return std::isfinite(value) ? value : 0.0; };
    out.holdout_rms.push_back(known(record.holdout.rms));
    out.holdout_max.push_back(known(record.holdout.max));
    linear += axis.rotary ? 0 : 1;
  }
  for (const std::size_t i : find_neighbours(axes, neighbours))
    out.notes.push_back(without_neighbour(axes[i].name, neighbours[i]));
  std::vector<std::string> standing;
  for (std::size_t i = 0; i < rules.machine.axes.size(); ++i) {
    if (std::find(program.axes.begin(), program.axes.end(), i) == program.axes.end())
      standing.push_back(rules.machine.axes[i].name);
  }
  if (!standing.empty()) out.notes.push_back(listed(standing) + " not in the path: taken to stand");

  out.validated_ns = std::min(wall_ns, validated_ns(out, in_force).value_or(0));

  LearnOptions options;
  options.trials = program.learn ? rules.ilc.trials : 0;
  options.ramp_s = rules.ilc.ramp_s;
  if (rules.ilc.contour && linear >= 2 && linear <= kMaxPathAxes) options.aim = Aim::kContour;
  const Plant twins = on_twins(axes);
  const Learned result = learn(
      axes,
      [&](const std::vector<ArrayXd>& commands) {
        if (stop.stop_requested())
          throw std::runtime_error("learning was aborted, because the daemon stops");
        return twins(commands);
      },
      options);

  for (std::size_t i = 0; i < axes.size(); ++i) {
    const LearnedAxis& axis = result.axes[i];
    out.offset.push_back(axis.correction);
    out.error_before.push_back(axis.error_before);
    out.error_after.push_back(axis.error_after);
    const ErrorSize before = size_of(axis.error_before), after = size_of(axis.error_after);
    AxisCorrectionFigures& figures = out.axes[i];
    figures.before_rms = before.rms;
    figures.before_max = before.max;
    figures.after_rms = after.rms;
    figures.after_max = after.max;
  }
  if (result.before) {
    out.contour_before = result.before->distance;
    out.contour_after = result.after->distance;
    out.contour_size_before = size_of(out.contour_before);
    out.contour_size_after = size_of(out.contour_after);
  }
  out.summary = summary_of(out);
  if (!program.learn) {
    out.why_not_live = "only a preview was requested";
    return out;
  }
  if (const std::string expected = expected_of(out, beyond); !expected.empty())
    out.notes.insert(out.notes.begin(), expected);
  for (const std::string& line : short_rests(axes)) out.notes.push_back(line);
  if (stale(out, rules, wall_ns))
    out.notes.push_back("its models were last validated longer ago than ilc.model_age_s = " +
                        number(rules.ilc.model_age_s) +
                        " s: nothing is sent until they are validated again");
  if (result.best == 0)
    throw std::runtime_error(
        out.summary + ": " + why_none_is_kept(result, axes) +
        (result.before && options.aim == Aim::kTracking
             ? R"(; try wider limits, or ilc.aim = "contour", which corrects the path error only)"
             : "; try wider limits or a better model"));
  for (std::size_t i = 0; i < axes.size() && out.why_not_live.empty(); ++i) {
    const std::optional<OffsetLimits>& limits = rules.limits[program.axes[i]];
    if (!limits) {
      out.why_not_live =
          "axis " + axes[i].name + " has no correction = { peak, rate, bandwidth } configured";
    } else if (const std::string why = refused_by_gate(out.offset[i], *limits, rules);
               !why.empty()) {
      out.why_not_live = "the gate would refuse axis " + axes[i].name + ": " + why;
    }
  }
  return out;
}

std::optional<std::int64_t> validated_ns(const LearnedProgram& learned,
                                         const std::vector<StoredModel>& in_force) {
  std::int64_t out = std::numeric_limits<std::int64_t>::max();
  for (const AxisCorrectionFigures& axis : learned.axes) {
    const auto model = std::find_if(in_force.begin(), in_force.end(), [&](const StoredModel& one) {
      return one.record.axis == axis.name && one.record.version == axis.model_version;
    });
    if (model == in_force.end()) return std::nullopt;
    out = std::min(out, std::max(wall_ns_of(model->record.created), wall_ns_of(model->validated)));
  }
  return out;
}

bool stale(const LearnedProgram& learned, const LearningRules& rules, std::int64_t wall_ns) {
  return learned.validated_ns + std::llround(1e9 * rules.ilc.model_age_s) < wall_ns;
}

std::vector<CorrectionChunk> chunks_of(const LearnedProgram& learned, const LearningRules& rules) {
  CorrectionChunk head;
  head.program = learned.program.name;
  head.revision = learned.program.revision;
  head.state = learned.program.learn ? CorrectionState::kLearned : CorrectionState::kPreviewed;
  head.reason = learned.summary;
  for (const std::string& note : learned.notes) head.reason += "; " + note;
  if (!learned.why_not_live.empty()) head.reason += "; not sent to drives: " + learned.why_not_live;
  head.created_ns = learned.created_ns;
  head.valid_until_ns = learned.validated_ns + std::llround(1e9 * rules.ilc.model_age_s);
  head.cycle_s = rules.machine.cycle_s;
  head.axes = learned.axes;
  if (learned.contour_before.size() > 0) {
    const ErrorSize &before = learned.contour_size_before, &after = learned.contour_size_after;
    head.contour_before_rms = before.rms;
    head.contour_before_max = before.max;
    head.contour_after_rms = after.rms;
    head.contour_after_max = after.max;
  }
  const Eigen::Index rows = learned.program.rows(), most = kMaxChunkSamples;
  head.chunks = static_cast<std::uint32_t>((rows + most - 1) / most);
  std::vector<CorrectionChunk> out;
  for (Eigen::Index from = 0; from < rows; from += most) {
    const Eigen::Index count = std::min(most, rows - from);
    CorrectionChunk chunk = head;
    chunk.chunk = static_cast<std::uint32_t>(out.size());
    const auto put = [&](std::vector<double>& to, const ArrayXd& values) {
      if (values.size() > 0) to.insert(to.end(), &values[from], &values[from] + count);
    };
    for (std::size_t i = 0; i < learned.axes.size(); ++i) {
      put(chunk.corrected, learned.program.command[i] + learned.offset[i]);
      put(chunk.error_before, learned.error_before[i]);
      put(chunk.error_after, learned.error_after[i]);
    }
    put(chunk.contour_before, learned.contour_before);
    put(chunk.contour_after, learned.contour_after);
    out.push_back(std::move(chunk));
  }
  return out;
}

std::string detail_of(const LearnedProgram& learned) {
  nlohmann::json axes = nlohmann::json::array();
  for (std::size_t i = 0; i < learned.axes.size(); ++i) {
    const AxisCorrectionFigures& axis = learned.axes[i];
    const std::string unit = axis.rotary ? "_rad" : "_m";
    axes.push_back({{"axis", axis.name},
                    {"model_version", axis.model_version},
                    {"before_rms" + unit, axis.before_rms},
                    {"after_rms" + unit, axis.after_rms},
                    {"offset_peak" + unit, learned.offset[i].abs().maxCoeff()}});
  }
  nlohmann::json out{{"program", learned.program.name},
                     {"revision", learned.program.revision},
                     {"rows", learned.program.rows()},
                     {"axes", std::move(axes)}};
  if (learned.contour_before.size() > 0) {
    out["contour_before_rms_m"] = learned.contour_size_before.rms;
    out["contour_after_rms_m"] = learned.contour_size_after.rms;
  }
  return out.dump();
}

}  // namespace servotwin::daemon
