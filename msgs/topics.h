// The topics: names, types and QoS in one place. What is sent: msgs/servotwin.idl.
//
// A reader and a writer of a topic are made from the same entry, so that their QoS match. All that
// a daemon says has one owner: of several daemons of a machine the strongest one that is alive.
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
extern const Topic kMachineFrame;  ///< in: one servo cycle; reliable, the last 64
extern const Topic kMachine;       ///< in: who the machine is; reliable, for late joiners
extern const Topic kPrediction;  ///< out: best effort; its writer offers the cycle as the deadline
extern const Topic kModel;       ///< out: the model in force; reliable, for late joiners
extern const Topic kDiagnosis;   ///< out: the last diagnosis; reliable, for late joiners
extern const Topic kStatus;      ///< out: how the daemon is; reliable, for late joiners
extern const Topic kProgram;     ///< in: paths to preview or learn; reliable, for late joiners
extern const Topic kCorrection;  ///< out: what came of a program; reliable
extern const Topic kOffset;      ///< out: best effort, the newest, not older than its lifespan
}  // namespace topics

/// The chunks of one program that are kept: as many as it can have.
inline constexpr int kProgramDepth = 256;

/// A daemon that does not show itself for this long is taken for dead [ns].
inline constexpr dds_duration_t kLivelinessLease_ns = DDS_SECS(2);

/// A live offset that has not been read after this long is of no use to anybody [ns]. When a drive
/// must drop one that it has says the offset itself, to the cycle.
inline constexpr dds_duration_t kOffsetLifespan_ns = DDS_MSECS(100);

}  // namespace servotwin
