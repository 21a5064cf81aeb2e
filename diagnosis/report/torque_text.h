// Output of the torque diagnosis: in the diagnosis file, on the terminal and in the report
// (docs/files.md).
// Any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "diagnosis/report/cause_words.h"
#include "diagnosis/torque/torque.h"

namespace servotwin {

/// Adds the torque diagnosis to a diagnosis file. A cause that the file already has gets the
/// evidence, parameters and gain from the torque as well; any other cause is added.
void add_torque(nlohmann::json& file, const TorqueDiagnosis& torque);
/// The diagnosis file where only the torque was diagnosed. `reason`: why the position loop was not.
[[nodiscard]] nlohmann::json torque_alone(const TorqueDiagnosis& torque, const std::string& reason);

/// The cause in plain words, and what to check for it.
[[nodiscard]] Shown as_shown(const TorqueCause& cause);

/// The torque diagnosis as lines of text, without the causes in `told`, which were printed before.
/// `details`: with the steps of the search.
[[nodiscard]] std::vector<std::string> torque_lines(const TorqueDiagnosis& torque, bool details,
                                                    const std::vector<std::string>& told = {});
/// One line about a cause that the position loop names as well; empty where the torque does not
/// name it.
[[nodiscard]] std::string torque_beside(const TorqueDiagnosis& torque, const std::string& id);

/// The torque diagnosis as a section of the report, and as a report of its own, in HTML.
[[nodiscard]] std::string torque_section(const TorqueDiagnosis& torque);
/// `reason`: why the position loop was not diagnosed.
[[nodiscard]] std::string torque_page(const TorqueDiagnosis& torque, const std::string& source,
                                      const std::string& reason);

/// A diagnosis by the torque alone in a few sentences for people (as diagnosis/report/in_short.h).
[[nodiscard]] std::vector<std::string> in_short(const TorqueDiagnosis& torque,
                                                const std::string& reason);

}  // namespace servotwin
