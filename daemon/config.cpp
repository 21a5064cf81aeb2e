#include "daemon/config.h"

#include <fcntl.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cstdlib>
#include <initializer_list>
#include <sstream>
#include <stdexcept>

#include "drivers/file_handle.h"
#include "drivers/messages.h"
#include "drivers/text.h"
#include "twin/catalogue.h"

namespace servotwin {
namespace {

/// The problems of one file, as they are found.
class Problems {
 public:
  Problems(std::string file, std::vector<ConfigProblem>& found)
      : file_(std::move(file)), found_(found) {}

  void add(const toml::source_region& where, std::string what) {
    found_.push_back({file_, static_cast<int>(where.begin.line),
                      static_cast<int>(where.begin.column), std::move(what)});
  }
  void add(const std::string& key, const toml::node& value, const std::string& rule) {
    if (value.is_table()) {
      add(value.source(), key + ": " + rule);
      return;
    }
    std::ostringstream shown;
    value.visit([&](const auto& node) { shown << node; });
    std::string text = shown.str();
    std::replace(text.begin(), text.end(), '\n', ' ');
    add(value.source(), key + " = " + text + ": " + rule);
  }
  void sort() {
    std::stable_sort(found_.begin(), found_.end(),
                     [](const ConfigProblem& a, const ConfigProblem& b) {
                       return a.line != b.line ? a.line < b.line : a.column < b.column;
                     });
  }

 private:
  std::string file_;
  std::vector<ConfigProblem>& found_;
};

std::string bounds(double lower, double upper, const std::string& unit) {
  return number(lower) + " to " + number(upper) + (unit.empty() ? "" : " " + unit);
}

/// One table of the file: hands out its keys, and knows in the end which were never asked for.
class Section {
 public:
  Section(const toml::table* table, std::string path, Problems& problems)
      : table_(table), path_(std::move(path)), problems_(problems) {}

  [[nodiscard]] bool given() const { return table_ != nullptr; }

  /// The value of a key, if it is there.
  const toml::node* find(const std::string& key) {
    known_.push_back(key);
    return table_ == nullptr ? nullptr : table_->get(key);
  }

  Section section(const std::string& key) {
    const toml::node* node = find(key);
    if (node != nullptr && !node->is_table())
      report(key, "must be a table: [" + name_of(key) + "]");
    return {node == nullptr ? nullptr : node->as_table(), name_of(key), problems_};
  }

  void number(const std::string& key, double lower, double upper, const std::string& unit,
              double& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const auto value = node->is_number() ? node->value<double>() : std::nullopt;
    if (value && *value >= lower && *value <= upper) {
      to = *value;
    } else {
      report(key, "must be a number from " + bounds(lower, upper, unit));
    }
  }

  void integer(const std::string& key, int lower, int upper, int& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const auto value = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
    if (value && *value >= lower && *value <= upper) {
      to = static_cast<int>(*value);
    } else {
      report(key, "must be a whole number from " + bounds(lower, upper, ""));
    }
  }

  void integers(const std::string& key, int lower, int upper, std::vector<int>& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const toml::array* list = node->as_array();
    std::vector<int> values;
    bool good = list != nullptr;
    for (std::size_t i = 0; good && i < list->size(); ++i) {
      const auto value = (*list)[i].is_integer() ? (*list)[i].value<std::int64_t>() : std::nullopt;
      good = value && *value >= lower && *value <= upper;
      if (good) values.push_back(static_cast<int>(*value));
    }
    if (good) {
      to = std::move(values);
    } else {
      report(key, "must be a list of whole numbers from " + bounds(lower, upper, ""));
    }
  }

  void text(const std::string& key, std::size_t shortest, std::size_t longest, std::string& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const auto value = node->value_exact<std::string>();
    if (value && value->size() >= shortest && value->size() <= longest) {
      to = *value;
    } else {
      report(key, "must be a text of " + std::to_string(shortest) + " to " +
                      std::to_string(longest) + " characters in quotes");
    }
  }

  /// A text that can stand in file names, column names and messages.
  void name(const std::string& key, std::size_t longest, std::string& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const auto value = node->value_exact<std::string>();
    if (value && value->size() <= longest && usable_name(*value)) {
      to = *value;
    } else {
      report(key, "must be 1 to " + std::to_string(longest) +
                      " letters, digits or any of . _ -, not beginning with a dot");
    }
  }

  void one_of(const std::string& key, std::initializer_list<std::string> allowed, std::string& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const auto value = node->value_exact<std::string>();
    if (value && std::find(allowed.begin(), allowed.end(), *value) != allowed.end()) {
      to = *value;
    } else {
      std::string list;
      for (const std::string& one : allowed) list += (list.empty() ? "'" : ", '") + one + "'";
      report(key, "must be one of " + list);
    }
  }

