// The diagnosis file, `servotwin.diagnosis/1` (JSON; docs/files.md). Any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "diagnosis/search/diagnose.h"

namespace servotwin {

/// The diagnosis as JSON. `extended_model`: the name of the file that the extended model was
/// written to; empty: none was written.
[[nodiscard]] nlohmann::json to_json(const Diagnosis& diagnosis, const std::string& extended_model);

/// The verdict in one line: how many causes are named, and the simulation error with and without
/// them.
[[nodiscard]] std::string verdict_text(const Diagnosis& diagnosis);
/// Whether a shape parameter of an effect has a meaning in this model. The reset of the integrator
/// has none in a loop without an integrator, nor has a mode above the Nyquist frequency.
[[nodiscard]] bool means_something(const Effect& effect, const Parameter& shape,
                                   const Model& model);
/// The parameters of the cause with their values and units, in one line.
[[nodiscard]] std::string cause_text(const Diagnosis& diagnosis, const Cause& cause);
/// The term of the extended model that no cause explains, in one line; empty: there is none.
[[nodiscard]] std::string not_understood_text(const Diagnosis& diagnosis);
/// The remaining residual in two lines: the share explained by each significant variable, and the
/// lines of its spectrum.
[[nodiscard]] std::vector<std::string> left_lines(const Diagnosis& diagnosis);
/// Whether a cause `stribeck` is friction that is higher at feed than at creeping speed, which no
/// oil film explains.
[[nodiscard]] bool friction_rises(const Diagnosis& diagnosis, const Cause& cause);
/// What to check on the machine for this cause; empty: there is no advice. `rises`: whether
/// friction_rises().
[[nodiscard]] std::string advice_for(const std::string& id, bool rises = false);
/// The same for the effect that stands for the cause.
[[nodiscard]] std::string advice_for(const Diagnosis& diagnosis, const Cause& cause);

/// The path of the document about this cause, relative to the folder that contains docs/: the
/// source tree, or /usr/share/doc/servotwin where the package is installed.
[[nodiscard]] std::string cause_page(const std::string& id);
/// The same for people: with its folder where it is installed with this program, so that it can be
/// opened as it is printed; else as cause_page().
[[nodiscard]] std::string page_to_read(const std::string& id);

}  // namespace servotwin
