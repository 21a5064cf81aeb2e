#include "drivers/recordings/column_map.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "drivers/common/text.h"
#include "drivers/recordings/column_guess.h"
#include "drivers/recordings/column_name.h"
#include "drivers/recordings/table/known_columns.h"

namespace servotwin {
namespace {

struct KnownChannel {
  std::string_view name;
  std::array<Quantity, 2> quantities;  // of a linear axis, of a rotary one
  std::optional<Channel> kept_as;      // absent: nothing uses it yet
};

constexpr std::array kPosition{Quantity::kLength, Quantity::kAngle};
constexpr std::array kRate{Quantity::kVelocity, Quantity::kAngularVelocity};
constexpr std::array kDrive{Quantity::kTorque, Quantity::kTorque};
constexpr std::array kChannels{
    KnownChannel{"command", kPosition, Channel::kCommand},
    KnownChannel{"actual", kPosition, Channel::kActual},
    KnownChannel{"actual_motor", kPosition, Channel::kActualMotor},
    KnownChannel{"torque", kDrive, Channel::kTorque},
    KnownChannel{"velocity_command", kRate, std::nullopt},
    KnownChannel{"velocity", kRate, std::nullopt},
    KnownChannel{"following_error", kPosition, std::nullopt},
};

const KnownChannel* find_channel(std::string_view name) {
  const auto* found = std::find_if(kChannels.begin(), kChannels.end(),
                                   [&](const KnownChannel& c) { return c.name == name; });
  return found == kChannels.end() ? nullptr : found;
}

std::vector<std::string> channel_names() {
  std::vector<std::string> names;
  for (const KnownChannel& channel : kChannels) names.emplace_back(channel.name);
  return names;
}

// "X.command": the axis may have points in its name, the channel has none.
struct AxisChannel {
  std::string axis;
  std::string channel;
};

std::optional<AxisChannel> split_channel(std::string_view name) {
  const std::size_t point = name.rfind('.');
  if (point == std::string_view::npos || point == 0) return std::nullopt;
  return AxisChannel{std::string(name.substr(0, point)), std::string(name.substr(point + 1))};
}

// One column to read: its place in the file, and its channel.
struct Wanted {
  std::string name;  // name of the channel: "X.command" or "time"
  Unit unit;
  std::size_t index = 0;
};

const char* kind_of(const Unit& unit) {
  switch (unit.quantity) {
    case Quantity::kTime:
      return "a time";
    case Quantity::kLength:
      return "a length";
    case Quantity::kAngle:
      return "an angle";
    case Quantity::kVelocity:
      return "a velocity";
    case Quantity::kAngularVelocity:
      return "an angular velocity";
    case Quantity::kTorque:
      break;
  }
  return "a torque, force, current, voltage or share";
}

// Reads the unit of a column; `written` is the column as the user or the file wrote it.
template <class Error>
Unit unit_of(const std::string& where, const std::string& written,
             const std::optional<std::string>& text) {
  if (!text) {
    throw Error(where + "column " + in_quotes(written) + " has no unit: write " + written +
                "[unit] with one of " + std::string(kKnownUnits) + ", in the file or in --columns");
  }
  const auto unit = parse_unit(*text);
  if (!unit && *text == "unit") {  // of a proposal, or of the help, as it is
    throw Error(where + "column " + in_quotes(written) +
                ": replace [unit] by the unit of its values, one of " + std::string(kKnownUnits));
  }
  if (!unit) {
    throw Error(where + "column " + in_quotes(written) + " has the unknown unit [" + *text +
                "]; known are " + std::string(kKnownUnits));
  }
  return *unit;
}

template <class Error>
void require_quantity(const std::string& where, const Wanted& wanted) {
  std::array<Quantity, 2> allowed{Quantity::kTime, Quantity::kTime};
  if (wanted.name != "time")
    allowed = find_channel(split_channel(wanted.name)->channel)->quantities;
  if (std::find(allowed.begin(), allowed.end(), wanted.unit.quantity) != allowed.end()) return;
  Unit expected = wanted.unit;
  expected.quantity = allowed[0];
  throw Error(where + in_quotes(wanted.name) + " cannot be " + kind_of(wanted.unit) +
              "; it needs " + kind_of(expected) + (allowed == kPosition ? " or an angle" : ""));
}

// The columns that `columns` names, in its order.
struct Mapping {
  Wanted wanted;
  std::string column;               // its name in the file
  std::string exact;                // the same with what was taken for its unit
  std::string written;              // as the user wrote it
  std::optional<std::string> unit;  // absent: that of the file
};

std::vector<Mapping> parse_mapping(const std::string& text) {
  const std::string where = "--columns: ";
  std::vector<Mapping> mappings;
  for (const std::string& part : split_fields(text, ',')) {
    const std::size_t equals = part.find('=');
    const std::string ours(trimmed(std::string_view(part).substr(0, equals)));
    if (equals == std::string::npos || ours.empty()) {
      throw std::invalid_argument(where + in_quotes(part) +
                                  " is not of the form X.command=NAME[unit] or time=NAME[s]");
    }
    const ColumnName theirs = column_name(std::string_view(part).substr(equals + 1));
    if (theirs.name.empty()) {
      throw std::invalid_argument(where + in_quotes(part) + " names no column after '='");
    }
    if (ours != "time") {
      const auto names = channel_names();
      const auto split = split_channel(ours);
      const std::string channel = split ? split->channel : ours;
      if (!split || find_channel(channel) == nullptr) {
        throw std::invalid_argument(
            where + in_quotes(ours) + " is neither time nor AXIS.channel with " +
            "one of the channels " + listed(names) + did_you_mean(channel, names));
      }
    }
    for (const Mapping& before : mappings) {
      if (before.wanted.name == ours) {
        throw std::invalid_argument(where + in_quotes(ours) + " is given twice");
      }
    }
    const std::string exact(trimmed(std::string_view(part).substr(equals + 1)));
    Mapping mapping{{ours, {}, 0}, theirs.name, exact, part, theirs.unit};
    if (mapping.unit) {
      mapping.wanted.unit = unit_of<std::invalid_argument>(where, part, mapping.unit);
      require_quantity<std::invalid_argument>(where, mapping.wanted);
    }
    mappings.push_back(std::move(mapping));
  }
  return mappings;
}

/// The columns that can be asked for: those that have a name.
std::vector<std::string> named(std::span<const std::string> names) {
  std::vector<std::string> out;
  std::copy_if(names.begin(), names.end(), std::back_inserter(out),
               [](const std::string& name) { return !name.empty(); });
  return out;
}

// The place of a column by its name: as written in the file, or without the unit that the file
// gives.
std::optional<std::size_t> find_column(const std::string& source, const std::string& name,
                                       std::span<const std::string> names) {
  const auto find = [&](auto&& is_it) -> std::optional<std::size_t> {
    const auto found = std::find_if(names.begin(), names.end(), is_it);
    if (found == names.end()) return std::nullopt;
    const auto again = std::find_if(found + 1, names.end(), is_it);
    if (again != names.end()) {
      throw std::runtime_error(source + ": column " + in_quotes(name) + " occurs twice (columns " +
                               std::to_string(found - names.begin() + 1) + " and " +
                               std::to_string(again - names.begin() + 1) + ")");
    }
    return static_cast<std::size_t>(found - names.begin());
  };
  const auto exact = find([&](const std::string& n) { return n == name; });
  return exact ? exact : find([&](const std::string& n) { return column_name(n).name == name; });
}

std::vector<Wanted> wanted_by_mapping(const std::string& source, std::span<const std::string> names,
                                      const std::string& columns, std::vector<bool>& used) {
  std::vector<Wanted> wanted;
  for (Mapping& mapping : parse_mapping(columns)) {
    const bool is_name = std::find(names.begin(), names.end(), mapping.exact) != names.end();
    const auto index = find_column(source, is_name ? mapping.exact : mapping.column, names);
    if (!index) {
      throw std::runtime_error(source + ": no column " + in_quotes(mapping.column) + " for " +
                               mapping.wanted.name + did_you_mean(mapping.column, names) +
                               " The file has: " + listed(named(names)));
    }
    mapping.wanted.index = *index;
    if (!mapping.unit) {
      const std::string where = "--columns: ";
      mapping.wanted.unit =
          unit_of<std::invalid_argument>(where, mapping.written, column_name(names[*index]).unit);
      require_quantity<std::invalid_argument>(where, mapping.wanted);
    }
    used[*index] = true;
    wanted.push_back(std::move(mapping.wanted));
  }
  return wanted;
}

bool is_channel(const std::string& name) {
  const auto split = split_channel(column_name(name).name);
  return split && find_channel(split->channel) != nullptr;
}

std::vector<Wanted> wanted_by_header(const std::string& source, std::span<const std::string> names,
                                     std::vector<bool>& used) {
  std::vector<Wanted> wanted;
  const std::string where = source + ": ";
  for (std::size_t i = 0; i < names.size(); ++i) {
    const ColumnName column = column_name(names[i]);
    if (column.name != "time" && !is_channel(names[i])) continue;
    used[i] = true;
    for (const Wanted& before : wanted) {
      if (before.name == column.name) {
        throw std::runtime_error(where + "column " + in_quotes(column.name) +
                                 " occurs twice (columns " + std::to_string(before.index + 1) +
                                 " and " + std::to_string(i + 1) + ")");
      }
    }
    Wanted one{column.name, unit_of<std::runtime_error>(where, names[i], column.unit), i};
    require_quantity<std::runtime_error>(where, one);
    wanted.push_back(std::move(one));
  }
  return wanted;
}

/// Adds what the header names of the axes that are mapped and the mapping says nothing of, where it
/// can be read beside what is mapped: it was not asked for.
void add_named(std::span<const std::string> names, std::vector<Wanted>& wanted,
               std::vector<bool>& used, std::vector<std::string>& notes) {
  const std::vector<Wanted> mapped = wanted;
  std::string added;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const ColumnName column = column_name(names[i]);
    const auto channel = split_channel(column.name);
    const auto unit = column.unit ? parse_unit(*column.unit) : std::nullopt;
    if (used[i] || !unit || !is_channel(names[i])) continue;
    const bool is_position = find_channel(channel->channel)->quantities == kPosition;
    bool is_of_axis = false, fits = true;
    for (const Wanted& one : mapped) {
      const auto other = split_channel(one.name);
      if (!other || other->axis != channel->axis) continue;
      is_of_axis = true;
      if (is_position && find_channel(other->channel)->quantities == kPosition)
        fits = fits && one.unit.quantity == unit->quantity;
    }
    const auto same_name = [&](const Wanted& one) { return one.name == column.name; };
    const bool torque_fits = is_position || unit->quantity == Quantity::kTorque;
    if (!is_of_axis || !fits || !torque_fits ||
        std::any_of(wanted.begin(), wanted.end(), same_name))
      continue;
    used[i] = true;
    wanted.push_back({column.name, *unit, i});
    added += (added.empty() ? "" : ", ") + names[i];
  }
  if (!added.empty()) notes.push_back("by its own name beside --columns: " + added);
}

// One note with the columns that are not read; for a channel that may be misspelt, with the most
// similar name.
void note_ignored(std::span<const std::string> names, const std::vector<bool>& used,
                  std::vector<std::string>& notes) {
  const auto known = channel_names();
  std::string ignored;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (used[i] || names[i].empty()) continue;
    ignored += (ignored.empty() ? "" : ", ") + names[i];
    const auto split = split_channel(column_name(names[i]).name);
    const std::string nearest = split ? nearest_name(split->channel, known) : std::string();
    if (!nearest.empty() && nearest != split->channel) {
      ignored += " (not " + split->axis + "." + nearest + "?)";
    }
  }
  if (!ignored.empty()) notes.push_back("ignored columns: " + ignored);
}