  /// [lowest, highest] of something that is searched between them.
  void range(const std::string& key, double lower, double upper, const std::string& unit,
             double& from, double& to) {
    const toml::node* node = find(key);
    if (node == nullptr) return;
    const toml::array* pair = node->as_array();
    std::optional<double> a, b;
    if (pair != nullptr && pair->size() == 2 && (*pair)[0].is_number() && (*pair)[1].is_number()) {
      a = (*pair)[0].value<double>();
      b = (*pair)[1].value<double>();
    }
    if (a && b && *a >= lower && *b <= upper && *a < *b) {
      from = *a;
      to = *b;
    } else {
      report(key, "must be [lowest, highest] within " + bounds(lower, upper, unit));
    }
  }

  /// A key that is there breaks this rule.
  void report(const std::string& key, const std::string& rule) {
    problems_.add(name_of(key), *table_->get(key), rule);
  }
  void report_missing(const std::string& key, const std::string& why) {
    problems_.add(table_->source(), name_of(key) + ": " + why);
  }

  void refuse_unknown() const {
    if (table_ == nullptr) return;
    for (const auto& [key, node] : *table_) {
      const std::string name(key.str());
      if (std::find(known_.begin(), known_.end(), name) != known_.end()) continue;
      problems_.add(key.source(),
                    name_of(name) + ": there is no such key" + did_you_mean(name, known_));
    }
  }

 private:
  [[nodiscard]] std::string name_of(const std::string& key) const {
    return path_.empty() ? key : path_ + "." + key;
  }

