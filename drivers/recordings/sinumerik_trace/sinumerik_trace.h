// SINUMERIK Solution Line Trace: a trace of a control's servo signals as XML.
//
//   <traceSession ..> <traceData> <dataFrame>
//     <frameHeader startTime="2012-01-20T20:01:47.526Z" dropOuts="0" ../>
//     <dataSignal id="f10" name="/Nck/!SD/nckServoDataCmdPos2ndEnc64 [u1, 7]" interval="0.002000"
//                 description="Position setpoint (64 bit)" unitsType="posn" ../>
//     <rec time="0.002000" f4="-0.000086" f8="-0.005600"/>
//
// A record holds only what has changed; there is none where nothing did. Signals have intervals of
// their own: the rows are those of the slowest one that is used. A signal is called by its last
// name and the number of its axis, "CmdPos2ndEnc64_7"; which is which channel, and whether a
// position is in mm or in deg, --columns tells. Values that are no numbers (infinities, written as
// whole numbers) are absent. Data that are packed (measuring functions) are not read.
//
// Errors: as drivers/recordings/recording_file.h. Any thread. Source: a trace of an 840D sl and its
// readers (hailongchenn/sinumerik-trace-viewer, eliasrhoden/Trace-Tools).
#pragma once

#include <filesystem>
#include <string_view>

#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

/// By the first bytes of a file.
[[nodiscard]] bool is_sinumerik_trace(std::string_view start) noexcept;
[[nodiscard]] Recording read_sinumerik_trace(const std::filesystem::path& file,
                                             const ReadOptions& options);

}  // namespace servotwin
