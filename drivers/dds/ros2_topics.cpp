#include "drivers/dds/ros2_topics.h"

#include <algorithm>
#include <cctype>
#include <stdexcept>

#include "servotwin_ros2.h"  // generated from msgs/servotwin_ros2.idl

namespace servotwin {
namespace {

using Time = builtin_interfaces_msg_dds__Time_;
using RosAxisPrediction = servotwin_msgs_msg_dds__AxisPrediction_;
using RosAxisStatus = servotwin_msgs_msg_dds__AxisStatus_;

constexpr int kDepthOfStream = 64;      // as servotwin/prediction has it (msgs/topics.cpp)
constexpr int kDepthOfAxes = kMaxAxes;  // without a key: one for every axis
constexpr dds_duration_t kBlocking_ns = DDS_MSECS(10);  // by a subscriber that does not follow

DdsEntity writer_of(const DdsNode& node, const std::string& topic_name,
                    const dds_topic_descriptor_t& type, int depth, bool for_late_joiners) {
  const DdsEntity topic(
      dds_create_topic(node.participant(), &type, topic_name.c_str(), nullptr, nullptr),
      "make DDS topic " + topic_name);
  const Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, kBlocking_ns);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, depth);
  if (for_late_joiners) {
    dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, depth, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  return {dds_create_writer(node.publisher(), topic.get(), qos.get(), nullptr),
          "write " + topic_name};
}

std::string topic_name(const std::string& name_space, const char* what) {
  return "rt/" + name_space + (name_space.empty() ? "" : "/") + what;
}

Time time_of(std::int64_t ns) {
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  std::int64_t seconds = ns / kSecond_ns, rest = ns % kSecond_ns;
  if (rest < 0) --seconds, rest += kSecond_ns;
  return {static_cast<std::int32_t>(seconds), static_cast<std::uint32_t>(rest)};
}

/// The C of the IDL has no const; dds_write() changes nothing.
char* chars(const std::string& from) { return const_cast<char*>(from.c_str()); }

template <class Sequence, class Element>
void lend(Sequence& to, std::vector<Element>& from) {
  to._length = to._maximum = static_cast<std::uint32_t>(from.size());
  to._buffer = from.data();
  to._release = false;
}

}  // namespace

bool usable_ros2_name(const std::string& name) {
  const auto letter = [](char c) {
    return std::isalpha(static_cast<unsigned char>(c)) || c == '_';
  };
  char before = '/';
  for (const char c : name) {
    const bool digit = c >= '0' && c <= '9';
    if (!(letter(c) || (before != '/' && (digit || c == '/')))) return false;
    before = c;
  }
  return !name.empty() && before != '/';
}

Ros2Topics::Ros2Topics(const DdsPlace& place, const std::string& name_space)
    : node_(place),
      machine_(place.machine),
      predictions_(writer_of(node_, topic_name(name_space, "prediction"),
                             servotwin_msgs_msg_dds__Prediction__desc, kDepthOfStream, false)),
      statuses_(writer_of(node_, topic_name(name_space, "status"),
                          servotwin_msgs_msg_dds__Status__desc, 1, true)),
      models_(writer_of(node_, topic_name(name_space, "model"), servotwin_msgs_msg_dds__Model__desc,
                        kDepthOfAxes, true)),
      diagnoses_(writer_of(node_, topic_name(name_space, "diagnosis"),
                           servotwin_msgs_msg_dds__Diagnosis__desc, kDepthOfAxes, true)) {}

void Ros2Topics::send(const DdsEntity& writer, const void* message) {
  if (dds_write(writer.get(), message) != DDS_RETCODE_OK) ++failed_;
}

void Ros2Topics::write(const MachinePrediction& prediction, const std::vector<AxisStatus>& axes) {
  const auto count = static_cast<std::size_t>(prediction.axis_count);
  const auto ahead = static_cast<std::size_t>(prediction.ahead_count);
  const AxisStatus unknown;
  std::vector<RosAxisPrediction> all;
  std::vector<double> errors;
  for (std::size_t i = 0; i < count; ++i) {
    const AxisPrediction& from = prediction.axes[i];
    const AxisStatus& axis = i < axes.size() ? axes[i] : unknown;
    all.push_back({chars(axis.name), axis.rotary, static_cast<std::uint8_t>(from.state),
                   from.model_version, from.predicted_error, from.standard_deviation,
                   from.measured_error, from.residual});
    errors.insert(errors.end(), prediction.ahead[i].begin(),
                  prediction.ahead[i].begin() + static_cast<std::ptrdiff_t>(ahead));
  }
  servotwin_msgs_msg_dds__Prediction_ out{};
  out.stamp = time_of(prediction.time_ns);
  out.machine = chars(machine_);
  out.sequence_number = prediction.sequence;
  out.contour_error = prediction.contour_error;
  out.measured_contour_error = prediction.measured_contour_error;
  lend(out.axes, all);
  out.ahead_count = static_cast<std::uint32_t>(ahead);
  lend(out.ahead_error, errors);
  send(predictions_, &out);
}

void Ros2Topics::write(const MachineStatus& status) {
  std::vector<RosAxisStatus> all;
  for (const AxisStatus& axis : status.axes) {
    all.push_back({chars(axis.name), axis.rotary, static_cast<std::uint8_t>(axis.alarm),
                   axis.model_version, axis.holdout_rms, chars(axis.activity), axis.refused,
                   chars(axis.last_refusal)});
  }
  servotwin_msgs_msg_dds__Status_ out{};
  out.stamp = time_of(status.time_ns);
  out.machine = chars(machine_);
  out.state = static_cast<std::uint8_t>(status.state);
  out.frame_rate = status.frame_rate_hz;
  out.frames = status.frames;
  out.lost = status.lost;
  out.repeated = status.repeated;
  out.malformed = status.malformed;
  out.time_jumps = status.time_jumps;
  out.not_finite = status.not_finite;
  out.overruns = status.overruns;
  out.predictions_dropped = status.predictions_dropped;
  out.rows_dropped = status.rows_dropped;
  out.wake_p50 = status.wake_p50_s;
  out.wake_p99 = status.wake_p99_s;
  out.work_p50 = status.work_p50_s;
  out.work_p99 = status.work_p99_s;
  out.work_max = status.work_max_s;
  lend(out.axes, all);
  out.last_error = chars(status.last_error);
  send(statuses_, &out);
}

void Ros2Topics::write(const ModelAnnouncement& model) {
  const servotwin_msgs_msg_dds__Model_ out{
      chars(machine_),      chars(model.axis),   model.version,          model.parent,
      chars(model.created), chars(model.reason), chars(model.model_json)};
  send(models_, &out);
}

void Ros2Topics::write(const DiagnosisAnnouncement& diagnosis) {
  const servotwin_msgs_msg_dds__Diagnosis_ out{chars(machine_), chars(diagnosis.axis),
                                               chars(diagnosis.diagnosis_json)};
  send(diagnoses_, &out);
}

}  // namespace servotwin
