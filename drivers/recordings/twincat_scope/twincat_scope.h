// TwinCAT Scope View, exported as CSV.
//
//   Name;ScopeProject                         four lines about the recording
//   File;C:\Scope\Axis1.svdx
//   Starttime of export;133603138100000000;...
//   Endtime of export;133603138190000000;...
//
//   Name;X.SetPos;X.ActPos;Name;X.Torque      a column of times before each group of channels
//   SampleTime[ms];1;1;SampleTime[ms];2
//   Unit;mm;mm;Unit;Nm
//
//   0;0,0000;0,0000;0;0,12
//
// Separators: ; tab , or :. Channels that share their times are a group; what is read together has
// to have one sample time. `X.SetPos` and `X.ActPos` are command and encoder of axis X; others are
// named by --columns. Whether exported values contain a ScaleFactor or Offset depends on the export
// and is not in the file: a note says so where they are not 1 and 0. A last line EOF is none.
// Source: Beckhoff, TwinCAT 3 Scope Export; samples of CagtayFabry/pytcs (BSD-3-Clause).
#pragma once

#include <string>
#include <string_view>

#include "drivers/common/text_lines.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {

/// Looks at the next line as well, and puts it back.
[[nodiscard]] bool is_twincat_scope(TextLines& lines, const std::string& first);
[[nodiscard]] CsvHeader read_twincat_scope_header(TextLines& lines, std::string_view first);

}  // namespace servotwin
