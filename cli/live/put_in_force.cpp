// servotwin put-in-force: makes a model file the model in force of an axis, judged by the rule of
// promotion: through a running daemon, or in the store of one that is stopped.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "daemon/between/clock.h"
#include "daemon/config/config.h"
#include "daemon/identify/held_out.h"
#include "daemon/identify/promotion.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "drivers/common/text.h"
#include "drivers/dds/dds.h"
#include "drivers/recordings/recording_file.h"
#include "identification/recording/segments.h"

namespace servotwin::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kLook_s = 0.1;  // between two looks at what the daemon says

struct PutInForceArguments {
  fs::path model, store;
  BusOptions bus;
  std::string axis;
  bool force = false;
  double wait_s = 60.0;
};

double waited_s(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// What this model is called: the file, without its folder, and when it was proposed, so that no
/// other proposal is called so.
std::string origin_of(const PutInForceArguments& arguments) {
  return daemon::printable(arguments.model.filename().string()) + " at " +
         daemon::iso_time(daemon::wall_ns());
}

void print_in_force(int version, const std::string& axis, const std::string& reason) {
  say(stdout, text("model %d of axis %s is in force: ", version, axis.c_str()) + reason);
}

/// The axis of this name as the daemon knows it; throws if there is none.
AxisStatus find_axis(const DdsNode& node, const BusOptions& bus, const std::string& name,
                     double patience_s) {
  std::vector<std::string> names;
  const std::vector<AxisStatus> axes = axes_of_daemon(node, bus, patience_s);
  for (const AxisStatus& one : axes) names.push_back(one.name);
  const std::string meant = spelling_in(names, name);
  for (const AxisStatus& one : axes) {
    if (one.name == meant) return one;
  }
  throw std::runtime_error(bus.text() + " has no axis " + in_quotes(name) + "; it has " +
                           listed(names) + " (--axis)");
}

void ask_daemon(const PutInForceArguments& arguments, ModelRecord record) {
  const DdsNode node(arguments.bus.place);
  DdsReader<ModelAnnouncement> models(node);
  DdsReader<MachineStatus> statuses(node);
  DdsWriter<ModelProposal> proposals(node);
  const double discovery_s = std::min(arguments.wait_s, kMaxDiscovery_s);
  const AxisStatus before = find_axis(node, arguments.bus, record.axis, discovery_s);
  const std::string& axis = record.axis = before.name;
  if (!proposals.wait_for_readers(1, discovery_s))
    throw std::runtime_error("the daemon of " + arguments.bus.text() +
                             " takes no models by hand: it is older than this tool, or DDS "
                             "Security forbids it");
  const std::string origin = origin_of(arguments);
  if (!proposals.write({axis, origin, arguments.force, to_json(record).dump()}))
    throw std::runtime_error("DDS refused the model");
  const Progress progress("waiting for the daemon");
  const auto start = std::chrono::steady_clock::now();
  std::string activity = before.activity;
  ModelAnnouncement model;
  MachineStatus status;
  const auto of_this = [&](const std::string& reason) {
    return reason.find(daemon::by_hand(origin)) != std::string::npos;
  };
  while (waited_s(start) < arguments.wait_s) {
    while (models.receive(model, kLook_s)) {
      if (model.axis == axis && model.version > before.model_version && of_this(model.reason)) {
        print_in_force(model.version, axis, model.reason);
        return;
      }
    }
    while (statuses.receive(status, 0.0)) {
      for (const AxisStatus& now : status.axes) {
        if (now.name != axis) continue;
        activity = now.activity;
        if (now.refused > before.refused && of_this(now.last_refusal))
          throw std::runtime_error("not in force: " + now.last_refusal);
      }
    }
  }
  throw std::runtime_error(
      text("not decided after %.3g s (--wait): axis %s is ", arguments.wait_s, axis.c_str()) +
      activity + "; the daemon may still decide");
}

/// Motion that was recorded after a model was made, newest first, as much as is needed.
struct RecordedMotion {
  std::vector<Segment> segments;           // with the axis beside it that the model is coupled to
  std::vector<Segment> segments_in_force;  // the same, that the model in force is coupled to
  std::vector<std::string> files;
  double moved_s = 0.0;
};

/// How long the command moves [s].
double moved_s(const Segment& segment) {
  const Eigen::Index n = segment.size();
  if (n < 2) return 0.0;
  const Eigen::ArrayXd steps = segment.command.tail(n - 1) - segment.command.head(n - 1);
  return static_cast<double>((steps != 0.0).count()) * segment.sample_time_s;
}

RecordedMotion motion_since(const fs::path& folder, const std::string& axis,
                            const ModelRecord& record, const std::string& neighbour_in_force,
                            double needed_s) {
  // A recording is called after its begin, without colons: 2026-01-31T120000.000Z.csv.
  std::string made = record.created;
  std::erase(made, ':');
  std::vector<fs::path> files;
  std::error_code missing;
  for (fs::directory_iterator entry(folder, missing), end; !missing && entry != end;
       entry.increment(missing)) {
    if (entry->path().extension() == ".csv" && entry->path().filename().string() > made)
      files.push_back(entry->path());
  }
  std::sort(files.rbegin(), files.rend());
  RecordedMotion out;
  for (const fs::path& file : files) {
    if (out.moved_s >= needed_s) break;
    const Recording recording = read_recording(file, {});
    const SegmentedAxis part = segment_axis(recording, axis, {}, record.neighbour),
                        in_force = segment_axis(recording, axis, {}, neighbour_in_force);
    MachineDescription machine{part.sample_time_s, {}};
    for (const AxisRecord& one : recording.axes)
      machine.axes.push_back({one.name, one.rotary, one.torque_unit});
    const auto at = std::find_if(machine.axes.begin(), machine.axes.end(),
                                 [&](const AxisDescription& one) { return one.name == axis; });
    const auto place = static_cast<std::size_t>(at - machine.axes.begin());
    if (const std::string why = daemon::why_not_for(record, machine, place); !why.empty())
      throw std::runtime_error("not in force: the model " + why);
    for (std::size_t i = 0; i < part.segments.size(); ++i) {
      const Segment& segment = part.segments[i];
      if (segment.actual.size() == 0) continue;
      out.moved_s += moved_s(segment);
      out.segments.push_back(segment);
      out.segments_in_force.push_back(in_force.segments[i]);
    }
    out.files.push_back(file.filename().string());
  }
  return out;
}

void put_in_store(const PutInForceArguments& arguments, ModelRecord record) {
  if (!fs::exists(arguments.store / "servotwin.sqlite"))
    throw std::runtime_error(arguments.store.string() + ": there is no store of a daemon here");
  if (daemon::Store::in_use(arguments.store))
    throw std::runtime_error(arguments.store.string() +
                             ": a daemon works on this store; ask it with --dds");
  const std::string& machine = arguments.bus.place.machine;
  daemon::Store store(arguments.store, machine);
  if (const std::vector<std::string> known = store.machines();
      !known.empty() && std::find(known.begin(), known.end(), machine) == known.end())
    throw std::runtime_error(arguments.store.string() + " knows no machine " + in_quotes(machine) +
                             "; it has " + listed(known) + " (--machine)");
  const std::vector<std::string> axes = store.axes();
  const std::string& axis = record.axis = spelling_in(axes, record.axis);
  const std::vector<daemon::StoredModel> all = store.in_force();
  const auto held = std::find_if(all.begin(), all.end(), [&](const daemon::StoredModel& one) {
    return one.record.axis == axis;
  });
  const bool first = held == all.end();
  if (!store.lost().empty()) say(stderr, "note: " + store.lost());
  if (!axes.empty() && std::find(axes.begin(), axes.end(), axis) == axes.end())
    throw std::runtime_error(arguments.store.string() + ": machine " + in_quotes(machine) +
                             " has no axis " + in_quotes(axis) + "; it has " + listed(axes) +
                             " (--axis)");
  if (!first) {
    // Whether there is the axis that acts on this one, the recordings tell.
    const MachineDescription machine_of_held{
        held->record.model.sample_time_s,
        {{axis, held->record.rotary, ""}, {record.neighbour, false, ""}}};
    const std::string why = daemon::why_not_for(record, machine_of_held, 0);
    if (!why.empty()) throw std::runtime_error("not in force: the model " + why);
  }
  daemon::Decision decision{daemon::Ruling::kPromoted, daemon::kUnjudged};
  std::vector<std::string> judged_on;
  if (!arguments.force) {
    const daemon::PromotionRule rule;
    RecordedMotion motion =
        motion_since(arguments.store / "recordings" / machine, axis, record,
                     first ? record.neighbour : held->record.neighbour, rule.judge_s);
    if (record.created.empty())
      throw std::runtime_error(arguments.model.string() +
                               ": does not say when it was made, so that no recording is known to "
                               "be new to it");
    const auto as_live = [&](std::vector<Segment>& segments, const ModelRecord& of) {
      const auto other = std::find_if(all.begin(), all.end(), [&](const auto& one) {
        return one.record.axis != axis && pushed_by(of, one.record.axis);
      });
      daemon::see_as_live(segments, of, other != all.end() ? &other->record : nullptr);
    };
    as_live(motion.segments, record);
    if (!first) as_live(motion.segments_in_force, held->record);
    daemon::Candidacy candidacy;
    candidacy.rotary = record.rotary;
    candidacy.refusals = record.excitation;
    candidacy.judged_s = motion.moved_s;
    candidacy.version_in_force = first ? 0 : held->record.version;
    if (!motion.segments.empty())
      record.holdout = daemon::judge_on(motion.segments, record.model, motion.segments_in_force,
                                        first ? nullptr : &held->record.model, candidacy);
    decision = daemon::decide(candidacy, rule);
    if (decision.ruling == daemon::Ruling::kNotJudged)
      decision.reason +=
          "; the store has no more motion from after the model was made (" + record.created + ")";
    judged_on = motion.files;
  }
  const std::string reason = decision.reason + "; " + daemon::by_hand(origin_of(arguments));
  if (!decision.promoted()) {
    store.add(daemon::event_now("model_refused", axis, "candidate refused: " + reason));
    throw std::runtime_error("not in force: " + reason);
  }
  daemon::admit(record, !arguments.force, daemon::iso_time(daemon::wall_ns()),
                first ? record.model.sample_time_s : held->record.model.sample_time_s);
  const int next = first ? 1 : held->record.version + 1;
  store.promote(record,
                daemon::event_now("model_promoted", axis,
                                  "model " + std::to_string(next) + " is in force: " + reason),
                judged_on);
  print_in_force(record.version, axis, reason);
}

void run(const PutInForceArguments& arguments) {
  if (arguments.bus.dds == !arguments.store.empty())
    throw UsageError(
        "choose one: --dds for a running daemon, or --store DIR for the store of one that is "
        "stopped");
  ModelRecord record = read_model(arguments.model);
  if (!arguments.axis.empty()) record.axis = arguments.axis;
  if (arguments.bus.dds) {
    ask_daemon(arguments, std::move(record));
  } else {
    put_in_store(arguments, std::move(record));
  }
}

}  // namespace

Command add_put_in_force(CLI::App& app) {
  const auto arguments = std::make_shared<PutInForceArguments>();
  OptionTable command(app, "put-in-force",
                      "Puts a model file in force, if it predicts better on motion that nobody "
                      "has seen.");
  command.option("MODEL", arguments->model, "model file (servotwin.model/1)")
      .takes("MODEL.json")
      .required();
  command.option("--axis", arguments->axis, "axis of the machine (default: that of the model)")
      .takes("X");
  arguments->bus.declare(command);
  command
      .option("--store", arguments->store,
              "store of a daemon that is stopped, in place of --dds: judged on what it recorded "
              "after the model was made")
      .takes("DIR");
  command.flag("--force", arguments->force,
               "put it in force without judging it; the history says so for ever");
  command
      .option("--wait", arguments->wait_s,
              "with --dds: how long to wait for the decision, which needs some seconds of "
              "motion (default 60)")
      .takes("S")
      .between(0.1, 1e6);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
