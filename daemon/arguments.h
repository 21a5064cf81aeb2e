// The options of servotwind. They are used by its main() and by the command servotwin, which writes
// the manual pages and the completions of both programs.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/config/listen_address.h"
#include "daemon/licences.h"

namespace servotwin::daemon {

/// Empty if an option was not given: then the configuration applies.
struct DaemonArguments {
  std::string config, store, machine, columns, http;
  std::optional<std::uint32_t> domain;
  std::optional<std::string> partition;
  std::vector<std::filesystem::path> replay;
  std::optional<double> speed;

  /// Declares the options on `app`; this object must outlive it.
  void declare(CLI::App& app, const std::string& version) {
    app.set_version_flag("--version", version);
    declare_licences(app);
    app.add_option("--config", config,
                   "configuration file (TOML); default values where it is not given")
        ->type_name("FILE");
    app.add_option("--store", store, "directory of models, events and recordings")
        ->type_name("DIR");
    app.add_option("--machine", machine, "name of the machine")->type_name("NAME");
    app.add_option("--domain", domain, "DDS domain")->type_name("N")->check(CLI::Range(0, 230));
    app.add_option("--partition", partition, "DDS partition of the cell")->type_name("NAME");
    auto* recordings =
        app.add_option("--replay", replay, "recordings to replay instead of listening to a machine")
            ->type_name("REC");
    app.add_option("--columns", columns,
                   "names for the columns of foreign recordings: \"X.command=qg[m],...\"")
        ->type_name("MAP")
        ->needs(recordings);
    app.add_option("--speed", speed, "replay speed, as a multiple of the recorded speed")
        ->type_name("F")
        ->needs(recordings)
        ->check(CLI::Range(0.01, 1000.0));
    app.add_option("--http", http,
                   std::string("where the web page and the HTTP interface listen, or none "
                               "(default ") +
                       kDefaultListen + ")")
        ->type_name("ADDRESS:PORT")
        ->check([](const std::string& given) {
          return given == "none" || parse_listen_address(given) ? std::string() : kListenRule;
        });
  }
};

/// The first line of --help.
inline constexpr const char* kDaemonDescription =
    "The always-on digital twin of a machine's servo drives.";

}  // namespace servotwin::daemon
