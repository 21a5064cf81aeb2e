// servotwin ros2: passes what the daemon publishes over DDS on to subscribers of ROS 2.
#include <cstdlib>
#include <memory>
#include <string>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/live/relay.h"
#include "drivers/dds/ros2_topics.h"

namespace servotwin::cli {
namespace {

constexpr int kLastDomain = 230;
constexpr int kOfEnvironment = -1;

struct Ros2Arguments {
  BusOptions bus;
  int domain = kOfEnvironment;
  std::string name_space = "servotwin";
  double seconds = 0.0;
};

/// As given, or as for every program of ROS 2: ROS_DOMAIN_ID, else 0.
int ros2_domain(const Ros2Arguments& arguments) {
  if (arguments.domain != kOfEnvironment) return arguments.domain;
  const char* given = std::getenv("ROS_DOMAIN_ID");
  if (given == nullptr || *given == '\0') return 0;
  const auto domain = number_of(given);
  if (!domain || !(*domain >= 0.0 && *domain <= kLastDomain) ||
      *domain != static_cast<double>(static_cast<int>(*domain)))
    throw UsageError(std::string("ROS_DOMAIN_ID: '") + given +
                     "' is not a whole number from 0 to " + std::to_string(kLastDomain));
  return static_cast<int>(*domain);
}

/// What the environment asks of every program of ROS 2.
bool keeps_to_this_host() {
  const auto is = [](const char* name, const std::string& value) {
    const char* given = std::getenv(name);
    return given != nullptr && given == value;
  };
  return is("ROS_LOCALHOST_ONLY", "1") || is("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
}

void run(const Ros2Arguments& arguments) {
  const std::string& name = arguments.name_space;
  if (!name.empty() && !usable_ros2_name(name))
    throw UsageError(
        "--namespace: '" + name +
        "' is not a name of ROS 2: letters, digits and _, in parts that are divided by "
        "/ and do not begin with a digit, without / at the ends");
  BusOptions bus = arguments.bus;
  DdsPlace ros2;
  ros2.machine = bus.place.machine;
  ros2.domain = static_cast<std::uint32_t>(ros2_domain(arguments));
  ros2.this_host_only = keeps_to_this_host();
  if (ros2.domain == bus.place.domain && !ros2.this_host_only && !dds_configured_outside())
    throw UsageError("the machine and ROS 2 are both in domain " + std::to_string(ros2.domain) +
                     ", where the machine's messages stay on this host: give the machine another "
                     "domain, or set ROS_LOCALHOST_ONLY=1 so that ROS 2 stays there, too");
  Ros2Topics topics(ros2, name);
  Relay relay(bus.place);
  std::vector<AxisStatus> axes;
  Subscriber& subscriber = relay.subscriber();
  subscriber.on_prediction = [&](const MachinePrediction& prediction) {
    topics.write(prediction, axes);
  };
  subscriber.on_status = [&](const MachineStatus& status) {
    axes = status.axes;
    topics.write(status);
  };
  subscriber.on_model = [&](const ModelAnnouncement& model) { topics.write(model); };
  subscriber.on_diagnosis = [&](const DiagnosisAnnouncement& diagnosis) {
    topics.write(diagnosis);
  };
  const std::string prefix = name.empty() ? "" : name + "/";
  say(stderr, "passing " + bus.text() + " on to ROS 2, domain " + std::to_string(ros2.domain) +
                  ", topics /" + prefix + "prediction, status, model, diagnosis");
  bool was_there = true;
  const bool interrupted = relay.run(
      arguments.seconds, [] {},
      [&](bool there) {
        if (there != was_there) say(stderr, there ? "the daemon is there" : "no daemon is heard");
        was_there = there;
      });
  if (topics.failed() > 0)
    complain(std::to_string(topics.failed()) + " messages could not be sent");
  if (!interrupted && !relay.record().status()) throw no_daemon(subscriber.node(), bus);
}

}  // namespace

Command add_ros2(CLI::App& app) {
  const auto arguments = std::make_shared<Ros2Arguments>();
  OptionTable command(app, "ros2",
                      "Passes predictions, status, models and diagnoses of a machine on to "
                      "subscribers of ROS 2.");
  arguments->bus.declare(command);
  command
      .option("--ros-domain", arguments->domain,
              "domain of ROS 2 (default: that of the environment, ROS_DOMAIN_ID, else 0)")
      .takes("N")
      .between(0, kLastDomain);
  command
      .option("--namespace", arguments->name_space,
              "what the topics begin with (default: servotwin); \"\": nothing")
      .takes("NAME");
  command.option("--seconds", arguments->seconds, "end after this time")
      .takes("S")
      .between(1e-3, 1e9);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
