// servotwin what-if: predicts how a changed part affects a feed axis, before it is bought (paper
// 002).
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/recording/feed_axis_file.h"
#include "diagnosis/report/plot.h"
#include "drivers/common/text.h"
#include "identification/torque/feed_axis_fit.h"
#include "twin/feed_axis/ball_screw.h"
#include "twin/feed_axis/feed_axis.h"
#include "twin/feed_axis/reversing_motion.h"
#include "twin/feed_axis/velocity_loop.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr int kShownModes = 3;

struct WhatIfArguments {
  std::filesystem::path file, changed, result, plot;
  std::vector<std::string> changes;
  RecordingOptions motion;
  std::string axis;
};

struct Motion {
  std::string name;
  Eigen::ArrayXd command;  // at the rate of the control [m]
};

struct Figures {
  double error_rms = 0.0, error_max = 0.0;    // command - table [m]
  double torque_rms = 0.0, torque_max = 0.0;  // [Nm]
};

/// The properties of one axis that are printed.
struct Axis {
  std::vector<double> nut;             // positions: both ends and the middle of the travel [m]
  std::vector<Eigen::VectorXd> modes;  // [Hz]
  std::vector<double> stiffness;       // [N/m]
  LoopFigures loop;                    // in the middle
  std::vector<std::optional<Figures>> motions;  // nullopt: the loop is not stable
  std::vector<double> share;                    // of the cover in the friction, per speed
};

constexpr double kSpeeds[] = {1e-3, 0.05, 0.2, 0.4};  // [m/s]

double middle(const NutParts& nut) { return (nut.from + nut.to) / 2.0; }

/// The three intervals of the paper at their highest speeds, about the middle of the travel.
std::vector<Motion> paper_motions(const FeedAxisParts& parts) {
  std::vector<Motion> out;
  for (const auto& [speed, travel] : {std::pair{0.4, 0.36}, {0.05, 0.05}, {0.005, 0.005}}) {
    const double distance = std::min(travel, 0.9 * (parts.nut.to - parts.nut.from));
    const Eigen::ArrayXd command =
        sampled({.speed = speed, .travel = distance}, parts.control.rate_hz) +
        (middle(parts.nut) - parts.nut.at_zero - distance / 2.0);
    out.push_back(
        {text("%.4g mm back and forth at %.4g mm/s", distance / kMilli, speed / kMilli), command});
  }
  return out;
}

/// The commands of a recording, at its own times; throws if they have a gap.
SegmentedAxis read_motion(const WhatIfArguments& arguments, std::FILE* people) {
  RecordingOptions motion = arguments.motion;
  motion.mends = false;  // a table of commands
  Recording recording = motion.read(people);
  for (AxisRecord& axis : recording.axes) {
    axis.actual.clear();
    axis.actual_motor.clear();
    axis.torque.clear();
  }
  SegmentedAxis axis = segment_axis(recording, axis_of(recording, arguments.axis));
  if (axis.rotary)
    throw std::runtime_error(axis.source + ": axis " + axis.axis +
                             " is rotary; a ball screw moves a linear one");
  if (axis.segments.size() != 1)
    throw std::runtime_error(axis.source + ": " + axis.axis +
                             ".command is interrupted; select one part with --from and --to");
  return axis;
}

/// The same at the sampling rate of the control: a cubic spline through the samples.
Motion motion_of(const SegmentedAxis& axis, const WhatIfArguments& arguments,
                 const FeedAxisParts& parts) {
  const Segment& segment = axis.segments.front();
  const double low = segment.command.minCoeff() + parts.nut.at_zero,
               high = segment.command.maxCoeff() + parts.nut.at_zero;
  if (low < parts.nut.from || high > parts.nut.to) {
    throw std::runtime_error(
        text("%s: %s goes from %.4g to %.4g mm, which takes the nut from %.4g to %.4g mm; nut."
             "travel_mm is [%.4g, %.4g]",
             arguments.motion.file.c_str(), axis.axis.c_str(), segment.command.minCoeff() / kMilli,
             segment.command.maxCoeff() / kMilli, low / kMilli, high / kMilli,
             parts.nut.from / kMilli, parts.nut.to / kMilli));
  }
  return {arguments.motion.file.filename().string() + ", " + axis.axis,
          at_rate(segment, parts.control.rate_hz)};
}

