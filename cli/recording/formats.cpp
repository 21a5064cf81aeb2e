// servotwin formats: which files are read as recordings, with an example line of each.
#include <string>
#include <string_view>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "drivers/recordings/foreign_format.h"
#include "drivers/recordings/recording_format.h"

namespace servotwin::cli {
namespace {

void run() {
  for (const FormatForm& form : recording_formats()) {
    write_line(form.name);
    write_line(std::string("  first line  ") + form.line);
    write_line(std::string("  channels    ") + form.channels);
    write_line(std::string("  --format    ") + form.id);
  }
  std::string_view last;
  for (const ForeignFormat& format : foreign_formats()) {
    if (last.empty()) write_line("\nNot read, but recognised:");
    if (last != format.name)
      write_line(std::string(format.name) + "\n  instead     " + format.advice);
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
