// servotwin: the command-line tool. Exit status: 0 done, 1 the work failed, 2 wrong usage.
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <vector>

#include "cli/command.h"
#include "daemon/unknown_option.h"
#include "drivers/text.h"

namespace {

constexpr int kFailed = 1;
constexpr int kUsage = 2;

int fail(int status, const std::string& command, std::string message) {
  // One line, whatever a library put into it.
  std::replace(message.begin(), message.end(), '\n', ' ');
  while (!message.empty() && message.back() == ' ') message.pop_back();
  std::fprintf(stderr, "%s: %s\n", command.c_str(), message.c_str());
  return status;
}

int run(int argc, char** argv) {
  using namespace servotwin::cli;
  CLI::App app{"Servotwin: models of servo drives from recordings, and what they predict.",
               "servotwin"};
  app.set_version_flag("--version", SERVOTWIN_VERSION);
  app.require_subcommand(1);
  app.footer("Guide: docs/guide.md. Exit status: 0 done, 1 the work failed, 2 wrong usage.");
  const std::array commands{add_identify(app),      add_predict(app),
                            add_diagnose(app),      add_simulate(app),
                            add_learn(app),         add_motion_law(app),
                            add_characterize(app),  add_frequency_response(app),
                            add_sequence(app),      add_preview(app),
                            add_replay(app),        add_watch(app),
                            add_history(app),       add_export(app),
                            add_what_if(app),       add_fit_axis(app),
                            add_multivariable(app), add_check_config(app)};

  std::string name = "servotwin";
  const auto called = [&] {
    return std::find_if(commands.begin(), commands.end(),
                        [](const Command& c) { return c.app->parsed(); });
  };
  // The parser would only say that a command is missing.
  if (argc > 1 && argv[1][0] != '-') {
    std::vector<std::string> names;
    names.reserve(commands.size());
    for (const Command& command : commands) names.push_back(command.app->get_name());
    if (std::find(names.begin(), names.end(), argv[1]) == names.end()) {
      return fail(kUsage, name,
                  "there is no command " + servotwin::in_quotes(argv[1]) +
                      servotwin::did_you_mean(argv[1], names) +
                      " Commands: " + servotwin::listed(names));
    }
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
    // An option with a slip in its name may be the one that is then said to be missing.
    const std::string unknown = servotwin::daemon::unknown_option(*command);
    return fail(kUsage, name,
                (unknown.empty() ? error.what() : unknown) + " (see " + name + " --help)");
  }

  const Command& command = *called();
  name += " " + command.app->get_name();
  try {
    command.run();
  } catch (const std::invalid_argument& error) {
    return fail(kUsage, name, error.what());
  } catch (const std::bad_alloc&) {
    return fail(kFailed, name,
                "not enough memory; take a part of the recording with --from and --to");
  } catch (const std::exception& error) {
    return fail(kFailed, name, error.what());
  }
  // A full disk behind a pipe or a redirection shows itself only here.
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    return fail(kFailed, name,
                std::string("standard output cannot be written: ") + std::strerror(errno));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "servotwin: %s\n", error.what());
    return kFailed;
  }
}
