// Tables of programs whose names of columns are documented with their units: read with no option
// but the file.
//
//   moteus, tview             timestamp, control_position [rev], position [rev], torque_Nm
//   moteus, csv_output.py     time, CONTROL_POSITION [rev], POSITION [rev], TORQUE [Nm]
//   ODrive                    time, odrive0.axis0.controller.pos_setpoint [turn] or input_pos,
//                             odrive0.axis0.encoder.pos_estimate [turn], .. Iq_measured [A]
//   Klipper, data_export.py   Time (s), stepper_x position (mm) or toolhead x position (mm), and
//                             NAME position (mm) of one angle sensor
// Sources: mjbots/moteus (April 2026), utils/gui/moteus_gui/tview.py, fw/bldc_servo_structs.h,
// lib/python/examples/csv_output.py and docs/protocol/registers.md; odriverobotics/ODrive (0.5.6),
// GUI/src/components/plots/Plot.vue and Firmware/odrive-interface.yaml; Klipper3d/klipper (August
// 2026), scripts/motan/data_export.py and readlog.py. Any thread.
#pragma once

#include <optional>
#include <span>
#include <string>

namespace servotwin {

struct KnownColumns {
  std::string columns;  ///< as ReadOptions::columns
  std::string note;     ///< whose they are and what was assumed, for people
};

/// Nothing unless command, encoder and time are among these names, each once for every axis.
[[nodiscard]] std::optional<KnownColumns> known_columns(std::span<const std::string> names);

}  // namespace servotwin
