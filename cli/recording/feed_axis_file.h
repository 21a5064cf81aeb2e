// The parts of a feed axis in a file (TOML, units in the names of the keys; all keys:
// docs/files.md, an example: examples/feed_axis.toml).
//
// Every problem of the file is reported at once, each on one line with its place, as in
// daemon/config/config.h. Any thread.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/config_problem.h"
#include "twin/feed_axis/parts.h"

namespace servotwin {

struct CheckedFeedAxis {
  FeedAxisParts parts;                  ///< to be used only if there are no problems
  std::vector<ConfigProblem> problems;  ///< in the order of the file
};

/// Reads the text of such a file; `name` is the file's name for the messages.
[[nodiscard]] CheckedFeedAxis check_feed_axis(std::string_view text, const std::string& name);

/// The parts in the file, after all `changes` ("section.key=value") have been made in their order;
/// the n-th band-stop is control.band_stop.n. Throws std::runtime_error with all problems of the
/// file, one per line, or why it cannot be read; std::invalid_argument for a change that is not
/// possible.
[[nodiscard]] FeedAxisParts read_feed_axis(const std::filesystem::path& file,
                                           const std::vector<std::string>& changes = {});

/// The text of the file without its comments, with the fitted values of `parts`: stiffness and
/// damping of coupling, bearing and nut; friction; cover. Throws std::runtime_error if the file
/// cannot be read.
[[nodiscard]] std::string with_fitted(const std::filesystem::path& file,
                                      const FeedAxisParts& parts);

}  // namespace servotwin
