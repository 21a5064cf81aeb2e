#include "drivers/recordings/mcap/joint_sets.h"

#include <algorithm>
#include <array>
#include <bit>
#include <map>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "drivers/common/memory.h"
#include "drivers/common/text.h"
#include "drivers/recordings/mcap/mcap_file.h"
#include "drivers/recordings/mcap/ros_message.h"
#include "twin/sample.h"

namespace servotwin {
namespace {

struct JointRole {
  std::string_view field, channel;
};
constexpr std::array kJointRoles{
    JointRole{"reference.positions", "command"},
    JointRole{"desired.positions", "command"},
    JointRole{"feedback.positions", "actual"},
    JointRole{"actual.positions", "actual"},
    JointRole{"position", "actual"},
    JointRole{"feedback.effort", "torque"},
    JointRole{"actual.effort", "torque"},
    JointRole{"effort", "torque"},
};
// Limits for damaged files; a robot has some ten joints, a topic one set of them.
constexpr std::size_t kMostJoints = 1000, kMostJointSets = 100;
// Slots of a message: of its texts, and of its numbers, where those of the fields follow.
constexpr int kNames = 0, kSeconds = 0, kNanoseconds = 1, kFirstField = 2;

/// Gives a slot to each field that has a number per joint.
void find_fields(RosField& message, std::vector<JointField>& found) {
  for (RosField& field : message.fields) {
    const bool repeats = field.repeats != RosField::Repeats::kNever;
    const std::string_view path = field.path;
    const std::string_view last = path.substr(path.rfind('.') + 1);
    const bool position = last.find("position") != last.npos;
    if (field.kind == RosField::Kind::kMessage && !repeats) {
      find_fields(field, found);
    } else if (field.kind == RosField::Kind::kFloat && repeats && (position || last == "effort")) {
      const auto* role = std::find_if(kJointRoles.begin(), kJointRoles.end(),
                                      [&](const JointRole& known) { return known.field == path; });
      field.slot = kFirstField + static_cast<int>(found.size());
      found.push_back({field.path, std::string(role == kJointRoles.end() ? "" : role->channel),
                       position ? "[rad]" : "[Nm]"});
    }
  }
}

/// Gives slots to the names and to the stamp; false if there are no names.
bool find_names(RosField& message) {
  bool named = false;
  for (RosField& field : message.fields) {
    if (!named && (field.path == "joint_names" || field.path == "name") &&
        field.kind == RosField::Kind::kText && field.repeats != RosField::Repeats::kNever) {
      field.slot = kNames;
      named = true;
    }
    for (RosField& stamp : field.fields) {
      for (RosField& part : stamp.fields) {
        if (part.kind == RosField::Kind::kFloat || part.bytes != sizeof(std::uint32_t)) continue;
        if (part.path == "header.stamp.sec") part.slot = kSeconds;
        if (part.path == "header.stamp.nanosec") part.slot = kNanoseconds;
      }
    }
  }
  return named;
}

/// A topic of the file, and why it is not read.
struct JointTopic {
  RosField message;
  JointSet empty;  // what the sets of its messages begin with
  bool is_read = false;
  std::string why_not;
};

JointTopic joint_topic(const McapChannel& channel, const McapSchema* schema) {
  JointTopic topic;
  if (channel.encoding != "cdr") {
    topic.why_not = "its messages are " + in_quotes(channel.encoding) + ", not 'cdr'";
  } else if (schema == nullptr || schema->definition.empty()) {
    topic.why_not = "the file has no definition of it";
  } else if (schema->encoding != "ros2msg") {
    topic.why_not = "its definition is " + in_quotes(schema->encoding) + ", not 'ros2msg'";
  } else {
    topic.empty.topic = in_one_line(channel.topic);
    topic.empty.type = in_one_line(schema->type);
    try {
      topic.message = parse_ros_definition(schema->type, schema->definition);
      find_fields(topic.message, topic.empty.fields);
      topic.is_read = find_names(topic.message) && !topic.empty.fields.empty();
    } catch (const std::runtime_error& unknown) {
      topic.why_not = unknown.what();
    }
  }
  return topic;
}

class JointReader {
 public:
  explicit JointReader(const std::filesystem::path& file) : file_(file), mcap_(file) {}

  JointSets read() {
    McapMessage message;
    while (mcap_.next(message)) {
      auto known = topics_.find(message.channel);
      if (known == topics_.end()) {
        const McapChannel& channel = mcap_.channels().at(message.channel);
        known = topics_.emplace(message.channel, joint_topic(channel, mcap_.schema(channel.schema)))
                    .first;
      }
      if (known->second.is_read) add(known->second, message);
    }
    if (!mcap_.missing().empty()) read_.notes.push_back(file_.string() + ": " + mcap_.missing());
    if (read_.sets.empty()) {
      throw std::runtime_error(file_.string() +
                               ": no message has positions of joints, as those of the types " +
                               "control_msgs/msg/JointTrajectoryControllerState and " +
                               "sensor_msgs/msg/JointState do. The file has: " + listed_topics() +
                               (mcap_.missing().empty() ? "" : "; it is " + mcap_.missing()));
    }
    for (std::size_t i = 0; i < read_.sets.size(); ++i)
      put_in_order(read_.sets[i], log_time_ns_[i]);
    return std::move(read_);
  }

 private:
  [[nodiscard]] std::string listed_topics() const {
    std::vector<std::string> all;
    for (const auto& [id, channel] : mcap_.channels()) {
      const McapSchema* schema = mcap_.schema(channel.schema);
      const auto known = topics_.find(id);
      const std::string why = known == topics_.end() ? "no message" : known->second.why_not;
      all.push_back(in_one_line(channel.topic) + " (" +
                    (schema == nullptr ? "no type" : in_one_line(schema->type)) +
                    (why.empty() ? "" : ": " + why) + ")");
    }
    return all.empty() ? "no topic" : listed(all);
  }