Figures figures_of(const FeedAxisRun& run, const Eigen::ArrayXd& command) {
  const Eigen::ArrayXd error = command - run.table_position;
  return {std::sqrt(error.square().mean()), error.abs().maxCoeff(),
          std::sqrt(run.torque.square().mean()), run.torque.abs().maxCoeff()};
}

Axis examine(const FeedAxisParts& parts, const std::vector<Motion>& motions) {
  Axis out;
  const BallScrew screw(parts);
  for (const double nut : {parts.nut.from, middle(parts.nut), parts.nut.to}) {
    out.nut.push_back(nut);
    out.modes.push_back(mode_frequencies(screw, nut).segment(1, kShownModes));
    out.stiffness.push_back(static_stiffness(screw, nut));
  }
  out.loop = velocity_loop_figures(parts, middle(parts.nut));
  out.motions.resize(motions.size());
  if (out.loop.stable) {
    ReducedAxis axis = reduced_axis(parts);
    for (std::size_t i = 0; i < motions.size(); ++i) {
      const Figures figures = figures_of(run(axis, motions[i].command), motions[i].command);
      // With a stable velocity loop, the position loop may still be unstable.
      if (figures.error_max < 1.0) out.motions[i] = figures;
    }
  }
  for (const double speed : kSpeeds) {
    const double drive = parts.friction ? steady_force(*parts.friction, speed) : 0.0,
                 cover = parts.cover ? steady_force(*parts.cover, speed) : 0.0;
    out.share.push_back(drive + cover > 0.0 ? cover / (drive + cover) : 0.0);
  }
  return out;
}

/// One line per quantity, before and after.
class Table {
 public:
  Table(std::FILE* people, bool both) : people_(people), both_(both) {}

  template <class Show>
  void row(const std::string& name, const Axis& before, const Axis& after, Show show) const {
    std::string line = text("%-46s%-22s", name.c_str(), show(before).c_str());
    if (both_) line += show(after);
    say(people_, line.substr(0, line.find_last_not_of(' ') + 1));
  }
  void head() const {
    if (both_) say(people_, text("%-46s%-22s%s", "", "before", "after"));
  }

 private:
  std::FILE* people_;
  bool both_;
};

std::string optional_text(const std::optional<double>& value, const char* unit) {
  return value ? text("%.4g %s", *value, unit) : "none";
}

