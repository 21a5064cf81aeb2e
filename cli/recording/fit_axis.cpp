// servotwin fit-axis: fits the parts of a feed axis to measurements, stage by stage (paper 002).
#include <array>
#include <charconv>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <optional>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/recording/feed_axis_file.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "identification/torque/feed_axis_fit.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

constexpr const char* kHeader = "frequency[Hz],gain[dB],phase[deg]";

struct FitAxisArguments {
  std::filesystem::path file, response, covered, out;
  RecordingOptions bare;
  std::string axis;
  std::optional<double> nut_mm;
};

/// Three numbers per line under the header, from the commanded to the motor's velocity.
VelocityResponse read_response(const std::filesystem::path& file) {
  const std::string whole = read_text(file);
  std::vector<std::array<double, 3>> rows;
  int line_number = 0;
  for (std::string_view left = whole; !left.empty();) {
    const std::size_t end = std::min(left.find('\n'), left.size());
    const std::string_view line = trimmed(left.substr(0, end));
    left.remove_prefix(std::min(end + 1, left.size()));
    ++line_number;
    const auto refuse = [&](const std::string& why) {
      throw std::runtime_error(file.string() + ":" + std::to_string(line_number) + ": " +
                               in_quotes(line) + " " + why);
    };
    if (line.empty() || line.front() == '#') continue;
    if (line == kHeader) continue;
    const std::vector<std::string> fields = split_fields(line, ',');
    std::array<double, 3> row{};
    if (fields.size() != row.size()) refuse(std::string("must be ") + kHeader);
    for (std::size_t i = 0; i < row.size(); ++i) {
      const char* last = fields[i].data() + fields[i].size();
      if (std::from_chars(fields[i].data(), last, row[i]).ptr != last || !std::isfinite(row[i]))
        refuse("has " + in_quotes(fields[i]) + ", which is not a number");
    }
    if (!(row[0] > (rows.empty() ? 0.0 : rows.back()[0])))
      refuse("must have a higher frequency than the line before, above 0 Hz");
    rows.push_back(row);
  }
  VelocityResponse out;
  const auto n = static_cast<Eigen::Index>(rows.size());
  out.frequency_hz = Eigen::ArrayXd(n);
  out.closed = Eigen::ArrayXcd(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const auto& [frequency, gain, phase] = rows[static_cast<std::size_t>(k)];
    out.frequency_hz(k) = frequency;
    out.closed(k) = std::polar(std::pow(10.0, gain / 20.0), phase * std::numbers::pi / 180.0);
  }
  return out;
}

SegmentedAxis read_torque(RecordingOptions options, const std::filesystem::path& file,
                          const std::string& given, std::FILE* people) {
  options.file = file;
  const Recording whole = options.read(people, given);
  const std::string name = axis_of(whole, given);
  SegmentedAxis axis = segment_axis(whole, name);
  if (axis.rotary || axis.torque_unit != "Nm")
    throw std::runtime_error(axis.source + ": " + name + (axis.rotary ? " is rotary" : "") +
                             (axis.torque_unit != "Nm"
                                  ? ": needs its motor's torque, " + name + ".torque[Nm]"
                                  : std::string()));
  for (const std::string& line : axis.report.lines()) say(people, "  " + line);
  return axis;
}

void print_stage(const std::string& stage, const FeedAxisFit& fit, const std::string& unit,
                 std::FILE* people) {
  say(people, text("%s: residual RMS %.4g %s, before the fit %.4g", stage.c_str(), fit.rms,
                   unit.c_str(), fit.rms_before));
  for (const FittedValue& value : fit.values) {
    say(people, text("  %-28s %-11.5g was %-11.5g", value.name.c_str(), value.value, value.before) +
                    (value.deviation < 0.5 ? text("+- %.2g %%", 100.0 * value.deviation)
                                           : "not determined by these data"));
  }
}

