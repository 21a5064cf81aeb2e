#include "drivers/recordings/recording_format.h"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

using enum RecordingFormat;

constexpr std::array kForms{
    FormatForm{kTable, "csv", "table of this program",
               "time[s],X.command[mm],X.actual[mm],X.torque[Nm]", "AXIS.channel[unit]"},
    FormatForm{kTable, "csv", "table of another program",
               "Zeit [ms];Lagesollwert [mm];Lageistwert [mm]",
               "by --columns; without it the error proposes one"},
    FormatForm{kTable, "csv", "log of moteus (tview, csv_output.py)",
               "time,POSITION,TORQUE,CONTROL_POSITION", "CONTROL_POSITION, POSITION and TORQUE"},
    FormatForm{kTable, "csv", "export of ODrive",
               "time,odrive0.axis0.controller.pos_setpoint,odrive0.axis0.encoder.pos_estimate",
               "pos_setpoint, pos_estimate and Iq_measured of each axis"},
    FormatForm{kTable, "csv", "export of Klipper (data_export.py)",
               "Time (s),toolhead x position (mm),my_sensor position (mm)",
               "the position of one stepper or of the toolhead, and of one angle sensor"},
    FormatForm{kTable, "csv", "table below the settings of a recorder", "Sampling interval,0.001,s",
               "by --columns: the last line of names above the rows"},
    FormatForm{kTable, "csv", "columns divided by blanks", "0.001   27.318985   24.5482",
               "by --columns: named in the comment above, else 1, 2, 3"},
    FormatForm{kMatlab, "matlab", "MATLAB 5 and 7.3", "(binary)", "by --columns: names of vectors"},
    FormatForm{kMcap, "mcap", "ROS 2 bag (MCAP)", "(binary)",
               "each joint that a state of a controller names"},
    FormatForm{kCandump, "candump", "candump -l", "(1652345678.123456) can0 181#0011223344556677",
               "by --can-map"},
    FormatForm{kCandump, "candump", "candump on a terminal",
               " (1652345678.123456)  can0  181   [2]  19 00", "by --can-map"},
    FormatForm{kVectorAsc, "asc", "Vector ASC", "date Thu May 16 06:16:50.884 pm 2024",
               "by --can-map"},
    FormatForm{kPeakTrc, "trc", "PEAK TRC", ";$FILEVERSION=2.1", "by --can-map"},
    FormatForm{kTwincatScope, "twincat", "TwinCAT Scope CSV", "Name;ScopeProject",
               "X.SetPos and X.ActPos of axis X; others by --columns"},
    FormatForm{kTncscope, "tncscope", "Heidenhain TNCscope (.sco)", "%TNCscopeNT data file",
               "s soll, s ist and I ist of each axis"},
    FormatForm{kHalscope, "halscope", "LinuxCNC halscope log", "Sampling period is 1000000 nSec",
               "by --columns"},
    FormatForm{kHalscope, "halscope", "LinuxCNC halscope CSV, since 2.9",
               "# Sampling period is 1000000 ns", "by --columns"},
    FormatForm{kSinumerikCapture, "sinumerik-capture", "SINUMERIK Edge capture",
               "{\"Header\": {.. \"SignalListHFData\": [..",
               "DES_POS, ENC_POS and TORQUE of each axis"},
    FormatForm{kSinumerikTrace, "sinumerik-trace", "SINUMERIK trace (XML)",
               "<traceSession version=\"01.00.03.02\">",
               "by --columns: CmdPos2ndEnc64_7 is that signal of axis 7"}};

}  // namespace

std::span<const FormatForm> recording_formats() noexcept { return kForms; }

const FormatForm& form_of(RecordingFormat format) noexcept {
  return *std::find_if(kForms.begin(), kForms.end(),
                       [&](const FormatForm& form) { return form.format == format; });
}

std::vector<std::string> format_ids() {
  std::vector<std::string> ids;
  for (const FormatForm& form : kForms) {
    if (ids.empty() || ids.back() != form.id) ids.emplace_back(form.id);
  }
  return ids;
}

RecordingFormat format_named(const std::string& id) {
  for (const FormatForm& form : kForms) {
    if (form.id == id) return form.format;
  }
  throw std::invalid_argument(in_quotes(id) + " is no format of recordings; they are " +
                              listed(format_ids()));
}

}  // namespace servotwin
