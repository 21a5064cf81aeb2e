// servotwin sequence: the friction that a part adds, from recordings without and with it (paper
// 002).
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "cli/common/force_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "diagnosis/report/plot.h"
#include "identification/model/json_number.h"
#include "identification/torque/friction_from_torque.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr double kMaxRmsOverRmsWithoutPart = 0.95;  // above, the part explains nothing

struct SequenceArguments {
  RecordingOptions bare, covered;
  std::vector<std::filesystem::path> verify_bare, verify_covered;
  std::filesystem::path result, plot;
  std::string axis, friction = "lugre";
  double lead_mm = 0.0, bandwidth_hz = 0.0;
  bool invert = false;
  int substeps = 8;
};

struct Torque {
  SegmentedAxis axis;
  ForceData data;
};

Torque read(RecordingOptions options, const std::filesystem::path& file,
            const SequenceArguments& arguments, const std::string& name, std::FILE* people) {
  options.file = file;
  const Recording whole = options.read(people, name);
  Torque out{segment_axis(whole, axis_of(whole, name)), {}};
  require_torque(out.axis, arguments.invert);
  require_motion(out.axis);
  say(people, "read " + file.string());
  for (const std::string& line : out.axis.report.lines()) say(people, "  " + line);
  out.data = ForceData::of_motion(out.axis.segments, arguments.bandwidth_hz, arguments.substeps);
  return out;
}

/// Throws unless two recordings have the same kind of axis and the same unit of torque.
void require_same(const SegmentedAxis& axis, const SegmentedAxis& bare) {
  if (axis.rotary != bare.rotary) {
    throw std::runtime_error(axis.source + ": axis " + axis.axis +
                             (axis.rotary ? " is rotary" : " is linear") + ", that of " +
                             bare.source + (bare.rotary ? " is rotary" : " is linear"));
  }
  if (axis.torque_unit != bare.torque_unit) {
    throw std::runtime_error(axis.source + ": its torque is in " + axis.torque_unit + ", that of " +
                             bare.source + " in " + bare.torque_unit);
  }
}

/// The share of the torque that the added part takes at one constant velocity of a recording.
struct Share {
  double velocity = 0.0;
  double measured = kAbsent;  ///< (mean torque - bare model) / mean torque
  double modelled = 0.0;
  double element = 0.0;  ///< measured torque of the part, against the motion
};

std::vector<Share> shares_of(const std::vector<Segment>& segments, const ForceModel& bare,
                             const ForceModel& added) {
  std::vector<Share> out;
  for (const Ramp& ramp : ramps_of(segments)) {
    if (ramp.stick_slip) continue;
    const double below = steady_force(bare, ramp.velocity),
                 part = steady_force(added, ramp.velocity);
    const double sign = ramp.velocity > 0.0 ? 1.0 : -1.0;
    out.push_back({ramp.velocity, (ramp.torque - below) / ramp.torque, part / (below + part),
                   sign * (ramp.torque - below)});
  }
  return out;
}

/// The torque that the part takes in the two directions at the same speeds.
struct Directions {
  double plus = 0.0, minus = 0.0;  ///< means, against the motion
  int pairs = 0;
};

Directions directions_of(const std::vector<Share>& shares) {
  constexpr double kSameSpeed = 0.02;
  Directions out;
  for (const Share& forward : shares) {
    if (forward.velocity < 0.0) continue;
    const auto back = std::find_if(shares.begin(), shares.end(), [&](const Share& share) {
      return std::abs(share.velocity + forward.velocity) < kSameSpeed * forward.velocity;
    });
    if (back == shares.end()) continue;
    out.plus += forward.element;
    out.minus += back->element;
    ++out.pairs;
  }
  if (out.pairs > 0) {
    out.plus /= out.pairs;
    out.minus /= out.pairs;
  }
  return out;
}

