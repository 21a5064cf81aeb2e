// servotwin check-config: would the daemon start with this configuration?
#include <sys/stat.h>

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "daemon/config/config.h"
#include "daemon/config/listen_address.h"
#include "daemon/input/offset_contract.h"
#include "daemon/service.h"
#include "daemon/web/tls_pair.h"
#include "drivers/can/can_map.h"
#include "drivers/common/text.h"

namespace servotwin::cli {
namespace {

std::string text_of(const daemon::DdsConfig& dds) {
  return "DDS domain " + std::to_string(dds.domain) +
         (dds.partition.empty() ? "" : ", partition " + in_quotes(dds.partition));
}

/// The mapping of a machine on CAN.
std::optional<CanMap> mapping_of(const daemon::Config& config) {
  if (config.second) return std::nullopt;  // nothing is sent on its buses
  if (config.source == daemon::SourceKind::kCan) return load_can_map(config.can.map);
  if (config.source == daemon::SourceKind::kUdp) return load_can_map(config.udp.map);
  return std::nullopt;
}

/// The messages to a PLC, if there are any.
void say_predictions(const std::optional<CanMap>& map) {
  if (!map) return;
  std::vector<std::string> messages;
  for (const std::size_t message : prediction_messages(*map))
    messages.push_back(map->messages[message].name);
  if (messages.empty()) return;
  say(stdout, text("PLC         predictions every %.6g ms in ", 1e3 * map->prediction_period_s) +
                  listed(messages));
}

/// What the drives must do with live offsets, if any axis has a correction.
void say_offsets(const daemon::Config& config, const std::optional<CanMap>& map) {
  if (daemon::corrected_axes(config).empty()) return;
  const daemon::IlcConfig& ilc = config.ilc;
  say(stdout, std::string("offsets     ") + (ilc.live ? "live" : "dry run") +
                  text("; a drive keeps one for %.6g ms or longer (validity_s), then ramps it to 0 "
                       "within %.6g ms (drive_ramp_s)",
                       1e3 * ilc.validity_s, 1e3 * ilc.drive_ramp_s));
  if (map) {
    for (const std::string& line : daemon::drive_settings(config, *map))
      say(stdout, "drive       " + line);
  }
  const double cycle_s = map ? map->machine.cycle_s : config.cycle_s.value_or(0.0);
  const daemon::OffsetContract contract =
      daemon::offset_contract(config, cycle_s, map ? &*map : nullptr);
  for (const std::string& remark : contract.remarks) say(stdout, "note: " + remark);
  if (const std::string why = contract.refusal(); !why.empty())
    say(stdout, "note: with ilc.live = true " + why);
}

/// The folder of commanded paths, if there is one.
void say_programs(const std::filesystem::path& folder) {
  if (folder.empty()) return;
  std::error_code error;
  const std::filesystem::directory_iterator readable(folder, error);
  say(stdout,
      "programs    the .csv files in " + folder.string() +
          (error == std::errc::no_such_file_or_directory
               ? ", which is not there: it is made with the first program that comes by HTTP"
           : error ? ", which cannot be read now: " + error.message()
                   : ""));
}

/// A note if others than its owner may read a file with a secret.
void note_readers(const std::filesystem::path& file, const std::string& secret,
                  const std::string& what_to_do) {
  struct stat found {};
  if (stat(file.c_str(), &found) != 0 || (found.st_mode & (S_IRGRP | S_IROTH)) == 0) return;
  say(stdout, "note: " + file.string() + " contains " + secret +
                  ", and others than its owner can read it" +
                  text(" (mode %04o): ", found.st_mode & 07777U) + what_to_do);
}

/// Notes on what makes it easy to read the token, and on a certificate that expires.
void note_secrets(const std::filesystem::path& file, const daemon::HttpConfig& http) {
  const std::string close = "remove the rights of group and others (chmod go= FILE)";
  if (!http.token_file.empty()) {
    note_readers(http.token_file, "the token", close);
  } else if (!http.token.empty()) {
    note_readers(file, "http.token",
                 "move the token to a file of its own, which only the daemon can read, and name it "
                 "in http.token_file");
  }
  if (!http.tls_key.empty()) note_readers(http.tls_key, "the private key", close);
  const std::string expiry = daemon::expiry_note(
      daemon::read_tls_pair(http.tls_certificate, http.tls_key), std::time(nullptr));
  if (!expiry.empty()) say(stdout, "note: " + expiry);
  const auto address = daemon::parse_listen_address(http.listen);
  if (address && !address->is_loopback() && http.tls_certificate.empty())
    say(stdout, "note: " + http.listen +
                    " can be reached from the network without TLS: who can listen there reads the "
                    "token; give http.tls_certificate and http.tls_key, or listen on 127.0.0.1");
}

void run(const std::filesystem::path& file) {
  const daemon::CheckedConfig checked = daemon::check_config(file);
  std::vector<std::string> problems;
  for (const ConfigProblem& problem : checked.problems) problems.push_back(problem.message());
  if (problems.empty()) {
    for (const std::string& obstacle : obstacles(checked.config))
      problems.push_back(file.string() + ": " + obstacle);
  }
  // While the file has problems, the names in it may not be the intended ones and are not checked.
  const std::string unseen = checked.problems.empty()
                                 ? ""
                                 : "; store, recordings, mapping, address and processors are "
                                   "checked once this is corrected";
  if (problems.size() == 1) throw std::runtime_error(problems.front() + unseen);
  if (!problems.empty()) {
    for (const std::string& problem : problems) complain(problem);
    throw std::runtime_error(
        file.string() +
        text(": %zu problems; the daemon would not run as configured", problems.size()) + unseen);
  }
  const daemon::Config& config = checked.config;
  say(stdout, file.string() + ": valid");
  say(stdout, "machine     " + config.machine +
                  (config.cycle_s ? text(", cycle %.6g ms", 1e3 * *config.cycle_s) : ""));
  std::string axes;
  for (const daemon::AxisConfig& axis : config.axes)
    axes += (axes.empty() ? "" : ", ") + axis.name + (axis.rotary ? " (rotary)" : "");
  say(stdout, "axes        " + (axes.empty() ? "as the source says" : axes));
  const std::string frames = text_of(config.dds_in.value_or(config.dds));
  std::string source = frames;
  if (config.source == daemon::SourceKind::kReplay)
    source = "replay of " + counted(config.replay.files.size(), "recording");
  if (config.uses(daemon::SourceKind::kCan)) {
    source = "CAN " + (config.can.interfaces.empty() ? "as named" : listed(config.can.interfaces)) +
             " in " + config.can.map.string();
  } else if (config.uses(daemon::SourceKind::kUdp)) {
    source = "CAN over UDP at " + config.udp.listen + ", " + config.udp.map.string();
  }
  if (config.second)
    source = config.source == daemon::SourceKind::kDds ? frames + ", joined with " + source
                                                       : source + ", joined with " + frames;
  say(stdout, "source      " + source);
  for (const std::string& unused : config.unused) {
    say(stdout, "note: nothing comes from [source." + unused +
                    "]: no axis names it as its source or encoder");
  }
  say(stdout, "output      " + text_of(config.dds) +
                  (config.dds.strength == 0 ? "" : text(", strength %d", config.dds.strength)));
  const auto store =
      config.store.directory.empty() ? daemon::default_store() : config.store.directory;
  say(stdout, "store       " + store.string());
  const std::optional<CanMap> map = mapping_of(config);
  say_predictions(map);
  say_offsets(config, map);
  say_programs(config.ilc.programs);
  if (config.ilc.live) {
    if (config.http.token.empty())
      say(stdout,
          "note: ilc.live sends nothing until it is armed, and it cannot be armed without "
          "http.token or http.token_file");
    if (std::none_of(config.axes.begin(), config.axes.end(),
                     [](const daemon::AxisConfig& axis) { return axis.correction.has_value(); }))
      say(stdout, "note: ilc.live sends nothing: no axis has a correction");
  }
  for (const daemon::AxisConfig& axis : config.axes) {
    if (!config.cycle_s || !axis.correction) continue;
    if (const double half_hz = 0.5 / *config.cycle_s; axis.correction->bandwidth_hz > half_hz)
      say(stdout, text("note: axis %s: the correction bandwidth of %.6g Hz has no effect, since "
                       "half the cycle rate is %.6g Hz",
                       axis.name.c_str(), axis.correction->bandwidth_hz, half_hz));
  }
  note_secrets(file, config.http);
  for (const std::string& line : taken(config))
    say(stdout, "note: " + line + " now: this is right if that is the daemon which will use " +
                    "this configuration; a second daemon would not start");
}

}  // namespace

Command add_check_config(CLI::App& app) {
  const auto file = std::make_shared<std::filesystem::path>();
  OptionTable command(app, "check-config",
                      "Checks a configuration of the daemon and prints one line per problem.");
  command.option("FILE", *file, "configuration (TOML)").required();
  return {command.app(), [file] { run(*file); }};
}

}  // namespace servotwin::cli
