#!/usr/bin/env python3
"""Writes the samples of this folder, as the programs named in README.md write them."""
import csv
import math
import pathlib

HERE = pathlib.Path(__file__).parent
ROWS, STEP_S = 300, 0.01

# Telemetry servo_stats of moteus that is constant here; fw/bldc_servo_structs.h.
REST = {"bus_V": 24.0, "control_position_raw": 0, "control_velocity": "", "cooldown_count": 0, "d_A": 0.0, "fault": 0, "fw.enabled": False,
        "mode": 10, "motor_max_velocity": 40.0, "pid_position.error": 0.0, "pid_position.integral": 0.0, "power_W": 0.0, "q_A": 0.0,
        "torque_error_Nm": 0.0, "trajectory_done": False, "velocity": 0.0, "velocity_filt": 0.0}


def command(t):
    return 0.25 * math.sin(2.0 * math.pi * t)


def actual(t):
    return 0.25 * math.sin(2.0 * math.pi * (t - 0.02))


def drive(t):
    return 0.5 * math.cos(2.0 * math.pi * t)


def write(name, header, row):
    with open(HERE / name, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([cell if not isinstance(cell, float) else round(cell, 6) for cell in row(k * STEP_S)] for k in range(ROWS))


def main():
    stats = sorted([*REST, "control_position", "position", "torque_Nm"])
    write("moteus_tview.csv", ["timestamp", *stats],
          lambda t: [1.7e9 + t, *({**REST, "control_position": command(t), "position": actual(t), "torque_Nm": drive(t)}[name] for name in stats)])
    write("moteus_csv_output.csv", ["time", "MODE", "POSITION", "VELOCITY", "TORQUE", "CONTROL_POSITION", "VOLTAGE", "FAULT"],
          lambda t: [t, 10, actual(t), 0.0, drive(t), command(t), 24.0, 0])
    write("odrive_gui.csv", ["time", "odrive0.axis1.controller.pos_setpoint", "odrive0.axis1.encoder.pos_estimate", "odrive0.axis1.motor.current_control.Iq_measured"],
          lambda t: [t, command(t), actual(t), drive(t)])
    write("klipper_export.csv", ["Time (s)", "stepper_x position (mm)", "my_sensor position (mm)", "toolhead velocity (mm/s)"],
          lambda t: [t, command(t), actual(t), 0.0])


if __name__ == "__main__":
    main()
