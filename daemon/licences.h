// The option --licences of both programs. The text is the package's copyright file
// (systemd/package/copyright), built in. Any thread.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace servotwin::daemon {

/// Licences of this program and of what is compiled into it or linked to it, in Debian's
/// machine-readable format.
[[nodiscard]] std::string licences();

/// Prints them and ends, as --version does.
inline void declare_licences(CLI::App& app) {
  app.add_flag_callback(
      "--licences", [] { throw CLI::CallForVersion(licences(), 0); },
      "Print the licences of this program and of its libraries and exit");
}

}  // namespace servotwin::daemon
