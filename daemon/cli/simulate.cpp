// servotwin simulate: the twin as a machine, from a table of commands to what its encoders would
// say.
#include <cmath>
#include <memory>
#include <random>

#include "daemon/cli/can_drive.h"
#include "daemon/cli/command.h"
#include "daemon/cli/model_text.h"
#include "daemon/cli/options.h"
#include "daemon/cli/output.h"
#include "drivers/text.h"
#include "twin/twin.h"

namespace servotwin::cli {
namespace {

constexpr double kMicro = 1e-6;  // people say um, the program m

/// What an encoder makes of a position: noise, then its step [m | rad].
struct Encoder {
  double step = 0.0;
  double noise_rms = 0.0;
};

struct Arguments {
  RecordingOptions path;
  std::vector<std::filesystem::path> models;
  std::filesystem::path table;
  Encoder encoder;
  std::uint64_t seed = 1;
  std::vector<std::string> can;
  double seconds = 0.0;
};

struct ModelFile {
  std::filesystem::path file;
  ModelRecord record;
};

/// The models, one per axis.
std::vector<ModelFile> read_models(const std::vector<std::filesystem::path>& files) {
  std::vector<ModelFile> models;
  for (const auto& file : files) {
    ModelRecord record = read_model(file);
    for (const ModelFile& other : models) {
      if (other.record.axis == record.axis) {
        throw UsageError(file.string() + " is a second model of axis " + in_quotes(record.axis) +
                         ", beside " + other.file.string());
      }
    }
    models.push_back({file, std::move(record)});
  }
  return models;
}

/// Leaves the commands alone, and says what of the table will not be in the result.
void keep_commands(Recording& table, const std::vector<ModelFile>& models, std::FILE* people) {
  std::string left_out;
  const auto leave_out = [&](const std::string& what) {
    left_out += (left_out.empty() ? "" : ", ") + what;
  };
  for (AxisRecord& axis : table.axes) {
    const bool modelled = std::any_of(models.begin(), models.end(), [&](const ModelFile& model) {
      return model.record.axis == axis.name;
    });
    if (!modelled) {
      leave_out("axis " + axis.name + " (no --model of it)");
    } else if (!axis.torque.empty()) {
      leave_out(axis.name + ".torque");
    }
    axis.actual.clear();  // nor may a hole in it be one in the command
    axis.torque.clear();
  }
  if (!left_out.empty()) say(people, "note: not simulated: " + left_out);
}

/// The one unbroken command of an axis; a path is made, not recorded, so that a gap in it is a
/// mistake. What was repaired in it is said on `people`.
Segment unbroken(const Recording& table, const std::string& axis, std::FILE* people) {
  const SegmentedAxis segmented = segment_axis(table, axis);
  const SegmentReport& report = segmented.report;
  if (segmented.segments.size() != 1 || report.short_stretches > 0) {
    throw std::runtime_error(
        table.source + ": " + axis + ".command breaks off" +
        (report.splits.empty() ? "" : text(" at %.6g s", report.splits.front().time_s)) +
        "; a path must be unbroken, take one part with --from and --to");
  }
  for (const std::string& line : report.lines()) say(people, line);
  return segmented.segments.front();
}

void run(const Arguments& arguments) {
  if (!arguments.can.empty()) {
    if (!arguments.path.file.empty() || !arguments.table.empty())
      throw UsageError("with --can the commands come from the bus, and the answers go there");
    drive_on_can(
        {arguments.models, arguments.can, arguments.path.read_options.can_map, arguments.seconds});
    return;
  }
  if (arguments.path.file.empty()) throw UsageError("PATH is required");
  if (arguments.seconds > 0.0) throw UsageError("--seconds is for --can");
  std::FILE* people = people_beside({arguments.table});
  const std::vector<ModelFile> models = read_models(arguments.models);
  Recording table = arguments.path.read(people);
  keep_commands(table, models, people);

  std::vector<Column> columns;
  Segment first;
  std::string first_axis;
  for (const auto& [file, record] : models) {
    const auto axis =
        std::find_if(table.axes.begin(), table.axes.end(),
                     [&name = record.axis](const AxisRecord& one) { return one.name == name; });
    if (axis == table.axes.end()) {
      std::vector<std::string> names;
      for (const AxisRecord& one : table.axes) names.push_back(one.name);
      throw std::runtime_error(table.source + ": has no axis " + in_quotes(record.axis) +
                               ", which " + file.string() + " is a model of; it has " +
                               listed(names));
    }
    require_kind(record, file, axis->name, axis->rotary);
    const std::string unit = axis->rotary ? "[rad]" : "[m]";

    const Segment segment = unbroken(table, record.axis, people);
    const Model model = model_at(record, segment.sample_time_s, people);
    if (columns.empty()) {
      first = segment;
      first_axis = record.axis;
      columns.push_back({"time[s]", {}});
      for (Eigen::Index i = 0; i < segment.size(); ++i) {
        columns[0].values.push_back(segment.start_s +
                                    segment.sample_time_s * static_cast<double>(i));
      }
    } else if (segment.size() != first.size() || segment.start_s != first.start_s) {
      throw std::runtime_error(table.source + ": the commands of " + first_axis + " and " +
                               record.axis + " are not there for the same rows");
    }

    const Eigen::ArrayXd error = simulate(model, segment);
    // One stream of numbers per axis, so that an axis does not depend on which others are
    // simulated.
    std::seed_seq seeds(record.axis.begin(), record.axis.end());
    std::array<std::uint32_t, 2> axis_seed{};
    seeds.generate(axis_seed.begin(), axis_seed.end());
    std::mt19937_64 random(arguments.seed ^ (std::uint64_t{axis_seed[0]} << 32 | axis_seed[1]));
    std::normal_distribution<double> normal;
    Column command{record.axis + ".command" + unit, {}}, actual{record.axis + ".actual" + unit, {}};
    for (Eigen::Index i = 0; i < segment.size(); ++i) {
      double position = segment.command(i) - error(i);
      if (arguments.encoder.noise_rms > 0.0)
        position += arguments.encoder.noise_rms * normal(random);
      if (arguments.encoder.step > 0.0) {
        position = std::round(position / arguments.encoder.step) * arguments.encoder.step;
      }
      command.values.push_back(segment.command(i));
      actual.values.push_back(position);
    }
    columns.push_back(std::move(command));
    columns.push_back(std::move(actual));
    say(people, record.axis + ": tracking error " +
                    figures_text({std::sqrt(error.square().mean()), error.abs().maxCoeff()},
                                 record.rotary));
  }
  if (!arguments.table.empty()) write_result(arguments.table, csv(columns));
}

/// STEP or STEP:SIGMA in um.
Encoder parse_noise(const std::string& given) {
  const std::vector<double> numbers =
      parse_numbers("--noise", given, "STEP or STEP:SIGMA in um", 1, 2);
  for (const double value : numbers) {
    if (value < 0.0)
      throw CLI::ValidationError("--noise", in_quotes(given) + " must not be negative");
  }
  return {numbers[0] * kMicro, numbers.size() > 1 ? numbers[1] * kMicro : 0.0};
}

}  // namespace

Command add_simulate(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand(
      "simulate", "The twin as a machine: what the encoders would say to these commands.");
  arguments->path.declare(
      command, "PATH",
      "table of commands: CSV with units, or a recording whose encoders are ignored");
  command.get_option("PATH")->required(false);
  command
      .add_option("--model", arguments->models, "model file of an axis of the table; once per axis")
      ->type_name("M.json")
      ->required()
      ->expected(1)
      ->take_all();
  command
      .add_option("--out", arguments->table,
                  "write the table with the simulated encoders; - is standard output")
      ->type_name("SIM.csv");
  command
      .add_option_function<std::string>(
          "--noise",
          [arguments](const std::string& given) { arguments->encoder = parse_noise(given); },
          "encoder step, and standard deviation of Gaussian noise before it [um | urad]")
      ->type_name("STEP[:SIGMA]");
  command
      .add_option("--can", arguments->can,
                  "be the drives on CAN interfaces, one per bus of --can-map: answer on SYNC")
      ->type_name("IF,..")
      ->delimiter(',');
  command.add_option("--seconds", arguments->seconds, "with --can: end after this time")
      ->type_name("S")
      ->check(CLI::Range(1e-3, 1e9).name(""));
  command.add_option("--seed", arguments->seed, "seed of the noise (default 1)")->type_name("N");
  return {&command, [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