void print_table(const Axis& before, const Axis& after, const std::vector<Motion>& motions,
                 const Table& table, bool friction) {
  table.head();
  const auto nut_text = [&](const char* what, std::size_t i) {
    std::string out = text("%s, nut at %.4g", what, before.nut[i] / kMilli);
    if (after.nut[i] != before.nut[i]) out += text(" | %.4g", after.nut[i] / kMilli);
    return out + " mm";
  };
  for (std::size_t i = 0; i < before.nut.size(); ++i) {
    table.row(nut_text("modes", i), before, after, [&](const Axis& axis) {
      const Eigen::VectorXd& f = axis.modes[i];
      return text("%.1f %.1f %.0f Hz", f(0), f(1), f(2));
    });
  }
  for (std::size_t i = 0; i < before.nut.size(); ++i) {
    table.row(nut_text("static stiffness", i), before, after,
              [&](const Axis& axis) { return text("%.2f N/um", axis.stiffness[i] * kMicro); });
  }
  const auto loop = [&](const char* name, auto show) {
    table.row(text("velocity loop, %s", name), before, after,
              [&](const Axis& axis) { return show(axis.loop); });
  };
  loop("stable", [](const LoopFigures& f) { return std::string(f.stable ? "yes" : "NO"); });
  // Of an unstable loop these figures have no meaning.
  const auto of_stable = [&](const char* name, auto show) {
    loop(name, [&](const LoopFigures& f) { return f.stable ? show(f) : std::string("-"); });
  };
  of_stable("bandwidth (-3 dB)",
            [](const LoopFigures& f) { return text("%.1f Hz", f.bandwidth_hz); });
  of_stable("peak",
            [](const LoopFigures& f) { return text("%.2f dB at %.4g Hz", f.peak_db, f.peak_hz); });
  of_stable("gain margin",
            [](const LoopFigures& f) { return optional_text(f.gain_margin_db, "dB"); });
  of_stable("phase margin",
            [](const LoopFigures& f) { return optional_text(f.phase_margin_deg, "degrees"); });
  for (std::size_t i = 0; i < motions.size(); ++i) {
    const auto motion = [&](const char* name, auto show) {
      table.row("  " + std::string(name), before, after, [&](const Axis& axis) {
        return axis.motions[i] ? show(*axis.motions[i]) : std::string("unstable");
      });
    };
    table.row(motions[i].name, before, after, [](const Axis&) { return std::string(); });
    motion("position error, RMS",
           [](const Figures& f) { return text("%.1f um", f.error_rms / kMicro); });
    motion("position error, maximum",
           [](const Figures& f) { return text("%.1f um", f.error_max / kMicro); });
    motion("torque, RMS", [](const Figures& f) { return text("%.4f Nm", f.torque_rms); });
    motion("torque, maximum", [](const Figures& f) { return text("%.4f Nm", f.torque_max); });
  }
  for (std::size_t i = 0; friction && i < std::size(kSpeeds); ++i) {
    table.row(text("cover's share of friction at %.4g mm/s", kSpeeds[i] / kMilli), before, after,
              [&](const Axis& axis) { return text("%.1f %%", 100.0 * axis.share[i]); });
  }
}

json json_of(const Axis& axis, const std::vector<Motion>& motions) {
  json out;
  for (std::size_t i = 0; i < axis.nut.size(); ++i) {
    out["places"].push_back(
        {{"nut_m", axis.nut[i]},
         {"modes_hz", std::vector<double>(axis.modes[i].begin(), axis.modes[i].end())},
         {"static_stiffness_n_per_m", axis.stiffness[i]}});
  }
  const auto maybe = [](const std::optional<double>& value) {
    return value ? json(*value) : json();
  };
  out["velocity_loop"] = {{"stable", axis.loop.stable},
                          {"bandwidth_hz", axis.loop.bandwidth_hz},
                          {"peak_db", axis.loop.peak_db},
                          {"peak_hz", axis.loop.peak_hz},
                          {"gain_margin_db", maybe(axis.loop.gain_margin_db)},
                          {"phase_margin_deg", maybe(axis.loop.phase_margin_deg)}};
  for (std::size_t i = 0; i < motions.size(); ++i) {
    json one = {{"motion", motions[i].name}, {"stable", axis.motions[i].has_value()}};
    if (axis.motions[i]) {
      const Figures& f = *axis.motions[i];
      one.update({{"error_rms_m", f.error_rms},
                  {"error_max_m", f.error_max},
                  {"torque_rms_nm", f.torque_rms},
                  {"torque_max_nm", f.torque_max}});
    }
    out["motions"].push_back(one);
  }
  for (std::size_t i = 0; i < std::size(kSpeeds); ++i)
    out["cover_share"].push_back({{"speed_mps", kSpeeds[i]}, {"share", axis.share[i]}});
  return out;
}

std::string picture(const FeedAxisParts& before, const FeedAxisParts& after, bool both) {
  constexpr Eigen::Index kPoints = 1200;
  PlotPanel gain{.title = "velocity loop, closed, nut in the middle",
                 .x_label = "frequency [Hz]",
                 .y_label = "gain [dB]",
                 .logarithmic_x = true,
                 .series = {}},
      phase = gain;
  phase.title = "phase of the closed velocity loop";
  phase.y_label = "phase [degrees]";
  const auto add = [&](const std::string& name, const FeedAxisParts& parts, bool dashed) {
    const Eigen::ArrayXd f =
        logarithmic(2.0, std::min(4000.0, 0.49 * parts.control.rate_hz), kPoints);
    const Eigen::ArrayXcd response = closed_velocity_loop(parts, middle(parts.nut), f);
    const Eigen::ArrayXd level = 20.0 * response.abs().log10(),
                         angle = response.arg() * (180.0 / std::numbers::pi);
    const std::vector<double> x(f.begin(), f.end());
    gain.series.push_back(
        {.name = name, .x = x, .y = {level.begin(), level.end()}, .colour = {}, .dashed = dashed});
    phase.series.push_back(
        {.name = name, .x = x, .y = {angle.begin(), angle.end()}, .colour = {}, .dashed = dashed});
  };
  add(both ? "before" : "the axis", before, false);
  if (both) add("after", after, true);
  return plot_svg({gain, phase});
}

