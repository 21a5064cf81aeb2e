// servotwin mtconnect: an adapter through which MTConnect agents see what the daemon publishes over
// DDS.
#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <string_view>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/live/relay.h"
#include "cli/live/shdr.h"
#include "daemon/between/clock.h"
#include "daemon/store/store.h"

namespace servotwin::cli {
namespace {

constexpr const char* kUnavailable = "UNAVAILABLE";
constexpr int kDefaultPort = 7878;  // where agents look for an adapter

struct MtconnectArguments {
  BusOptions bus;
  std::string address = "127.0.0.1";
  int port = kDefaultPort;
  std::filesystem::path device;
  double seconds = 0.0;
};

/// An axis as the daemon and its predictions show it.
struct SeenAxis {
  const AxisStatus& status;
  const LiveAxis& live;
};

/// A length [m | rad] in the unit of the device description.
std::string in_mm_or_degrees(double value, bool rotary) {
  if (!std::isfinite(value)) return kUnavailable;
  return text("%.7g", value * (rotary ? 180.0 / std::numbers::pi : 1e3));
}

std::string rms_of(const SeenAxis& axis, const RunningError& error) {
  return in_mm_or_degrees(error.figures().rms, axis.status.rotary);
}

std::string max_of(const SeenAxis& axis, const RunningError& error) {
  return in_mm_or_degrees(error.figures().max, axis.status.rotary);
}

/// LEVEL|CODE|SEVERITY|QUALIFIER|TEXT
std::string alarm_of(const SeenAxis& axis) {
  switch (axis.status.alarm) {
    case AlarmState::kRaised:
      return "WARNING|RESIDUAL||HIGH|the residual of axis " + shdr_name(axis.status.name) +
             " is larger than usual";
    case AlarmState::kWatching:
      return "NORMAL||||";
    case AlarmState::kOff:
    case AlarmState::kLearning:
      break;
  }
  return std::string(kUnavailable) + "||||";
}

/// CODE|TEXT: the version and why it is in force.
std::string model_of(const SeenAxis& axis) {
  const int version = axis.status.model_version;
  if (version == 0) return std::string("|") + kUnavailable;
  std::string reason;
  for (const ModelAnnouncement& model : axis.live.promotions) {
    if (model.version == version) reason = model.reason;
  }
  return std::to_string(version) + "|" + shdr_word(reason.empty() ? "in force" : reason);
}

std::string diagnosis_of(const SeenAxis& axis) {
  return "|" + (axis.live.diagnosis.empty() ? kUnavailable : shdr_word(axis.live.diagnosis));
}

/// What agents see of an axis: how the device description has it, and its words in a line.
struct AxisItem {
  const char* name;       ///< after that of the axis
  const char* category;   ///< as the device description
  const char* type;       ///< of an error without _LINEAR or _ANGULAR
  const char* statistic;  ///< of the last second; null: none
  const char* what;
  std::string (*words)(const SeenAxis&);
};

constexpr const char* kError = "FOLLOWING_ERROR";
constexpr const char *kRms = "ROOT_MEAN_SQUARE", *kMax = "MAXIMUM";

constexpr AxisItem kAxisItems[] = {
    {"error_rms", "SAMPLE", kError, kRms, "Tracking error: command minus encoder",
     [](const SeenAxis& axis) { return rms_of(axis, axis.live.lately.tracking); }},
    {"error_max", "SAMPLE", kError, kMax, "Tracking error: command minus encoder",
     [](const SeenAxis& axis) { return max_of(axis, axis.live.lately.tracking); }},
    {"predicted_rms", "SAMPLE", kError, kRms, "Tracking error as predicted from the command alone",
     [](const SeenAxis& axis) { return rms_of(axis, axis.live.lately.predicted); }},
    {"residual_rms", "SAMPLE", kError, kRms, "Measured minus predicted tracking error",
     [](const SeenAxis& axis) { return rms_of(axis, axis.live.lately.residual); }},
    {"residual_max", "SAMPLE", kError, kMax, "Measured minus predicted tracking error",
     [](const SeenAxis& axis) { return max_of(axis, axis.live.lately.residual); }},
    {"alarm", "CONDITION", "POSITION", nullptr, "Residual alarm", alarm_of},
    {"model", "EVENT", "MESSAGE", nullptr, "Version of the model in force, and why it is",
     model_of},
    {"diagnosis", "EVENT", "MESSAGE", nullptr, "Last diagnosis: verdict and causes", diagnosis_of},
};

std::string key_of(const AxisStatus& axis, const AxisItem& item) {
  return shdr_name(axis.name) + "_" + item.name;
}

std::string unavailable(const AxisItem& item) {
  const std::string_view category = item.category, type = item.type;
  if (category == "CONDITION") return std::string(kUnavailable) + "||||";
  return type == "MESSAGE" ? std::string("|") + kUnavailable : kUnavailable;
}

/// Throws std::runtime_error if two names of the device description would be the same.
void require_own_names(const std::vector<AxisStatus>& axes) {
  PassedNames names("for MTConnect", {"avail", "axes", "controller", "path", "contour_rms"});
  for (const AxisStatus& axis : axes) {
    names.add(shdr_name(axis.name), axis.name);
    for (const AxisItem& item : kAxisItems) names.add(key_of(axis, item), axis.name);
  }
}

/// One <DataItem>, which lines name by `name`.
std::string data_item(const std::string& device, const std::string& name,
                      const std::string& attributes, const std::string& what) {
  const std::string begin = text("<DataItem id=\"%s_%s\" name=\"%s\" %s", device.c_str(),
                                 name.c_str(), name.c_str(), attributes.c_str());
  if (what.empty()) return begin + "/>\n";
  return begin + ">\n  <Definition><Description>" + what +
         "</Description></Definition>\n</DataItem>\n";
}

std::string error_attributes(bool rotary, const char* statistic) {
  const char* unit = rotary ? "DEGREE" : "MILLIMETER";
  return text("category=\"SAMPLE\" type=\"%s_%s\" statistic=\"%s\" units=\"%s\" nativeUnits=\"%s\"",
              kError, rotary ? "ANGULAR" : "LINEAR", statistic, unit, unit);
}

/// An element with what is in it, two spaces further in.
std::string element(const std::string& name, const std::string& attributes,
                    const std::string& inner) {
  std::string out = "<" + name + (attributes.empty() ? "" : " ") + attributes + ">\n  ";
  for (const char c : inner.substr(0, inner.size() - 1)) {
    out += c;
    if (c == '\n') out += "  ";
  }
  return out + "\n</" + name + ">\n";
}

/// The device description (MTConnectDevices) for the configuration of an agent.
std::string device_description(const std::string& machine, const std::vector<AxisStatus>& axes) {
  require_own_names(axes);
  // An id begins with a letter.
  const std::string device = "servotwin_" + shdr_name(machine);
  const auto named = [&](const std::string& name) {
    return "id=\"" + device + "_" + name + "\" name=\"" + name + "\"";
  };
  std::string all;
  for (const AxisStatus& axis : axes) {
    std::string items;
    for (const AxisItem& item : kAxisItems) {
      const bool is_error = item.statistic != nullptr;
      items += data_item(
          device, key_of(axis, item),
          is_error ? error_attributes(axis.rotary, item.statistic)
                   : std::string("category=\"") + item.category + "\" type=\"" + item.type + "\"",
          item.what);
    }
    all += element(axis.rotary ? "Rotary" : "Linear", named(shdr_name(axis.name)),
                   element("DataItems", "", items));
  }
  const std::string contour =
      element("DataItems", "",
              data_item(device, "contour_rms", error_attributes(false, kRms),
                        "Predicted distance from the commanded path"));
  const std::string components =
      element("Axes", named("axes"), element("Components", "", all)) +
      element("Controller", named("controller"),
              element("Components", "", element("Path", named("path"), contour)));
  const std::string content =
      "<Description>Servotwin, digital twin of the servo drives</Description>\n" +
      element("DataItems", "",
              data_item(device, "avail", "category=\"EVENT\" type=\"AVAILABILITY\"", "")) +
      element("Components", "", components);
  // The agent has a header of its own; this one is for the schema alone.
  const std::string now = daemon::iso_time(daemon::wall_ns());
  const std::string schema = "urn:mtconnect.org:MTConnectDevices:2.2";
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" +
         element("MTConnectDevices",
                 "xmlns=\"" + schema +
                     "\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
                     "xsi:schemaLocation=\"" +
                     schema + " http://schemas.mtconnect.org/schemas/MTConnectDevices_2.2.xsd\"",
                 "<Header creationTime=\"" + now + "\" deviceModelChangeTime=\"" + now +
                     "\" sender=\"servotwin\" instanceId=\"1\" version=\"2.2\" "
                     "assetBufferSize=\"1\" assetCount=\"0\" bufferSize=\"1\"/>\n" +
                     element("Devices", "",
                             element("Device",
                                     "id=\"" + device + "\" name=\"" + shdr_name(machine) +
                                         "\" uuid=\"" + device + "\"",
                                     content)));
}

class Adapter {
 public:
  explicit Adapter(const MtconnectArguments& arguments)
      : bus_(arguments.bus), server_(address_of(arguments)), relay_(bus_.place) {
    server_.on_news = [](const std::string& line) { say(stderr, line); };
    server_.set(daemon::iso_time(daemon::wall_ns()), "avail", kUnavailable);
    say(stderr, "serving " + bus_.text() + " to MTConnect agents at " + server_.address().text());
  }