// The time column of a foreign file that is not named in `columns`.
std::optional<Wanted> find_time(const std::string& source, std::span<const std::string> names,
                                std::vector<std::string>& notes) {
  std::optional<Wanted> found;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::optional<TimeName> time = time_by_name(names[i]);
    if (!time) continue;
    if (found) {
      throw std::runtime_error(
          source + ": columns " + in_quotes(names[found->index]) + " and " + in_quotes(names[i]) +
          " could both be the time: name it with time=" + names[i] + "[s] in --columns");
    }
    found = Wanted{"time", time->unit, i};
    notes.push_back("time is column " + in_quotes(names[i]) +
                    (time->bare ? ", read as seconds (it has no unit)" : ""));
  }
  return found;
}

[[noreturn]] void throw_foreign(const std::string& source, std::span<const std::string> names) {
  const std::string proposal = guess_columns(names).columns;
  const bool timed = std::any_of(names.begin(), names.end(),
                                 [](const std::string& name) { return time_by_name(name); });
  const bool numbered = !names.empty() && names.front() == "1";
  std::string guess = "X.command=NAME[unit],X.actual=NAME[unit],time=NAME[s]\"";
  if (!proposal.empty()) {
    guess = proposal + "\" (a guess" +
            (proposal.find("[unit]") == std::string::npos ? ""
                                                          : "; replace [unit] by mm, deg, Nm, ..") +
            (lower_case(proposal).find("count") == std::string::npos
                 ? ""
                 : ", for counts by rev/8192 or mm/1000") +
            ")" + (timed ? "" : ", with time=NAME[s] if needed");
  }
  throw std::runtime_error(
      source +
      ": no column is named AXIS.channel[unit], such as X.command[mm]; if this is another " +
      "program's recording, assign its columns to channels: --columns \"" + guess +
      ". The file has" + (numbered ? " no names, so the columns are called" : "") + ": " +
      listed(named(names)));
}

