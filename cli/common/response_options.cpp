#include "cli/common/response_options.h"

#include <algorithm>
#include <cmath>

#include "cli/common/axis_channels.h"
#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "drivers/common/text.h"

namespace servotwin::cli {
namespace {

std::vector<std::string> parts_of(const std::string& list) { return split_fields(list, ','); }

const std::vector<std::string> kChannels{"command", "position", "error", "torque"};

/// Adds the segments in which every signal has a value.
void add_finite(const ResponseRecord& whole, std::vector<ResponseRecord>& out) {
  std::vector<const Eigen::ArrayXd*> all{&whole.output};
  for (const Eigen::ArrayXd& x : whole.inputs) all.push_back(&x);
  for (const Eigen::ArrayXd& x : whole.instruments) all.push_back(&x);
  for (const auto& stretch : finite_stretches(all)) {
    const auto begin = stretch.first, count = stretch.second;
    const auto cut = [begin, count](const std::vector<Eigen::ArrayXd>& from) {
      std::vector<Eigen::ArrayXd> to;
      for (const Eigen::ArrayXd& x : from) to.push_back(x.segment(begin, count));
      return to;
    };
    out.push_back({cut(whole.inputs), whole.output.segment(begin, count), cut(whole.instruments)});
  }
}

/// Channels of axes. A torque as input needs the axis' command as instrumental variable, because
/// the position loop feeds the noise of the position back into the torque.
double axis_signals(const ResponseOptions& options, ResponseSignals& out, std::FILE* people) {
  const Recording whole = options.recording.read(people);
  out.inputs = options.inputs.empty() ? std::vector<std::string>{"command"}
                                      : parts_of(options.inputs.front());
  out.output = options.outputs.empty() ? "position" : options.outputs.front();
  out.axis = axis_of(whole, options.axis);
  AxisChannels axes(whole, out.axis, people);
  const Channel output = channel_of(out.output, out.axis, kChannels, whole);
  std::vector<Channel> inputs;
  bool fed_back = false;
  for (const std::string& name : out.inputs) {
    inputs.push_back(channel_of(name, out.axis, kChannels, whole));
    if (inputs.back().axis == output.axis && inputs.back().name == output.name)
      throw UsageError("--input and --output are both " + in_quotes(name));
    fed_back = fed_back || inputs.back().name != "command";
  }
  for (std::size_t i = 0; i < axes.segments(); ++i) {
    ResponseRecord record;
    for (const Channel& input : inputs) {
      record.inputs.push_back(axes.values(input, i));
      if (fed_back) record.instruments.push_back(axes.values({input.axis, "command"}, i));
    }
    record.output = axes.values(output, i);
    add_finite(record, out.records);
  }
  if (fed_back)
    say(people,
        "closed loop: the command is the instrumental variable, so that noise fed back into the "
        "input does not bias the response");
  out.differenced = true;
  return axes.sample_time_s();
}

/// Columns of a file as they are, one record per pair of --input and --output.
double column_signals(const ResponseOptions& options, ResponseSignals& out, std::FILE* people) {
  if (options.inputs.empty() || options.inputs.size() != options.outputs.size())
    throw UsageError(
        "give --axis, or columns of the file as --input and --output, one of each per repetition");
  RecordingOptions recording = options.recording;
  recording.mends = false;  // the columns may be anything, not command and encoder
  if (!recording.read_options.columns.empty())
    throw UsageError("--columns needs --axis; without it --input and --output name the columns");
  std::vector<std::vector<std::string>> names;
  for (std::size_t i = 0; i < options.inputs.size(); ++i) {
    const std::vector<std::string> inputs = parts_of(options.inputs[i]);
    if (inputs.size() != parts_of(options.inputs.front()).size())
      throw UsageError("every --input must name the same number of columns");
    names.emplace_back();
    for (const std::string& input : inputs) {
      names.back().push_back(input + " to " + options.outputs[i]);
      // The unit of a column is not converted: "m" is a factor of one.
      recording.read_options.columns += (i == 0 && names.back().size() == 1 ? "" : ",") +
                                        names.back().back() + ".command=" + input + "[m]," +
                                        names.back().back() + ".actual=" + options.outputs[i] +
                                        "[m]";
    }
  }
  const Recording whole = recording.read(people);
  double h = 0.0;
  for (const std::vector<std::string>& repetition : names) {
    std::vector<SegmentedAxis> axes;
    for (const std::string& name : repetition) axes.push_back(segment_axis(whole, name));
    for (const std::string& line : axes.front().report.lines()) say(people, line);
    h = axes.front().sample_time_s;
    for (std::size_t i = 0; i < axes.front().segments.size(); ++i) {
      ResponseRecord record;
      record.output = axes.front().segments[i].actual;
      for (const SegmentedAxis& axis : axes) {
        if (axis.segments.size() != axes.front().segments.size() ||
            axis.segments[i].size() != record.output.size())
          throw std::runtime_error(axis.source +
                                   ": the inputs do not have values in the same rows");
        record.inputs.push_back(axis.segments[i].command);
      }
      add_finite(record, out.records);
    }
  }
  out.inputs = parts_of(options.inputs.front());
  out.output = options.outputs.front();
  return h;
}

}  // namespace

void ResponseOptions::declare(OptionTable& command) {
  recording.declare(command, "REC", kRecordingHelp);
  command
      .option("--axis", axis, "axis of the recording (default: --input and --output name columns)")
      .takes("X");
  command
      .option("--input", inputs,
              "command (default), torque, or of another axis Y.command; a list A,B separates "
              "their contributions; without --axis a column, once per repetition")
      .takes("NAME")
      .one_value_each_time();
  command
      .option("--output", outputs,
              "position (default), error or torque; without --axis a column, once per "
              "repetition")
      .takes("NAME")
      .one_value_each_time();
}

ResponseSignals ResponseOptions::read(std::FILE* people) const {
  if (!axis.empty() && (inputs.size() > 1 || outputs.size() > 1))
    throw UsageError("with --axis, --input and --output are given once; several inputs are a list");
  ResponseSignals out;
  out.sample_time_s =
      axis.empty() ? column_signals(*this, out, people) : axis_signals(*this, out, people);
  return out;
}

}  // namespace servotwin::cli