  void run(double seconds) {
    const bool interrupted = relay_.run(
        seconds, [this] { server_.serve(relay_.now_s()); }, [this](bool there) { pass_on(there); });
    if (!interrupted && !relay_.record().status())
      throw no_daemon(relay_.subscriber().node(), bus_);
  }

 private:
  static daemon::ListenAddress address_of(const MtconnectArguments& arguments) {
    const std::string& given = arguments.address;
    const std::string host = given.find(':') == given.npos ? given : "[" + given + "]";
    const auto out = daemon::parse_listen_address(host + ":" + std::to_string(arguments.port));
    if (!out)
      throw UsageError("--address: '" + given +
                       "' is not a numeric address of this host, such as 127.0.0.1, ::1 or, for "
                       "everybody on the network, 0.0.0.0");
    return *out;
  }

  void pass_on(bool there) {
    const double now_s = relay_.now_s(), period_s = now_s - passed_s_;
    passed_s_ = now_s;
    if (!said_ || there != there_)
      say(stderr, there ? "the daemon is there" : "no daemon: every value is UNAVAILABLE");
    said_ = true;
    there_ = there;
    const LiveRecord& record = relay_.record();
    const std::string now = daemon::iso_time(daemon::wall_ns());
    const std::string second = now + text("@%.3f", period_s);  // what a statistic is of
    server_.set(now, "avail", there && record.status() ? "AVAILABLE" : kUnavailable);
    if (!record.status()) return;
    server_.set(second, "contour_rms",
                there ? in_mm_or_degrees(record.contour_lately().predicted.figures().rms, false)
                      : kUnavailable);
    const std::vector<AxisStatus>& axes = record.status()->axes;
    require_own_names(axes);
    for (std::size_t i = 0; i < axes.size(); ++i) {
      for (const AxisItem& item : kAxisItems)
        server_.set(item.statistic != nullptr ? second : now, key_of(axes[i], item),
                    there ? item.words({axes[i], record.axes()[i]}) : unavailable(item));
    }
  }

