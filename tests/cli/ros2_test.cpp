// servotwin ros2 with a subscriber of Fast DDS, the default middleware of ROS 2, which reads by the
// message files that are compiled on a ROS 2 host; this test is the daemon.
#include <fastcdr/Cdr.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <chrono>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "fake_daemon.h"
#include "program.h"
#include "tests/support/process.h"

namespace servotwin {
namespace {

namespace fastdds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastcdr::Cdr;
using nlohmann::json;
using test::Process;
using testing::HasSubstr;

DdsPlace ros2_place() { return test::place_of_test("ros2-test"); }

/// Members of a message file, in their order: types and names.
std::vector<std::pair<std::string, std::string>> members_of(const std::string& message) {
  std::ifstream file(std::filesystem::path(SERVOTWIN_SOURCE_DIR) /
                     "examples/ros2/servotwin_msgs/msg" / (message + ".msg"));
  EXPECT_TRUE(file) << message;
  std::vector<std::pair<std::string, std::string>> out;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::string type, name;
    if (words >> type >> name && name.find('=') == name.npos) out.emplace_back(type, name);
  }
  return out;
}

template <class T>
json number_from(Cdr& from) {
  T value{};
  from >> value;
  return value;
}

json value_from(Cdr& from, const std::string& type);

json message_from(Cdr& from, const std::string& message) {
  json out;
  for (const auto& [type, name] : members_of(message)) out[name] = value_from(from, type);
  return out;
}

/// By the wire format of ROS 2: plain CDR, lists with their length before them.
json value_from(Cdr& from, const std::string& type) {
  if (type.ends_with("[]")) {
    json out = json::array();
    const auto count = number_from<std::uint32_t>(from).get<std::uint32_t>();
    for (std::uint32_t i = 0; i < count; ++i)
      out.push_back(value_from(from, type.substr(0, type.size() - 2)));
    return out;
  }
  if (type == "builtin_interfaces/Time") {
    const json seconds = number_from<std::int32_t>(from);
    return {{"sec", seconds}, {"nanosec", number_from<std::uint32_t>(from)}};
  }
  static const std::map<std::string, std::function<json(Cdr&)>> kPlain{
      {"bool", number_from<bool>},
      {"uint8", number_from<std::uint8_t>},
      {"int32", number_from<std::int32_t>},
      {"uint32", number_from<std::uint32_t>},
      {"uint64", number_from<std::uint64_t>},
      {"float64", number_from<double>},
      {"string", number_from<std::string>}};
  const auto plain = kPlain.find(type);
  return plain != kPlain.end() ? plain->second(from) : message_from(from, type);
}

/// A message of servotwin_msgs as its middleware knows it.
class RosType final : public fastdds::TopicDataType {
 public:
  explicit RosType(std::string message) : message_(std::move(message)) {
    constexpr std::uint32_t kMostBytes = 1U << 16;
    setName(("servotwin_msgs::msg::dds_::" + message_ + "_").c_str());
    m_typeSize = kMostBytes;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
    Cdr from(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    from.read_encapsulation();
    *static_cast<json*>(data) = message_from(from, message_);
    return from.getSerializedDataLength() <= payload->length;
  }
  bool serialize(void*, rtps::SerializedPayload_t*) override { return false; }
  std::function<std::uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return 0U; };
  }
  void* createData() override { return new json; }
  void deleteData(void* data) override { delete static_cast<json*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }

 private:
  std::string message_;
};

/// As ROS_LOCALHOST_ONLY has it.
fastdds::DomainParticipantQos on_this_host() {
  const auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  transport->interfaceWhiteList.emplace_back("127.0.0.1");
  fastdds::DomainParticipantQos qos = fastdds::PARTICIPANT_QOS_DEFAULT;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(transport);
  return qos;
}