void add_column(const std::string& source, const Wanted& wanted, Layout& layout) {
  const AxisChannel split = *split_channel(wanted.name);
  const KnownChannel& known = *find_channel(split.channel);
  auto axis = std::find_if(layout.axes.begin(), layout.axes.end(),
                           [&](const AxisRecord& a) { return a.name == split.axis; });
  const bool position = known.quantities == kPosition;
  const bool rotary = wanted.unit.quantity == Quantity::kAngle;
  if (!known.kept_as) {
    layout.notes.push_back(wanted.name + " is not used");
    return;
  }
  if (axis == layout.axes.end()) {
    if (layout.axes.size() == kMaxAxes) {
      throw std::runtime_error(source + ": more than " + std::to_string(kMaxAxes) +
                               " axes; name those that are wanted with --columns");
    }
    axis = layout.axes.emplace(axis);
    axis->name = split.axis;
    axis->rotary = rotary;
  }
  const auto same_axis = [&](const Layout::Column& c) {
    return &layout.axes[c.axis] == &*axis && c.channel != Channel::kTorque;
  };
  const bool first_position = std::none_of(layout.columns.begin(), layout.columns.end(), same_axis);
  if (position && first_position) axis->rotary = rotary;
  if (position && axis->rotary != rotary) {
    throw std::runtime_error(source + ": axis " + in_quotes(axis->name) +
                             " has one position as a length and another as an angle");
  }
  if (known.kept_as == Channel::kTorque) axis->torque_unit = wanted.unit.si;
  layout.columns.push_back({wanted.index, wanted.name,
                            static_cast<std::size_t>(axis - layout.axes.begin()), *known.kept_as,
                            wanted.unit});
}

