// The configuration of the daemon (TOML; all keys: docs/reference.md). Without a file these default
// values apply.
//
// All problems of a file are reported together, each on one line with its position: a wrong type, a
// value out of range, an unknown key with the nearest known one. Any thread.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/config_problem.h"
#include "identification/loop/identify.h"

namespace servotwin::daemon {

/// Limits of the correction of an axis (ilc/gate.h); all positive.
struct OffsetLimits {
  double peak = 0.0;          ///< [m | rad]
  double rate = 0.0;          ///< [m/s | rad/s]
  double bandwidth_hz = 0.0;  ///< [Hz]
};

enum class SourceKind : std::uint8_t { kDds, kReplay, kCan, kUdp };

struct AxisConfig {
  std::string name;         ///< 1..31 characters
  bool rotary = false;      ///< units = "rad"; else "m"
  std::string torque_unit;  ///< unit of the torque that the machine sends; empty: none
  std::string path{};       ///< name of the path that it forms with other axes; empty: none
  std::optional<OffsetLimits> correction{};  ///< absent: no offset is ever sent
  SourceKind command = SourceKind::kDds;     ///< where the command comes from
  SourceKind encoder = SourceKind::kDds;     ///< where encoder and torque come from
};

struct DdsConfig {
  std::uint32_t domain = 0;  ///< 0..230
  std::string partition;     ///< empty: the default one
  int strength = 0;          ///< of several daemons of a machine the strongest is active
};

struct ReplayConfig {
  std::vector<std::filesystem::path> files;
  std::string columns;            ///< column names of other tools' files, as on the command line
  std::filesystem::path can_map;  ///< for CAN logs
  double speed = 1.0;             ///< multiple of the recorded speed
};

struct CanConfig {
  std::filesystem::path map;            ///< which bits carry which signal (drivers/can/can_map.h)
  std::vector<std::string> interfaces;  ///< one per bus; empty: the names in the mapping
  bool filter = false;                  ///< only ids of the mapping are received
};

struct UdpConfig {
  std::filesystem::path map;
  std::string listen = "127.0.0.1:20000";
  std::string peer;  ///< HOST:PORT; empty: packets of any sender
};

struct IdentifyConfig {
  double window_s = 8.0;          ///< new motion between two identification steps
  double memory_s = 24.0;         ///< maximum of stored fast motion; of slow reversals half of it
  double judge_s = 4.0;           ///< held-out motion on which both models are compared
  double min_improvement = 0.02;  ///< relative reduction of the RMS that a new model must reach
  IdentifyOptions options;

