// servotwin mqtt: passes what the daemon publishes over DDS on to an MQTT broker.
#include <cmath>
#include <csignal>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/live/mqtt_client.h"
#include "cli/live/relay.h"
#include "daemon/web/live_json.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

// The state is repeated: the will of an earlier connection, or the end of another bridge of this
// machine, would stay otherwise.
constexpr double kRepeat_s = 10.0;
// Without a connection for this long, that is said; and once more when it is back.
constexpr double kPatience_s = 5.0;

struct MqttArguments {
  BusOptions bus;
  std::string broker, prefix = "servotwin", user;
  std::filesystem::path password_file, ca_file;
  bool tls = false;
  double seconds = 0.0;
};

/// HOST, HOST:PORT, [ADDRESS] or [ADDRESS]:PORT.
MqttBroker broker_of(const MqttArguments& arguments) {
  constexpr int kPlainPort = 1883, kTlsPort = 8883;
  MqttBroker out;
  out.tls = arguments.tls || !arguments.ca_file.empty();
  out.ca_file = arguments.ca_file;
  out.port = out.tls ? kTlsPort : kPlainPort;
  const std::string& given = arguments.broker;
  const bool bracketed = given.starts_with('[');
  const std::size_t closed = bracketed ? given.find(']') : 0;
  const std::size_t colon = closed == given.npos ? given.npos : given.find(':', closed);
  out.host =
      bracketed && closed != given.npos ? given.substr(1, closed - 1) : given.substr(0, colon);
  bool valid = !out.host.empty() && closed != given.npos &&
               (!bracketed || closed + 1 == given.size() || colon == closed + 1);
  if (colon != given.npos) {
    const auto port = number_of(given.substr(colon + 1));
    valid = valid && port && *port >= 1.0 && *port <= 65535.0 && *port == std::floor(*port);
    if (valid) out.port = static_cast<int>(*port);
  }
  if (!valid)
    throw UsageError("--broker: '" + given +
                     "' is not HOST or HOST:PORT; an address of IPv6 is in brackets");
  out.user = arguments.user;
  if (arguments.password_file.empty()) return out;
  if (out.user.empty()) throw UsageError("--password-file needs --user");
  std::ifstream file(arguments.password_file);
  std::getline(file, out.password);
  if (out.password.ends_with('\r')) out.password.pop_back();
  if (out.password.empty())
    throw std::runtime_error(arguments.password_file.string() +
                             ": cannot be read, or its first line is empty; it has the password");
  return out;
}

/// The name of an axis as one level of a topic.
std::string level_of(std::string name) {
  for (char& c : name) {
    if (c == '/' || c == '+' || c == '#' || static_cast<unsigned char>(c) < ' ') c = '_';
  }
  return name;
}

std::string dumped(const json& value) {
  return value.dump(-1, ' ', false, json::error_handler_t::replace);
}

daemon::LiveFigures figures_of(const RunningError& error) {
  const ErrorFigures figures = error.figures();
  return {figures.rms, figures.max};
}

/// servotwin.status/1 without what is not on DDS, with the errors since the one before.
std::string status_of(const LiveRecord& record, const std::string& machine) {
  daemon::LiveStatus live;
  live.status = *record.status();
  live.contour = figures_of(record.contour_lately().predicted);
  live.measured_contour = figures_of(record.contour_lately().measured);
  MachineDescription description;
  std::vector<AlarmState> alarms;
  for (const AxisStatus& axis : live.status.axes) {
    description.axes.push_back({axis.name, axis.rotary, ""});
    alarms.push_back(axis.alarm);
    live.axes.emplace_back();
    for (const LiveAxis& seen : record.axes()) {
      if (seen.name != axis.name) continue;
      live.axes.back() = {figures_of(seen.lately.tracking), figures_of(seen.lately.predicted),
                          figures_of(seen.lately.residual)};
    }
  }
  json out = daemon::status_json(live, description, alarms);
  out["machine"] = machine;
  for (const char* unknown : {"cycle_s", "buses", "not_recording", "publish_p50_s", "publish_p99_s",
                              "publish_p999_s", "publish_max_s"})
    out.erase(unknown);
  for (json& axis : out["axes"]) axis.erase("torque_unit");
  return dumped(out);
}

/// servotwin.promotion/1, as the live stream of the page has it, with the model.
std::string promotion_of(const ModelAnnouncement& model, const std::string& machine) {
  json out{{"schema", "servotwin.promotion/1"},
           {"machine", machine},
           {"axis", model.axis},
           {"version", model.version},
           {"parent", model.parent},
           {"created", model.created},
           {"reason", model.reason}};
  if (json file = json::parse(model.model_json, nullptr, false); !file.is_discarded())
    out["model"] = std::move(file);
  return dumped(out);
}

