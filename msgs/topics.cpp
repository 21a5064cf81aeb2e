#include "msgs/topics.h"

#include "servotwin.h"

namespace servotwin {
namespace {

Qos reliable_stream() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 64);
  return qos;
}

/// Of several daemons of a machine, readers get only the data of the strongest live one.
void let_one_speak(Qos& qos) {
  dds_qset_ownership(qos.get(), DDS_OWNERSHIP_EXCLUSIVE);
  dds_qset_liveliness(qos.get(), DDS_LIVELINESS_AUTOMATIC, kLivelinessLease_ns);
}

Qos newest_best_effort() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 64);  // a reader may fall behind by 64 cycles
  let_one_speak(qos);
  return qos;
}

/// A late offset must not be applied, so it expires.
Qos newest_while_it_lasts() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_lifespan(qos.get(), kOffsetLifespan_ns);
  let_one_speak(qos);
  return qos;
}

Qos for_late_joiners() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  return qos;
}

Qos of_one_daemon() {
  Qos qos = for_late_joiners();
  let_one_speak(qos);
  return qos;
}

/// All chunks of a complete program, also for late joiners.
Qos chunks_for_late_joiners() {
  Qos qos = for_late_joiners();
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, kProgramDepth);
  dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, kProgramDepth,
                              DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  return qos;
}

Qos chunks_of_one_daemon() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, kProgramDepth);
  let_one_speak(qos);
  return qos;
}

}  // namespace

static_assert(kProgramDepth == servotwin_msgs_kMaxProgramChunks);

namespace topics {
const Topic kMachineFrame{"servotwin/machine_frame", &servotwin_msgs_MachineFrame_desc,
                          reliable_stream};
const Topic kMachine{"servotwin/machine", &servotwin_msgs_MachineDescription_desc,
                     for_late_joiners};
const Topic kPrediction{"servotwin/prediction", &servotwin_msgs_Prediction_desc,
                        newest_best_effort};
const Topic kModel{"servotwin/model", &servotwin_msgs_AxisModel_desc, of_one_daemon};
const Topic kModelProposal{"servotwin/model_proposal", &servotwin_msgs_ModelProposal_desc,
                           for_late_joiners};
const Topic kDiagnosis{"servotwin/diagnosis", &servotwin_msgs_Diagnosis_desc, of_one_daemon};
const Topic kStatus{"servotwin/status", &servotwin_msgs_Status_desc, of_one_daemon};
const Topic kProgram{"servotwin/program", &servotwin_msgs_ProgramChunk_desc,
                     chunks_for_late_joiners};
const Topic kCorrection{"servotwin/correction", &servotwin_msgs_CorrectionChunk_desc,
                        chunks_of_one_daemon};
const Topic kOffset{"servotwin/offset", &servotwin_msgs_Offset_desc, newest_while_it_lasts};
}  // namespace topics

}  // namespace servotwin