  const toml::table* table_;
  std::string path_;
  Problems& problems_;
  std::vector<std::string> known_;
};

/// The source that an axis names, with the place where it does.
struct NamedSource {
  std::string name;
  toml::source_region where;
};

NamedSource read_axis(const toml::table& table, Config& config, Problems& problems) {
  Section section(&table, "axis", problems);
  AxisConfig axis;
  std::string units = "m";
  NamedSource source;
  if (section.find("name") == nullptr) section.report_missing("name", "every axis needs one");
  section.name("name", 31, axis.name);
  section.one_of("units", {"m", "rad"}, units);
  section.one_of("torque_unit", {"N", "Nm", "A", "V", "%"}, axis.torque_unit);
  section.one_of("source", {"dds", "replay"}, source.name);
  section.refuse_unknown();
  if (!source.name.empty()) source.where = table.get("source")->source();
  axis.rotary = units == "rad";
  for (const AxisConfig& other : config.axes) {
    if (!axis.name.empty() && other.name == axis.name) {
      section.report("name", "there is an axis of this name already");
    }
  }
  config.axes.push_back(axis);
  return source;
}

std::vector<NamedSource> read_axes(const toml::node* node, Config& config, Problems& problems) {
  std::vector<NamedSource> sources;
  if (node == nullptr) return sources;
  const toml::array* axes = node->as_array();
  if (axes == nullptr || !axes->is_array_of_tables()) {
    problems.add("axis", *node, "must be given as [[axis]] tables");
  } else if (axes->size() > kMaxAxes) {
    problems.add(node->source(), "axis: a machine has at most " + std::to_string(kMaxAxes) +
                                     " axes, not " + std::to_string(axes->size()));
  } else {
    for (const toml::node& entry : *axes) {
      NamedSource source = read_axis(*entry.as_table(), config, problems);
      if (!source.name.empty()) sources.push_back(std::move(source));
    }
  }
  return sources;
}

void read_replay(Section& replay, ReplayConfig& config) {
  if (const toml::node* files = replay.find("files")) {
    const toml::array* list = files->as_array();
    if (list == nullptr || list->empty() || !list->is_homogeneous(toml::node_type::string)) {
      replay.report("files", "must be a list of file names in quotes");
    } else {
      for (const toml::node& name : *list) config.files.emplace_back(*name.value<std::string>());
    }
  } else if (replay.given()) {
    replay.report_missing("files", "is missing; which recordings are to be replayed?");
  }
  replay.text("columns", 0, 4096, config.columns);
  replay.number("speed", 0.01, 1000.0, "", config.speed);
  replay.refuse_unknown();
}

void read_source(Section source, const std::vector<NamedSource>& named, Config& config,
                 Problems& problems) {
  Section dds = source.section("dds");
  int domain = static_cast<int>(config.dds.domain);
  dds.integer("domain", 0, 230, domain);
  config.dds.domain = static_cast<std::uint32_t>(domain);
  dds.text("partition", 0, 255, config.dds.partition);
  dds.refuse_unknown();
  Section replay = source.section("replay");
  read_replay(replay, config.replay);
  source.refuse_unknown();

  std::string chosen = replay.given() && !dds.given() ? "replay" : "dds";
  if (!named.empty()) {
    chosen = named.front().name;
  } else if (replay.given() && dds.given()) {
    source.report("replay", "there is a source.dds as well; say which one with axis.source");
  }
  for (const NamedSource& other : named) {
    if (other.name != chosen) {
      problems.add(other.where, "axis.source = '" + other.name + "': another axis says '" + chosen +
                                    "', and all axes of a machine come from one source");
    }
  }
  if (chosen == "replay" && !replay.given()) {
    problems.add(named.front().where, "axis.source = 'replay': there is no [source.replay]");
  }
  config.source = chosen == "replay" ? SourceKind::kReplay : SourceKind::kDds;
}

void read_identify(Section section, IdentifyConfig& identify) {
  section.number("window_s", 1.0, 3600.0, "s", identify.window_s);
  section.number("memory_s", 1.0, 3600.0, "s", identify.memory_s);
  section.number("judge_s", 0.5, 3600.0, "s", identify.judge_s);
  section.number("min_improvement", 0.0, 0.9, "", identify.min_improvement);
  std::string method = "joint";
  section.one_of("method", {"joint", "pole-search"}, method);
  identify.options.method = method == "joint" ? Method::kJoint : Method::kPoleSearch;
  PoleBounds& poles = identify.options.bounds;
  section.range("real_pole_hz", 1e-3, 1e5, "Hz", poles.real_min_hz, poles.real_max_hz);
  section.range("omega_hz", 1e-3, 1e5, "Hz", poles.omega_min_hz, poles.omega_max_hz);
  section.range("zeta", 1e-3, 100.0, "", poles.zeta_min, poles.zeta_max);
  const Parameter& delay = TimeDelay::kShapes[0];
  section.number("delay_max_s", delay.lower, delay.upper, "s", identify.options.delay_max_s);
  if (identify.memory_s < identify.window_s) {
    section.report(section.find("window_s") != nullptr ? "window_s" : "memory_s",
                   "a model is sought on the last memory_s = " + number(identify.memory_s) +
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
  section.refuse_unknown();
}

/// Every key with its value as text; a list, also one of tables, is one value.
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

void read_all(const toml::table& table, Config& config, Problems& problems) {
  Section root(&table, "", problems);

  Section machine = root.section("machine");
  machine.name("name", 63, config.machine);
  double cycle_s = 0.0;
  machine.number("cycle_s", 1e-5, 1.0, "s", cycle_s);
  if (cycle_s > 0.0) config.cycle_s = cycle_s;
  machine.refuse_unknown();

  const std::vector<NamedSource> named = read_axes(root.find("axis"), config, problems);
  read_source(root.section("source"), named, config, problems);
  read_identify(root.section("identify"), config.identify);
  read_diagnose(root.section("diagnose"), config.diagnose);

  Section store = root.section("store");
  std::string directory;
  store.text("directory", 1, 4096, directory);
  config.store.directory = directory;
  store.number("recordings_mb", 0.0, 1e9, "MB", config.store.recordings_mb);
  store.refuse_unknown();

  Section real_time = root.section("real_time");
  real_time.integer("priority", 0, 98, config.priority);
  real_time.integers("cpus", 0, 1023, config.cpus);
  real_time.refuse_unknown();
  root.refuse_unknown();
}

}  // namespace

std::string ConfigProblem::message() const {
  const std::string place =
      line == 0 ? "" : ":" + std::to_string(line) + ":" + std::to_string(column);
  return file + place + ": " + what;
}

CheckedConfig check_config(std::string_view text, const std::string& name) {
  CheckedConfig out;
  Problems problems(name, out.problems);
  try {
    const toml::table table = toml::parse(text, name);
    read_all(table, out.config, problems);
    flatten(table, "", out.config.given);
    problems.sort();
  } catch (const toml::parse_error& error) {
    problems.add(error.source(), std::string(error.description()));
  }
  return out;
}

CheckedConfig check_config(const std::filesystem::path& file) {
  const FileHandle handle = FileHandle::open(file, O_RDONLY);
  std::string text;
  char block[4096];
  while (const std::size_t count = handle.read(block, sizeof block)) text.append(block, count);
  return check_config(text, file.string());
}

Config load_config(const std::filesystem::path& file) {
  CheckedConfig checked = check_config(file);
  if (checked.problems.empty()) return checked.config;
  std::string message;
  for (const ConfigProblem& problem : checked.problems) {
    if (!message.empty()) message += '\n';
    message += problem.message();
  }
  throw std::runtime_error(message);
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
      "no place for the store: neither STATE_DIRECTORY, XDG_STATE_HOME nor HOME is set; give "
      "--store");
}

}  // namespace servotwin
