// The daemon's configuration (TOML; all keys: docs/reference.md). Without a file these defaults
// hold.
//
// Every problem of a file is reported at once, each on one line with its place: a wrong type, a
// value out of its range, a key that does not exist with the nearest one that does. Any thread.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/config_problem.h"
#include "identification/loop/identify.h"

namespace servotwin::daemon {

/// What a correction of an axis may be (ilc/gate.h); all positive.
struct OffsetLimits {
  double peak = 0.0;          ///< [m | rad]
  double rate = 0.0;          ///< [m/s | rad/s]
  double bandwidth_hz = 0.0;  ///< [Hz]
};

struct AxisConfig {
  std::string name;         ///< 1..31 characters
  bool rotary = false;      ///< units = "rad"; else "m"
  std::string torque_unit;  ///< of what the machine sends; empty: it sends none
  std::string path{};       ///< that it draws together with others of this name; empty: none
  std::optional<OffsetLimits> correction{};  ///< absent: it is never sent one
};

enum class SourceKind : std::uint8_t { kDds, kReplay, kCan, kUdp };

struct DdsConfig {
  std::uint32_t domain = 0;  ///< 0..230
  std::string partition;     ///< empty: the default one
  int strength = 0;          ///< of two daemons of a machine the stronger one is heard
};

struct ReplayConfig {
  std::vector<std::filesystem::path> files;
  std::string columns;            ///< names for foreign files, as on the command line
  std::filesystem::path can_map;  ///< for CAN logs
  double speed = 1.0;             ///< times as fast as recorded
};

struct CanConfig {
  std::filesystem::path map;            ///< which bits are which signal (drivers/can_map.h)
  std::vector<std::string> interfaces;  ///< one per bus of the mapping; empty: as they are called
  bool filter = false;                  ///< only ids of the mapping are listened to
};

struct UdpConfig {
  std::filesystem::path map;
  std::string listen = "127.0.0.1:20000";
  std::string peer;  ///< HOST:PORT; empty: anybody
};

struct IdentifyConfig {
  double window_s = 8.0;          ///< new motion until the next model is sought
  double memory_s = 24.0;         ///< most fast motion it is sought on; half of slow reversals
  double judge_s = 4.0;           ///< motion that neither model has seen, to judge on
  double min_improvement = 0.02;  ///< share by which the RMS must fall for a new model
  IdentifyOptions options;

  IdentifyConfig() { options.method = Method::kJoint; }
};

struct DiagnoseConfig {
  double every_s = 3600.0;         ///< of the machine's time, from diagnosis to diagnosis; 0: never
  double record_s = 30.0;          ///< the most recent motion that is looked at
  double false_alarm_days = 30.0;  ///< of motion, between false alarms; 0: there is no alarm
  double reference_s = 900.0;      ///< motion that tells what a model leaves when all is well
  /// What comes as the actual value is the encoder that the position loop uses, of every axis but
  /// those that say it themselves.
  bool encoder_in_loop = false;
  std::map<std::string, bool> encoder_in_loop_of;
};

/// Corrections of programs: how they are learned, and how they may be given back.
struct IlcConfig {
  bool contour = false;            ///< aim = "contour": on the path; else every axis on its command
  int trials = 10;                 ///< virtual ones, at most
  bool live = false;               ///< false: offsets are advice, whoever arms them
  double ramp_s = 0.1;             ///< from nothing to the whole offset, and back
  double validity_s = 0.02;        ///< after which a drive must drop an offset
  double model_age_s = 604800.0;   ///< the oldest model whose corrections are sent
  double match_tolerance = 2e-6;   ///< of a command that belongs to a program [m | rad]
  double residual_band = 8.0;      ///< standard deviations of the model; beyond it offsets go out
  int delay_cycles = 1;            ///< from a frame to the offset that answers it being applied
  std::optional<bool> in_command;  ///< whether the frames' command has the offset in it; absent: on
                                   ///< CAN it has, elsewhere not
};

struct StoreConfig {
  std::filesystem::path directory;  ///< empty: default_store()
  double recordings_mb =
      1024.0;  ///< the oldest recordings go when there are more; 0: none are kept
  std::optional<double> recordings_max_mb;  ///< with those that models cite, too, where recording
                                            ///< stops; absent: four times as much
};

/// The page and its API.
struct HttpConfig {
  std::string listen;              ///< ADDRESS:PORT; empty or "none": nowhere
  std::string token;               ///< of who may change something; empty: nobody
  std::vector<std::string> names;  ///< what this host is called besides its host name
  bool needed = true;              ///< where it cannot listen the daemon does not start
};

struct Config {
  std::string machine = "machine";  ///< 1..63 characters
  std::optional<double> cycle_s;    ///< absent: the source says it
  std::vector<AxisConfig> axes;     ///< in the order of the frames; empty: the source says them
  SourceKind source = SourceKind::kDds;
  DdsConfig dds;  ///< where the daemon says what it has to say, wherever its frames come from
  std::optional<DdsConfig> dds_in;  ///< where these are, if it is DDS and elsewhere
  ReplayConfig replay;
  CanConfig can;
  UdpConfig udp;
  IdentifyConfig identify;
  DiagnoseConfig diagnose;
  IlcConfig ilc;
  StoreConfig store;
  HttpConfig http;
  int priority = 80;      ///< SCHED_FIFO priority of the real-time loop, 1..98; 0: none
  std::vector<int> cpus;  ///< that the real-time loop may use; empty: all
  std::map<std::string, std::string> given;  ///< the keys of the file as they stand there
};

struct CheckedConfig {
  Config config;                        ///< to be used only if there are no problems
  std::vector<ConfigProblem> problems;  ///< in the order of the file
};

/// Reads the text of a configuration; `name` is the file's name for the messages.
[[nodiscard]] CheckedConfig check_config(std::string_view text, const std::string& name);
/// The same from a file. Throws std::runtime_error if it cannot be read.
[[nodiscard]] CheckedConfig check_config(const std::filesystem::path& file);
/// Throws std::runtime_error with all problems, one per line, or why the file cannot be read.
[[nodiscard]] Config load_config(const std::filesystem::path& file);

/// $STATE_DIRECTORY (systemd), else servotwin/ in $XDG_STATE_HOME or ~/.local/state.
[[nodiscard]] std::filesystem::path default_store();

}  // namespace servotwin::daemon