  IdentifyConfig() { options.method = Method::kJoint; }
};

struct DiagnoseConfig {
  double every_s = 3600.0;         ///< machine time between two diagnoses; 0: none on schedule
  double record_s = 30.0;          ///< length of the most recent motion that is diagnosed
  double false_alarm_days = 30.0;  ///< mean motion between two false alarms; 0: no alarm
  double reference_s = 900.0;      ///< motion from which the normal residual is learned
  /// True: the actual value is that of the encoder which closes the position loop. Applies to every
  /// axis without an entry of its own in encoder_in_loop_of.
  bool encoder_in_loop = false;
  std::map<std::string, bool> encoder_in_loop_of;
};

/// Corrections of programs: how they are learned and how they may be applied live.
struct IlcConfig {
  bool contour = false;  ///< aim = "contour": reduces the path error; else that of every axis
  std::filesystem::path programs;  ///< folder of commanded paths to learn; empty: none
  /// What becomes of motion that repeats: nothing, offered as a program, or put into the folder.
  enum class Recognise : std::uint8_t { kOff, kOffer, kLearn };
  Recognise recognise = Recognise::kOffer;
  int trials = 10;                ///< maximum number of virtual trials
  bool live = false;              ///< false: dry run, even when armed
  double ramp_s = 0.1;            ///< fade-in time from 0 to the full offset, and fade-out time
  double validity_s = 0.02;       ///< time for which a drive holds an offset that is not renewed
  double drive_ramp_s = 0.1;      ///< time within which the drive then brings the offset to 0
  double model_age_s = 604800.0;  ///< maximum time since the validation of the models
  double match_tolerance = 2e-6;  ///< deviation of a command from its program row [m | rad]
  double residual_band = 8.0;  ///< in standard deviations of the model; beyond it offsets fade out
  int delay_cycles = 1;        ///< cycles from a frame to the cycle that applies its offset
  /// Axes whose offsets may be armed although their drives keep the last one for ever.
  std::vector<std::string> arm_without_timeout;
  std::optional<bool> in_command;  ///< whether the frames' command contains the offset; absent:
                                   ///< yes on CAN, otherwise no
};

struct StoreConfig {
  std::filesystem::path directory;  ///< empty: default_store()
  /// The oldest recordings are deleted beyond this; 0: nothing is recorded.
  double recordings_mb = 1024.0;
  std::optional<double> recordings_max_mb;  ///< including those that models cite; recording stops
                                            ///< there; absent: four times recordings_mb
};

/// The web page and the HTTP interface.
struct HttpConfig {
  std::string listen;                ///< ADDRESS:PORT; empty or "none": no page
  std::string token;                 ///< needed for every change over HTTP; empty: no changes
  std::filesystem::path token_file;  ///< where the token is from; empty: from the configuration
  std::filesystem::path tls_certificate, tls_key;  ///< PEM; both or none; empty: no TLS
  std::vector<std::string> names;                  ///< further names of this host
  bool needed = true;  ///< the daemon does not start if it cannot listen
};

struct Config {
  std::string machine = "machine";       ///< 1..63 characters
  std::optional<double> cycle_s;         ///< absent: given by the source
  std::vector<AxisConfig> axes;          ///< in the order of the frames; empty: given by the source
  SourceKind source = SourceKind::kDds;  ///< that of the first axis' command: the cycles are its
  std::optional<SourceKind> second;      ///< another one beside it, as the axes say
  std::vector<std::string> unused;       ///< sources that are configured and no axis names
  DdsConfig dds;  ///< where the daemon publishes, whatever the source of its frames is
  std::optional<DdsConfig> dds_in;  ///< where the frames are, if not at `dds`
  ReplayConfig replay;
  CanConfig can;
  UdpConfig udp;
  IdentifyConfig identify;
  DiagnoseConfig diagnose;
  IlcConfig ilc;
  StoreConfig store;
  HttpConfig http;
  int priority = 80;      ///< SCHED_FIFO priority of the real-time loop, 1..98; 0: none
  std::vector<int> cpus;  ///< processors of the loop, the publisher and DDS; empty: all
  std::map<std::string, std::string> given;  ///< the keys of the file and their values as text

  [[nodiscard]] bool uses(SourceKind kind) const noexcept {
    return source == kind || second == kind;
  }
};

/// "dds", "replay", "can" or "udp", as a configuration names it.
[[nodiscard]] std::string_view name_of(SourceKind kind) noexcept;

struct CheckedConfig {
  Config config;                        ///< valid only if there are no problems
  std::vector<ConfigProblem> problems;  ///< in the order of the file
};

/// Reads the text of a configuration, and the file of the token that it names; `name` is the file's
/// name for the messages.
[[nodiscard]] CheckedConfig check_config(std::string_view text, const std::string& name);
/// The same from a file. Throws std::runtime_error if it cannot be read.
[[nodiscard]] CheckedConfig check_config(const std::filesystem::path& file);
/// Throws std::runtime_error with all problems, one per line, or why the file cannot be read.
[[nodiscard]] Config load_config(const std::filesystem::path& file);

/// $STATE_DIRECTORY (systemd), else servotwin/ in $XDG_STATE_HOME or ~/.local/state.
[[nodiscard]] std::filesystem::path default_store();

}  // namespace servotwin::daemon
