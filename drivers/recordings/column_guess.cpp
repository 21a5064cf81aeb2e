#include "drivers/recordings/column_guess.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include "drivers/common/units.h"
#include "drivers/recordings/column_name.h"

namespace servotwin {
namespace {

/// What a channel may be called by other programs, in lower case.
using Parts = std::span<const std::string_view>;
constexpr std::array<std::string_view, 13> kCommand{
    "command", "cmd",    "soll",   "setpos", "setpoint",  "set_pos", "des_pos",
    "pos_des", "posdes", "demand", "target", "reference", "cmdpos"};
constexpr std::array<std::string_view, 14> kActual{
    "actual",  "actpos", "act_pos", "pos_act", "posact",   "xact", "_act",
    "lageist", "s ist",  "enc_pos", "encoder", "feedback", "fb",   "meas"};
constexpr std::array<std::string_view, 13> kTorque{
    "torque", "moment", "force", "kraft",   "current", "strom",  "i ist",
    "iq",     "effort", "load",  "actcurr", "toract",  "tor_act"};
/// What a control puts out, which is as good as a torque; by these words only with a unit of one.
constexpr std::array<std::string_view, 2> kControlOutput{"control", "ctrl"};
/// Parts of names of other quantities.
constexpr std::array<std::string_view, 11> kNoPosition{"vel",    "speed", "geschw", "drehzahl",
                                                       "rpm",    "acc",   "v soll", "v ist",
                                                       "v_soll", "v_ist", "err"};
/// Words that tell command from encoder, longer ones before those that they begin with.
constexpr std::array<std::string_view, 23> kRole{
    "commanded", "command", "cmd",     "sollwert", "soll",      "setpoint", "set_point", "set",
    "desired",   "demand",  "des",     "target",   "reference", "ref",      "actual",    "act",
    "istwert",   "ist",     "encoder", "enc",      "feedback",  "measured", "meas"};
/// What a torque is said to be of, beside the axis.
constexpr std::array<std::string_view, 5> kOfMotor{"motor", "drive", "antrieb", "dreh", "value"};
constexpr std::array<std::string_view, 5> kOfPosition{"position", "pos", "lage", "value", "wert"};

bool has(std::string_view name, std::string_view part) {
  return name.find(part) != std::string_view::npos;
}
bool has_any(std::string_view name, Parts parts) {
  return std::any_of(parts.begin(), parts.end(), [&](auto part) { return has(name, part); });
}

/// "A" of iq_A: a unit that the name ends with.
std::optional<std::string> unit_in_name(const std::string& name) {
  const std::size_t underscore = name.rfind('_');
  if (underscore == std::string::npos || !parse_unit(name.substr(underscore + 1)))
    return std::nullopt;
  return name.substr(underscore + 1);
}

struct Column {
  std::string name;  ///< as in the file, without its unit
  std::optional<std::string> unit;
  std::string common;  ///< in lower case, without its role and what divides words
  std::string axis;    ///< what is left of `name` without its role and "position"
};

/// Cuts the first of `words` that is found out of `name`, and out of `beside`, which has the same
/// letters.
void cut_first(Parts words, std::string& lower, std::string& beside) {
  for (const std::string_view word : words) {
    const std::size_t at = lower.find(word);
    if (at == std::string::npos) continue;
    lower.erase(at, word.size());
    beside.erase(at, word.size());
    return;
  }
}

std::string without_blanks(std::string text) {
  std::erase_if(text, [](unsigned char c) { return c < 0x80 && std::isalnum(c) == 0; });
  return text;
}

/// The columns that have one of these parts in their names and can be of that kind.
std::vector<Column> columns_with(std::span<const std::string> names, Parts parts, bool torque) {
  std::vector<Column> out;
  for (const std::string& written : names) {
    const ColumnName split = column_name(written);
    Column column{split.name, split.unit ? split.unit : unit_in_name(split.name), {}, split.name};
    const auto unit = column.unit ? parse_unit(*column.unit) : std::nullopt;
    if (!unit) column.unit.reset();
    std::string lower = lower_case(column.name);
    const bool of_position =
        unit && (unit->quantity == Quantity::kLength || unit->quantity == Quantity::kAngle);
    if (unit && (torque ? unit->quantity != Quantity::kTorque : !of_position)) continue;
    const bool put_out = torque && unit && has_any(lower, kControlOutput);
    if (!(put_out || has_any(lower, parts)) || has_any(lower, kNoPosition)) continue;
    if (torque ? has(lower, "pos") : !unit && has_any(lower, kTorque) && !has(lower, "pos"))
      continue;
    if (!split.unit && unit) {
      const std::size_t unit_begin = lower.rfind('_');
      lower.resize(unit_begin);
      column.axis.resize(unit_begin);
    }
    // "torAct" has its role in the middle of its name.
    if (torque) cut_first(kTorque, lower, column.axis);
    if (put_out) cut_first(kControlOutput, lower, column.axis);
    cut_first(kRole, lower, column.axis);
    column.common = without_blanks(lower);
    cut_first(torque ? Parts(kOfMotor) : Parts(kOfPosition), lower, column.axis);
    column.axis = without_blanks(column.axis);
    out.push_back(std::move(column));
  }
  return out;
}

struct Axis {
  std::string name;
  Column command;
  std::optional<Column> actual, torque;
};

/// The one that is not `command` and for which `is_it` holds; nothing if there are more.
template <class Is>
std::optional<Column> only_one(const std::vector<Column>& columns, const Column& command,
                               Is is_it) {
  std::optional<Column> found;
  for (const Column& column : columns) {
    if (column.name == command.name || !is_it(column)) continue;
    if (found) return std::nullopt;
    found = column;
  }
  return found;
}

std::string part_of_mapping(const std::string& axis, const char* channel, const Column& column) {
  return axis + "." + channel + "=" + column.name + "[" + column.unit.value_or("unit") + "]";
}

std::string mapping_of(const std::vector<Axis>& axes) {
  std::string out;
  for (const Axis& axis : axes) {
    out += (out.empty() ? "" : ",") + part_of_mapping(axis.name, "command", axis.command);
    if (axis.actual) out += "," + part_of_mapping(axis.name, "actual", *axis.actual);
    if (axis.torque) out += "," + part_of_mapping(axis.name, "torque", *axis.torque);
  }
  return out;
}

/// The torque of an axis: the one whose name has nothing but the axis' beside its own words. Of one
/// that is asked for and one that is measured, the measured one.
std::optional<Column> torque_of(const std::vector<Column>& torques, const std::string& axis) {
  const auto of_axis = [&](const Column& c) { return c.axis == axis; };
  const auto asked = [](const Column& c) {
    constexpr std::array<std::string_view, 6> kAsked{"cmd", "command", "soll", "set", "des", "ref"};
    return has_any(lower_case(c.name), kAsked);
  };
  std::optional<Column> found;
  for (const Column& column : torques) {
    if (!of_axis(column) || asked(column)) continue;
    if (found) return std::nullopt;
    found = column;
  }
  return found;
}

/// Several commands: each with the encoder that has the same name but for its role. Empty if one
/// has none, or two axes would have one name.
std::vector<Axis> axes_of(const std::vector<Column>& commands, const std::vector<Column>& actuals,
                          const std::vector<Column>& torques) {
  std::vector<Axis> axes;
  for (const Column& command : commands) {
    const auto alike = [&](const Column& c) { return c.common == command.common; };
    const std::string& name = command.axis;
    const auto called = [&](const Axis& axis) { return axis.name == name; };
    const auto actual = only_one(actuals, command, alike);
    if (!actual || name.empty() || std::any_of(axes.begin(), axes.end(), called)) return {};
    axes.push_back({name, command, actual, torque_of(torques, name)});
  }
  // "X" and "Xfiltered" are one axis, "X1" and "X10" are two.
  for (const Axis& one : axes) {
    for (const Axis& other : axes) {
      const std::string& longer = other.name;
      if (longer.size() > one.name.size() && longer.starts_with(one.name) &&
          std::isdigit(static_cast<unsigned char>(longer[one.name.size()])) == 0)
        return {};
    }
  }
  return axes;
}

}  // namespace

ColumnGuess guess_columns(std::span<const std::string> names) {
  const std::vector<Column> commands = columns_with(names, kCommand, false),
                            torques = columns_with(names, kTorque, true);
  std::vector<Column> actuals = columns_with(names, kActual, false);
  // "ActualPositionReference" is a command.
  std::erase_if(actuals, [&](const Column& actual) {
    return std::any_of(commands.begin(), commands.end(),
                       [&](const Column& command) { return command.name == actual.name; });
  });
  if (commands.empty()) return {};
  ColumnGuess out;
  std::vector<Axis> axes;
  if (commands.size() > 1) axes = axes_of(commands, actuals, torques);
  out.clear = !axes.empty();
  if (axes.empty()) {
    const Column& command = commands.front();
    const auto any = [](const Column&) { return true; };
    const auto alike = [&](const Column& c) { return c.common == command.common; };
    Axis axis{"X", command, only_one(actuals, command, alike), std::nullopt};
    if (!axis.actual) axis.actual = only_one(actuals, command, any);
    const auto same_axis = [&](const Column& c) {
      return c.axis.empty() || command.axis.empty() || c.axis == command.axis;
    };
    out.clear = commands.size() == 1 && axis.actual && same_axis(*axis.actual);
    if (!axis.actual && !actuals.empty()) axis.actual = actuals.front();
    // What is the position and not the command is the encoder.
    constexpr std::array<std::string_view, 1> kAnyPosition{"pos"};
    if (!axis.actual)
      axis.actual = only_one(columns_with(names, kAnyPosition, false), command, any);
    axis.torque = torque_of(torques, command.axis);
    if (!axis.torque && !command.axis.empty()) axis.torque = torque_of(torques, "");
    // Where the user is asked anyway, a torque that may be of the axis is offered.
    const bool asked = !out.clear || !command.unit || !axis.actual->unit;
    if (!axis.torque && asked && torques.size() == 1) axis.torque = torques.front();
    axes.push_back(std::move(axis));
  }
  out.columns = mapping_of(axes);
  out.clear = out.clear && out.columns.find("[unit]") == std::string::npos;
  return out;
}

}  // namespace servotwin