class Bridge {
 public:
  explicit Bridge(const MqttArguments& arguments)
      : machine_(arguments.bus.place.machine),
        root_(arguments.prefix + "/" + machine_),
        where_(arguments.broker),
        client_(broker_of(arguments), root_ + "/state", "offline"),
        relay_(arguments.bus.place) {
    relay_.subscriber().on_model = [this](const ModelAnnouncement& model) {
      client_.publish(topic_of(model.axis, "model"), promotion_of(model, machine_));
    };
    relay_.subscriber().on_diagnosis = [this](const DiagnosisAnnouncement& diagnosis) {
      client_.publish(topic_of(diagnosis.axis, "diagnosis"), diagnosis.diagnosis_json);
    };
  }

  void run(double seconds) {
    const bool interrupted = relay_.run(
        seconds, [this] { look_at_connection(); }, [this](bool there) { pass_on(there); });
    if (!was_connected_ && !interrupted)
      throw std::runtime_error(where_ + " was not reached: " + problem());
  }

 private:
  [[nodiscard]] std::string topic_of(const std::string& axis, const char* what) const {
    return root_ + "/axis/" + level_of(axis) + "/" + what;
  }
  [[nodiscard]] std::string problem() const {
    const std::string known = client_.problem();
    return known.empty() ? "it does not answer" : known;
  }

  void pass_on(bool there) {
    client_.publish(root_ + "/state", there ? "online" : "no daemon");
    if (relay_.now_s() - repeated_s_ >= kRepeat_s) {
      client_.repeat(root_ + "/state");
      repeated_s_ = relay_.now_s();
    }
    const LiveRecord& record = relay_.record();
    if (!there || !record.status()) return;
    PassedNames names("in topics", {});
    for (const AxisStatus& axis : record.status()->axes) names.add(level_of(axis.name), axis.name);
    client_.publish(root_ + "/status", status_of(record, machine_));
    for (const AxisStatus& axis : record.status()->axes)
      client_.publish(topic_of(axis.name, "alarm"), daemon::name_of(axis.alarm));
  }

  void look_at_connection() {
    if (const std::string refusal = client_.refusal(); !refusal.empty())
      throw std::runtime_error(where_ + " refuses the connection: " + refusal +
                               "; see --user and --password-file");
    const bool connected = client_.connected();
    if (connected) {
      if (!was_connected_ || said_)
        say(stderr, "connected to " + where_ + ", topics " + root_ + "/#");
      was_connected_ = true;
      said_ = false;
      apart_s_ = relay_.now_s();
    } else if (!said_ && relay_.now_s() - apart_s_ > kPatience_s) {
      complain("no connection to " + where_ + ": " + problem() + "; trying again");
      said_ = true;
    }
  }

  std::string machine_, root_, where_;
  MqttClient client_;
  Relay relay_;
  double repeated_s_ = 0.0, apart_s_ = 0.0;
  bool was_connected_ = false, said_ = false;
};

void run(const MqttArguments& arguments) {
  const std::string& prefix = arguments.prefix;
  if (prefix.empty() || prefix.find_first_of("+#") != prefix.npos || prefix.front() == '/' ||
      prefix.back() == '/')
    throw UsageError("--prefix: '" + prefix +
                     "' is not the beginning of a topic: no + and #, no / at its ends");
  std::signal(SIGPIPE, SIG_IGN);  // a broker that goes away is a message of libmosquitto
  Bridge(arguments).run(arguments.seconds);
}

}  // namespace

Command add_mqtt(CLI::App& app) {
  const auto arguments = std::make_shared<MqttArguments>();
  OptionTable command(
      app, "mqtt",
      "Passes status, alarms, models and diagnoses of a machine on to an MQTT broker.");
  arguments->bus.declare(command);
  command.option("--broker", arguments->broker, "the broker; port 1883, with TLS 8883")
      .takes("HOST[:PORT]")
      .required();
  command.option("--prefix", arguments->prefix, "what topics begin with").takes("TOPIC");
  command.option("--user", arguments->user, "name at the broker").takes("NAME");
  command
      .option("--password-file", arguments->password_file,
              "file whose first line is the password at the broker")
      .takes("F");
  command.flag("--tls", arguments->tls,
               "encrypt, and trust the authorities that this system trusts");
  command
      .option("--ca-file", arguments->ca_file,
              "encrypt, and trust the certificates in this file (PEM) only")
      .takes("F");
  command.option("--seconds", arguments->seconds, "end after this time")
      .takes("S")
      .between(1e-3, 1e9);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
