#include "drivers/recordings/can_log/can_recording.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include "drivers/can/can_assembly.h"
#include "drivers/common/text.h"
#include "drivers/recordings/can_log/can_log.h"
#include "drivers/recordings/column_map.h"

namespace servotwin {
namespace {

/// The rows in their order, one vector per channel.
class Rows {
 public:
  Rows(const std::filesystem::path& file, const CanMap& map) {
    recording_.source = file.string();
    for (std::size_t i = 0; i < map.machine.axes.size(); ++i) {
      const AxisDescription& axis = map.machine.axes[i];
      recording_.axes.push_back({axis.name, axis.rotary, {}, {}, {}, axis.torque_unit});
      has_torque_.push_back(map.find(i, CanChannel::kTorque) != nullptr);
    }
  }
  void add(double time_s, const MachineFrame& frame) {
    recording_.time.push_back(time_s);
    for (std::size_t i = 0; i < recording_.axes.size(); ++i) {
      AxisRecord& axis = recording_.axes[i];
      axis.command.push_back(frame.axes[i].command);
      axis.actual.push_back(frame.axes[i].actual);
      if (has_torque_[i]) axis.torque.push_back(frame.axes[i].torque);
    }
  }
  Recording& recording() { return recording_; }

 private:
  Recording recording_;
  std::vector<bool> has_torque_;
};

/// The bus of the mapping that an interface of the log belongs to.
class Interfaces {
 public:
  explicit Interfaces(const CanMap& map) : map_(map) {}

  std::optional<std::size_t> bus_of(const std::string& interface) {
    const auto named = std::find(map_.buses.begin(), map_.buses.end(), interface);
    if (named != map_.buses.end()) return static_cast<std::size_t>(named - map_.buses.begin());
    others_.insert(interface);
    // One bus in the log and one in the mapping: their names need not be the same.
    if (map_.buses.size() == 1 && others_.size() == 1) return 0;
    return std::nullopt;
  }
  [[nodiscard]] bool ambiguous() const { return map_.buses.size() == 1 && others_.size() > 1; }
  [[nodiscard]] std::string others() const {
    return listed(std::vector<std::string>(others_.begin(), others_.end()));
  }
  [[nodiscard]] bool ignored_some() const { return map_.buses.size() > 1 && !others_.empty(); }

 private:
  const CanMap& map_;
  std::set<std::string> others_;
};

}  // namespace

std::optional<CanLogForm> named_can_log(const ReadOptions& options) noexcept {
  if (options.format == RecordingFormat::kCandump) return CanLogForm::kCandump;
  if (options.format == RecordingFormat::kVectorAsc) return CanLogForm::kVectorAsc;
  if (options.format == RecordingFormat::kPeakTrc) return CanLogForm::kPeakTrc;
  return std::nullopt;
}

Recording read_candump(const std::filesystem::path& file, const ReadOptions& options) {
  const std::optional<CanLogForm> named = named_can_log(options);
  {  // What is wrong with the log itself is said before a mapping is asked for.
    CanLogReader reader(file, named);
    CandumpLine line;
    if (!reader.next(line) && named)
      throw std::runtime_error(file.string() + ": has no frame in the lines of " +
                               form_of(*options.format).name);
  }
  if (options.can_map.empty()) {
    throw std::invalid_argument(
        file.string() +
        ": is a CAN log; --can-map F.toml is required: it maps the bits of frames to signals");
  }
  CanMap map = load_can_map(options.can_map);
  Rows rows(file, map);
  CanAssembly assembly(std::move(map));
  Interfaces interfaces(assembly.map());
  const CanCounts none = assembly.counts();
  CanLogReader reader(file, named);
  CandumpLine line;
  MachineFrame frame;
  std::int64_t first_ns = 0;
  bool any = false;
  double last_s = 0.0;
  const auto keep = [&] {
    while (assembly.take(frame)) {
      if (!any) first_ns = frame.time_ns;
      any = true;
      last_s = 1e-9 * static_cast<double>(frame.time_ns - first_ns);
      if (last_s >= options.from_s && last_s <= options.to_s) rows.add(last_s, frame);
    }
  };
  while (reader.next(line)) {
    if (const auto bus = interfaces.bus_of(line.interface)) assembly.on_frame(*bus, line.frame);
    if (interfaces.ambiguous()) {
      throw std::runtime_error(file.string() + ": has frames of several interfaces (" +
                               interfaces.others() + "), and " + options.can_map.string() +
                               " one bus, " + assembly.map().buses.front() +
                               "; name the bus as its interface with [[bus]]");
    }
    keep();
  }
  // The last cycle is not ended by a next one.
  if (const auto deadline = assembly.deadline_ns()) assembly.on_time(*deadline + 1);
  keep();

  const CanMap& used = assembly.map();
  Recording& recording = rows.recording();
  std::vector<std::string>& notes = recording.notes;
  const auto note = [&](const std::string& what) { notes.push_back(file.string() + ": " + what); };
  for (const std::string& odd : used.notes) notes.push_back(odd);
  notes.insert(notes.end(), reader.notes().begin(), reader.notes().end());
  const CanCounts counts = assembly.counts();
  for (const SourceNews& matter : happened(used, none, counts)) note(matter.text);
  if (counts.incomplete > 0) {
    note("not all messages came in " + std::to_string(counts.incomplete) + " of " +
         counted(counts.cycles, "cycle"));
  }
  if (interfaces.ignored_some())
    note("interfaces that are not in the mapping: " + interfaces.others());
  if (!any) {
    throw std::runtime_error(
        file.string() + ": no cycle begins in it: there is no frame with id " +
        can_id_text(used.start.id, used.start.extended) + " on " + used.buses[used.start.bus] +
        "; give the message that begins a cycle as sync in " + options.can_map.string());
  }
  if (recording.time.empty()) throw_no_rows(file.string(), last_s, options);
  return std::move(recording);
}

}  // namespace servotwin