void run(const SequenceArguments& arguments) {
  std::FILE* people = people_beside({arguments.result, arguments.plot});
  const Torque bare = read(arguments.bare, arguments.bare.file, arguments, arguments.axis, people);
  const Torque covered =
      read(arguments.bare, arguments.covered.file, arguments, arguments.axis, people);
  require_same(covered.axis, bare.axis);
  std::vector<Torque> verify_bare, verify_covered;
  for (const auto& file : arguments.verify_bare) {
    verify_bare.push_back(read(arguments.bare, file, arguments, arguments.axis, people));
    require_same(verify_bare.back().axis, bare.axis);
  }
  for (const auto& file : arguments.verify_covered) {
    verify_covered.push_back(read(arguments.bare, file, arguments, arguments.axis, people));
    require_same(verify_covered.back().axis, bare.axis);
  }
  if (arguments.lead_mm > 0.0 && (bare.axis.rotary || bare.axis.torque_unit != "Nm"))
    throw UsageError("--lead needs a linear axis whose torque is in Nm");
  const ForceUnit unit =
      force_unit(bare.axis.torque_unit, bare.axis.rotary, arguments.lead_mm * kMilli);
  const std::size_t kind = kind_of(arguments.friction);

  std::optional<ForceFit> drive, part, unlike;
  {
    const Progress progress("fitting the bare axis, then the added part");
    drive = fit_force(bare.data, {true, {kind, kind_of<ConstantForce>()}});
    if (!drive) throw std::runtime_error(bare.axis.source + ": no finite fit of the bare axis");
    const Eigen::VectorXd frozen = force_of(drive->model, covered.data);
    part = fit_force(covered.data, {true, {kind}}, {}, frozen);
    if (!part) throw std::runtime_error(covered.axis.source + ": no finite fit of the added part");
    // The same element with different levels in the two directions and its shapes held, which a
    // symmetric element cannot represent.
    ForceFitOptions held;
    held.shapes.emplace(
        part->model.effects[0].shape.begin(),
        part->model.effects[0].shape.begin() + static_cast<std::ptrdiff_t>(shapes_of(kind).size()));
    unlike = fit_force(covered.data, {true, {kind, kind_of<AsymmetricFriction>()}}, held, frozen);
  }
  const auto error_text = [&](const ForceError& e) {
    return text("%9.4g %s RMS %9.4g %s MAX %8.3f %% of the torque", e.rms / unit.scale,
                unit.name.c_str(), e.max / unit.scale, unit.name.c_str(), 100.0 * e.relative);
  };
  say(people, "bare axis");
  for (const std::string& line : force_lines(*drive, true, unit)) say(people, "  " + line);
  say(people, "  fitted      " + error_text(drive->error));
  say(people, "added part, with the bare axis held");
  for (const std::string& line : force_lines(*part, true, unit)) say(people, "  " + line);

  const auto together = [&](const Torque& torque, bool with_part) {
    Eigen::VectorXd left = torque.data.force() - force_of(drive->model, torque.data);
    if (with_part) left -= force_of(part->model, torque.data);
    return ForceError{std::sqrt(left.squaredNorm() / static_cast<double>(left.size())),
                      left.cwiseAbs().maxCoeff(), left.norm() / torque.data.force().norm()};
  };
  const ForceError fitted = together(covered, true), without = together(covered, false);
  std::vector<Share> shares = shares_of(covered.axis.segments, drive->model, part->model);
  const bool takes_less = std::count_if(shares.begin(), shares.end(),
                                        [](const Share& share) { return share.measured < 0.0; }) *
                              2 >
                          static_cast<std::ptrdiff_t>(shares.size());
  if (takes_less || fitted.rms > kMaxRmsOverRmsWithoutPart * without.rms) {
    throw std::runtime_error(covered.axis.source + " needs no more torque than " +
                             bare.axis.source +
                             ": are --bare and --covered exchanged, or of different axes?");
  }
  say(people, "  fitted      " + error_text(fitted));
  say(people, "  without it  " + error_text(without));

  json verified = json::array();
  const auto verify = [&](const std::vector<Torque>& torques, bool with_part) {
    for (const Torque& torque : torques) {
      const std::string name = std::filesystem::path(torque.axis.source).filename().string();
      const ForceError e = together(torque, with_part);
      if (with_part) {
        const auto more = shares_of(torque.axis.segments, drive->model, part->model);
        shares.insert(shares.end(), more.begin(), more.end());
      }
      say(people, "verified    " + error_text(e) + "  (" + name + ", not seen by the fit)");
      verified.push_back({{"source", name},
                          {"covered", with_part},
                          {"rms", e.rms / unit.scale},
                          {"max", e.max / unit.scale},
                          {"relative", e.relative}});
    }
  };
  verify(verify_bare, false);
  verify(verify_covered, true);

  std::sort(shares.begin(), shares.end(), [](const Share& l, const Share& r) {
    return std::abs(l.velocity) < std::abs(r.velocity);
  });
  double ratio = kAbsent;
  const char* length = milli(unit.rotary);
  json share_json = json::array();
  if (shares.empty()) {
    say(people, "share       not known: the covered recording has no constant velocity");
  } else {
    const auto [least, most] =
        std::minmax_element(shares.begin(), shares.end(),
                            [](const Share& l, const Share& r) { return l.measured < r.measured; });
    say(people,
        text("share       of the torque at steady speed: %.1f to %.1f %% measured; the model gives "
             "%.1f %% at the slowest (%.4g %s/s), %.1f %% at the fastest (%.4g %s/s)",
             100.0 * least->measured, 100.0 * most->measured, 100.0 * shares.front().modelled,
             std::abs(shares.front().velocity) / kMilli, length, 100.0 * shares.back().modelled,
             std::abs(shares.back().velocity) / kMilli, length));
    for (const Share& share : shares) {
      share_json.push_back({{"velocity", share.velocity},
                            {"measured", share.measured},
                            {"modelled", share.modelled}});
    }
    const auto [plus, minus, pairs] = directions_of(shares);
    if (pairs > 0 && plus > 0.0) {
      ratio = minus / plus;
      say(people,
          text("directions  the added part takes %.4g %s in the negative direction and %.4g %s in "
               "the positive one: ratio %.3f",
               minus / unit.scale, unit.name.c_str(), plus / unit.scale, unit.name.c_str(), ratio));
    }
  }
  if (unlike) {
    say(people,
        text(
            "            with a model that differs between directions: %.4g %s RMS instead of %.4g",
            unlike->error.rms / unit.scale, unit.name.c_str(), fitted.rms / unit.scale));
  }

  if (!arguments.plot.empty()) {
    const Eigen::VectorXd base = force_of(drive->model, covered.data);
    const Eigen::VectorXd all = base + force_of(part->model, covered.data);
    PlotSeries measured{"measured", {}, {}, true, ""}, modelled{"bare + added", {}, {}, true, ""},
        alone{"bare", {}, {}, true, ""};
    for (Eigen::Index k = 0; k < all.size(); ++k) {
      const double t = covered.data.step_s() * static_cast<double>(k);
      for (PlotSeries* series : {&measured, &modelled, &alone}) series->x.push_back(t);
      measured.y.push_back(covered.data.force()(k) / unit.scale);
      modelled.y.push_back(all(k) / unit.scale);
      alone.y.push_back(base(k) / unit.scale);
    }
    std::vector<PlotPanel> panels{{"motor with the added part",
                                   "time [s]",
                                   "torque [" + unit.name + "]",
                                   false,
                                   {measured, modelled, alone}}};
    if (!shares.empty()) {
      PlotSeries plus{"measured, positive direction", {}, {}, false, ""},
          minus{"negative", {}, {}, false, ""}, curve{"model", {}, {}, true, ""};
      for (const Share& share : shares) {
        PlotSeries& series = share.velocity > 0.0 ? plus : minus;
        series.x.push_back(std::abs(share.velocity) / kMilli);
        series.y.push_back(100.0 * share.measured);
      }
      for (const double sign : {1.0, -1.0}) {
        for (const Share& share : shares) {
          if (share.velocity * sign < 0.0) continue;
          curve.x.push_back(std::abs(share.velocity) / kMilli);
          curve.y.push_back(100.0 * share.modelled);
        }
        curve.x.push_back(1.0);
        curve.y.push_back(kAbsent);  // separates the lines of the two directions
      }
      panels.push_back({"share of the torque at steady speed",
                        text("speed [%s/s]", length),
                        "share [%]",
                        true,
                        {plus, minus, curve}});
    }
    write_result(arguments.plot, plot_svg(panels));
  }
  if (!arguments.result.empty()) {
    json out;
    out["schema"] = "servotwin.sequence/1";
    out["axis"] = bare.axis.axis;
    out["bare"] = force_json(*drive, true, unit);
    out["added"] = force_json(*part, true, unit);
    out["force_unit"] = unit.name;
    out["sources"] = {{"bare", bare.axis.source}, {"covered", covered.axis.source}};
    out["fitted"] = {{"rms", fitted.rms / unit.scale},
                     {"max", fitted.max / unit.scale},
                     {"relative", fitted.relative}};
    out["bare_fitted"] = {{"rms", drive->error.rms / unit.scale},
                          {"relative", drive->error.relative}};
    out["without"] = {{"rms", without.rms / unit.scale}, {"relative", without.relative}};
    out["verified"] = verified;
    out["share"] = share_json;
    out["direction_ratio"] = number_or_null(ratio);
    write_json(arguments.result, out);
  }
  say_written(people, {arguments.plot, arguments.result});
}

}  // namespace