/// The encoder of the load without which that of a motor is not read; empty for other channels.
std::string load_of(const std::string& name) {
  constexpr std::string_view kMotor = "_motor";
  return split_channel(name)->channel == "actual_motor"
             ? name.substr(0, name.size() - kMotor.size())
             : std::string();
}

}  // namespace

std::vector<double>& values_of(AxisRecord& axis, Channel channel) {
  switch (channel) {
    case Channel::kCommand:
      return axis.command;
    case Channel::kActual:
      return axis.actual;
    case Channel::kActualMotor:
      return axis.actual_motor;
    case Channel::kTorque:
      break;
  }
  return axis.torque;
}

Layout lay_out(const std::string& source, std::span<const std::string> names,
               const ReadOptions& options, std::optional<double> rate_hz,
               std::span<const std::string> unclear_rates) {
  Layout layout;
  std::string columns = options.columns;
  if (columns.empty()) {
    if (auto known = known_columns(names)) {
      columns = std::move(known->columns);
      layout.notes.push_back(known->note + ": read as --columns \"" + columns + "\"");
    }
  }
  if (columns.empty() && std::none_of(names.begin(), names.end(), is_channel)) {
    ColumnGuess guess = guess_columns(names);
    if (guess.clear) {
      columns = std::move(guess.columns);
      layout.notes.push_back("by the names of its columns: read as --columns \"" + columns + "\"");
    }
  }
  const bool mapped = !columns.empty();
  // Before its time is asked for a unit.
  if (!mapped && std::none_of(names.begin(), names.end(), is_channel)) throw_foreign(source, names);
  std::vector<bool> used(names.size());
  std::vector<Wanted> wanted = mapped ? wanted_by_mapping(source, names, columns, used)
                                      : wanted_by_header(source, names, used);
  if (!options.columns.empty()) add_named(names, wanted, used, layout.notes);
  const auto is_time = [](const Wanted& w) { return w.name == "time"; };
  if (std::all_of(wanted.begin(), wanted.end(), is_time))
    throw std::invalid_argument("--columns: names no channel of an axis");
  if (mapped && std::none_of(wanted.begin(), wanted.end(), is_time)) {
    if (auto time = find_time(source, names, layout.notes)) {
      used[time->index] = true;
      wanted.push_back(std::move(*time));
    }
  }
  note_ignored(names, used, layout.notes);
  for (const Wanted& one : wanted) {
    if (is_time(one)) {
      layout.time = one.index;
      layout.time_unit = one.unit;
    } else if (const std::string load = load_of(one.name);
               !load.empty() && std::none_of(wanted.begin(), wanted.end(),
                                             [&](const Wanted& w) { return w.name == load; })) {
      layout.notes.push_back(one.name + " is not used without " + load +
                             ", the encoder of the load: call an only encoder " + load);
    } else {
      add_column(source, one, layout);
    }
  }

  // Position and force without a command are a recording of a test rig.
  const auto has = [&](Channel channel) {
    return std::any_of(layout.columns.begin(), layout.columns.end(),
                       [channel](const auto& c) { return c.channel == channel; });
  };
  if (!has(Channel::kCommand) && !(has(Channel::kActual) && has(Channel::kTorque))) {
    throw std::runtime_error(source +
                             ": no column is the command of an axis, such as X.command[mm]. " +
                             "The file has: " + listed(named(names)));
  }
  if (!layout.time && !options.rate_hz && !rate_hz) {
    std::string unclear;
    for (const std::string& line : unclear_rates) unclear += (unclear.empty() ? "" : "; ") + line;
    throw std::runtime_error(
        source + ": no time column: give one as time[s], name it with " +
        "time=NAME[s] in --columns, or give --rate HZ" +
        (unclear.empty() ? "" : " (the rate is not clear from " + unclear + ")") +
        ". The file has: " + listed(named(names)));
  }
  if (layout.time && options.rate_hz) {
    throw std::runtime_error(source +
                             ": --rate is for files without time, and this one has the column " +
                             in_quotes(names[*layout.time]));
  }
  return layout;
}

