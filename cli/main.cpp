// servotwin: the command-line tool. Exit status: 0 done, 1 the work failed, 2 wrong usage.
#include <sched.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <sstream>
#include <string>
#include <vector>

#include "cli/common/command.h"
#include "cli/common/output.h"
#include "cli/program/examples.h"
#include "cli/program/help.h"
#include "daemon/licences.h"
#include "daemon/unknown_option.h"
#include "identification/least_squares/parallel.h"

namespace {

constexpr int kFailed = 1;
constexpr int kUsage = 2;

/// A file may have several problems; each is a line of the message.
int fail(int status, const std::string& command, const std::string& message) {
  std::fflush(stdout);  // what was read comes before why it failed, in a pipe as well
  std::istringstream lines(message);
  for (std::string line; std::getline(lines, line);) {
    if (!line.empty()) servotwin::cli::complain(command + ": " + line);
  }
  return status;
}

/// Every command takes it as well, so that it may stand before or behind the command's name.
void declare_quiet(CLI::App& app) {
  app.add_flag_callback(
      "--quiet", [] { servotwin::cli::keep_quiet(); },
      "print results and errors only: no notes, no summaries, no progress");
}

/// The examples of a command, above what --help of every command ends with.
std::string examples_text(const CLI::App& command) {
  std::string out = "Example:\n";
  for (const std::string& line : servotwin::cli::examples_of(command.get_name()))
    out += "  " + line + "\n";
  return out + "\n";
}

/// All commands, under the headings of --help. One without a heading is hidden.
std::vector<servotwin::cli::Command> declare_commands(CLI::App& app) {
  using namespace servotwin::cli;
  std::vector<Command> commands;
  const auto group = [&](const std::string& heading, const std::vector<Command>& members) {
    for (const Command& member : members) {
      member.app->group(heading);
      member.app->footer(examples_text(*member.app) + app.get_footer());
      declare_quiet(*member.app);
      commands.push_back(member);
    }
  };
  group("Models of axes",
        {add_identify(app), add_predict(app), add_simulate(app), add_export(app)});
  group("Diagnosis", {add_diagnose(app), add_history(app)});
  group("Friction from the motor's torque",
        {add_motion_law(app), add_characterize(app), add_sequence(app)});
  group("Frequency response and feed axes",
        {add_frequency_response(app), add_multivariable(app), add_fit_axis(app), add_what_if(app)});
  group("Path correction", {add_learn(app), add_preview(app)});
  group("Machine and daemon", {add_replay(app), add_watch(app), add_mqtt(app), add_mtconnect(app),
                               add_ros2(app), add_put_in_force(app), add_check_config(app)});
  group("This program", {add_help(app), add_version(app), add_completion(app), add_formats(app)});
  group("", {add_manual(app)});
  return commands;
}

int run(int argc, char** argv) {
  using namespace servotwin::cli;
  CLI::App app{"Servotwin: models of servo drives from recordings, and what they predict.",
               "servotwin"};
  app.set_version_flag("--version", SERVOTWIN_VERSION);
  servotwin::daemon::declare_licences(app);
  app.require_subcommand(1);
  app.get_formatter()->label("SUBCOMMAND", "COMMAND");
  app.footer("Manual: man servotwin. Exit status: 0 done, 1 the work failed, 2 wrong usage.");
  declare_quiet(app);
  const std::vector<Command> commands = declare_commands(app);

  std::string name = "servotwin";
  const auto called = [&] {
    return std::find_if(commands.begin(), commands.end(),
                        [](const Command& c) { return c.app->parsed(); });
  };
  // The parser would only say that a command is missing.
  if (argc == 1) return fail(kUsage, name, "a command is required (see servotwin --help)");
  if (argv[1][0] != '-' &&
      app.get_subcommands([&](const CLI::App* one) { return one->check_name(argv[1]); }).empty()) {
    return fail(kUsage, name, unknown_command(app, argv[1]));
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    const CLI::App* command = &app;
    if (called() != commands.end()) {
      command = called()->app;
      name += " " + command->get_name();
    }
    // A misspelt option may be the one that the parser reports as missing.
    const std::string unknown = servotwin::daemon::unknown_option(*command);
    std::string why = unknown.empty() ? error.what() : unknown;
    // Who has no model yet does not find in the help of this command how to make one.
    if (why.starts_with("--model ")) why += "; servotwin identify REC --model M.json makes one";
    return fail(kUsage, name, why + " (see " + name + " --help)");
  }

  const Command& command = *called();
  name += " " + command.app->get_name();
  try {
    command.run();
  } catch (const std::invalid_argument& error) {
    return fail(kUsage, name, error.what());
  } catch (const std::bad_alloc&) {
    return fail(kFailed, name,
                "not enough memory; select a part of the recording with --from and --to");
  } catch (const std::exception& error) {
    return fail(kFailed, name, error.what());
  }
  // If standard output is redirected to a full disk, the error appears only here.
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    return fail(kFailed, name,
                std::string("standard output cannot be written: ") + std::strerror(errno));
  }
  return 0;
}

/// The cores that this process may use; `taskset` limits them, which the standard library ignores.
std::size_t allowed_cores() {
  cpu_set_t set;
  CPU_ZERO(&set);
  return sched_getaffinity(0, sizeof set, &set) == 0 ? static_cast<std::size_t>(CPU_COUNT(&set))
                                                     : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    servotwin::use_threads(allowed_cores());
    servotwin::keep_freed_memory();
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "servotwin: %s\n", error.what());
    return kFailed;
  }
}
