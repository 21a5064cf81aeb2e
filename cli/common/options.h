// Options that several commands share, and the data that they name.
#pragma once

#include <cstdio>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/dds/dds.h"
#include "drivers/recordings/recording_file.h"
#include "identification/model/model_file.h"
#include "identification/recording/segments.h"

namespace servotwin::cli {

class OptionTable;

/// What REC may be, in the help of every command that reads one.
inline constexpr const char* kRecordingHelp =
    "recording: a table with units in its header, MATLAB, a trace of a controller, a ROS 2 bag, or "
    "a "
    "CAN log with --can-map (all: servotwin formats); - is standard input";

/// REC --columns --format --can-map --from --to --rate --as-recorded: a recording and the part of
/// it that is read.
struct RecordingOptions {
  std::filesystem::path file;
  ReadOptions read_options;
  /// Whether positions are repaired. A command that plays or simulates what the file says clears it
  /// before declare(), and has no --as-recorded.
  bool mends = true;
  bool as_recorded = false;  ///< --as-recorded: a repair is named, but not done

  void declare(OptionTable& command, const std::string& name, const std::string& what);
  /// --format and --as-recorded alone, for commands that name several recordings.
  void declare_format(OptionTable& command);
  void declare_as_recorded(OptionTable& command);
  /// Reads the recording, from standard input if the file is "-", and prints on `people` what was
  /// ignored, repaired or dropped. `axis`: the one whose encoder is repaired; empty: all.
  [[nodiscard]] Recording read(std::FILE* people, const std::string& axis = "") const;
};

/// The one of `names` that is meant: `given`, or the only one that differs from it in upper and
/// lower case alone; `given` itself if there is none.
[[nodiscard]] std::string spelling_in(const std::vector<std::string>& names,
                                      const std::string& given);
/// The axis that is meant, as the recording spells it: the given one, or its only one. Throws if
/// none is given and it has several.
[[nodiscard]] std::string axis_of(const Recording& whole, const std::string& given);
/// An axis of a recording, cut into segments, with the command of its neighbour beside it
/// (segment_axis); prints on `people` what was read.
[[nodiscard]] SegmentedAxis segmented(const Recording& whole, const std::string& axis,
                                      std::FILE* people, const std::string& neighbour = {});

/// REC and --axis, which may be left out where the recording has one axis.
struct AxisOptions {
  RecordingOptions recording;
  std::vector<std::filesystem::path> more;  ///< further recordings of the same axis
  std::string axis;
  std::string beside;  ///< the axis whose acceleration may act on it; empty: acting_axis()

  void declare(OptionTable& command);
  /// Also --beside and MORE..
  void declare_several(OptionTable& command);
  /// Reads the axis and prints on `people` what was read. `seek_acting`: of several other axes the
  /// one that acts on it is needed, where --beside does not name it.
  [[nodiscard]] SegmentedAxis read(std::FILE* people, bool seek_acting = false) const;
  /// The axis that --beside names, or the one that acts on this one, which is said on `people`.
  [[nodiscard]] std::string acting_on(const Recording& whole, const std::string& axis,
                                      std::FILE* people) const;
  /// Throws where --beside names an axis that the recording does not have.
  void require_beside(const SegmentedAxis& read) const;
  /// Adds the further recordings to the first one, read before.
  void read_more(SegmentedAxis& axis, std::FILE* people) const;
  /// The names of the files, without their folders.
  [[nodiscard]] std::string source() const;
};

/// --dds --machine --domain --partition.
struct BusOptions {
  bool dds = false;
  DdsPlace place;

  void declare(OptionTable& command);
  /// "machine 'mill' in DDS domain 3".
  [[nodiscard]] std::string text() const;
};

enum class DaemonThere : std::uint8_t { kNobody, kKnowsNoAxes, kReady };
/// Waits up to `patience_s` until a daemon knows the axes of this node's machine and is ready for
/// its frames; its status is then stored in `axes`. A reader of frames alone proves nothing: it may
/// be `servotwin watch`.
[[nodiscard]] DaemonThere wait_for_daemon(const DdsNode& node, double patience_s,
                                          std::vector<AxisStatus>* axes = nullptr);
/// How long a running daemon may take to be found [s].
inline constexpr double kMaxDiscovery_s = 10.0;
/// The error that no daemon serves the machine of this bus.
[[nodiscard]] std::runtime_error no_daemon(const DdsNode& node, const BusOptions& bus);
/// The axes of the machine as its daemon knows them. Throws if there is no daemon, or it does not
/// know them yet.
[[nodiscard]] std::vector<AxisStatus> axes_of_daemon(const DdsNode& node, const BusOptions& bus,
                                                     double patience_s);
/// For an error message when no daemon serves the machine of this node: "; in this domain there are
/// daemons of 'a', 'b'", or an empty string. Listens for one and a half periods of the daemons'
/// status.
[[nodiscard]] std::string other_daemons(const DdsNode& node);

/// The numbers in "A:B". Refuses the value with "OPTION: 'given' is not a valid FORM" unless
/// there are `least` to `most` of them, all finite.
[[nodiscard]] std::vector<double> parse_numbers(const std::string& option, const std::string& given,
                                                const std::string& form, std::size_t least,
                                                std::size_t most);

/// Throws if the model of this file is not for an axis of this kind.
void require_kind(const ModelRecord& record, const std::filesystem::path& file,
                  const std::string& axis, bool rotary);
/// A model file for an axis of this kind; throws if it is of the other kind.
[[nodiscard]] ModelRecord read_model_for(const std::filesystem::path& file, const std::string& axis,
                                         bool rotary);

/// The models of a machine on CAN, one per axis of `machine`, discretised for its cycle; nullopt
/// for an axis without a file. Throws std::runtime_error if a file belongs to none of the axes or
/// to an axis of the other kind (linear, rotary).
[[nodiscard]] std::vector<std::optional<ModelRecord>> models_of(
    const MachineDescription& machine, const std::vector<std::filesystem::path>& files,
    std::FILE* people);

/// The model of a record for data with this sampling time. The loop is continuous in time, so it
/// only has to be discretised anew; a change of the rate is printed on `people`. Throws
/// std::runtime_error if the model cannot run at that rate.
[[nodiscard]] Model model_at(const ModelRecord& record, double sample_time_s, std::FILE* people);

}  // namespace servotwin::cli
