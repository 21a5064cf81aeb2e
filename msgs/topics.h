// The DDS topics: name, type and QoS of each in one place. The types are in msgs/servotwin.idl.
//
// Readers and writers of a topic are created from the same entry, so their QoS match. All topics
// that a daemon publishes have exclusive ownership: of several daemons of a machine, readers get
// the data of the live one with the highest strength.
//
// Any thread. Errors: none.
#pragma once

#include <dds/dds.h>

#include <memory>

namespace servotwin {

struct DeleteQos {
  void operator()(dds_qos_t* qos) const noexcept { dds_delete_qos(qos); }
};
using Qos = std::unique_ptr<dds_qos_t, DeleteQos>;

struct Topic {
  const char* name;
  const dds_topic_descriptor_t* type;
  Qos (*qos)();
};

namespace topics {
// "in": the daemon subscribes; "out": it publishes. Transient local: late joiners get the last
// data.
extern const Topic kMachineFrame;  ///< in: one servo cycle; reliable, the last 64
extern const Topic kMachine;       ///< in: description of the machine; reliable, transient local
extern const Topic kPrediction;    ///< out: prediction of a cycle; best effort, deadline: the cycle
extern const Topic kModel;         ///< out: the model in force; reliable, transient local
extern const Topic kModelProposal;  ///< in: a model to be judged; reliable, transient local
extern const Topic kDiagnosis;      ///< out: the last diagnosis; reliable, transient local
extern const Topic kStatus;         ///< out: state of the daemon; reliable, transient local
extern const Topic kProgram;        ///< in: paths to preview or learn; reliable, transient local
extern const Topic kCorrection;     ///< out: result of a program; reliable
extern const Topic kOffset;         ///< out: the newest offset, within its lifespan; best effort
}  // namespace topics

/// History depth of kProgram: the largest number of chunks of one program.
inline constexpr int kProgramDepth = 256;

/// Liveliness lease: a daemon that is silent for this long counts as dead [ns].
inline constexpr dds_duration_t kLivelinessLease_ns = DDS_SECS(2);

/// Lifespan of a live offset that has not been read [ns]. The time at which a drive must drop an
/// offset that it has read is a field of the offset.
inline constexpr dds_duration_t kOffsetLifespan_ns = DDS_MSECS(100);

}  // namespace servotwin
