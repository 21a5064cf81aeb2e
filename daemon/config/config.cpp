#include "daemon/config/config.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "daemon/config/listen_address.h"
#include "daemon/config/secret_file.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/messages.h"
#include "drivers/common/text.h"
#include "drivers/common/toml_section.h"
#include "identification/loop/joint.h"
#include "twin/catalogue.h"
#include "twin/contour.h"

namespace servotwin::daemon {
namespace {

/// Reads the limits of the correction of an axis, all of them or none, in units of the axis.
void read_correction(Section section, std::optional<OffsetLimits>& to) {
  if (!section.given()) return;
  OffsetLimits limits;
  for (const char* key : {"peak", "rate", "bandwidth"}) {
    if (!section.has(key))
      section.report_missing(key, "a correction needs peak, rate and bandwidth");
  }
  section.number("peak", 1e-9, 1.0, "of the axis", limits.peak);
  section.number("rate", 1e-9, 100.0, "of the axis per second", limits.rate);
  section.number("bandwidth", 0.5, 1e5, "Hz", limits.bandwidth_hz);
  section.refuse_unknown();
  to = limits;
}

constexpr std::array<std::pair<std::string_view, SourceKind>, 4> kSources{
    {{"dds", SourceKind::kDds},
     {"replay", SourceKind::kReplay},
     {"can", SourceKind::kCan},
     {"udp", SourceKind::kUdp}}};

SourceKind source_named(std::string_view name) {
  for (const auto& [known, kind] : kSources) {
    if (known == name) return kind;
  }
  return SourceKind::kDds;
}

/// A source that an axis names, with its position in the file.
struct NamedSource {
  std::string name;
  toml::source_region where;
};
/// Those of an axis; empty: not named.
struct AxisSources {
  NamedSource command, encoder;
};

AxisSources read_axis(const toml::table& table, Config& config, Problems& problems) {
  Section section(&table, "axis", problems);
  AxisConfig axis;
  std::string units = "m";
  AxisSources sources;
  if (section.find("name") == nullptr) section.report_missing("name", "every axis needs one");
  section.name("name", 31, axis.name);
  section.one_of("units", {"m", "rad"}, units);
  section.one_of("torque_unit", {"N", "Nm", "A", "V", "%"}, axis.torque_unit);
  section.one_of("source", {"dds", "replay", "can", "udp"}, sources.command.name);
  section.one_of("encoder", {"dds", "can", "udp"}, sources.encoder.name);
  section.name("path", 31, axis.path);
  read_correction(section.section("correction"), axis.correction);
  if (section.has("encoder_in_loop"))
    section.flag("encoder_in_loop", config.diagnose.encoder_in_loop_of[axis.name]);
  section.refuse_unknown();
  if (!sources.command.name.empty()) sources.command.where = table.get("source")->source();
  if (!sources.encoder.name.empty()) sources.encoder.where = table.get("encoder")->source();
  axis.rotary = units == "rad";
  if (axis.rotary && !axis.path.empty())
    section.report("path", "needs linear axes, but this axis has units = 'rad'");
  for (const AxisConfig& other : config.axes) {
    if (!axis.name.empty() && other.name == axis.name) {
      section.report("name", "another axis has the same name");
    }
  }
  config.axes.push_back(axis);
  return sources;
}

/// Reports paths whose number of axes is not 2 to kMaxPathAxes.
void check_paths(const toml::array& axes, const Config& config, Problems& problems) {
  std::map<std::string, int> axes_of;
  for (const AxisConfig& axis : config.axes) ++axes_of[axis.path];
  for (std::size_t i = 0; i < config.axes.size(); ++i) {
    const std::string& path = config.axes[i].path;
    const int count = axes_of[path];
    if (path.empty() || count == 0 || (count >= 2 && count <= kMaxPathAxes)) continue;
    problems.add("axis.path", *axes[i].as_table()->get("path"),
                 "a path has 2 to " + std::to_string(kMaxPathAxes) + " axes, this one has " +
                     std::to_string(count));
    axes_of[path] = 0;  // reported once
  }
}

std::vector<AxisSources> read_axes(const toml::node* node, Config& config, Problems& problems) {
  std::vector<AxisSources> sources;
  if (node == nullptr) return sources;
  const toml::array* axes = node->as_array();
  if (axes == nullptr || !axes->is_array_of_tables()) {
    problems.add("axis", *node, "must be given as [[axis]] tables");
  } else if (axes->size() > kMaxAxes) {
    problems.add(node->source(), "axis: a machine has at most " + std::to_string(kMaxAxes) +
                                     " axes, not " + std::to_string(axes->size()));
  } else {
    for (const toml::node& entry : *axes) {
      sources.push_back(read_axis(*entry.as_table(), config, problems));
    }
    check_paths(*axes, config, problems);
  }
  return sources;
}

/// Reads the name of a file or folder, relative to the configuration.
void read_map(Section& section, const std::string& key, const std::filesystem::path& folder,
              std::filesystem::path& to) {
  std::string file;
  section.text(key, 1, 4096, file);
  if (!file.empty()) to = folder / file;
}

void read_replay(Section& replay, const std::filesystem::path& folder, ReplayConfig& config) {
  if (const toml::node* files = replay.find("files")) {
    const toml::array* list = files->as_array();
    if (list == nullptr || list->empty() || !list->is_homogeneous(toml::node_type::string)) {
      replay.report("files", "must be a list of file names in quotes");
    } else {
      for (const toml::node& name : *list) config.files.emplace_back(*name.value<std::string>());
    }
  } else if (replay.given()) {
    replay.report_missing("files", "is missing: list the recordings to replay");
  }
  replay.text("columns", 0, 4096, config.columns);
  read_map(replay, "can_map", folder, config.can_map);
  replay.number("speed", 0.01, 1000.0, "", config.speed);
  replay.refuse_unknown();
}

void read_can(Section& can, const std::filesystem::path& folder, CanConfig& config) {
  read_map(can, "map", folder, config.map);
  if (can.given() && !can.has("map"))
    can.report_missing("map", "is missing: name the file that maps bits to signals");
  if (const toml::node* names = can.find("interfaces")) {
    const toml::array* list = names->as_array();
    if (list == nullptr || list->empty() || list->size() > 8 ||
        !list->is_homogeneous(toml::node_type::string)) {
      can.report("interfaces", "must be a list of 1 to 8 names in quotes, such as [\"can0\"]");
    } else {
      for (const toml::node& name : *list) config.interfaces.push_back(*name.value<std::string>());
    }
  }
  can.flag("filter", config.filter);
  can.refuse_unknown();
}

void read_udp(Section& udp, const std::filesystem::path& folder, UdpConfig& config) {
  read_map(udp, "map", folder, config.map);
  if (udp.given() && !udp.has("map"))
    udp.report_missing("map", "is missing: name the file that maps bits to signals");
  udp.text("listen", 3, 255, config.listen);
  udp.text("peer", 3, 255, config.peer);
  udp.refuse_unknown();
}

/// Chooses the source among those that the file configures, and a second one if the axes say so.
void choose_sources(Section& source, const std::vector<AxisSources>& named, Config& config,
                    Problems& problems) {
  std::vector<std::string> given;
  for (const auto& [name, kind] : kSources) {
    if (source.has(std::string(name))) given.emplace_back(name);
  }
  const auto first = std::find_if(named.begin(), named.end(), [](const AxisSources& axis) {
    return !axis.command.name.empty();
  });
  const auto encoder = std::find_if(named.begin(), named.end(), [](const AxisSources& axis) {
    return !axis.encoder.name.empty();
  });
  std::string chosen = given.empty() ? "dds" : given.front();
  if (first != named.end()) {
    chosen = first->command.name;
  } else if (encoder != named.end() && encoder->encoder.name != "dds") {
    chosen = "dds";  // an encoder from elsewhere than the command
  } else if (given.size() > 1) {
    source.report(
        given.back(),
        "there is a source." + given.front() + " as well; choose one with axis.source" +
            (source.has("dds") ? ", or move the daemon's own DDS settings to [dds]" : ""));
  }
  config.source = source_named(chosen);
  const auto use = [&](const NamedSource& one, const char* key) {
    const SourceKind kind = one.name.empty() ? config.source : source_named(one.name);
    const auto refuse = [&](const std::string& why) {
      problems.add(one.where, std::string("axis.") + key + " = '" + one.name + "': " + why);
    };
    if (!one.name.empty() && one.name != "dds" && !source.has(one.name))
      refuse("there is no [source." + one.name + "]");
    if (config.uses(kind)) return kind;
    if (kind == SourceKind::kReplay || config.source == SourceKind::kReplay) {
      refuse("another axis has '" + chosen + "', and a recording cannot be joined with a source");
    } else if (config.second) {
      refuse("the axes have '" + chosen + "' and '" + std::string(name_of(*config.second)) +
             "' already; two sources can be joined, not three");
    } else if (kind != SourceKind::kDds && config.source != SourceKind::kDds) {
      refuse("another axis has '" + chosen +
             "'; of two sources one must be dds, since a mapping describes all buses");
    } else {
      config.second = kind;
    }
    return kind;
  };
  for (std::size_t i = 0; i < named.size(); ++i) {
    config.axes[i].command = use(named[i].command, "source");
    config.axes[i].encoder =
        named[i].encoder.name.empty() ? config.axes[i].command : use(named[i].encoder, "encoder");
  }
  for (const std::string& name : given) {
    // What [source.dds] says holds for [dds] as well.
    if (name != "dds" && !config.uses(source_named(name))) config.unused.push_back(name);
  }
}

void read_dds(Section& dds, DdsConfig& config) {
  int domain = static_cast<int>(config.domain);
  dds.integer("domain", 0, 230, domain);
  config.domain = static_cast<std::uint32_t>(domain);
  dds.text("partition", 0, 255, config.partition);
  dds.integer("strength", 0, 1000, config.strength);
}

/// Reads [dds] and [source.dds]; a key that is missing in one of them is taken from the other,
/// because most machines use the same domain and partition for both.
void read_dds(Section out, Section in, Config& config) {
  read_dds(in, config.dds);
  DdsConfig frames = config.dds;
  read_dds(out, config.dds);
  if (!in.has("domain")) frames.domain = config.dds.domain;
  if (!in.has("partition")) frames.partition = config.dds.partition;
  if (frames.domain != config.dds.domain || frames.partition != config.dds.partition)
    config.dds_in = frames;
  if (in.has("strength") && out.has("strength"))
    in.report("strength",
              "is given as dds.strength as well; both set the strength of the daemon's outputs");
  out.refuse_unknown();
  in.refuse_unknown();
}

void read_source(Section source, Section out, const std::vector<AxisSources>& named,
                 const std::filesystem::path& folder, Config& config, Problems& problems) {
  read_dds(std::move(out), source.section("dds"), config);
  Section replay = source.section("replay");
  read_replay(replay, folder, config.replay);
  Section can = source.section("can");
  read_can(can, folder, config.can);
  Section udp = source.section("udp");
  read_udp(udp, folder, config.udp);
  source.refuse_unknown();
  choose_sources(source, named, config, problems);
}

void read_identify(Section section, IdentifyConfig& identify) {
  section.number("window_s", 1.0, 3600.0, "s", identify.window_s);
  section.number("memory_s", 1.0, 3600.0, "s", identify.memory_s);
  section.number("judge_s", 0.5, 3600.0, "s", identify.judge_s);
  section.number("min_improvement", 0.0, 0.9, "", identify.min_improvement);
  std::string method = "joint";
  section.one_of("method", {"joint", "pole-search"}, method);
  IdentifyOptions& options = identify.options;
  options.method = method == "joint" ? Method::kJoint : Method::kPoleSearch;
  std::string friction, structure = "rigid";
  std::vector<std::string> frictions;
  for (const std::size_t kind : friction_kinds()) frictions.emplace_back(identity_of(kind).id);
  section.one_of("friction", frictions, friction);
  if (!friction.empty()) options.friction = kind_of(friction);
  section.integer("modes", 0, static_cast<int>(kMaxModes), options.modes);
  section.flag("coupling", options.coupling);
  section.one_of("structure", {"rigid", "two-mass", "auto"}, structure);
  options.masses = structure == "two-mass" ? Masses::kTwo
                   : structure == "auto"   ? Masses::kChosen
                                           : Masses::kRigid;
  const auto needs = [&](const char* key, const char* what) {
    if (section.find(key) != nullptr) section.report(key, what);
  };
  if (options.method != Method::kJoint) {
    needs("friction", "needs method = \"joint\"");
    if (options.masses != Masses::kRigid) needs("structure", "needs method = \"joint\"");
  }
  if (options.masses != Masses::kRigid && options.modes > 0)
    needs("modes", "two masses have the vibration of their spring: leave out modes or structure");
  PoleBounds& poles = options.bounds;
  section.range("real_pole_hz", 1e-3, 1e5, "Hz", poles.real_min_hz, poles.real_max_hz);
  section.range("omega_hz", 1e-3, 1e5, "Hz", poles.omega_min_hz, poles.omega_max_hz);
  section.range("zeta", 1e-3, 100.0, "", poles.zeta_min, poles.zeta_max);
  const Parameter& delay = TimeDelay::kShapes[0];
  section.number("delay_max_s", delay.lower, delay.upper, "s", options.delay_max_s);
  if (identify.memory_s < identify.window_s) {
    section.report(section.find("window_s") != nullptr ? "window_s" : "memory_s",
                   "a model is fitted to the last memory_s = " + number(identify.memory_s) +
                       " s, which must not be less than window_s = " + number(identify.window_s) +
                       " s");
  }
  section.refuse_unknown();
}

void read_diagnose(Section section, DiagnoseConfig& diagnose) {
  section.number("every_s", 0.0, 1e7, "s", diagnose.every_s);
  section.number("record_s", 5.0, 600.0, "s", diagnose.record_s);
  section.number("false_alarm_days", 0.0, 36525.0, "days of motion", diagnose.false_alarm_days);
  section.number("reference_s", 60.0, 86400.0, "s", diagnose.reference_s);
  section.flag("encoder_in_loop", diagnose.encoder_in_loop);
  section.refuse_unknown();
}

/// Reads the names of axes; each must be one of the configuration.
void read_axis_names(Section& section, const std::string& key, const std::vector<AxisConfig>& axes,
                     std::vector<std::string>& to) {
  const toml::node* given = section.find(key);
  if (given == nullptr) return;
  const toml::array* list = given->as_array();
  if (list == nullptr || (!list->empty() && !list->is_homogeneous(toml::node_type::string)))
    return section.report(key, "must be a list of axis names in quotes");
  for (const toml::node& entry : *list) {
    const std::string name = *entry.value<std::string>();
    if (std::none_of(axes.begin(), axes.end(),
                     [&](const AxisConfig& axis) { return axis.name == name; }))
      section.report(key, "there is no [[axis]] named " + in_quotes(name));
    to.push_back(name);
  }
}

void read_ilc(Section section, const std::vector<AxisConfig>& axes,
              const std::filesystem::path& folder, IlcConfig& ilc) {
  std::string aim = "tracking";
  section.one_of("aim", {"tracking", "contour"}, aim);
  ilc.contour = aim == "contour";
  read_map(section, "programs", folder, ilc.programs);
  std::string recognise = "offer";
  section.one_of("recognise", {"off", "offer", "learn"}, recognise);
  ilc.recognise = recognise == "off"     ? IlcConfig::Recognise::kOff
                  : recognise == "learn" ? IlcConfig::Recognise::kLearn
                                         : IlcConfig::Recognise::kOffer;
  if (recognise == "learn" && ilc.programs.empty())
    section.report("recognise", "puts programs into a folder; give ilc.programs as well");
  section.integer("trials", 1, 100, ilc.trials);
  section.flag("live", ilc.live);
  section.number("ramp_s", 1e-3, 10.0, "s", ilc.ramp_s);
  section.number("validity_s", 1e-3, 1.0, "s", ilc.validity_s);
  section.number("drive_ramp_s", 0.0, 10.0, "s", ilc.drive_ramp_s);
  section.number("model_age_s", 1.0, 1e9, "s", ilc.model_age_s);
  section.number("match_tolerance", 1e-12, 1e-2, "m or rad", ilc.match_tolerance);
  section.number("residual_band", 1.0, 1000.0, "standard deviations", ilc.residual_band);
  section.integer("delay_cycles", 1, 100, ilc.delay_cycles);
  read_axis_names(section, "arm_without_timeout", axes, ilc.arm_without_timeout);
  if (section.has("offset_in_command")) {
    bool in_command = false;
    section.flag("offset_in_command", in_command);
    ilc.in_command = in_command;
  }
  section.refuse_unknown();
}

/// Reads the token: as it is written in the configuration, or from a file.
void read_token(Section& section, const std::filesystem::path& folder, HttpConfig& http) {
  if (const toml::node* token = section.find("token")) {
    http.token = token->value_or(std::string());
    if (!token->is_string() || http.token.size() < kMinTokenBytes ||
        http.token.size() > kMaxTokenBytes)
      section.report_secret("token", "must be a text of " + std::to_string(kMinTokenBytes) +
                                         " to " + std::to_string(kMaxTokenBytes) +
                                         " characters in quotes");
  }
  std::string file;
  section.text("token_file", 1, 4096, file);
  if (file.empty()) return;
  http.token_file = find_secret(file, folder);
  if (section.has("token")) {
    section.report("token_file", "http.token is given as well; give one of them");
    return;
  }
  try {
    http.token = token_in(http.token_file);
  } catch (const std::runtime_error& error) {
    section.report("token_file", error.what());
  }
}

void read_tls(Section& section, const std::filesystem::path& folder, HttpConfig& http) {
  std::string certificate, key;
  section.text("tls_certificate", 1, 4096, certificate);
  section.text("tls_key", 1, 4096, key);
  if (section.has("tls_certificate") != section.has("tls_key"))
    section.report(section.has("tls_key") ? "tls_key" : "tls_certificate",
                   "TLS needs both http.tls_certificate and http.tls_key");
  if (!certificate.empty()) http.tls_certificate = find_secret(certificate, folder);
  if (!key.empty()) http.tls_key = find_secret(key, folder);
}

void read_http(Section section, const std::filesystem::path& folder, HttpConfig& http) {
  section.text("listen", 1, 64, http.listen);
  if (!http.listen.empty() && http.listen != "none" && !parse_listen_address(http.listen))
    section.report("listen", kListenRule);
  read_token(section, folder, http);
  read_tls(section, folder, http);
  if (const toml::node* names = section.find("names")) {
    const toml::array* list = names->as_array();
    if (list == nullptr || (!list->empty() && !list->is_homogeneous(toml::node_type::string))) {
      section.report("names", "must be a list of host names in quotes");
    } else {
      for (const toml::node& name : *list) http.names.push_back(*name.value<std::string>());
    }
  }
  section.refuse_unknown();
}

/// All keys with their values as text; a list, also a list of tables, is one value.
void flatten(const toml::table& table, const std::string& path,
             std::map<std::string, std::string>& out) {
  for (const auto& [key, node] : table) {
    const std::string name = path + std::string(key.str());
    if (const toml::table* inner = node.as_table()) {
      flatten(*inner, name + ".", out);
      continue;
    }
    std::ostringstream shown;
    node.visit([&](const auto& value) { shown << value; });
    std::string text = shown.str();
    std::replace(text.begin(), text.end(), '\n', ' ');
    out[name] = std::move(text);
  }
}

void read_all(const toml::table& table, const std::filesystem::path& folder, Config& config,
              Problems& problems) {
  Section root(&table, "", problems);

  Section machine = root.section("machine");
  machine.name("name", 63, config.machine);
  double cycle_s = 0.0;
  machine.number("cycle_s", kMinCycle_s, kMaxCycle_s, "s", cycle_s);
  if (cycle_s > 0.0) config.cycle_s = cycle_s;
  machine.refuse_unknown();

  const std::vector<AxisSources> named = read_axes(root.find("axis"), config, problems);
  read_source(root.section("source"), root.section("dds"), named, folder, config, problems);
  read_identify(root.section("identify"), config.identify);
  read_diagnose(root.section("diagnose"), config.diagnose);
  Section ilc = root.section("ilc");
  const bool all_by_dds =
      std::all_of(config.axes.begin(), config.axes.end(),
                  [](const AxisConfig& axis) { return axis.command == SourceKind::kDds; });
  if (config.second && !all_by_dds && ilc.has("live"))
    ilc.report(
        "live",
        "of two sources offsets are only sent over DDS: the commands of all axes must come from "
        "there");
  read_ilc(std::move(ilc), config.axes, folder, config.ilc);

  Section store = root.section("store");
  std::string directory;
  store.text("directory", 1, 4096, directory);
  config.store.directory = directory;
  double least_mb = -1.0, most_mb = -1.0;
  store.number("recordings_mb", 0.0, 1e9, "MB", least_mb);
  store.number("recordings_max_mb", 0.0, 1e9, "MB", most_mb);
  if (least_mb >= 0.0) config.store.recordings_mb = least_mb;
  if (most_mb >= 0.0) config.store.recordings_max_mb = most_mb;
  // A wrong recordings_mb has been reported already: its default must not be reported as well.
  const bool both_known = most_mb >= 0.0 && (least_mb >= 0.0 || !store.has("recordings_mb"));
  if (both_known && most_mb < config.store.recordings_mb)
    store.report("recordings_max_mb",
                 "must not be less than recordings_mb = " + number(config.store.recordings_mb));
  store.refuse_unknown();

  read_http(root.section("http"), folder, config.http);

  Section real_time = root.section("real_time");
  real_time.integer("priority", 0, 98, config.priority);
  real_time.integers("cpus", 0, 1023, config.cpus);
  real_time.refuse_unknown();
  root.refuse_unknown();
}

}  // namespace

std::string_view name_of(SourceKind kind) noexcept {
  const auto* const found = std::find_if(kSources.begin(), kSources.end(),
                                         [&](const auto& one) { return one.second == kind; });
  return found->first;
}

CheckedConfig check_config(std::string_view text, const std::string& name) {
  CheckedConfig out;
  Problems problems(name, out.problems);
  try {
    const toml::table table = parse_toml(text, name);
    read_all(table, std::filesystem::path(name).parent_path(), out.config, problems);
    flatten(table, "", out.config.given);
    // Wherever it is from: a new token in the same file is a change as well.
    if (const std::string& token = out.config.http.token; !token.empty())
      out.config.given["http.token"] = token;
    problems.sort();
  } catch (const toml::parse_error& error) {
    problems.add(error.source(), std::string(error.description()));
  }
  return out;
}

CheckedConfig check_config(const std::filesystem::path& file) {
  return check_config(read_text(file), file.string());
}

Config load_config(const std::filesystem::path& file) {
  CheckedConfig checked = check_config(file);
  if (checked.problems.empty()) return checked.config;
  throw std::runtime_error(messages(checked.problems));
}

std::filesystem::path default_store() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::filesystem::path(value == nullptr ? "" : value);
  };
  if (auto state = variable("STATE_DIRECTORY"); !state.empty()) return state;
  if (const auto state = variable("XDG_STATE_HOME"); !state.empty()) return state / "servotwin";
  if (const auto home = variable("HOME"); !home.empty()) {
    return home / ".local" / "state" / "servotwin";
  }
  throw std::runtime_error(
      "no directory for the store: none of STATE_DIRECTORY, XDG_STATE_HOME and HOME is set; give "
      "--store");
}

}  // namespace servotwin::daemon
