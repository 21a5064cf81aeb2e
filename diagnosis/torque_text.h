// What the torque says, in the diagnosis file, on the terminal and on the page (docs/files.md).
// Any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "diagnosis/torque.h"

namespace servotwin {

/// Adds it to a diagnosis file: a cause that is there already gets the torque's evidence,
/// parameters and gain, another is added.
void add_torque(nlohmann::json& file, const TorqueDiagnosis& torque);
/// The diagnosis file of a recording of which the torque alone was explained. `reason`: why.
[[nodiscard]] nlohmann::json torque_alone(const TorqueDiagnosis& torque, const std::string& reason);

/// For people, one thing per line, but nothing of the causes that are `told` already.
[[nodiscard]] std::vector<std::string> torque_lines(const TorqueDiagnosis& torque, bool details,
                                                    const std::vector<std::string>& told = {});
/// What it says of a cause that the position names as well; empty if that is nothing.
[[nodiscard]] std::string torque_beside(const TorqueDiagnosis& torque, const std::string& id);

/// A section of the page, and the page of the torque alone.
[[nodiscard]] std::string torque_section(const TorqueDiagnosis& torque);
[[nodiscard]] std::string torque_page(const TorqueDiagnosis& torque, const std::string& source);

}  // namespace servotwin