class RosNode {
 public:
  explicit RosNode(std::uint32_t domain)
      : participant_(fastdds::DomainParticipantFactory::get_instance()->create_participant(
            domain, on_this_host())) {}
  RosNode(const RosNode&) = delete;
  RosNode& operator=(const RosNode&) = delete;
  ~RosNode() {
    participant_->delete_contained_entities();
    fastdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  /// A subscriber with the settings of rclcpp: reliable, the last ten; `late`: what was kept, too.
  fastdds::DataReader* subscribe(const std::string& topic, const std::string& message, bool late) {
    const fastdds::TypeSupport type(new RosType(message));
    type.register_type(participant_);
    fastdds::Topic* of =
        participant_->create_topic(topic, type.get_type_name(), fastdds::TOPIC_QOS_DEFAULT);
    fastdds::DataReaderQos qos = fastdds::DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = fastdds::RELIABLE_RELIABILITY_QOS;
    qos.history().kind = fastdds::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 10;
    if (late) qos.durability().kind = fastdds::TRANSIENT_LOCAL_DURABILITY_QOS;
    return participant_->create_subscriber(fastdds::SUBSCRIBER_QOS_DEFAULT)
        ->create_datareader(of, qos);
  }

 private:
  fastdds::DomainParticipant* participant_;
};

/// The first message for which this holds; null after half a minute.
json message_of(
    fastdds::DataReader* reader,
    const std::function<bool(const json&)>& wanted = [](const json&) { return true; }) {
  using eprosima::fastrtps::types::ReturnCode_t;
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  json out;
  fastdds::SampleInfo info;
  while (std::chrono::steady_clock::now() < until) {
    while (reader->take_next_sample(&out, &info) == ReturnCode_t::RETCODE_OK) {
      if (info.valid_data && wanted(out)) return out;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return nullptr;
}

TEST(Ros2, SubscribersHearWhatTheDaemonPublishes) {
  const DdsPlace place = ros2_place();
  const std::uint32_t domain = place.domain + 1;
  const test::FakeDaemon daemon(place);
  Process relay({"servotwin", "ros2", "--dds", "--machine", place.machine, "--domain",
                 std::to_string(place.domain), "--ros-domain", std::to_string(domain)},
                {{{"ROS_LOCALHOST_ONLY", "1"}}});
  RosNode node(domain);
  const json cycle = message_of(
      node.subscribe("rt/servotwin/prediction", "Prediction", false),
      [](const json& m) { return m["axes"].size() == 2 && m["axes"][0]["name"] == "X"; });
  ASSERT_FALSE(cycle.is_null()) << relay.said();
  EXPECT_EQ(cycle["machine"], place.machine);
  EXPECT_GT(cycle["sequence_number"].get<std::uint64_t>(), 0U);
  EXPECT_EQ(cycle["axes"][0]["state"], 2);
  EXPECT_EQ(cycle["axes"][0]["model_version"], 3);
  EXPECT_EQ(cycle["axes"][0]["predicted_error"], 3e-4);
  EXPECT_EQ(cycle["axes"][0]["standard_deviation"], 1.5e-6);
  EXPECT_EQ(cycle["axes"][0]["measured_error"], 3.02e-4);
  EXPECT_EQ(cycle["axes"][0]["residual"], 2e-6);
  EXPECT_EQ(cycle["axes"][1]["name"], "B/1");
  EXPECT_EQ(cycle["axes"][1]["rotary"], true);
  EXPECT_EQ(cycle["axes"][1]["measured_error"], -0.001);
  EXPECT_EQ(cycle["ahead_count"], 0);

  const json status = message_of(node.subscribe("rt/servotwin/status", "Status", true));
  ASSERT_FALSE(status.is_null());
  EXPECT_EQ(status["state"], 2);
  EXPECT_GT(status["frames"].get<std::uint64_t>(), 0U);
  EXPECT_EQ(status["axes"][0]["alarm"], 3);
  EXPECT_EQ(status["axes"][0]["activity"], "collecting");
  EXPECT_EQ(status["axes"][0]["holdout_rms"], 1.5e-6);
  EXPECT_EQ(status["axes"][1]["rotary"], true);

  // They were published once, before their subscribers came.
  const json model = message_of(node.subscribe("rt/servotwin/model", "Model", true));
  ASSERT_FALSE(model.is_null());
  EXPECT_EQ(model["axis"], "X");
  EXPECT_EQ(model["version"], 3);
  EXPECT_EQ(model["parent"], 2);
  EXPECT_EQ(model["reason"], "better");
  EXPECT_THAT(model["model_json"].get<std::string>(), HasSubstr("servotwin.model/1"));
  const json diagnosis = message_of(node.subscribe("rt/servotwin/diagnosis", "Diagnosis", true));
  ASSERT_FALSE(diagnosis.is_null());
  EXPECT_THAT(diagnosis["diagnosis_json"].get<std::string>(), HasSubstr("explained"));
}

TEST(Ros2, WrongUsageIsSaid) {
  const auto said = [](std::vector<std::string> words) {
    words.insert(words.begin(), {"servotwin", "ros2", "--dds", "--machine", "m"});
    Process wrong(words);
    EXPECT_EQ(wrong.end(), 2);
    return wrong.said();
  };
  EXPECT_THAT(said({"--namespace", "hall-2"}),
              HasSubstr("--namespace: 'hall-2' is not a name of ROS 2"));
  EXPECT_THAT(said({"--namespace", "2nd"}), HasSubstr("do not begin with a digit"));
  EXPECT_THAT(said({"--namespace", "hall/"}), HasSubstr("without / at the ends"));
  EXPECT_THAT(said({"--domain", "7", "--ros-domain", "7"}),
              HasSubstr("the machine and ROS 2 are both in domain 7"));
}

}  // namespace
}  // namespace servotwin
