// Predicts the errors of a program with the models in force, and learns its correction in virtual
// trials on the twins (ilc/learn.h).
//
// Every axis learns with the inverse of its model, at the largest bandwidth at which the iteration
// converges for all models within the uncertainty, and within peak, rate and bandwidth of its
// configuration. A correction that the gate would refuse anywhere along the program is not sent;
// `why_not_live` gives the reason.
//
// SI units; times since 1970 [ns]. Any thread; the same input gives the same result. Errors:
// std::runtime_error with the reason in one line: no model, a model for another cycle time, no
// bandwidth, no trial better than no correction.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "daemon/config/config.h"
#include "daemon/store/store.h"
#include "drivers/common/messages.h"
#include "ilc/learn.h"

namespace servotwin::daemon {

/// The configuration of learning, and the axes of the machine.
struct LearningRules {
  MachineDescription machine;
  std::vector<std::optional<OffsetLimits>> limits;  ///< of each axis
  IlcConfig ilc;
};
[[nodiscard]] LearningRules learning_rules(const Config& config, const MachineDescription& machine);
/// The part that the real-time loop needs. `in_command`: the command of a frame contains the
/// offset.
[[nodiscard]] OffsetRules offset_rules(const LearningRules& rules, bool in_command,
                                       double drive_timeout_s);

/// Predicts and, if `program.learn`, learns. `in_force`: the models of the machine. `wall_ns`: now.
/// When `stop` is requested, it throws before the next trial.
[[nodiscard]] LearnedProgram learned(const CommandedPath& program, const LearningRules& rules,
                                     const std::vector<StoredModel>& in_force, std::int64_t wall_ns,
                                     const std::stop_token& stop = {});

/// The validation time of its models, that of the model validated longest ago; nothing if another
/// version of one of them is in force by now.
[[nodiscard]] std::optional<std::int64_t> validated_ns(const LearnedProgram& learned,
                                                       const std::vector<StoredModel>& in_force);

/// Whether the validation of its models is too old, so that the gate would refuse it (ilc/gate.h).
[[nodiscard]] bool stale(const LearnedProgram& learned, const LearningRules& rules,
                         std::int64_t wall_ns);

/// The messages in which it is published.
[[nodiscard]] std::vector<CorrectionChunk> chunks_of(const LearnedProgram& learned,
                                                     const LearningRules& rules);

/// The detail of its event (JSON).
[[nodiscard]] std::string detail_of(const LearnedProgram& learned);

}  // namespace servotwin::daemon
