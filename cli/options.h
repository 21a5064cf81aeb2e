// Options that several commands share, and what they stand for.
#pragma once

#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "drivers/dds.h"
#include "drivers/recording_file.h"
#include "identification/model/model_file.h"
#include "identification/recording/segments.h"

namespace CLI {
class App;
}

namespace servotwin::cli {

/// REC --columns --from --to --rate: a recording and the part of it that is wanted.
struct RecordingOptions {
  std::filesystem::path file;
  ReadOptions read_options;

  void declare(CLI::App& command, const std::string& name, const std::string& what);
  /// Reads it and says on `people` what the reader ignored, repaired or dropped.
  [[nodiscard]] Recording read(std::FILE* people) const;
};

/// REC and --axis.
struct AxisOptions {
  RecordingOptions recording;
  std::string axis;

  void declare(CLI::App& command);
  /// Reads the axis and says on `people` what was read.
  [[nodiscard]] SegmentedAxis read(std::FILE* people) const;
  /// The same of a recording that was read before.
  [[nodiscard]] SegmentedAxis segmented(const Recording& whole, std::FILE* people) const;
};

/// --dds --machine --domain --partition.
struct BusOptions {
  bool dds = false;
  DdsPlace place;

  void declare(CLI::App& command);
  /// "machine 'mill' in DDS domain 3".
  [[nodiscard]] std::string text() const;
};

enum class DaemonThere : std::uint8_t { kNobody, kKnowsNoAxes, kReady };
/// Waits until a daemon has heard of the machine of this node and made itself ready for its frames:
/// it then tells the `axes`. That somebody reads frames is not enough, it may be a watcher.
[[nodiscard]] DaemonThere wait_for_daemon(const DdsNode& node, double patience_s,
                                          std::vector<AxisStatus>* axes = nullptr);
/// For a message about a machine that no daemon speaks for: "; there are daemons of 'a', 'b'", or
/// nothing. Listens for as long as a daemon may be silent.
[[nodiscard]] std::string other_daemons(const DdsNode& node);

/// The numbers in "A:B"; throws CLI::ValidationError "OPTION: 'given' is no FORM" unless there are
/// least..most.
[[nodiscard]] std::vector<double> parse_numbers(const std::string& option, const std::string& given,
                                                const std::string& form, std::size_t least,
                                                std::size_t most);

/// Throws if the model of this file is not for an axis of this kind.
void require_kind(const ModelRecord& record, const std::filesystem::path& file,
                  const std::string& axis, bool rotary);
/// A model file for an axis of this kind; throws if it is of the other kind.
[[nodiscard]] ModelRecord read_model_for(const std::filesystem::path& file, const std::string& axis,
                                         bool rotary);

/// The models of a machine on CAN: one per axis, at its cycle; nothing where no file is of the
/// axis. Throws if a file is of none, or of the other kind.
[[nodiscard]] std::vector<std::optional<ModelRecord>> models_of(
    const MachineDescription& machine, const std::vector<std::filesystem::path>& files,
    std::FILE* people);

/// The model of a record for data of another rate: its loop is continuous in time, so that it only
/// has to be discretised for the new step, which is said on `people`. Throws if it cannot run at
/// that rate.
[[nodiscard]] Model model_at(const ModelRecord& record, double sample_time_s, std::FILE* people);

}  // namespace servotwin::cli
