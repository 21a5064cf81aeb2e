// Writes what the virtual machine recorded as CSV: unit-tagged columns, one row per sample.
//
//   time[s],X.command[mm],X.actual[mm],X.torque[Nm],Y.command[mm],...
//
// Numbers are rounded to fixed decimals, so that the file is the same on every run. Any thread.
// Errors: std::invalid_argument if there is no axis or the axes differ in length or sampling time.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tests/virtual_machine/axis.h"

namespace servotwin::virtual_machine {

struct CsvFormat {
  int time_decimals = 4;     ///< of s
  int command_decimals = 6;  ///< of mm
  int actual_decimals = 6;   ///< of mm; the encoder's step decides what is worth writing
  int torque_decimals = 4;
  std::string torque_unit = "Nm";
  std::vector<std::string> comments;  ///< one line each, written with "# " before it
};

void write_csv(const std::vector<AxisRecord>& axes, const CsvFormat& format, std::ostream& out);

}  // namespace servotwin::virtual_machine
