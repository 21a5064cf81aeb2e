// servotwin motion-law: the test motion that friction is measured with.
#include "identification/torque/motion_law.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "drivers/common/text.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

constexpr double kMaxVelocities = 1e4;
constexpr double kMaxRows = 1e7;      // a table of about 250 MB
constexpr double kPicometres = 1e12;  // in a metre; finer digits are rounding errors

struct MotionLawArguments {
  std::string velocities;
  std::string bands = "10";
  MotionLawPlan plan;
  double acceleration_mm = 1000.0;
  double centre_mm = 0.0;
  std::optional<double> travel_mm;
  std::string axis = "X";
  double rate_hz = 1000.0;
  std::filesystem::path table, json;
};

double number_in(const std::string& option, const std::string& given, const std::string& word) {
  const std::optional<double> value = number_of(std::string(trimmed(word)));
  if (!value) {
    throw UsageError(option + ": " + in_quotes(word) + " of " + in_quotes(given) +
                     " is not a number");
  }
  return *value;
}

int index_in(const std::string& option, const std::string& given, const std::string& word,
             double most) {
  const double value = number_in(option, given, word);
  if (value != std::floor(value) || value < 1.0 || value > most) {
    throw UsageError(option + ": " + in_quotes(word) + " of " + in_quotes(given) +
                     " must be a whole number from 1 to " + number(most));
  }
  return static_cast<int>(value);
}

std::vector<double> numbers_in(const std::string& option, const std::string& given,
                               const std::string& list) {
  std::vector<double> values;
  for (const std::string& word : split_fields(list, ',')) {
    values.push_back(number_in(option, given, word));
  }
  return values;
}

/// V1,V2,... in mm/s, or poly:A0,A1,..:N in m/s.
std::vector<double> parse_velocities(const std::string& given) {
  const std::string option = "--velocities", polynomial = "poly:";
  if (given.compare(0, polynomial.size(), polynomial) != 0) {
    std::vector<double> velocities = numbers_in(option, given, given);
    for (double& v : velocities) v *= kMilli;
    return velocities;
  }
  const std::vector<std::string> parts = split_fields(given, ':');
  if (parts.size() != 3)
    throw UsageError(option + ": " + in_quotes(given) + " does not have the form poly:A0,A1,..:N");
  return polynomial_velocities(numbers_in(option, given, parts[1]),
                               index_in(option, given, parts[2], kMaxVelocities));
}

/// W, or W@K,..,W: the first for the velocities up to the K-th, the last for the rest; in mm.
std::vector<double> parse_bands(const std::string& given, std::size_t velocities) {
  const std::string option = "--band";
  std::vector<double> bands;
  const std::vector<std::string> words = split_fields(given, ',');
  for (const std::string& word : words) {
    const std::vector<std::string> parts = split_fields(word, '@');
    const bool last = &word == &words.back();
    if (parts.size() != (last ? 1U : 2U)) {
      throw UsageError(option + ": " + in_quotes(word) + " of " + in_quotes(given) +
                       (last ? " is the last band, for all remaining velocities, and takes no @K"
                             : " needs the number of the last velocity that it is for, W@K"));
    }
    const double band = number_in(option, given, parts[0]) * kMilli;
    const auto up_to = last ? velocities
                            : static_cast<std::size_t>(index_in(option, given, parts[1],
                                                                static_cast<double>(velocities)));
    if (up_to <= bands.size()) {
      throw UsageError(
          option + ": " + in_quotes(word) + " of " + in_quotes(given) +
          (last ? " has no velocity left" : " does not extend beyond the band before it"));
    }
    bands.resize(up_to, band);
  }
  return bands;
}

MotionLawPlan plan_of(const MotionLawArguments& arguments) {
  MotionLawPlan plan = arguments.plan;
  plan.velocities = parse_velocities(arguments.velocities);
  plan.bands = parse_bands(arguments.bands, plan.velocities.size());
  plan.acceleration = arguments.acceleration_mm * kMilli;
  plan.centre = arguments.centre_mm * kMilli;
  if (arguments.travel_mm) plan.travel = *arguments.travel_mm * kMilli;
  return plan;
}

/// "1 h 02 min 03 s", "2 min 03 s" or "3.4 s".
std::string time_text(double seconds) {
  if (seconds < 60.0) return text("%.1f s", seconds);
  const auto whole = static_cast<long long>(std::lround(seconds));
  const long long minutes = whole / 60;
  if (minutes < 60) return text("%lld min %02lld s", minutes, whole % 60);
  return text("%lld h %02lld min %02lld s", minutes / 60, minutes % 60, whole % 60);
}

std::string bands_text(const std::vector<double>& bands) {
  std::string out;
  for (std::size_t i = 0; i < bands.size();) {
    std::size_t next = i;
    while (next < bands.size() && bands[next] == bands[i]) ++next;
    out += (out.empty() ? "" : ", ") + text("%.6g mm", bands[i] / kMilli);
    if (next - i < bands.size()) {
      out += next - i == 1 ? text(" (%zu)", next) : text(" (%zu to %zu)", i + 1, next);
    }
    i = next;
  }
  return out;
}

