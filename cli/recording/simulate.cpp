// servotwin simulate: the twin in place of a machine; from a table of commands it computes the
// encoder positions.
#include <cmath>
#include <memory>
#include <random>

#include "cli/common/command.h"
#include "cli/common/command_table.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/live/can_drive.h"
#include "drivers/common/text.h"
#include "identification/model/motion_reach.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin::cli {
namespace {

/// The errors of an encoder [m | rad]: noise is added to the position, then it is rounded to the
/// step.
struct Encoder {
  double step = 0.0;
  double noise_rms = 0.0;
};

struct SimulateArguments {
  TableOptions commands;
  std::filesystem::path table;
  Encoder encoder;
  std::uint64_t seed = 1;
  std::vector<std::string> can;
  CanUdpPlace udp;
  double seconds = 0.0;
};

void run(const SimulateArguments& arguments) {
  if (!arguments.can.empty() && !arguments.udp.peer.empty())
    throw UsageError("choose one bus: --can or --udp");
  if (!arguments.can.empty() || !arguments.udp.peer.empty()) {
    if (!arguments.commands.path.file.empty() || !arguments.table.empty())
      throw UsageError(
          "with --can and --udp, commands and answers are on the bus: leave PATH and --out out");
    drive_on_can({arguments.commands.models, arguments.can, arguments.udp,
                  arguments.commands.path.read_options.can_map, arguments.seconds});
    return;
  }
  if (arguments.commands.path.file.empty()) throw UsageError("PATH is required");
  if (arguments.seconds > 0.0) throw UsageError("--seconds is for --can and --udp");
  std::FILE* people = people_beside({arguments.table});
  std::vector<Column> columns;
  for (const auto& [record, model, segment] :
       read_commands(arguments.commands, "simulated", people)) {
    if (columns.empty()) columns.push_back({"time[s]", times_of(segment)});
    if (coupled_by_motion(model) && segment.neighbour_motion.size() == 0)
      say(people, "note: the model of " + record.axis + " contains the motion of " +
                      (record.neighbour.empty() ? "another axis" : "axis " + record.neighbour) +
                      ", which has no --model here: " +
                      (segment.neighbour.size() > 0 ? "its command stands in for it"
                                                    : "its part of the error is missing"));
    const std::string unit = record.rotary ? "[rad]" : "[m]";
    if (const MotionReach reach = motion_reach(record, {&segment, 1}); reach.beyond())
      say(people, "note: " + reach.words);
    const Eigen::ArrayXd error = simulate(model, segment);
    // One random sequence per axis, so that the result of an axis does not depend on the other
    // axes.
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
    std::string of_torque;
    if (record.torque) {
      const Eigen::ArrayXd torque =
          simulated_torque(model, record.torque->by, record.torque->lag, segment);
      columns.push_back(
          {record.axis + ".torque[" + record.torque->unit + "]", {torque.begin(), torque.end()}});
      of_torque = ", torque " + torque_range_text(torque, record.torque->unit);
    }
    say(people, record.axis + ": tracking error " +
                    figures_text({std::sqrt(error.square().mean()), error.abs().maxCoeff()},
                                 record.rotary) +
                    of_torque);
  }
  if (!arguments.table.empty()) write_result(arguments.table, csv(columns));
  say_written(people, {arguments.table});
}

/// STEP or STEP:SIGMA in um.
Encoder parse_noise(const std::string& given) {
  const std::vector<double> numbers =
      parse_numbers("--noise", given, "STEP or STEP:SIGMA in um", 1, 2);
  for (const double value : numbers) {
    if (value < 0.0) refuse_value("--noise", in_quotes(given) + " must not be negative");
  }
  return {numbers[0] * kMicro, numbers.size() > 1 ? numbers[1] * kMicro : 0.0};
}

}  // namespace

Command add_simulate(CLI::App& app) {
  const auto arguments = std::make_shared<SimulateArguments>();
  OptionTable command(app, "simulate",
                      "Simulates the encoder positions of a machine for given commands.");
  arguments->commands.declare(command);
  command.declared("PATH").required(false);
  command
      .option("--out", arguments->table,
              "write the table with the simulated encoders to this file; - is standard output")
      .takes("SIM.csv");
  command
      .option_read_by(
          "--noise",
          [arguments](const std::string& given) { arguments->encoder = parse_noise(given); },
          "encoder step, and standard deviation of Gaussian noise before it [um | urad]")
      .takes("STEP[:SIGMA]");
  command
      .option("--can", arguments->can,
              "act as the drives on CAN interfaces, one per bus of --can-map: answer on SYNC")
      .takes("IF,..")
      .comma_separated();
  command
      .option("--udp", arguments->udp.peer,
              "the same on CAN over UDP (cannelloni's format), with the controller at this address")
      .takes("HOST:PORT");
  command
      .option("--listen", arguments->udp.listen,
              "with --udp: local address where its frames arrive (default " +
                  arguments->udp.listen + ")")
      .takes("ADDRESS:PORT");
  command.option("--seconds", arguments->seconds, "with --can or --udp: end after this time")
      .takes("S")
      .between(1e-3, 1e9);
  command.option("--seed", arguments->seed, "seed of the noise (default 1)").takes("N");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
