// Tables of programs whose names of columns are documented with their units: read with no option
// but the file.
//
//   moteus, tview             timestamp, control_position [rev], position [rev], torque_Nm
//   moteus, csv_output.py     time, CONTROL_POSITION [rev], POSITION [rev], TORQUE [Nm]
//   ODrive                    time, odrive0.axis0.controller.pos_setpoint [turn] or input_pos,
//                             odrive0.axis0.encoder.pos_estimate [turn], .. Iq_measured [A]
//   Klipper, data_export.py   Time (s), stepper_x position (mm) or toolhead x position (mm), and
//                             NAME position (mm) of one angle sensor
//   SINUMERIK, one axis       t_s, des_pos [mm], enc_pos [mm], cont_dev, torque [Nm]
//   EMPS benchmark            t, qg (command) [m], qm (encoder) [m], vir [V]
//   rostopic echo -p          %time [ns], field.set_point [rad], field.process_value [rad]
//   joints of robots          t, q1 .. [rad], q_des1 .., i1 .. [A] or tau1 .. [Nm]
// Sources: mjbots/moteus (April 2026), utils/gui/moteus_gui/tview.py, fw/bldc_servo_structs.h,
// lib/python/examples/csv_output.py and docs/protocol/registers.md; odriverobotics/ODrive (0.5.6),
// GUI/src/components/plots/Plot.vue and Firmware/odrive-interface.yaml; Klipper3d/klipper (August
// 2026), scripts/motan/data_export.py and readlog.py; of SINUMERIK,
// drivers/recordings/sinumerik_capture/sinumerik_capture.h; Janot, Gautier, Brunot, "Data Set and
// Reference Models of EMPS", 2019; ROS, control_msgs/JointControllerState.msg (1.5) and the pages
// of rostopic. That q is an angle in rad and tau a torque in Nm is custom (Siciliano and others,
// "Robotics", 2009), which the note says. Any thread.
#pragma once

#include <optional>
#include <span>
#include <string>

namespace servotwin {

struct KnownColumns {
  std::string columns;  ///< as ReadOptions::columns
  std::string note;     ///< whose they are and what was assumed, for people
};

/// Nothing unless time, encoder and command are among these names, each once for every axis; of
/// joints of robots, a torque or a command.
[[nodiscard]] std::optional<KnownColumns> known_columns(std::span<const std::string> names);

}  // namespace servotwin