void describe(const MotionLawPlan& plan, const MotionLaw& law, std::FILE* people) {
  const auto [slowest, fastest] =
      std::minmax_element(plan.velocities.begin(), plan.velocities.end());
  say(people, text("velocities  %zu, %.6g to %.6g mm/s, each in both directions",
                   plan.velocities.size(), *slowest / kMilli, *fastest / kMilli));
  say(people, "bands       " + bands_text(plan.bands));
  say(people, text("travel      %.6g mm, from %.6g to %.6g mm", (law.high() - law.low()) / kMilli,
                   law.low() / kMilli, law.high() / kMilli));
  say(people, "total time  " + time_text(law.duration_s()));
  if (law.single_band_duration_s() > law.duration_s()) {
    const double widest = *std::max_element(plan.bands.begin(), plan.bands.end());
    say(people, text("saved       %.1f %%: it would be %s with %.6g mm for all velocities",
                     100.0 * (1.0 - law.duration_s() / law.single_band_duration_s()),
                     time_text(law.single_band_duration_s()).c_str(), widest / kMilli));
  }
}

/// The rows of the table; throws if it cannot be written.
double rows_of(const MotionLawArguments& arguments, const MotionLaw& law) {
  if (!(arguments.rate_hz > 0.0)) {
    throw UsageError("--rate is " + number(arguments.rate_hz) + " Hz, must be positive");
  }
  if (arguments.axis.empty() ||
      arguments.axis.find_first_of(",;\t\r\n\"[]#") != std::string::npos) {
    throw UsageError("--axis: " + in_quotes(arguments.axis) +
                     " cannot be used in the header of a recording");
  }
  const double rows = std::floor(law.duration_s() * arguments.rate_hz * (1.0 + 1e-12)) + 1.0;
  if (!(rows <= kMaxRows)) {
    throw UsageError(
        text("--out would have %.6g rows, more than %.0f; use a lower --rate, a narrower --band or "
             "faster --velocities",
             rows, kMaxRows));
  }
  return rows;
}

std::string table_of(const MotionLawArguments& arguments, const MotionLaw& law, double rows) {
  Column time{"time[s]", {}}, command{arguments.axis + ".command[mm]", {}};
  for (double row = 0.0; row < rows; row += 1.0) {
    time.values.push_back(row / arguments.rate_hz);
    command.values.push_back(std::round(law.at(time.values.back()) * kPicometres) / 1e9);
  }
  return csv({time, command});
}

nlohmann::json json_of(const MotionLawArguments& arguments, const MotionLawPlan& plan,
                       const MotionLaw& law) {
  nlohmann::json ramps = nlohmann::json::array();
  for (const MotionRamp& ramp : law.ramps()) {
    ramps.push_back({{"velocity_mps", ramp.velocity},
                     {"band_m", ramp.band},
                     {"from_m", ramp.from},
                     {"to_m", ramp.to},
                     {"start_s", ramp.start_s},
                     {"end_s", ramp.end_s},
                     {"band_begin_s", ramp.band_begin_s},
                     {"band_end_s", ramp.band_end_s}});
  }
  return {{"schema", "servotwin.motion-law/1"},
          {"axis", arguments.axis},
          {"rate_hz", arguments.rate_hz},
          {"acceleration_mps2", plan.acceleration},
          {"settle_s", plan.settle_s},
          {"rest_s", plan.rest_s},
          {"centre_m", plan.centre},
          {"low_m", law.low()},
          {"high_m", law.high()},
          {"duration_s", law.duration_s()},
          {"single_band_duration_s", law.single_band_duration_s()},
          {"ramps", std::move(ramps)}};
}

void run(const MotionLawArguments& arguments) {
  std::FILE* people = people_beside({arguments.table, arguments.json});
  const MotionLawPlan plan = plan_of(arguments);
  const MotionLaw law(plan);
  const double rows = arguments.table.empty() ? 0.0 : rows_of(arguments, law);
  describe(plan, law, people);
  if (!arguments.table.empty()) {
    write_result(arguments.table, table_of(arguments, law, rows));
    say(people, text("table       %.0f rows at %.6g Hz", rows, arguments.rate_hz));
  }
  if (!arguments.json.empty()) write_json(arguments.json, json_of(arguments, plan, law));
  say_written(people, {arguments.table, arguments.json});
}

}  // namespace

Command add_motion_law(CLI::App& app) {
  const auto arguments = std::make_shared<MotionLawArguments>();
  OptionTable command(
      app, "motion-law",
      "Generates the test motion for friction: ramps of constant velocity across a band.");
  command
      .option("--velocities", arguments->velocities,
              "speeds V1,V2,.. [mm/s], or poly:A0,A1,..:N for A0 + A1 i + A2 i^2 .. [m/s], "
              "i = 1 to N")
      .takes("LIST")
      .required();
  command
      .option("--band", arguments->bands,
              "width of the band in which the force is averaged [mm]; 2@3,5@6,10 is 2 mm up to "
              "the third speed, 5 mm "
              "up to the sixth, 10 mm for the rest (default 10)")
      .takes("W");
  command
      .option("--settle", arguments->plan.settle_s,
              "a ramp of speed v starts settle x v before its band [s] (default 0.2)")
      .takes("S");
  command
      .option("--acceleration", arguments->acceleration_mm,
              "acceleration before and after every ramp [mm/s^2] (default 1000)")
      .takes("A");
  command.option("--rest", arguments->plan.rest_s, "rest after every ramp [s] (default 1)")
      .takes("S");
  command.option("--centre", arguments->centre_mm, "centre of the bands [mm] (default 0)")
      .takes("MM");
  command
      .option("--travel", arguments->travel_mm, "travel that is available [mm] (default: no limit)")
      .takes("MM");
  command.option("--axis", arguments->axis, "name of the axis in the table (default X)").takes("X");
  command.option("--rate", arguments->rate_hz, "rows per second of the table (default 1000)")
      .takes("HZ");
  command
      .option("--out", arguments->table,
              "write the table of commands to this file; - is standard output")
      .takes("PATH.csv");
  command
      .option("--json", arguments->json,
              "write every ramp with the times of its band to this file; - is standard output")
      .takes("OUT.json");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
