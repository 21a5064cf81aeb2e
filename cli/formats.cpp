// servotwin formats: which files are read as recordings, with an example line of each.
#include <string>
#include <string_view>

#include "cli/command.h"
#include "cli/option_table.h"
#include "cli/output.h"
#include "drivers/foreign_format.h"
#include "drivers/recording_format.h"

namespace servotwin::cli {
namespace {

void run() {
  for (const FormatForm& form : recording_formats()) {
    say(stdout, form.name);
    say(stdout, std::string("  first line  ") + form.line);
    say(stdout, std::string("  channels    ") + form.channels);
    say(stdout, std::string("  --format    ") + form.id);
  }
  std::string_view last;
  for (const ForeignFormat& format : foreign_formats()) {
    if (last.empty()) say(stdout, "\nNot read, but recognised:");
    if (last != format.name)
      say(stdout, std::string(format.name) + "\n  instead     " + format.advice);
    last = format.name;
  }
}

}  // namespace

Command add_formats(CLI::App& app) {
  OptionTable command(app, "formats",
                      "Lists the files that are read as recordings, with an example line of each.");
  return {command.app(), [] { run(); }};
}

}  // namespace servotwin::cli
