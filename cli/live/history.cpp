// servotwin history: the daemon's diagnoses of an axis in their order of time, so that a drift over
// weeks can be seen.
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "daemon/config/config.h"
#include "daemon/store/store.h"
#include "drivers/common/text.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr const char* kSchema = "servotwin.history/1";

struct HistoryArguments {
  std::filesystem::path store, result;
  std::string machine = daemon::Config().machine, axis;
  int last = 100;
};

/// In um or urad; "-" where it is not known.
std::string micro_of(const json& value) {
  return value.is_number() ? text("%.3g", 1e6 * value.get<double>()) : "-";
}

/// "cogging(period_m 0.0025, amplitude_mps2 0.0098)"; SI, as in the diagnosis file.
std::string cause_line(const json& cause) {
  std::string parameters;
  for (const auto& [name, value] : cause.at("parameters").items()) {
    if (value.is_number())
      parameters += (parameters.empty() ? "" : ", ") + name + text(" %.4g", value.get<double>());
  }
  // A cause that only the torque shows does not change the tracking error and is in no model.
  const json gain = cause.value("gain", json::object());
  bool by_torque = false;
  for (const auto& [name, value] : gain.items())
    by_torque |= name.starts_with("holdout_rms_before_") && name != "holdout_rms_before_m";
  by_torque = by_torque && gain.value("holdout_rms_before_m", json()).is_null();
  return cause.at("id").get<std::string>() + "(" + parameters + ")" +
         (by_torque ? " by torque" : "");
}

/// "  suspected cogging, backlash"; empty if the list is empty or missing, as in old files.
std::string ids_line(const char* what, const json& diagnosis, const char* key) {
  std::string ids;
  for (const json& one : diagnosis.value(key, json::array()))
    ids += (ids.empty() ? "" : ", ") + one.at("id").get<std::string>();
  return ids.empty() ? "" : std::string("  ") + what + " " + ids;
}

std::string line_of(const daemon::StoredDiagnosis& stored, const json& diagnosis) {
  std::string line = stored.time + text("  %-19s", stored.verdict.c_str());
  line += text(" %8s -> %-8s", micro_of(diagnosis.at("baseline").at("rms_m")).c_str(),
               micro_of(diagnosis.at("extended").at("rms_m")).c_str());
  for (const json& cause : diagnosis.at("causes")) line += "  " + cause_line(cause);
  line += ids_line("suspected", diagnosis, "suspected") +
          ids_line("not observable here:", diagnosis, "not_observable");
  return line + (stored.reason == "on schedule" ? "" : "  [alarm]");
}

json parsed(const daemon::StoredDiagnosis& stored) {
  try {
    return json::parse(stored.json);
  } catch (const json::exception& error) {
    throw std::runtime_error("the diagnosis of axis " + stored.axis + " of " + stored.time +
                             " in the store is damaged: " + error.what());
  }
}

std::string why_none(const daemon::Store& store, const HistoryArguments& arguments) {
  const std::vector<std::string> machines = store.machines(), axes = store.axes();
  if (machines.empty()) return "has no model and no diagnosis of any machine yet";
  if (axes.empty())
    return "knows no machine " + in_quotes(arguments.machine) + "; it has " + listed(machines) +
           " (--machine)";
  if (std::find(axes.begin(), axes.end(), arguments.axis) == axes.end())
    return "machine " + in_quotes(arguments.machine) + " has no axis " + in_quotes(arguments.axis) +
           " there; it has " + listed(axes);
  return "axis " + arguments.axis + " of machine " + in_quotes(arguments.machine) +
         " has not been diagnosed yet";
}

void run(HistoryArguments arguments) {
  std::FILE* people = people_beside({arguments.result});
  const auto directory = arguments.store.empty() ? daemon::default_store() : arguments.store;
  const daemon::Store store(directory, arguments.machine, daemon::StoreAccess::kRead);
  arguments.axis = spelling_in(store.axes(), arguments.axis);
  std::vector<daemon::StoredDiagnosis> diagnoses = store.diagnoses(arguments.axis, arguments.last);
  if (diagnoses.empty())
    throw std::runtime_error("store " + directory.string() + ": " + why_none(store, arguments));
  std::reverse(diagnoses.begin(), diagnoses.end());
  json list = json::array();
  say(people,
      "time (UTC)                verdict             RMS without -> with causes [um | "
      "urad]; causes with their parameters (SI)");
  for (const daemon::StoredDiagnosis& one : diagnoses) {
    list.push_back(parsed(one));
    // The model with its causes is kept beside a diagnosis, not in it.
    if (!one.extended_model.empty())
      list.back()["model"] = json::parse(one.extended_model, nullptr, false);
    say(people, line_of(one, list.back()));
  }
  for (const json& sentences : list.back().value("in_short", json::array()))
    say(people, sentences.get<std::string>());
  if (arguments.result.empty()) return;
  write_json(arguments.result, {{"schema", kSchema},
                                {"machine", arguments.machine},
                                {"axis", arguments.axis},
                                {"diagnoses", list}});
  say_written(people, {arguments.result});
}

}  // namespace

Command add_history(CLI::App& app) {
  const auto arguments = std::make_shared<HistoryArguments>();
  OptionTable command(app, "history",
                      "Lists the daemon's diagnoses of an axis from its store, the newest last.");
  command
      .option("--store", arguments->store,
              "the daemon's directory (default: where servotwind keeps it)")
      .takes("DIR");
  command
      .option("--machine", arguments->machine,
              "name of the machine (default: " + arguments->machine + ")")
      .takes("NAME");
  command.option("--axis", arguments->axis, "axis of the machine").takes("X").required();
  command.option("--last", arguments->last, "number of diagnoses (default: 100)")
      .takes("N")
      .between(1, 1'000'000);
  command
      .option("--json", arguments->result,
              "write the diagnoses to this file (servotwin.history/1); - is standard output")
      .takes("OUT.json");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
