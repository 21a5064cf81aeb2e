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

Qos newest_best_effort() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 64);  // a reader may fall behind by 64 cycles
  return qos;
}

Qos for_late_joiners() {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  return qos;
}

Qos alive() {
  Qos qos = for_late_joiners();
  dds_qset_liveliness(qos.get(), DDS_LIVELINESS_AUTOMATIC, kLivelinessLease_ns);
  return qos;
}

}  // namespace

namespace topics {
const Topic kMachineFrame{"servotwin/machine_frame", &servotwin_msgs_MachineFrame_desc,
                          reliable_stream};
const Topic kMachine{"servotwin/machine", &servotwin_msgs_MachineDescription_desc,
                     for_late_joiners};
const Topic kPrediction{"servotwin/prediction", &servotwin_msgs_Prediction_desc,
                        newest_best_effort};
const Topic kModel{"servotwin/model", &servotwin_msgs_AxisModel_desc, for_late_joiners};
const Topic kDiagnosis{"servotwin/diagnosis", &servotwin_msgs_Diagnosis_desc, for_late_joiners};
const Topic kStatus{"servotwin/status", &servotwin_msgs_Status_desc, alive};
}  // namespace topics

}  // namespace servotwin
