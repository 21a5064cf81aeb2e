// Frames, predictions, models and status over DDS (Cyclone DDS; topics and QoS: msgs/topics.h).
//
// Without CYCLONEDDS_URI in the environment everything stays on the loopback interface of this
// host. Every message carries the name of the machine; a reader returns those of its machine only.
// Errors: constructors throw std::runtime_error with what failed and why, write()
// std::invalid_argument for a name that does not fit. An invalid message is counted as malformed
// and never thrown. A reader or a writer belongs to one thread at a time, and its node must outlive
// it.
#pragma once

#include <dds/dds.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "drivers/common/messages.h"
#include "msgs/topics.h"
#include "twin/sample.h"

namespace servotwin {

/// A DDS entity that is deleted, with all that was made from it, when it goes out of scope.
class DdsEntity {
 public:
  /// Throws if `result` is an error: "cannot `what`: reason".
  DdsEntity(dds_entity_t result, const std::string& what);
  DdsEntity(DdsEntity&& other) noexcept : entity_(other.entity_) { other.entity_ = 0; }
  DdsEntity& operator=(DdsEntity&&) = delete;
  ~DdsEntity();
  [[nodiscard]] dds_entity_t get() const noexcept { return entity_; }

 private:
  dds_entity_t entity_ = 0;
};

/// The place of one machine in DDS.
struct DdsPlace {
  std::string machine = "machine";  ///< 1..63 characters
  std::uint32_t domain = 0;         ///< 0..230
  std::string partition;            ///< of a cell; empty: the default one
  /// Ownership strength of the messages of a daemon, if a machine has several daemons.
  std::int32_t strength = 0;
  /// SCHED_FIFO priority of the receive threads of Cyclone DDS; 0: normal scheduling. The process
  /// needs permission for it. The first node of a domain decides; if CYCLONEDDS_URI is set, that
  /// does.
  int receive_priority = 0;
  /// Without CYCLONEDDS_URI: nothing leaves this host. False: as Cyclone DDS does by itself, by
  /// multicast on the network. The first node of a domain in this process decides.
  bool this_host_only = true;
};

/// Whether CYCLONEDDS_URI configures Cyclone DDS, instead of this program.
[[nodiscard]] bool dds_configured_outside();

/// A participant in a domain, with one publisher and one subscriber.
class DdsNode {
 public:
  explicit DdsNode(DdsPlace place);
  [[nodiscard]] const DdsPlace& place() const noexcept { return place_; }
  [[nodiscard]] dds_entity_t participant() const noexcept { return participant_.get(); }
  [[nodiscard]] dds_entity_t publisher() const noexcept { return publisher_.get(); }
  [[nodiscard]] dds_entity_t subscriber() const noexcept { return subscriber_.get(); }

 private:
  DdsPlace place_;
  std::shared_ptr<DdsEntity> domain_;  // shared by the nodes of this process
  DdsEntity participant_, publisher_, subscriber_;
};

/// One message in its wire format; its memory is reused from message to message.
class DdsSample {
 public:
  explicit DdsSample(const dds_topic_descriptor_t& type);
  DdsSample(const DdsSample&) = delete;
  DdsSample& operator=(const DdsSample&) = delete;
  ~DdsSample();
  [[nodiscard]] void* get() const noexcept { return bytes_; }

 private:
  const dds_topic_descriptor_t* type_;
  void* bytes_;
};

struct ReaderCounts {
  std::uint64_t received = 0;
  std::uint64_t malformed = 0;  ///< of this machine, but refused
  std::uint64_t foreign = 0;    ///< of another machine
};

/// M is MachineFrame, MachineDescription, MachinePrediction, ModelAnnouncement, ModelProposal,
/// DiagnosisAnnouncement, MachineStatus, MachineOffset, ProgramChunk or CorrectionChunk.
template <class M>
class DdsReader {
 public:
  /// `deadline_s`: requested deadline QoS, the longest time between two messages; 0: none. It must
  /// not be shorter than the deadline that the writer offers, otherwise they are not matched.
  explicit DdsReader(const DdsNode& node, double deadline_s = 0.0);

  /// Waits for at most `timeout_s` for the next message of this machine; false if none was
  /// received.
  bool receive(M& message, double timeout_s);
  /// When the last message was written, by its writer's clock [ns since 1970].
  [[nodiscard]] std::int64_t written_ns() const noexcept { return written_ns_; }
  [[nodiscard]] const ReaderCounts& counts() const noexcept { return counts_; }
  /// The writer of the last message.
  [[nodiscard]] dds_instance_handle_t writer() const noexcept { return writer_; }
  /// True while there is a writer of this topic, of any machine. Any thread.
  [[nodiscard]] bool matched() const;
  /// True while this writer exists.
  [[nodiscard]] bool matched(dds_instance_handle_t writer) const;
  /// True if this machine has been silent for longer than the deadline since the last call.
  [[nodiscard]] bool deadline_missed() const;

 private:
  enum class Taken { kMessage, kOther, kNothing };
  Taken take(M& message);

  std::string machine_;
  DdsSample sample_;
  DdsEntity reader_, condition_, waitset_;
  std::int64_t written_ns_ = 0;
  dds_instance_handle_t writer_ = 0, instance_ = 0;
  ReaderCounts counts_;
};

/// The machines whose daemons publish a status in this domain and partition, in alphabetical order.
/// Listens for `listen_s`.
[[nodiscard]] std::vector<std::string> machines_with_daemons(const DdsNode& node, double listen_s);

template <class M>
class DdsWriter {
 public:
  /// `deadline_s`: offered deadline QoS, the longest time between two messages; 0: none.
  explicit DdsWriter(const DdsNode& node, double deadline_s = 0.0);

  /// Returns false and counts a failure if the message could not be sent.
  bool write(const M& message);
  [[nodiscard]] std::uint64_t failed() const noexcept { return failed_; }
  /// The handle that DdsReader::writer() returns for this writer in the same process.
  [[nodiscard]] dds_instance_handle_t handle() const noexcept;
  /// Waits until there are `count` readers; false if there are fewer after `timeout_s`.
  [[nodiscard]] bool wait_for_readers(int count, double timeout_s) const;
  /// Waits until all readers have acknowledged all messages; false if not after `timeout_s`.
  [[nodiscard]] bool wait_for_delivery(double timeout_s) const;

 private:
  std::string machine_;
  DdsSample sample_;
  DdsEntity writer_;
  std::uint64_t failed_ = 0;
};

}  // namespace servotwin
