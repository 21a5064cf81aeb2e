// What a candidate and the model in force leave of the error on held-out motion, for the rule of
// promotion (daemon/identify/promotion.h).
//
// Errors [m | rad]. Errors of the models' simulation are thrown as std::invalid_argument. Pure: no
// clock, file or thread.
#pragma once

#include <string>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "daemon/identify/promotion.h"
#include "drivers/common/messages.h"
#include "identification/model/model_file.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin::daemon {

/// Fills in what the candidacy says of the errors, on the same samples for both models, behind the
/// lead-in of each segment; returns those of the candidate. Each model has its own copy of the
/// motion, with the axis beside it that it is coupled to. `in_force`: null where no model is in
/// force, which is compared with no prediction. Throws std::invalid_argument if the copies differ.
[[nodiscard]] ErrorFigures judge_on(const std::vector<Segment>& motion, const Model& candidate,
                                    const std::vector<Segment>& motion_in_force,
                                    const Model* in_force, Candidacy& candidacy);

/// Why a model cannot be used for this axis of the machine, "is for ..."; empty: it can. An effect
/// that belongs to the time or the work of its recording predicts no other motion.
[[nodiscard]] std::string why_not_for(const ModelRecord& record, const MachineDescription& machine,
                                      std::size_t axis);

/// The axis of the machine whose acceleration acts on this one in the model: the one that it names,
/// else the first other one; -1: none.
[[nodiscard]] int neighbour_in(const MachineDescription& machine, std::size_t axis,
                               const ModelRecord& record);
/// Why the machine lacks the axis that acts on this one in the model, "needs the motion of ..";
/// empty: it has it, or none acts.
[[nodiscard]] std::string why_no_neighbour(const ModelRecord& record,
                                           const MachineDescription& machine, std::size_t axis);

/// The model as the loop of this machine uses it.
[[nodiscard]] TwinInForce twin_in_force(const ModelRecord& record,
                                        const MachineDescription& machine, std::size_t axis);

/// The motion with what the loop knows of the axis that acts on it in this model: its motion as
/// `other`, the model of that axis in force, predicts it, without what a third axis does to it;
/// null: its commands alone.
void see_as_live(std::vector<Segment>& motion, const ModelRecord& record, const ModelRecord* other);

/// Text from elsewhere for a reason: printable ASCII, of a length that a line can hold.
[[nodiscard]] std::string printable(const std::string& text);

/// "from mine.json, proposed by hand".
[[nodiscard]] std::string by_hand(const std::string& origin);
/// The reason of a model that was forced.
inline constexpr const char* kUnjudged = "put in force without being judged (--force)";
/// Makes a model from a person ready to be promoted: one that was judged is validated now (`now`,
/// ISO 8601); one that was not has no error that is known, and nothing is sent to drives by it.
void admit(ModelRecord& record, bool judged, const std::string& now, double cycle_s);

}  // namespace servotwin::daemon
