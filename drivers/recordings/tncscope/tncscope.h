// Heidenhain TNCscope, saved as text (.sco).
//
//   %TNCscopeNT data file
//   %[CURVE1]                    a section for each curve, with the column of its values
//   %CHANNELTYPE=s soll
//   %AXISTYPE=Y
//   %DIMENSION=mm
//   %COLUMN=1
//   %[DATA]
//    0.000000000e+000;  4.000000000e+002;      column 0 is the time [us]
//
// `s soll` (s nominal) is the command of its axis, `s ist` (s actual) the encoder, `I ist` (I
// actual) the current. Axes whose positions are in degrees are rotary. Source: TNCscope 2.0, a
// recording of an iTNC 530 (Duncan-McPherson/Thesis-Work).
#pragma once

#include <string_view>

#include "drivers/common/text_lines.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {

[[nodiscard]] inline bool is_tncscope(std::string_view first) noexcept {
  return first.starts_with("%TNCscope");
}
[[nodiscard]] CsvHeader read_tncscope_header(TextLines& lines);

}  // namespace servotwin