  BusOptions bus_;
  ShdrServer server_;
  Relay relay_;
  double passed_s_ = 0.0;
  bool there_ = false, said_ = false;
};

void run(const MtconnectArguments& arguments) {
  if (arguments.device.empty()) {
    Adapter(arguments).run(arguments.seconds);
    return;
  }
  std::FILE* people = people_beside({arguments.device});
  const DdsNode node(arguments.bus.place);
  write_result(arguments.device,
               device_description(arguments.bus.place.machine,
                                  axes_of_daemon(node, arguments.bus, kMaxDiscovery_s)));
  say_written(people, {arguments.device});
}

}  // namespace

Command add_mtconnect(CLI::App& app) {
  const auto arguments = std::make_shared<MtconnectArguments>();
  OptionTable command(
      app, "mtconnect",
      "Serves errors, alarms, models and diagnoses of a machine to MTConnect agents.");
  arguments->bus.declare(command);
  command
      .option(
          "--port", arguments->port,
          "where agents connect (default: " + std::to_string(kDefaultPort) + "); 0: any free port")
      .takes("N")
      .between(0, 65535);
  command
      .option("--address", arguments->address,
              "the address of this host on which agents are served (default: " +
                  arguments->address + ", this host only)")
      .takes("ADDRESS");
  command
      .option_read_by(
          "--device",
          [arguments](const std::string& given) {
            arguments->device = given.empty() ? "-" : given;
          },
          "write the device description for an agent (XML) and end; - or no name is standard "
          "output")
      .takes("OUT")
      .value_optional();
  command.option("--seconds", arguments->seconds, "end after this time")
      .takes("S")
      .between(1e-3, 1e9);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