void run(const WhatIfArguments& arguments) {
  if (arguments.motion.file.empty() != arguments.axis.empty())
    throw UsageError("--motion and --axis go together");
  std::FILE* people = people_beside({arguments.result, arguments.plot});
  const FeedAxisParts before = read_feed_axis(arguments.file);
  const FeedAxisParts after = read_feed_axis(
      arguments.changed.empty() ? arguments.file : arguments.changed, arguments.changes);
  const bool both = !arguments.changed.empty() || !arguments.changes.empty();

  // Both axes get the same motion, sampled at the rate of their own control.
  std::vector<Motion> motions, motions_after;
  if (arguments.motion.file.empty()) {
    motions = motions_after = paper_motions(before);
    if (after.control.rate_hz != before.control.rate_hz) motions_after = paper_motions(after);
  } else {
    const SegmentedAxis axis = read_motion(arguments, people);
    motions = {motion_of(axis, arguments, before)};
    motions_after = {motion_of(axis, arguments, after)};
  }
  const Axis axis_before = examine(before, motions);
  const Axis axis_after = both ? examine(after, motions_after) : axis_before;
  print_table(axis_before, axis_after, motions, {people, both},
              before.friction || before.cover || after.friction || after.cover);
  if (!arguments.plot.empty()) write_result(arguments.plot, picture(before, after, both));
  if (!arguments.result.empty()) {
    json out = {{"schema", "servotwin.what-if/1"},
                {"axis_file", arguments.file.string()},
                {"before", json_of(axis_before, motions)}};
    if (!arguments.changed.empty()) out["changed_file"] = arguments.changed.string();
    if (both) {
      out["set"] = arguments.changes;
      out["after"] = json_of(axis_after, motions);
    }
    write_json(arguments.result, out);
  }
  say_written(people, {arguments.plot, arguments.result});
}

}  // namespace

Command add_what_if(CLI::App& app) {
  const auto arguments = std::make_shared<WhatIfArguments>();
  OptionTable command(app, "what-if", "Predicts how a changed part affects a feed axis.");
  command.option("AXIS", arguments->file, "parts of the axis (TOML; examples/feed_axis.toml)")
      .takes("AXIS.toml")
      .required();
  command
      .option("--set", arguments->changes,
              "new value of a part, such as table.mass_kg=150 or "
              "control.band_stop.1.frequency_hz=300; may be given again")
      .takes("KEY=VALUE")
      .one_value_each_time();
  command.option("--change", arguments->changed, "file with the changed axis")
      .takes("CHANGED.toml");
  command
      .option("--motion", arguments->motion.file,
              "table of commands for both axes (default: back and forth at three speeds)")
      .takes("PATH.csv");
  command.option("--axis", arguments->axis, "axis of the table").takes("X");
  command
      .option("--columns", arguments->motion.read_options.columns,
              "which column of a foreign file is which channel")
      .takes("MAP");
  arguments->motion.declare_format(command);
  command
      .option("--from", arguments->motion.read_options.from_s,
              "start of the part to read [s after the first row]")
      .takes("S");
  command
      .option("--to", arguments->motion.read_options.to_s,
              "end of the part to read [s after the first row]")
      .takes("S");
  command
      .option("--json", arguments->result,
              "write the complete result to this file; - is standard output")
      .takes("OUT");
  command
      .option("--plot", arguments->plot,
              "write a Bode plot of the velocity loop before and after to this file (SVG)")
      .takes("OUT.svg");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