void check(const ReadOptions& options) {
  if (options.rate_hz && !(std::isfinite(*options.rate_hz) && *options.rate_hz > 0.0)) {
    throw std::invalid_argument("--rate " + number(*options.rate_hz) + ": must be above 0 Hz");
  }
  if (!(options.from_s >= 0.0 && options.to_s > options.from_s)) {
    throw std::invalid_argument("--from " + number(options.from_s) + " --to " +
                                number(options.to_s) + ": must be seconds with 0 <= from < to");
  }
}

bool selects_part(const ReadOptions& options) noexcept {
  return options.from_s > 0.0 || std::isfinite(options.to_s);
}

void throw_no_rows(const std::string& source, double recorded_s, const ReadOptions& options) {
  if (!selects_part(options)) {
    throw std::runtime_error(source + ": a header and no rows: nothing was recorded");
  }
  throw std::runtime_error(source + ": no rows between " + number(options.from_s) + " s and " +
                           number(options.to_s) + " s: the recording is " + number(recorded_s) +
                           " s long, and --from and --to count from its first row");
}

void fill_absent(Recording& recording) {
  for (AxisRecord& axis : recording.axes) {
    if (axis.command.empty()) axis.command.assign(recording.time.size(), kAbsent);
    if (axis.actual.empty()) axis.actual.assign(recording.time.size(), kAbsent);
  }
}

}  // namespace servotwin
