// Frames, predictions, models and status over DDS (Cyclone DDS; topics and QoS: msgs/topics.h).
//
// Without CYCLONEDDS_URI in the environment everything stays on the loopback interface of this
// host. Every message carries the machine's name; a reader takes those of its machine and leaves
// the rest. Errors: constructors throw std::runtime_error with what failed and why, write()
// std::invalid_argument for a name that does not fit. What comes in wrong is counted as malformed,
// never thrown. A reader or a writer belongs to one thread at a time, and its node outlives it.
#pragma once

#include <dds/dds.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "drivers/messages.h"
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

/// Where one machine is spoken of.
struct DdsPlace {
  std::string machine = "machine";  ///< 1..63 characters
  std::uint32_t domain = 0;         ///< 0..230
  std::string partition;            ///< of a cell; empty: the default one
  std::int32_t strength = 0;        ///< of what a daemon says, where there are several of a machine
  /// SCHED_FIFO priority of what Cyclone DDS receives with; 0: normal. It must be permitted. Of the
  /// nodes of a domain the first one decides, and where CYCLONEDDS_URI is set, that.
  int receive_priority = 0;
};

/// Whether CYCLONEDDS_URI says how Cyclone DDS works, in place of this program.
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

/// One message as it lies on the wire, with room that is kept from message to message.
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
  std::uint64_t malformed = 0;  ///< of this machine, and refused
  std::uint64_t foreign = 0;    ///< of another machine
};

/// M is MachineFrame, MachineDescription, MachinePrediction, ModelAnnouncement,
/// DiagnosisAnnouncement, MachineStatus, MachineOffset, ProgramChunk or CorrectionChunk.
template <class M>
class DdsReader {
 public:
  /// `deadline_s`: the longest silence between two messages that is no news; 0: none. Not shorter
  /// than what the writer offers, or they do not find each other.
  explicit DdsReader(const DdsNode& node, double deadline_s = 0.0);

  /// Waits for at most `timeout_s` for the next message of this machine; false if none came.
  bool receive(M& message, double timeout_s);
  /// When the last message was written, by its writer's clock [ns since 1970].
  [[nodiscard]] std::int64_t written_ns() const noexcept { return written_ns_; }
  [[nodiscard]] const ReaderCounts& counts() const noexcept { return counts_; }
  /// Who wrote the last message.
  [[nodiscard]] dds_instance_handle_t writer() const noexcept { return writer_; }
  /// True while a writer of this topic is there. Any thread.
  [[nodiscard]] bool matched() const;
  /// True while this writer is there.
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

/// The machines whose daemons say how they are, in this domain and partition, in alphabetical
/// order. Listens for `listen_s`.
[[nodiscard]] std::vector<std::string> machines_with_daemons(const DdsNode& node, double listen_s);

template <class M>
class DdsWriter {
 public:
  /// `deadline_s`: the time from message to message that is offered to readers; 0: none.
  explicit DdsWriter(const DdsNode& node, double deadline_s = 0.0);

  /// False, and counted, if it could not be sent.
  bool write(const M& message);
  [[nodiscard]] std::uint64_t failed() const noexcept { return failed_; }
  /// As DdsReader::writer() of a reader in the same process calls it.
  [[nodiscard]] dds_instance_handle_t handle() const noexcept;
  /// Waits until `count` readers are there; false if they did not come in time.
  [[nodiscard]] bool wait_for_readers(int count, double timeout_s) const;
  /// Waits until the readers have everything; false if they did not get it in time.
  [[nodiscard]] bool wait_for_delivery(double timeout_s) const;

 private:
  std::string machine_;
  DdsSample sample_;
  DdsEntity writer_;
  std::uint64_t failed_ = 0;
};

}  // namespace servotwin