  void add(const JointTopic& topic, const McapMessage& message) {
    values_.texts.resize(1);
    values_.numbers.resize(kFirstField + topic.empty.fields.size());
    try {
      decode_cdr(topic.message, message.bytes, values_);
    } catch (const std::runtime_error& damaged) {
      throw std::runtime_error(file_.string() + ": a message of " + topic.empty.title() +
                               " cannot be read: " + damaged.what());
    }
    std::vector<std::string>& names = values_.texts[kNames];
    std::transform(names.begin(), names.end(), names.begin(), in_one_line);
    if (names.empty()) return;
    if (names.size() > kMostJoints)
      throw std::runtime_error(file_.string() + ": a message of " + topic.empty.topic + " names " +
                               std::to_string(names.size()) + " joints; the limit is " +
                               std::to_string(kMostJoints));
    const std::size_t index = index_of(topic, names);
    JointSet& set = read_.sets[index];
    require_room(set);
    const auto part = [&](std::size_t slot) {
      return values_.numbers[slot].empty() ? 0.0 : std::max(values_.numbers[slot][0], 0.0);
    };
    set.time_ns.push_back(static_cast<std::uint64_t>(part(kSeconds)) * 1'000'000'000U +
                          static_cast<std::uint64_t>(part(kNanoseconds)));
    log_time_ns_[index].push_back(message.log_time_ns);
    auto values = set.values.begin();
    for (std::size_t field = 0; field < set.fields.size(); ++field) {
      const std::vector<double>& numbers = values_.numbers[kFirstField + field];
      for (const std::string& joint : set.joints) {
        const auto at = std::find(names.begin(), names.end(), joint) - names.begin();
        values++->push_back(numbers.size() == names.size() ? numbers[static_cast<std::size_t>(at)]
                                                           : kAbsent);
      }
    }
  }

  /// The set with these joints, in any order.
  std::size_t index_of(const JointTopic& topic, const std::vector<std::string>& names) {
    std::pair<const JointTopic*, std::vector<std::string>> key{&topic, names};
    std::sort(key.second.begin(), key.second.end());
    const auto [known, is_new] = index_.emplace(std::move(key), read_.sets.size());
    if (!is_new) return known->second;
    if (read_.sets.size() == kMostJointSets)
      throw std::runtime_error(file_.string() + ": the messages have more than " +
                               std::to_string(kMostJointSets) + " different sets of joints");
    const std::size_t columns = topic.empty.fields.size() * names.size();
    stored_bytes_ += static_cast<double>(columns * sizeof(std::vector<double>));
    require_plausible_size(file_, stored_bytes_, "values", kMcapRemedy);
    read_.sets.push_back(topic.empty);
    read_.sets.back().joints = names;
    read_.sets.back().values.resize(columns);
    log_time_ns_.emplace_back();
    return known->second;
  }

  // Before the vectors grow to twice their size.
  void require_room(const JointSet& set) {
    const std::size_t rows = set.time_ns.size(), columns = set.values.size() + 2;
    stored_bytes_ += static_cast<double>(columns * sizeof(double));
    if (!std::has_single_bit(rows)) return;
    require_plausible_size(file_, stored_bytes_, "values", kMcapRemedy);
    require_memory(file_, rows, columns);
  }

  // By the stamps; by the time of the recorder if no message has a stamp.
  void put_in_order(JointSet& set, const std::vector<std::uint64_t>& log_time_ns) {
    const auto note = [&](const std::string& what) {
      read_.notes.push_back(set.title() + ": " + what);
    };
    std::vector<std::size_t> rows(set.time_ns.size());
    std::iota(rows.begin(), rows.end(), std::size_t{0});
    const auto unstamped = static_cast<std::size_t>(
        std::count(set.time_ns.begin(), set.time_ns.end(), std::uint64_t{0}));
    if (unstamped == rows.size()) {
      set.time_ns = log_time_ns;
      note("its stamps are 0; the time is that of the recorder");
    } else if (unstamped > 0) {
      std::erase_if(rows, [&](std::size_t row) { return set.time_ns[row] == 0; });
      note("left out: " + counted(unstamped, "message") + " with the stamp 0");
    }
    const auto earlier = [&](std::size_t a, std::size_t b) {
      return set.time_ns[a] < set.time_ns[b];
    };
    if (!std::is_sorted(rows.begin(), rows.end(), earlier)) {
      std::stable_sort(rows.begin(), rows.end(), earlier);
      note("its messages are put in the order of their stamps");
    }
    const auto arrange = [&](auto& values) {
      auto arranged = values;
      arranged.clear();
      for (const std::size_t row : rows) arranged.push_back(values[row]);
      values = std::move(arranged);
    };
    arrange(set.time_ns);
    for (std::vector<double>& values : set.values) arrange(values);
  }

  std::filesystem::path file_;
  McapFile mcap_;
  std::map<std::uint16_t, JointTopic> topics_;
  std::map<std::pair<const JointTopic*, std::vector<std::string>>, std::size_t> index_;
  JointSets read_;
  std::vector<std::vector<std::uint64_t>> log_time_ns_;  // of the sets
  RosValues values_;
  double stored_bytes_ = 0.0;
};

}  // namespace

JointSets read_joint_sets(const std::filesystem::path& file) { return JointReader(file).read(); }

}  // namespace servotwin
