#include "cli/common/options.h"

#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "daemon/identify/held_out.h"
#include "diagnosis/evidence/encoder_difference.h"
#include "diagnosis/search/acting_axis.h"
#include "drivers/common/text.h"
#include "drivers/recordings/column_name.h"
#include "identification/recording/positions.h"
#include "identification/recording/same_axis.h"
#include "identification/recording/time_shift.h"
#include "twin/twin.h"

namespace servotwin::cli {

void RecordingOptions::declare(OptionTable& command, const std::string& name,
                               const std::string& what) {
  command.option(name, file, what).required();
  command
      .option("--columns", read_options.columns,
              "which column of a foreign file is which channel: "
              "\"X.command=qg[m],X.actual=qm[m],time=t[s]\"")
      .takes("MAP");
  declare_format(command);
  command.option("--can-map", read_options.can_map, "mapping of the bits of a CAN log to signals")
      .takes("F.toml");
  command.option("--from", read_options.from_s, "start of the part to read [s after the first row]")
      .takes("S");
  command.option("--to", read_options.to_s, "end of the part to read [s after the first row]")
      .takes("S");
  command.option("--rate", read_options.rate_hz, "rows per second of a file without a time column")
      .takes("HZ");
  if (mends) declare_as_recorded(command);
}

void RecordingOptions::declare_format(OptionTable& command) {
  command
      .option_read_by(
          "--format", [this](const std::string& id) { read_options.format = format_named(id); },
          "format of the file, whatever it looks like (servotwin formats)")
      .one_of(format_ids())
      .takes("NAME");
}

void RecordingOptions::declare_as_recorded(OptionTable& command) {
  command.flag("--as-recorded", as_recorded,
               "use the positions as they are in the file: do not unwrap them, and do not repair "
               "sign, ratio and zero of the encoder");
}

namespace {

/// What standard input says, in a file that is deleted afterwards: readers go through a file more
/// than once.
class StandardInput {
 public:
  StandardInput() {
    std::FILE* out = nullptr;
    const int descriptor = ::mkstemp(path_.data());
    if (descriptor >= 0) out = ::fdopen(descriptor, "wb");
    if (out == nullptr) throw std::runtime_error("standard input cannot be kept in " + path_);
    std::array<char, 1 << 16> block{};
    bool written = true;
    while (written) {
      const std::size_t count = std::fread(block.data(), 1, block.size(), stdin);
      if (count == 0) break;
      written = std::fwrite(block.data(), 1, count, out) == count;
    }
    const bool complete = std::ferror(stdin) == 0;
    written = std::fclose(out) == 0 && written;
    if (written && complete) return;
    ::unlink(path_.c_str());
    if (!complete) throw std::runtime_error("standard input cannot be read to its end");
    throw std::runtime_error("standard input cannot be kept in " + path_ + ": the disk is full?");
  }
  StandardInput(const StandardInput&) = delete;
  StandardInput& operator=(const StandardInput&) = delete;
  ~StandardInput() { ::unlink(path_.c_str()); }

  [[nodiscard]] Recording read(const ReadOptions& options) const {
    try {
      Recording recording = read_recording(path_, options);
      recording.source = kShown;
      return recording;
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(shown(error.what()));
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(shown(error.what()));
    }
  }

 private:
  static constexpr const char* kShown = "standard input";

  /// A message without the name of the file.
  [[nodiscard]] std::string shown(std::string message) const {
    if (const std::size_t at = message.find(path_); at != std::string::npos)
      message.replace(at, path_.size(), kShown);
    return message;
  }

