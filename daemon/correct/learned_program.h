// A program and what the models in force say of it: predicted errors, and the correction that was
// learned in virtual trials on the twins (ilc/learn.h).
//
// Every axis learns by the inverse of its model, with the largest bandwidth at which all models
// within its uncertainty contract, within peak, rate and bandwidth of its configuration. What the
// gate would not let through along the whole program is not sent: `why_not_live` says so.
//
// SI units; times since 1970 [ns]. Any thread; the same input gives the same result. Errors:
// std::runtime_error with the reason, one line: no model, a model at another cycle, no bandwidth.
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
#include "drivers/messages.h"
#include "ilc/learn.h"

namespace servotwin::daemon {

/// What is configured about learning and the axes of the machine.
struct LearningRules {
  MachineDescription machine;
  std::vector<std::optional<OffsetLimits>> limits;  ///< of each axis
  IlcConfig ilc;
};
[[nodiscard]] LearningRules learning_rules(const Config& config, const MachineDescription& machine);
/// The same as the real-time loop needs it. `in_command`: the frames' command has the offset in it.
[[nodiscard]] OffsetRules offset_rules(const LearningRules& rules, bool in_command);

/// `in_force`: the models of the machine. When `stop` is requested it is given up before its next
/// trial, by throwing.
[[nodiscard]] LearnedProgram learned(const CommandedPath& program, const LearningRules& rules,
                                     const std::vector<StoredModel>& in_force, std::int64_t wall_ns,
                                     const std::stop_token& stop = {});

/// When of these models the one was last found to hold for which that is the longest ago; nothing
/// where another version is in force by now.
[[nodiscard]] std::optional<std::int64_t> validated_ns(const LearnedProgram& learned,
                                                       const std::vector<StoredModel>& in_force);

/// Whether its models are too old by now: the gate would refuse it (ilc/gate.h).
[[nodiscard]] bool stale(const LearnedProgram& learned, const LearningRules& rules,
                         std::int64_t wall_ns);

/// As it is published.
[[nodiscard]] std::vector<CorrectionChunk> chunks_of(const LearnedProgram& learned,
                                                     const LearningRules& rules);

/// As an event's detail: JSON.
[[nodiscard]] std::string detail_of(const LearnedProgram& learned);

}  // namespace servotwin::daemon
