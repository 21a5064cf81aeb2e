// servotwin formats: which files are read as recordings, with an example line of each.
#include <array>
#include <string>
#include <string_view>

#include "cli/command.h"
#include "cli/option_table.h"
#include "cli/output.h"
#include "drivers/foreign_format.h"

namespace servotwin::cli {
namespace {

struct Format {
  const char *name, *line, *channels;
};

constexpr std::array kFormats{
    Format{"table of this program", "time[s],X.command[mm],X.actual[mm],X.torque[Nm]",
           "AXIS.channel[unit]"},
    Format{"table of another program", "Zeit [ms];Lagesollwert [mm];Lageistwert [mm]",
           "by --columns; without it the error proposes one"},
    Format{"columns divided by blanks", "0.001   27.318985   24.5482",
           "by --columns: named in the comment above, else 1, 2, 3"},
    Format{"MATLAB 5 and 7.3", "(binary)", "by --columns: names of vectors"},
    Format{"ROS 2 bag (MCAP)", "(binary)", "each joint that a state of a controller names"},
    Format{"candump -l", "(1652345678.123456) can0 181#0011223344556677", "by --can-map"},
    Format{"candump on a terminal", " (1652345678.123456)  can0  181   [2]  19 00", "by --can-map"},
    Format{"Vector ASC", "date Thu May 16 06:16:50.884 pm 2024", "by --can-map"},
    Format{"PEAK TRC", ";$FILEVERSION=2.1", "by --can-map"},
    Format{"TwinCAT Scope CSV", "Name;ScopeProject",
           "X.SetPos and X.ActPos of axis X; others by --columns"},
    Format{"Heidenhain TNCscope (.sco)", "%TNCscopeNT data file",
           "s soll, s ist and I ist of each axis"},
    Format{"LinuxCNC halscope log", "Sampling period is 1000000 nSec", "by --columns"},
    Format{"SINUMERIK Edge capture", "{\"Header\": {.. \"SignalListHFData\": [..",
           "DES_POS, ENC_POS and TORQUE of each axis"},
    Format{"SINUMERIK trace (XML)", "<traceSession version=\"01.00.03.02\">",
           "by --columns: CmdPos2ndEnc64_7 is that signal of axis 7"}};

void run() {
  for (const Format& format : kFormats) {
    say(stdout, format.name);
    say(stdout, std::string("  first line  ") + format.line);
    say(stdout, std::string("  channels    ") + format.channels);
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
