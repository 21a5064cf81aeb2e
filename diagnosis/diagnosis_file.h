// The diagnosis file, `servotwin.diagnosis/1` (JSON; docs/files.md). Any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "diagnosis/diagnose.h"

namespace servotwin {

/// `extended_model`: the name of the file that the extended model was written to; empty: none.
[[nodiscard]] nlohmann::json to_json(const Diagnosis& diagnosis, const std::string& extended_model);

/// One sentence for a person on the shop floor.
[[nodiscard]] std::string verdict_text(const Diagnosis& diagnosis);
/// Whether a shape of an effect says something in this model: what resets the integrator of a
/// control does not where there is none, nor a mode that swings faster than the recording can show.
[[nodiscard]] bool means_something(const Effect& effect, const Parameter& shape,
                                   const Model& model);
/// What the cause is, with its sizes, in one line.
[[nodiscard]] std::string cause_text(const Diagnosis& diagnosis, const Cause& cause);
/// The term that is not understood, in one line; empty: there is none.
[[nodiscard]] std::string not_understood_text(const Diagnosis& diagnosis);
/// What explains what is left, against chance; two lines.
[[nodiscard]] std::vector<std::string> left_lines(const Diagnosis& diagnosis);
/// What to look at on the machine.
[[nodiscard]] std::string advice_for(const std::string& id);

/// The page of this cause, from the folder that has docs/: the source tree, or
/// /usr/share/doc/servotwin where the package is installed.
[[nodiscard]] std::string cause_page(const std::string& id);

}  // namespace servotwin
