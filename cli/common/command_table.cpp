#include "cli/common/command_table.h"

#include <algorithm>
#include <cmath>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "drivers/common/text.h"
#include "twin/neighbour.h"

namespace servotwin::cli {
namespace {

struct ModelFile {
  std::filesystem::path file;
  ModelRecord record;
};

/// The models, one per axis.
std::vector<ModelFile> read_models(const std::vector<std::filesystem::path>& files) {
  std::vector<ModelFile> models;
  for (const auto& file : files) {
    ModelRecord record = read_model(file);
    for (const ModelFile& other : models) {
      if (other.record.axis == record.axis) {
        throw UsageError(file.string() + " is a second model of axis " + in_quotes(record.axis) +
                         ", beside " + other.file.string());
      }
    }
    models.push_back({file, std::move(record)});
  }
  return models;
}

/// Removes everything but the commands, and prints which parts of the table the result will not
/// contain.
void keep_commands(Recording& table, const std::vector<ModelFile>& models, const std::string& done,
                   std::FILE* people) {
  std::string left_out;
  const auto leave_out = [&](const std::string& what) {
    left_out += (left_out.empty() ? "" : ", ") + what;
  };
  for (AxisRecord& axis : table.axes) {
    const bool modelled = std::any_of(models.begin(), models.end(), [&](const ModelFile& model) {
      return model.record.axis == axis.name;
    });
    if (!modelled) {
      leave_out("axis " + axis.name + " (no --model of it)");
    } else if (!axis.torque.empty()) {
      leave_out(axis.name + ".torque");
    }
    axis.actual.clear();  // a gap in the encoder must not split the command
    axis.actual_motor.clear();
    axis.torque.clear();
  }
  if (!left_out.empty()) say(people, "note: not " + done + ": " + left_out);
}

/// The command of an axis as one segment. A path is computed, not recorded, so a gap in it is an
/// error. What was repaired in it is printed on `people`.
Segment unbroken(const Recording& table, const std::string& axis, const std::string& neighbour,
                 std::FILE* people) {
  const std::vector<double>& command =
      std::find_if(table.axes.begin(), table.axes.end(), [&](const AxisRecord& one) {
        return one.name == axis;
      })->command;
  const auto missing =
      std::find_if_not(command.begin(), command.end(), [](double x) { return std::isfinite(x); });
  if (missing != command.end()) {
    const auto row = static_cast<std::size_t>(missing - command.begin());
    throw std::runtime_error(table.source + ": " + axis + ".command has no value in row " +
                             std::to_string(row + 1) + text(" (at %.6g s)", table.time[row]) +
                             "; commands are not interpolated: fill in the value");
  }
  const SegmentedAxis segmented = segment_axis(table, axis, {}, neighbour);
  const SegmentReport& report = segmented.report;
  if (segmented.segments.size() != 1 || report.short_stretches > 0) {
    throw std::runtime_error(
        table.source + ": " + axis + ".command is interrupted" +
        (report.splits.empty() ? "" : text(" at %.6g s", report.splits.front().time_s)) +
        "; a path must have no gap: select one part with --from and --to");
  }
  for (const std::string& line : report.lines()) say(people, line);
  const Segment& segment = segmented.segments.front();
  if (report.spacing == Spacing::kUneven ||
      static_cast<std::size_t>(segment.size()) != report.rows) {
    say(people,
        text("note: %s: the result has %td rows every %.9g ms, not the %zu rows of the table",
             axis.c_str(), segment.size(), 1e3 * segment.sample_time_s, report.rows));
  }
  return segment;
}

/// Each with the motion of the axis that acts on it, as the model of that axis predicts it.
void move_together(std::vector<CommandedAxis>& axes) {
  for (CommandedAxis& axis : axes) {
    if (!coupled_by_motion(axis.model)) continue;
    const auto other = std::find_if(axes.begin(), axes.end(), [&](const CommandedAxis& one) {
      return one.record.axis != axis.record.axis && pushed_by(axis.record, one.record.axis) &&
             one.path.size() == axis.path.neighbour.size() &&
             (one.path.command == axis.path.neighbour).all();
    });
    if (other != axes.end())
      predict_neighbour(axis.path, axis.model, other->model,
                        pushed_by(other->record, axis.record.axis));
  }
}

}  // namespace

void TableOptions::declare(OptionTable& command) {
  path.mends = false;  // the commands mean what they say
  path.declare(command, "PATH",
               "table of commands: CSV with units, or a recording whose encoders are ignored");
  command.option("--model", models, "model file of an axis of the table; once per axis")
      .takes("M.json")
      .required()
      .one_value_each_time();
}

std::vector<CommandedAxis> read_commands(const TableOptions& options, const std::string& done,
                                         std::FILE* people) {
  const std::vector<ModelFile> models = read_models(options.models);
  Recording table = options.path.read(people);
  keep_commands(table, models, done, people);
  std::vector<CommandedAxis> out;
  for (const auto& [file, record] : models) {
    const auto axis =
        std::find_if(table.axes.begin(), table.axes.end(),
                     [&name = record.axis](const AxisRecord& one) { return one.name == name; });
    if (axis == table.axes.end()) {
      std::vector<std::string> names;
      for (const AxisRecord& one : table.axes) names.push_back(one.name);
      throw std::runtime_error(table.source + ": has no axis " + in_quotes(record.axis) +
                               ", which " + file.string() + " is a model of; it has " +
                               listed(names));
    }
    require_kind(record, file, axis->name, axis->rotary);
    Segment segment = unbroken(table, record.axis, record.neighbour, people);
    Model model = model_at(record, segment.sample_time_s, people);
    if (!out.empty() && (segment.size() != out.front().path.size() ||
                         segment.start_s != out.front().path.start_s)) {
      throw std::runtime_error(table.source + ": the commands of " + out.front().record.axis +
                               " and " + record.axis + " do not cover the same rows");
    }
    out.push_back({record, std::move(model), std::move(segment)});
  }
  move_together(out);
  return out;
}

std::vector<double> times_of(const Segment& path) {
  std::vector<double> out;
  for (Eigen::Index i = 0; i < path.size(); ++i)
    out.push_back(path.start_s + path.sample_time_s * static_cast<double>(i));
  return out;
}

}  // namespace servotwin::cli
