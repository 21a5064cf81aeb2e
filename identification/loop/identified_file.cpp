#include "identification/loop/identified_file.h"

#include <nlohmann/json.hpp>

#include "identification/model/json_number.h"

namespace servotwin {

nlohmann::json to_json(const Identified& identified) {
  nlohmann::json out = to_json(identified.record);
  nlohmann::json trials = nlohmann::json::array();
  for (const StructureTrial& trial : identified.trials) {
    nlohmann::json effects = nlohmann::json::array();
    for (const std::size_t kind : trial.effects) effects.push_back(identity_of(kind).id);
    trials.push_back({{"order", trial.order},
                      {"modes", trial.modes},
                      {"moving", trial.moving},
                      {"effects", effects},
                      {"validation_rms_m", number_or_null(trial.validation_rms)},
                      {"chosen", trial.chosen},
                      {"ruled_out", trial.ruled_out}});
  }
  out["trials"] = trials;
  out["refusals"] = identified.refusals;
  return out;
}

}  // namespace servotwin
