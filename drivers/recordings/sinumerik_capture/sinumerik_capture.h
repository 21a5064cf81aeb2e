// SINUMERIK Edge, Capture4Analysis: a capture as JSON.
//
//   {"Header": {"SignalListHFData": [{"Name": "CYCLE"}, {"Name": "DES_POS|2", "Axis": "Y1"}, ..],
//               "CycleTimeMs": 2.0},
//    "Payload": [{"HFData": [[5558098, 910.0, ..], ..]}, ..]}
//
// DES_POS, ENC_POS and TORQUE of an axis are its command, encoder and torque [mm, Nm]; positions of
// axes called A.., B.. or C.. are in degrees, as DIN 66217 names rotary axes. Other signals are
// named by --columns, as "CURRENT|2". Time is the cycle times its length: a cycle that was not
// captured is a gap. Errors: as drivers/recordings/recording_file.h. Any thread. Source: a capture
// of an 840D sl (max-scw/CaptureDataParser, MIT).
#pragma once

#include <filesystem>
#include <string_view>

#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

/// By the first bytes of a file.
[[nodiscard]] bool is_sinumerik_capture(std::string_view start) noexcept;
[[nodiscard]] Recording read_sinumerik_capture(const std::filesystem::path& file,
                                               const ReadOptions& options);

}  // namespace servotwin