  std::string path_ = (std::filesystem::temp_directory_path() / "servotwin-input-XXXXXX").string();
};

}  // namespace

Recording RecordingOptions::read(std::FILE* people, const std::string& axis) const {
  Recording recording;
  {
    const Progress progress("reading " + file.filename().string());
    recording =
        file == "-" ? StandardInput().read(read_options) : read_recording(file, read_options);
  }
  const std::string of = axis.empty() ? axis : axis_of(recording, axis);
  if (mends && as_recorded) {
    Recording mended = recording;
    for (const std::string& line : mend_positions(mended, of))
      recording.notes.push_back("as recorded, so without this: " + line);
  } else if (mends) {
    mend_positions(recording, of);
  }
  for (const std::string& note : recording.notes) say(people, "note: " + note);
  return recording;
}

void AxisOptions::declare(OptionTable& command) {
  recording.declare(command, "REC", kRecordingHelp);
  command.option("--axis", axis, "axis of the recording, if it has several").takes("X");
}

void AxisOptions::declare_several(OptionTable& command) {
  declare(command);
  command
      .option("--beside", beside,
              "axis whose acceleration may act on this one (default: the one that explains most of "
              "the error, else the first other one)")
      .takes("AXIS");
  command
      .option("MORE", more,
              "further recordings of the same axis, of the same rate: used together with the "
              "first, each with a start of its own")
      .takes("REC");
}

std::string AxisOptions::acting_on(const Recording& whole, const std::string& of,
                                   std::FILE* people) const {
  if (!beside.empty()) return beside;
  ActingAxis acting;
  {
    const Progress progress("looking which axis acts on " + of);
    acting = acting_axis(whole, of);
  }
  if (!acting.sought) return {};
  for (const std::string& other : acting.apart)
    say(people, "note: " + other + " has commands at other times than " + of +
                    " (gaps): whether it acts on " + of + " is not known");
  if (acting.name.empty()) {
    say(people, text("note: the acceleration of no other axis explains %.0f %% of what a first "
                     "model of ",
                     100.0 * kMinShareOfActing) +
                    of + " leaves");
  } else {
    say(people,
        "note: of the other axes, the acceleration of " + acting.name +
            text(" explains most of what a first model leaves: %.0f %%", 100.0 * acting.share));
  }
  return acting.name;
}

SegmentedAxis AxisOptions::read(std::FILE* people, bool seek_acting) const {
  const Recording whole = recording.read(people, axis);
  const std::string of = axis_of(whole, axis);
  SegmentedAxis out =
      segmented(whole, of, people, seek_acting ? acting_on(whole, of, people) : beside);
  require_beside(out);
  read_more(out, people);
  return out;
}

void AxisOptions::require_beside(const SegmentedAxis& read) const {
  if (beside.empty() || read.neighbour == beside) return;
  throw std::runtime_error(read.source + ": has no axis " + in_quotes(beside) + " beside " +
                           read.axis + " with commands at the same times (--beside)");
}

namespace {

/// Whether the segments of `next` are among those of `all` already.
bool is_copy(const std::vector<Segment>& all, const std::vector<Segment>& next) {
  return std::all_of(next.begin(), next.end(), [&](const Segment& s) {
    return std::any_of(all.begin(), all.end(), [&](const Segment& known) {
      return known.size() == s.size() && known.actual.size() == s.actual.size() &&
             (known.command == s.command).all() && (known.actual == s.actual).all();
    });
  });
}

}  // namespace

void AxisOptions::read_more(SegmentedAxis& read, std::FILE* people) const {
  for (const std::filesystem::path& file : more) {
    std::error_code error;
    if (std::filesystem::equivalent(file, recording.file, error) ||
        std::count(more.begin(), more.end(), file) > 1)
      throw std::runtime_error(file.string() +
                               ": is given twice; its hold-out would be fitted with its copy");
    RecordingOptions one = recording;
    one.file = file;
    const Recording whole = one.read(people, read.axis);
    SegmentedAxis next = segmented(whole, read.axis, people, read.neighbour);
    if (is_copy(read.segments, next.segments))
      throw std::runtime_error(file.string() +
                               ": has the same motion, sample by sample, as a recording before it; "
                               "its hold-out would be fitted with its copy");
    if (const double ratio = common_over_own(read.segments, next.segments);
        ratio > kMaxCommonOverOwn)
      say(people,
          text("note: %s does not seem to be the same axis: one law of lag and friction for "
               "all leaves %.2g times the error that one for each leaves",
               file.filename().string().c_str(), ratio));
    const double begin_s = append(read, std::move(next));
    say(people, text("note: %s begins at %.6g s of the time used below",
                     file.filename().string().c_str(), begin_s));
  }
}

std::string AxisOptions::source() const {
  std::string out = recording.file.filename().string();
  for (const std::filesystem::path& file : more) out += ", " + file.filename().string();
  return out;
}

std::string spelling_in(const std::vector<std::string>& names, const std::string& given) {
  if (std::find(names.begin(), names.end(), given) != names.end()) return given;
  const auto alike = [folded = lower_case(given)](const std::string& name) {
    return lower_case(name) == folded;
  };
  if (std::count_if(names.begin(), names.end(), alike) != 1) return given;
  return *std::find_if(names.begin(), names.end(), alike);
}

std::string axis_of(const Recording& whole, const std::string& given) {
  if (given.empty() && whole.axes.size() == 1) return whole.axes.front().name;
  std::vector<std::string> names;
  for (const AxisRecord& one : whole.axes) names.push_back(one.name);
  if (!given.empty()) return spelling_in(names, given);
  throw std::runtime_error(whole.source + ": has the axes " + listed(names) +
                           "; choose one with --axis");
}

SegmentedAxis segmented(const Recording& whole, const std::string& axis, std::FILE* people,
                        const std::string& neighbour) {
  std::string axes;
  for (const AxisRecord& one : whole.axes) axes += (axes.empty() ? "" : ", ") + one.name;
  say(people, "read " + whole.source + ": " + (whole.axes.size() == 1 ? "axis " : "axes ") + axes);
  SegmentedAxis segmented = segment_axis(whole, axis, {}, neighbour);
  for (const std::string& line : segmented.report.lines()) say(people, line);
  if (const std::string late = remark_on_time(segmented.segments); !late.empty())
    say(people, "note: " + axis + ".actual " + late);
  const auto errors = encoder_errors(segmented.segments);
  if (errors && errors->load_max > 0.0)  // 0: without a command, the position stands in for it
    say(people, "two encoders, following error " + errors_text(*errors, segmented.rotary));
  return segmented;
}

void BusOptions::declare(OptionTable& command) {
  command.flag("--dds", dds,
               "use DDS (Cyclone DDS; on this host only, unless CYCLONEDDS_URI is set)");
  command.option("--machine", place.machine, "name of the machine (default: " + place.machine + ")")
      .takes("NAME");
  command.option("--domain", place.domain, "DDS domain (default: 0)").takes("N").between(0, 230);
  command.option("--partition", place.partition, "DDS partition of the cell (default: none)")
      .takes("NAME");
}

std::string BusOptions::text() const {
  return "machine '" + place.machine + "' in DDS domain " + std::to_string(place.domain);
}

DaemonThere wait_for_daemon(const DdsNode& node, double patience_s, std::vector<AxisStatus>* axes) {
  DaemonThere there = DaemonThere::kNobody;
  DdsReader<MachineStatus> statuses(node);
  const auto start = std::chrono::steady_clock::now();
  MachineStatus status;
  while (true) {
    const double left_s =
        patience_s -
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (!statuses.receive(status, std::max(left_s, 0.0))) return there;
    if (status.state == DaemonState::kStopping) continue;
    if (!status.axes.empty()) {
      if (axes != nullptr) *axes = status.axes;
      return DaemonThere::kReady;
    }
    there = DaemonThere::kKnowsNoAxes;
  }
}

std::runtime_error no_daemon(const DdsNode& node, const BusOptions& bus) {
  return std::runtime_error("no daemon listens to " + bus.text() + other_daemons(node) +
                            "; start servotwind with this machine and domain first");
}

std::vector<AxisStatus> axes_of_daemon(const DdsNode& node, const BusOptions& bus,
                                       double patience_s) {
  std::vector<AxisStatus> axes;
  switch (wait_for_daemon(node, patience_s, &axes)) {
    case DaemonThere::kNobody:
      throw no_daemon(node, bus);
    case DaemonThere::kKnowsNoAxes:
      throw std::runtime_error("the daemon of " + bus.text() +
                               " does not know its axes yet; it learns them when the machine runs");
    case DaemonThere::kReady:
      break;
  }
  return axes;
}

std::string other_daemons(const DdsNode& node) {
  constexpr double kStatusEvery_s = 1.0;
  std::vector<std::string> machines = machines_with_daemons(node, 1.5 * kStatusEvery_s);
  std::erase(machines, node.place().machine);
  if (machines.empty()) return "";
  return std::string("; in this domain there ") +
         (machines.size() == 1 ? "is a daemon of " : "are daemons of ") + listed(machines);
}

std::vector<double> parse_numbers(const std::string& option, const std::string& given,
                                  const std::string& form, std::size_t least, std::size_t most) {
  std::vector<double> numbers;
  for (const std::string& part : split_fields(given, ':')) {
    const std::optional<double> value = number_of(part);
    if (!value) numbers.resize(most + 1);
    numbers.push_back(value.value_or(0.0));
  }
  if (numbers.size() < least || numbers.size() > most) {
    refuse_value(option, in_quotes(given) + " is not a valid " + form);
  }
  return numbers;
}

void require_kind(const ModelRecord& record, const std::filesystem::path& file,
                  const std::string& axis, bool rotary) {
  if (record.rotary != rotary) {
    throw std::runtime_error(file.string() + ": kind: the model is of a " +
                             (record.rotary ? "rotary" : "linear") + " axis, " + axis +
                             " of the recording is " + (rotary ? "rotary" : "linear"));
  }
}

ModelRecord read_model_for(const std::filesystem::path& file, const std::string& axis,
                           bool rotary) {
  ModelRecord record = read_model(file);
  require_kind(record, file, axis, rotary);
  return record;
}

Model model_at(const ModelRecord& record, double sample_time_s, std::FILE* people) {
  Model model = record.model;
  if (std::abs(model.sample_time_s - sample_time_s) > 1e-6 * sample_time_s) {
    say(people, cli::text("note: the model was identified at %.6g Hz and is used at %.6g Hz",
                          1.0 / model.sample_time_s, 1.0 / sample_time_s));
  }
  model.sample_time_s = sample_time_s;
  try {
    (void)Twin(model);
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(cli::text("the model of axis %s cannot run at %.6g Hz: ",
                                       record.axis.c_str(), 1.0 / sample_time_s) +
                             error.what());
  }
  return model;
}

std::vector<std::optional<ModelRecord>> models_of(const MachineDescription& machine,
                                                  const std::vector<std::filesystem::path>& files,
                                                  std::FILE* people) {
  std::vector<std::optional<ModelRecord>> models(machine.axes.size());
  for (const std::filesystem::path& file : files) {
    ModelRecord record = read_model(file);
    std::size_t axis = 0;
    while (axis < models.size() && machine.axes[axis].name != record.axis) ++axis;
    if (axis == models.size()) {
      throw std::runtime_error(file.string() + ": is a model of axis " + in_quotes(record.axis) +
                               ", which the CAN mapping does not have");
    }
    require_kind(record, file, record.axis, machine.axes[axis].rotary);
    if (const std::string why = daemon::why_no_neighbour(record, machine, axis); !why.empty())
      throw std::runtime_error(file.string() + ": " + why);
    record.model = model_at(record, machine.cycle_s, people);
    models[axis] = std::move(record);
  }
  return models;
}

}  // namespace servotwin::cli
