#include "drivers/recordings/mcap/mcap.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include "drivers/common/text.h"
#include "drivers/recordings/column_map.h"
#include "drivers/recordings/mcap/joint_sets.h"

namespace servotwin {
namespace {

// Of the stamps of two topics: a recorder loses messages, but topics that share fewer stamps have
// clocks of their own.
constexpr double kMinSharedStampsShare = 0.9;

/// A channel that can be read from the file.
struct JointColumn {
  std::string name;
  const JointSet* set = nullptr;
  const std::vector<double>* values = nullptr;
};

bool has_values(const std::vector<double>& values) {
  return std::any_of(values.begin(), values.end(),
                     [](double value) { return std::isfinite(value); });
}

bool has_command(const JointSet& set) {
  return std::any_of(set.fields.begin(), set.fields.end(),
                     [](const JointField& field) { return field.channel == "command"; });
}

/// For each row of `rows` the row of `other` with the same stamp; its number of rows where there is
/// none.
std::vector<std::size_t> same_stamps(const JointSet& rows, const JointSet& other) {
  std::vector<std::size_t> same;
  for (const std::uint64_t time : rows.time_ns) {
    const auto found = std::lower_bound(other.time_ns.begin(), other.time_ns.end(), time);
    same.push_back(found != other.time_ns.end() && *found == time
                       ? static_cast<std::size_t>(found - other.time_ns.begin())
                       : other.time_ns.size());
  }
  return same;
}

bool shares_stamps(const JointSet& rows, const JointSet& other) {
  const std::vector<std::size_t> same = same_stamps(rows, other);
  const auto absent = std::count(same.begin(), same.end(), other.time_ns.size());
  return static_cast<double>(absent) <=
         (1.0 - kMinSharedStampsShare) * static_cast<double>(same.size());
}

/// What --columns can name: of the topics that it mentions, or of all if it mentions none.
std::vector<JointColumn> columns_by_topic(const std::vector<JointSet>& sets,
                                          const std::string& mapping) {
  const auto is_mentioned = [&](const JointSet& set) {
    return mapping.find(set.topic + ":") != std::string::npos;
  };
  const bool all = std::none_of(sets.begin(), sets.end(), is_mentioned);
  std::vector<JointColumn> columns;
  for (const JointSet& set : sets) {
    if (!all && !is_mentioned(set)) continue;
    for (std::size_t field = 0; field < set.fields.size(); ++field) {
      for (std::size_t joint = 0; joint < set.joints.size(); ++joint) {
        const std::vector<double>& values = set.of(field, joint);
        if (has_values(values))
          columns.push_back({set.topic + ":" + set.fields[field].path + "." + set.joints[joint] +
                                 set.fields[field].unit,
                             &set, &values});
      }
    }
  }
  return columns;
}

/// The axes by the names of the joints. The first set gives the rows.
std::vector<JointColumn> columns_by_joint(const std::vector<JointSet>& sets,
                                          std::vector<std::string>& notes) {
  const JointSet& rows = sets.front();
  std::vector<JointColumn> columns;
  std::set<std::string> axes, taken;
  for (const JointSet& set : sets) {
    if (!shares_stamps(rows, set)) {
      notes.push_back(set.title() + " is not read: its stamps are not those of " + rows.topic +
                      "; --columns can choose it");
      continue;
    }
    // The joints of a state without commands are axes only where no topic has commands.
    const bool adds_axes = has_command(set) || !has_command(rows);
    std::set<std::string> channels;
    for (std::size_t field = 0; field < set.fields.size(); ++field) {
      const JointField& of = set.fields[field];
      for (std::size_t joint = 0; joint < set.joints.size() && !of.channel.empty(); ++joint) {
        const std::string& axis = set.joints[joint];
        const std::vector<double>& values = set.of(field, joint);
        if (!has_values(values) || !(adds_axes || axes.contains(axis)) ||
            !taken.insert(axis + "." + of.channel).second)
          continue;
        axes.insert(axis);
        channels.insert(of.channel);
        columns.push_back({axis + "." + of.channel + of.unit, &set, &values});
      }
    }
    notes.push_back(channels.empty()
                        ? set.title() + " is not read: " + rows.topic + " has its channels"
                        : listed(std::vector<std::string>(channels.begin(), channels.end())) +
                              " from " + set.title());
  }
  return columns;
}

/// The values of the columns that `layout` chose. The rows are those of the first command.
void fill(Recording& recording, const Layout& layout, const std::vector<JointColumn>& columns,
          const ReadOptions& options) {
  const auto command = std::find_if(
      layout.columns.begin(), layout.columns.end(),
      [](const Layout::Column& column) { return column.channel == Channel::kCommand; });
  // Index 0 is the time.
  const auto chosen = [&](const Layout::Column& column) { return columns[column.index - 1]; };
  const JointSet& rows =
      *chosen(command == layout.columns.end() ? layout.columns.front() : *command).set;
  const auto seconds = [&](std::uint64_t time_ns) {
    return 1e-9 * static_cast<double>(time_ns - rows.time_ns.front());
  };
  const auto is_wanted = [&](std::uint64_t time_ns) {
    return seconds(time_ns) >= options.from_s && seconds(time_ns) <= options.to_s;
  };
  for (const std::uint64_t time_ns : rows.time_ns)
    if (is_wanted(time_ns)) recording.time.push_back(seconds(time_ns));
  if (recording.time.empty())
    throw_no_rows(recording.source, seconds(rows.time_ns.back()), options);

  std::map<const JointSet*, std::vector<std::size_t>> same;
  for (const Layout::Column& column : layout.columns) {
    const JointColumn from = chosen(column);
    if (!shares_stamps(rows, *from.set))
      throw std::invalid_argument("--columns: " + column.name + " is of " + from.set->topic +
                                  ", whose stamps are not those of " + rows.topic +
                                  "; all channels need the same stamps");
    if (!same.contains(from.set)) same[from.set] = same_stamps(rows, *from.set);
    const std::vector<std::size_t>& at = same[from.set];
    std::vector<double>& to = values_of(recording.axes[column.axis], column.channel);
    for (std::size_t row = 0; row < at.size(); ++row) {
      if (!is_wanted(rows.time_ns[row])) continue;
      const double value = at[row] < from.values->size() ? (*from.values)[at[row]] : kAbsent;
      to.push_back(std::isfinite(value) ? column.unit.to_si(value) : kAbsent);
    }
  }
}

}  // namespace

bool is_mcap(std::string_view start) noexcept { return start.starts_with("\x89MCAP"); }

Recording read_mcap(const std::filesystem::path& file, const ReadOptions& options) {
  Recording recording;
  recording.source = file.string();
  JointSets read = read_joint_sets(file);
  // A state with commands before one without, and the one with the most messages first.
  std::stable_sort(read.sets.begin(), read.sets.end(), [](const JointSet& a, const JointSet& b) {
    return std::pair(has_command(a), a.time_ns.size()) >
           std::pair(has_command(b), b.time_ns.size());
  });
  recording.notes = std::move(read.notes);
  std::vector<JointColumn> columns;
  if (options.columns.empty()) {
    columns = columns_by_joint(read.sets, recording.notes);
    recording.notes.push_back(
        "positions of ROS are taken as [rad] and efforts as [Nm]; a linear joint needs --columns "
        "\"Z.command=TOPIC:FIELD.JOINT[m],..\"");
  } else {
    columns = columns_by_topic(read.sets, options.columns);
  }
  std::vector<std::string> names{"time[s]"};
  for (const JointColumn& column : columns) names.push_back(column.name);
  Layout layout = lay_out(recording.source, names, options);
  recording.notes.insert(recording.notes.end(), layout.notes.begin(), layout.notes.end());
  recording.axes = layout.axes;
  fill(recording, layout, columns, options);
  fill_absent(recording);
  return recording;
}

}  // namespace servotwin