void run(const FitAxisArguments& arguments) {
  if (arguments.response.empty() && arguments.bare.file.empty() && arguments.covered.empty())
    throw UsageError("nothing to fit to; give --response, --bare or --covered");
  if ((!arguments.bare.file.empty() || !arguments.covered.empty()) && arguments.axis.empty())
    throw UsageError("--axis is required: the axis of the recordings");
  std::FILE* people = people_beside({arguments.out});
  FeedAxisParts parts = read_feed_axis(arguments.file);
  const auto needs = [&](const std::optional<LuGreParts>& law, const char* name) {
    if (!law)
      throw std::runtime_error(arguments.file.string() + ": [" + name +
                               "] is missing; the fit needs rough values to start from");
  };
  if (!arguments.bare.file.empty()) needs(parts.friction, "friction");
  if (!arguments.covered.empty()) needs(parts.cover, "cover");

  if (!arguments.response.empty()) {
    VelocityResponse response = read_response(arguments.response);
    response.nut =
        arguments.nut_mm ? *arguments.nut_mm * kMilli : (parts.nut.from + parts.nut.to) / 2.0;
    if (response.frequency_hz.size() < 10 ||
        response.frequency_hz.maxCoeff() >= parts.control.rate_hz / 2.0)
      throw std::runtime_error(arguments.response.string() +
                               ": needs 10 frequencies or more, below half of control.rate_hz");
    const Progress progress("fitting springs and dampers");
    const FeedAxisFit fit = fit_response(parts, response);
    parts = fit.parts;
    print_stage(text("stage 1, velocity loop with the nut at %.4g mm", response.nut / kMilli), fit,
                "(logarithm of the response)", people);
  }
  const auto friction = [&](const std::filesystem::path& file, FrictionOf which,
                            const std::string& stage) {
    if (file.empty()) return;
    const SegmentedAxis axis = read_torque(arguments.bare, file, arguments.axis, people);
    const Progress progress("fitting friction");
    FeedAxisParts own = parts;
    if (which == FrictionOf::kDrive) own.cover.reset();  // the cover is not mounted yet
    const FeedAxisFit fit = fit_friction(own, which, axis.segments);
    (which == FrictionOf::kDrive ? parts.friction : parts.cover) =
        which == FrictionOf::kDrive ? fit.parts.friction : fit.parts.cover;
    print_stage(stage, fit, "Nm", people);
  };
  friction(arguments.bare.file, FrictionOf::kDrive, "stage 2, friction of the bare axis");
  friction(arguments.covered, FrictionOf::kCover, "stage 3, friction that the cover adds");
  if (!arguments.out.empty()) write_result(arguments.out, with_fitted(arguments.file, parts));
  say_written(people, {arguments.out});
}

}  // namespace

Command add_fit_axis(CLI::App& app) {
  const auto arguments = std::make_shared<FitAxisArguments>();
  OptionTable command(app, "fit-axis",
                      "Fits the parts of a feed axis to measurements, stage by stage.");
  command
      .option("AXIS", arguments->file,
              "parts of the axis with the values of their data sheets (TOML)")
      .takes("AXIS.toml")
      .required();
  command
      .option("--response", arguments->response,
              std::string("stage 1: closed velocity loop, ") + kHeader)
      .takes("R.csv");
  command
      .option(
          "--nut", arguments->nut_mm,
          "position of the nut in stage 1, from the bearing [mm] (default: middle of its travel)")
      .takes("MM");
  command
      .option("--bare", arguments->bare.file,
              "stage 2: recording without the cover, command and torque in Nm, from rest")
      .takes("A.csv");
  command.option("--covered", arguments->covered, "stage 3: recording with the cover")
      .takes("B.csv");
  command.option("--axis", arguments->axis, "axis of the recordings").takes("X");
  command
      .option("--columns", arguments->bare.read_options.columns,
              "which column of a foreign file is which channel")
      .takes("MAP");
  arguments->bare.declare_format(command);
  arguments->bare.declare_as_recorded(command);
  command
      .option("--out", arguments->out,
              "write the fitted axis to this file (TOML); - is standard output")
      .takes("FITTED.toml");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
