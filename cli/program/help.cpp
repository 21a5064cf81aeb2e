#include "cli/program/help.h"

#include <CLI/CLI.hpp>
#include <memory>
#include <vector>

#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "cli/program/completion.h"
#include "cli/program/manual.h"
#include "cli/program/manual_text.h"
#include "cli/program/usage.h"
#include "daemon/arguments.h"
#include "drivers/common/text.h"

namespace servotwin::cli {
namespace {

constexpr const char* kTool = "servotwin";
constexpr const char* kDaemon = "servotwind";

/// --program: which of the two programs is described.
void declare_program(OptionTable& command, std::string& program) {
  command.option("--program", program, "program to describe (default servotwin)")
      .one_of({kTool, kDaemon})
      .takes("NAME");
}

Usage usage_of_program(CLI::App& tool, const std::string& program) {
  if (program == kTool) return usage_of(tool);
  CLI::App daemon(daemon::kDaemonDescription, kDaemon);
  daemon::DaemonArguments arguments;
  arguments.declare(daemon, SERVOTWIN_VERSION);
  return usage_of(daemon);
}

}  // namespace

std::string unknown_command(const CLI::App& app, const std::string& word) {
  std::vector<std::string> names;
  for (const CLI::App* command :
       app.get_subcommands([](const CLI::App* one) { return !one->get_group().empty(); })) {
    names.push_back(command->get_name());
  }
  return "there is no command " + in_quotes(word) + did_you_mean(word, names) +
         " Commands: " + listed(names);
}

Command add_help(CLI::App& app) {
  const auto name = std::make_shared<std::string>();
  OptionTable command(app, "help", "Shows the commands, or the options of one command.");
  command.option("COMMAND", *name, "command to explain").takes("COMMAND");
  return {command.app(), [&app, name] {
            const CLI::App* subject = &app;
            if (!name->empty()) {
              const auto found = app.get_subcommands(
                  [&](const CLI::App* one) { return one->get_name() == *name; });
              if (found.empty()) throw UsageError(unknown_command(app, *name));
              subject = found.front();
            }
            // App::help() gives the help of the command that was called, which is this one.
            write_result("-", app.get_formatter()->make_help(
                                  subject, app.get_name() + (name->empty() ? "" : " " + *name),
                                  CLI::AppFormatMode::Normal));
          }};
}

Command add_version(CLI::App& app) {
  OptionTable command(app, "version", "Shows the version of this program.");
  return {command.app(), [] { write_result("-", std::string(SERVOTWIN_VERSION) + "\n"); }};
}

Command add_completion(CLI::App& app) {
  struct CompletionArguments {
    std::string shell, program = kTool;
  };
  const auto arguments = std::make_shared<CompletionArguments>();
  OptionTable command(app, "completion",
                      "Writes the script that completes commands and options in a shell.");
  command.option("SHELL", arguments->shell, "shell that reads the script")
      .required()
      .one_of({"bash", "zsh", "fish"});
  declare_program(command, arguments->program);
  return {command.app(), [&app, arguments] {
            const Usage program = usage_of_program(app, arguments->program);
            write_result("-", arguments->shell == "bash"  ? bash_completion(program)
                              : arguments->shell == "zsh" ? zsh_completion(program)
                                                          : fish_completion(program));
          }};
}

Command add_manual(CLI::App& app) {
  struct ManualArguments {
    std::string program = kTool, date;
  };
  const auto arguments = std::make_shared<ManualArguments>();
  OptionTable command(app, "manual", "Writes the manual page, in the man macros of troff.");
  declare_program(command, arguments->program);
  command.option("--date", arguments->date, "date of the version, for the foot of the page")
      .takes("DATE");
  return {command.app(), [&app, arguments] {
            write_result("-", manual_page(usage_of_program(app, arguments->program),
                                          arguments->program == kTool ? servotwin_manual_text()
                                                                      : servotwind_manual_text(),
                                          SERVOTWIN_VERSION, arguments->date));
          }};
}

}  // namespace servotwin::cli
