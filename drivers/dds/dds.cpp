#include "drivers/dds/dds.h"

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>

#include "drivers/dds/dds_log.h"
#include "drivers/dds/dds_wire.h"
#include "drivers/dds/own_host_bind.h"

namespace servotwin {
namespace {

// One host, no multicast, no network needed. Up to 64 participants find each other by their ports.
// The peer is an address: the name "localhost" is unknown where there is no /etc/hosts.
constexpr const char* kLoopback = R"(<General>
  <Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
  <AllowMulticast>false</AllowMulticast>
</General>
<Discovery>
  <ParticipantIndex>auto</ParticipantIndex>
  <MaxAutoParticipantIndex>63</MaxAutoParticipantIndex>
  <Peers><Peer address="127.0.0.1"/></Peers>
</Discovery>)";

/// The threads between the socket and the waiting reader: the receiver, the one that delivers what
/// the receiver does not, and the one that acknowledges messages and requests lost ones. Cyclone
/// DDS 0.10 would use one thread for each kind of socket, whose priority cannot be set: here one
/// receives from all.
std::string real_time_threads(int priority) {
  std::string out =
      "<Internal><MultipleReceiveThreads>false</MultipleReceiveThreads></Internal><Threads>";
  for (const char* name : {"recv", "dq.user", "tev"}) {
    out += std::string("<Thread name=\"") + name +
           "\"><Scheduling><Class>realtime</Class><Priority>" + std::to_string(priority) +
           "</Priority></Scheduling></Thread>";
  }
  return out + "</Threads>";
}

/// The domain with the settings of this program, shared by all nodes of this process; null if the
/// environment configures it, or Cyclone DDS itself is to.
std::shared_ptr<DdsEntity> domain_of(const DdsPlace& place) {
  limit_dds_log();
  if (dds_configured_outside() || !place.this_host_only) return nullptr;
  const std::uint32_t id = place.domain;
  static std::mutex mutex;
  static std::map<std::uint32_t, std::weak_ptr<DdsEntity>> domains;
  const std::lock_guard lock(mutex);
  std::shared_ptr<DdsEntity> domain = domains[id].lock();
  if (domain == nullptr) {
    const std::string settings =
        kLoopback +
        (place.receive_priority > 0 ? real_time_threads(place.receive_priority) : std::string());
    const OwnHostBind own_host;  // opens the sockets
    domain = std::make_shared<DdsEntity>(dds_create_domain(id, settings.c_str()),
                                         "open DDS domain " + std::to_string(id));
    domains[id] = domain;
  }
  return domain;
}

DdsPlace checked(DdsPlace place) {
  if (!usable_name(place.machine))
    throw std::invalid_argument("machine name '" + place.machine +
                                "': " + std::string(kUsableNameRule));
  // The ports of higher domains lie above 65535 (DDSI-RTPS 9.6.1.1).
  if (place.domain > 230) {
    throw std::invalid_argument("DDS domain " + std::to_string(place.domain) +
                                ": must be 0 to 230");
  }
  return place;
}

Qos partition_of(const DdsPlace& place) {
  Qos qos(dds_create_qos());
  if (!place.partition.empty()) dds_qset_partition1(qos.get(), place.partition.c_str());
  return qos;
}

dds_entity_t topic_of(const DdsNode& node, const Topic& topic) {
  // Belongs to the participant and is deleted with it; creating it twice gives the same topic.
  const dds_entity_t entity =
      dds_create_topic(node.participant(), topic.type, topic.name, nullptr, nullptr);
  if (entity < 0) {
    throw std::runtime_error(std::string("cannot make DDS topic ") + topic.name + ": " +
                             dds_strretcode(entity));
  }
  return entity;
}

dds_duration_t nanoseconds(double seconds) { return static_cast<dds_duration_t>(seconds * 1e9); }

/// The remaining time to wait. Not by dds_time(), because the wall clock may be set meanwhile.
class Patience {
 public:
  explicit Patience(double timeout_s)
      : end_(Clock::now() + std::chrono::nanoseconds(nanoseconds(timeout_s))) {}
  [[nodiscard]] dds_duration_t left_ns() const {
    return std::chrono::nanoseconds(end_ - Clock::now()).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point end_;
};

Qos with_deadline(Qos qos, double deadline_s) {
  if (deadline_s > 0.0) dds_qset_deadline(qos.get(), nanoseconds(deadline_s));
  return qos;
}

/// A reader that gets no processor time loses messages that exceed its history. Its history is
/// longer than that of a writer, which is the topic's.
Qos reader_qos(const Topic& topic, double deadline_s) {
  constexpr std::int32_t kFactor = 16;
  Qos qos = with_deadline(topic.qos(), deadline_s);
  dds_history_kind_t kind = DDS_HISTORY_KEEP_LAST;
  std::int32_t depth = 1;
  if (dds_qget_history(qos.get(), &kind, &depth) && kind == DDS_HISTORY_KEEP_LAST && depth > 1)
    dds_qset_history(qos.get(), kind, kFactor * depth);
  return qos;
}

Qos writer_qos(const Topic& topic, const DdsPlace& place, double deadline_s) {
  Qos qos = with_deadline(topic.qos(), deadline_s);
  dds_qset_ownership_strength(qos.get(), place.strength);
  return qos;
}

}  // namespace

bool dds_configured_outside() {
  const char* configured = std::getenv("CYCLONEDDS_URI");
  return configured != nullptr && *configured != '\0';
}

DdsEntity::DdsEntity(dds_entity_t result, const std::string& what) : entity_(result) {
  if (result < 0) throw std::runtime_error("cannot " + what + ": " + dds_strretcode(result));
}

DdsEntity::~DdsEntity() {
  if (entity_ > 0) dds_delete(entity_);
}

DdsNode::DdsNode(DdsPlace place)
    : place_(checked(std::move(place))),
      domain_(domain_of(place_)),
      participant_(dds_create_participant(place_.domain, nullptr, nullptr),
                   "join DDS domain " + std::to_string(place_.domain)),
      publisher_(dds_create_publisher(participant_.get(), partition_of(place_).get(), nullptr),
                 "make a DDS publisher"),
      subscriber_(dds_create_subscriber(participant_.get(), partition_of(place_).get(), nullptr),
                  "make a DDS subscriber") {}

DdsSample::DdsSample(const dds_topic_descriptor_t& type)
    : type_(&type), bytes_(dds_alloc(type.m_size)) {}  // zeroed

DdsSample::~DdsSample() { dds_sample_free(bytes_, type_, DDS_FREE_ALL); }

template <class M>
DdsReader<M>::DdsReader(const DdsNode& node, double deadline_s)
    : machine_(node.place().machine),
      sample_(*Wire<M>::topic().type),
      reader_(dds_create_reader(node.subscriber(), topic_of(node, Wire<M>::topic()),
                                reader_qos(Wire<M>::topic(), deadline_s).get(), nullptr),
              std::string("read ") + Wire<M>::topic().name),
      condition_(dds_create_readcondition(reader_.get(), DDS_ANY_STATE), "wait for DDS data"),
      waitset_(dds_create_waitset(node.participant()), "wait for DDS data") {
  if (dds_waitset_attach(waitset_.get(), condition_.get(), 0) < 0) {
    throw std::runtime_error("cannot wait for DDS data");
  }
}

template <class M>
auto DdsReader<M>::take(M& message) -> Taken {
  void* samples[1] = {sample_.get()};
  dds_sample_info_t info;
  if (dds_take(reader_.get(), samples, &info, 1, 1) <= 0) return Taken::kNothing;
  if (!info.valid_data) return Taken::kOther;  // a writer appeared or disappeared
  const auto& sample = *static_cast<const typename Wire<M>::Sample*>(sample_.get());
  if (machine_ != sample.machine) {
    ++counts_.foreign;
    return Taken::kOther;
  }
  if (!Wire<M>::decode(sample, message)) {
    ++counts_.malformed;
    return Taken::kOther;
  }
  ++counts_.received;
  written_ns_ = info.source_timestamp;
  writer_ = info.publication_handle;
  instance_ = info.instance_handle;
  return Taken::kMessage;
}

template <class M>
bool DdsReader<M>::receive(M& message, double timeout_s) {
  const Patience patience(timeout_s);
  while (true) {
    switch (take(message)) {
      case Taken::kMessage:
        return true;
      case Taken::kOther:
        if (patience.left_ns() <= 0) return false;
        break;
      case Taken::kNothing: {
        const dds_duration_t left = patience.left_ns();
        if (left <= 0) return false;
        dds_waitset_wait(waitset_.get(), nullptr, 0, left);
      }
    }
  }
}

template <class M>
bool DdsReader<M>::matched() const {
  return dds_get_matched_publications(reader_.get(), nullptr, 0) > 0;
}

template <class M>
bool DdsReader<M>::matched(dds_instance_handle_t writer) const {
  dds_builtintopic_endpoint_t* endpoint = dds_get_matched_publication_data(reader_.get(), writer);
  if (endpoint == nullptr) return false;
  dds_builtintopic_free_endpoint(endpoint);
  return true;
}

template <class M>
bool DdsReader<M>::deadline_missed() const {
  // It is reported again with every missed deadline, so another machine's silence hides that of
  // this machine only briefly.
  dds_requested_deadline_missed_status_t status;
  return dds_get_requested_deadline_missed_status(reader_.get(), &status) == DDS_RETCODE_OK &&
         status.total_count_change > 0 && status.last_instance_handle == instance_;
}

std::vector<std::string> machines_with_daemons(const DdsNode& node, double listen_s) {
  using StatusWire = Wire<MachineStatus>;
  const DdsEntity reader(dds_create_reader(node.subscriber(), topic_of(node, StatusWire::topic()),
                                           reader_qos(StatusWire::topic(), 0.0).get(), nullptr),
                         "read " + std::string(StatusWire::topic().name));
  dds_sleepfor(nanoseconds(listen_s));
  const DdsSample sample(*StatusWire::topic().type);
  void* samples[1] = {sample.get()};
  dds_sample_info_t info;
  std::set<std::string> machines;
  while (dds_take(reader.get(), samples, &info, 1, 1) > 0) {
    if (info.valid_data && info.instance_state == DDS_ALIVE_INSTANCE_STATE)
      machines.insert(static_cast<const StatusWire::Sample*>(sample.get())->machine);
  }
  return {machines.begin(), machines.end()};
}

template <class M>
DdsWriter<M>::DdsWriter(const DdsNode& node, double deadline_s)
    : machine_(node.place().machine),
      sample_(*Wire<M>::topic().type),
      writer_(
          dds_create_writer(node.publisher(), topic_of(node, Wire<M>::topic()),
                            writer_qos(Wire<M>::topic(), node.place(), deadline_s).get(), nullptr),
          std::string("write ") + Wire<M>::topic().name) {}

template <class M>
bool DdsWriter<M>::write(const M& message) {
  auto& sample = *static_cast<typename Wire<M>::Sample*>(sample_.get());
  std::memcpy(sample.machine, machine_.c_str(), machine_.size() + 1);
  Wire<M>::encode(message, sample);
  if (dds_write(writer_.get(), &sample) == DDS_RETCODE_OK) return true;
  ++failed_;
  return false;
}

template <class M>
dds_instance_handle_t DdsWriter<M>::handle() const noexcept {
  dds_instance_handle_t handle = 0;
  dds_get_instance_handle(writer_.get(), &handle);
  return handle;
}

template <class M>
bool DdsWriter<M>::wait_for_readers(int count, double timeout_s) const {
  const Patience patience(timeout_s);
  while (dds_get_matched_subscriptions(writer_.get(), nullptr, 0) < count) {
    if (patience.left_ns() <= 0) return false;
    dds_sleepfor(DDS_MSECS(5));
  }
  return true;
}

template <class M>
bool DdsWriter<M>::wait_for_delivery(double timeout_s) const {
  return dds_wait_for_acks(writer_.get(), nanoseconds(timeout_s)) == DDS_RETCODE_OK;
}

template class DdsReader<MachineFrame>;
template class DdsReader<MachineDescription>;
template class DdsReader<MachinePrediction>;
template class DdsReader<ModelAnnouncement>;
template class DdsReader<ModelProposal>;
template class DdsReader<DiagnosisAnnouncement>;
template class DdsReader<MachineStatus>;
template class DdsReader<MachineOffset>;
template class DdsReader<ProgramChunk>;
template class DdsReader<CorrectionChunk>;
template class DdsWriter<MachineFrame>;
template class DdsWriter<MachineDescription>;
template class DdsWriter<MachinePrediction>;
template class DdsWriter<ModelAnnouncement>;
template class DdsWriter<ModelProposal>;
template class DdsWriter<DiagnosisAnnouncement>;
template class DdsWriter<MachineStatus>;
template class DdsWriter<MachineOffset>;
template class DdsWriter<ProgramChunk>;
template class DdsWriter<CorrectionChunk>;

}  // namespace servotwin
