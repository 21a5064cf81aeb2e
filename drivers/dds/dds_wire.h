// The wire format of each message: converts between the program's types and those of
// msgs/servotwin.idl. For drivers/dds/dds.cpp only. `decode` returns false for an inconsistent
// message; it never throws. `encode` throws std::invalid_argument for a name that does not fit.
// Values are not checked: a NaN affects one axis of one cycle, and its user handles it.
#pragma once

#include "drivers/common/messages.h"
#include "msgs/topics.h"
#include "servotwin.h"  // generated from msgs/servotwin.idl
#include "twin/sample.h"

namespace servotwin {

template <class M>
struct Wire;

template <>
struct Wire<MachineFrame> {
  using Sample = servotwin_msgs_MachineFrame;
  static const Topic& topic() { return topics::kMachineFrame; }
  static bool decode(const Sample& sample, MachineFrame& frame) noexcept;
  static void encode(const MachineFrame& frame, Sample& sample);
};

template <>
struct Wire<MachineDescription> {
  using Sample = servotwin_msgs_MachineDescription;
  static const Topic& topic() { return topics::kMachine; }
  static bool decode(const Sample& sample, MachineDescription& description);
  static void encode(const MachineDescription& description, Sample& sample);
};

template <>
struct Wire<MachinePrediction> {
  using Sample = servotwin_msgs_Prediction;
  static const Topic& topic() { return topics::kPrediction; }
  static bool decode(const Sample& sample, MachinePrediction& prediction) noexcept;
  static void encode(const MachinePrediction& prediction, Sample& sample);
};

template <>
struct Wire<ModelAnnouncement> {
  using Sample = servotwin_msgs_AxisModel;
  static const Topic& topic() { return topics::kModel; }
  static bool decode(const Sample& sample, ModelAnnouncement& model);
  static void encode(const ModelAnnouncement& model, Sample& sample);
};

template <>
struct Wire<ModelProposal> {
  using Sample = servotwin_msgs_ModelProposal;
  static const Topic& topic() { return topics::kModelProposal; }
  static bool decode(const Sample& sample, ModelProposal& proposal);
  static void encode(const ModelProposal& proposal, Sample& sample);
};

template <>
struct Wire<DiagnosisAnnouncement> {
  using Sample = servotwin_msgs_Diagnosis;
  static const Topic& topic() { return topics::kDiagnosis; }
  static bool decode(const Sample& sample, DiagnosisAnnouncement& diagnosis);
  static void encode(const DiagnosisAnnouncement& diagnosis, Sample& sample);
};

template <>
struct Wire<MachineStatus> {
  using Sample = servotwin_msgs_Status;
  static const Topic& topic() { return topics::kStatus; }
  static bool decode(const Sample& sample, MachineStatus& status);
  static void encode(const MachineStatus& status, Sample& sample);
};

template <>
struct Wire<MachineOffset> {
  using Sample = servotwin_msgs_Offset;
  static const Topic& topic() { return topics::kOffset; }
  static bool decode(const Sample& sample, MachineOffset& offset) noexcept;
  static void encode(const MachineOffset& offset, Sample& sample);
};

template <>
struct Wire<ProgramChunk> {
  using Sample = servotwin_msgs_ProgramChunk;
  static const Topic& topic() { return topics::kProgram; }
  static bool decode(const Sample& sample, ProgramChunk& chunk);
  static void encode(const ProgramChunk& chunk, Sample& sample);
};

template <>
struct Wire<CorrectionChunk> {
  using Sample = servotwin_msgs_CorrectionChunk;
  static const Topic& topic() { return topics::kCorrection; }
  static bool decode(const Sample& sample, CorrectionChunk& chunk);
  static void encode(const CorrectionChunk& chunk, Sample& sample);
};

}  // namespace servotwin
