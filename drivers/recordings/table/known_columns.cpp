#include "drivers/recordings/table/known_columns.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <string_view>

namespace servotwin {
namespace {

struct Program {
  const char* note;
  std::string_view time, command, actual, torque;
  const char* position_unit;
  const char* torque_unit;
  const char* only_axis;  ///< name of the axis where the columns do not name one
  bool torque_always;     ///< whether the program always writes it: then it has to be there
  /// A column that nothing is read from, and without which the table is another program's.
  std::string_view beside = {};
};

// The first one that fits counts.
constexpr std::array kPrograms{
    Program{"columns of moteus (tview)", "timestamp", "control_position", "position", "torque_Nm",
            "rev", "Nm", "servo", true},
    Program{"columns of moteus (csv_output.py)", "time", "CONTROL_POSITION", "POSITION", "TORQUE",
            "rev", "Nm", "servo", false},
    Program{"columns of ODrive, positions in turns as from firmware 0.5.1 on", "time",
            "pos_setpoint", "pos_estimate", "Iq_measured", "rev", "A", "axis0", false},
    Program{"columns of ODrive, positions in turns as from firmware 0.5.1 on; input_pos is the "
            "setpoint in the input mode PASSTHROUGH only, in others pos_setpoint is",
            "time", "input_pos", "pos_estimate", "Iq_measured", "rev", "A", "axis0", false},
    Program{"signals of SINUMERIK, in its units", "t_s", "des_pos", "enc_pos", "torque", "mm", "Nm",
            "X", false, "cont_dev"},
    Program{"names of the EMPS benchmark (DATA_EMPS.mat)", "t", "qg", "qm", "vir", "m", "V", "X",
            true},
};

struct AxisColumns {
  std::string command, actual, torque;
};

/// "odrive0.axis1" of odrive0.axis1.encoder.pos_estimate; empty if no part is an axis.
std::string axis_in(std::string_view path) {
  for (std::size_t begin = 0; begin < path.size();) {
    const std::size_t end = std::min(path.find('.', begin), path.size());
    const std::string_view part = path.substr(begin, end - begin);
    if (part.size() > 4 && part.starts_with("axis") &&
        std::isdigit(static_cast<unsigned char>(part[4])) != 0)
      return std::string(path.substr(0, end));
    begin = end + 1;
  }
  return {};
}

/// False if there is one already: then nobody can tell which of them is meant.
bool set_once(std::string& place, const std::string& column) {
  const bool free = place.empty();
  place = column;
  return free;
}

std::string channel_of(const std::string& axis, const char* channel, const std::string& column,
                       const char* unit) {
  return column.empty() ? std::string()
                        : "," + axis + "." + channel + "=" + column + "[" + unit + "]";
}

std::optional<KnownColumns> columns_of(const Program& program, std::span<const std::string> names) {
  if (!program.beside.empty() && std::count(names.begin(), names.end(), program.beside) != 1)
    return std::nullopt;
  std::string time;
  std::map<std::string, AxisColumns> axes;
  for (const std::string& name : names) {
    const std::size_t point = name.rfind('.');
    const bool path = point != std::string::npos;
    const std::string_view last = std::string_view(name).substr(path ? point + 1 : 0);
    const std::string axis = path ? axis_in(name) : program.only_axis;
    if (axis.empty()) continue;
    const bool once = !path && last == program.time ? set_once(time, name)
                      : last == program.command     ? set_once(axes[axis].command, name)
                      : last == program.actual      ? set_once(axes[axis].actual, name)
                      : last == program.torque      ? set_once(axes[axis].torque, name)
                                                    : true;
    if (!once) return std::nullopt;
  }
  std::string columns = "time=" + time + "[s]";
  bool any = false;
  for (const auto& [name, axis] : axes) {
    if (axis.command.empty() || axis.actual.empty()) continue;
    if (program.torque_always && axis.torque.empty()) continue;
    any = true;
    columns += channel_of(name, "command", axis.command, program.position_unit) +
               channel_of(name, "actual", axis.actual, program.position_unit) +
               channel_of(name, "torque", axis.torque, program.torque_unit);
  }
  if (time.empty() || !any) return std::nullopt;
  return KnownColumns{columns, program.note};
}

/// Klipper writes "stepper_x position (mm)"; an angle sensor has a name of its own.
std::optional<KnownColumns> columns_of_klipper(std::span<const std::string> names) {
  constexpr std::string_view kPosition = " position (mm)";
  constexpr std::array<std::string_view, 3> kComputed{"Derived ", "Smoothed ", "SOS "};
  if (std::count(names.begin(), names.end(), "Time (s)") != 1) return std::nullopt;
  AxisColumns axis;
  for (const std::string& name : names) {
    const bool computed =
        std::any_of(kComputed.begin(), kComputed.end(),
                    [&](std::string_view begin) { return name.starts_with(begin); });
    if (computed || !name.ends_with(kPosition)) continue;
    const bool commanded = name.starts_with("stepper_") || name.starts_with("toolhead ");
    if (!set_once(commanded ? axis.command : axis.actual, name)) return std::nullopt;
  }
  if (axis.command.empty() || axis.actual.empty()) return std::nullopt;
  const std::string command = axis.command.substr(0, axis.command.size() - kPosition.size());
  const std::string axis_name{
      static_cast<char>(std::toupper(static_cast<unsigned char>(command.back())))};
  const std::string actual = axis.actual.substr(0, axis.actual.size() - kPosition.size());
  return KnownColumns{"time=Time[s]" +
                          channel_of(axis_name, "command", command + " position", "mm") +
                          channel_of(axis_name, "actual", actual + " position", "mm"),
                      "columns of Klipper (data_export.py)"};
}

/// What `rostopic echo -p` writes of a control_msgs/JointControllerState.
std::optional<KnownColumns> columns_of_rostopic(std::span<const std::string> names) {
  constexpr std::array<std::string_view, 3> kNeeded{"%time", "field.set_point",
                                                    "field.process_value"};
  for (const std::string_view needed : kNeeded)
    if (std::count(names.begin(), names.end(), needed) != 1) return std::nullopt;
  return KnownColumns{
      "time=%time[ns],joint.command=field.set_point[rad],joint.actual=field.process_value[rad]",
      "columns of rostopic echo -p, a joint that turns (of one that slides they are in m)"};
}

/// The custom of robotics: q1, q2, .. are the joints' angles, q_des1 their commands, i1 currents,
/// tau1 torques.
std::optional<KnownColumns> columns_of_joints(std::span<const std::string> names) {
  const auto there = [&](const std::string& name) {
    return std::count(names.begin(), names.end(), name) == 1 ? name : std::string();
  };
  const std::string time = there("t").empty() ? there("time") : "t";
  std::string columns = "time=" + time + "[s]";
  bool any = false;
  for (int k = 1; !there("q" + std::to_string(k)).empty(); ++k) {
    const std::string number = std::to_string(k), axis = "joint" + number;
    const std::string command = there("q_des" + number), current = there("i" + number),
                      torque = current.empty() ? there("tau" + number) : current;
    any = any || !command.empty() || !torque.empty();
    columns += channel_of(axis, "command", command, "rad") +
               channel_of(axis, "actual", "q" + number, "rad") +
               channel_of(axis, "torque", torque, current.empty() ? "Nm" : "A");
  }
  if (time.empty() || !any) return std::nullopt;
  return KnownColumns{
      columns,
      "columns named as joints of a robot: q angle [rad], i current [A], tau torque [Nm], assumed"};
}

}  // namespace

std::optional<KnownColumns> known_columns(std::span<const std::string> names) {
  for (const Program& program : kPrograms) {
    if (auto found = columns_of(program, names)) return found;
  }
  for (const auto columns : {columns_of_klipper, columns_of_rostopic, columns_of_joints}) {
    if (auto found = columns(names)) return found;
  }
  return std::nullopt;
}

}  // namespace servotwin