Command add_sequence(CLI::App& app) {
  const auto arguments = std::make_shared<SequenceArguments>();
  OptionTable command(
      app, "sequence",
      "Identifies the friction that a part adds, from recordings without and with the part.");
  command.option("--bare", arguments->bare.file, "recording of the axis without the part")
      .takes("A.csv")
      .required();
  command.option("--covered", arguments->covered.file, "recording of the axis with the part")
      .takes("B.csv")
      .required();
  command.option("--axis", arguments->axis, "axis of the recordings").takes("X").required();
  command
      .option("--columns", arguments->bare.read_options.columns,
              "which column of a foreign file is which channel")
      .takes("MAP");
  arguments->bare.declare_format(command);
  arguments->bare.declare_as_recorded(command);
  command.option("--friction", arguments->friction, "friction model of both (default lugre)")
      .one_of(torque_frictions())
      .takes("ID");
  command
      .option("--verify-bare", arguments->verify_bare,
              "recordings without the part for validation; they are not fitted")
      .takes("C.csv");
  command
      .option("--verify", arguments->verify_covered,
              "recordings with the part for validation; they are not fitted")
      .takes("D.csv");
  command
      .option("--lead", arguments->lead_mm,
              "lead of the screw [mm]: print torques in Nm as forces in N")
      .takes("MM")
      .positive();
  command
      .option("--bandwidth", arguments->bandwidth_hz,
              "highest frequency at which torque and model are compared [Hz]; 0 (default): no "
              "limit, for an encoder of high resolution")
      .takes("HZ")
      .not_negative();
  command.flag("--invert-torque", arguments->invert,
               "the drive records torque with the opposite sign: invert it");
  command
      .option("--json", arguments->result,
              "write the complete result to this file; - is standard output")
      .takes("OUT");
  command.option("--plot", arguments->plot, "write a plot of torque and shares to this file (SVG)")
      .takes("OUT.svg");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
