// From a recording to a model: splits the data, chooses the structure, fits the model and validates
// it on held-out data.
//
// Structure (order 3 or 2, with or without a delay, with or without a constant force) is chosen
// within the training data, on a part of them that no fit uses; the held-out data take no part in
// any choice. The joint method continues from there: it chooses the friction model in the same way
// and refines all parameters in free simulation (identification/loop/joint.h).
//
// SI units; rotary axes in rad.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "identification/loop/pole_search.h"
#include "identification/model/model_file.h"
#include "identification/recording/segments.h"

namespace servotwin {

enum class Method { kPoleSearch, kFullLs, kJoint };

/// Whether the axis is rigid, or motor and load are two masses on a spring (docs/theory.md 3.11).
enum class Masses { kRigid, kTwo, kChosen };

struct IdentifyOptions {
  Method method = Method::kPoleSearch;
  PoleBounds bounds;
  bool pole_constraints = true;  ///< full LS only
  /// Of the time of the data; the rest is held out. None: training_share_of().
  std::optional<double> training_share;
  int order = 0;  ///< 2 or 3; 0: chosen by validation error
  std::optional<std::size_t>
      friction;               ///< joint only: index in the catalogue; none: all are compared
  double delay_max_s = 0.02;  ///< longest delay considered; 0: none
  int modes =
      0;  ///< most modes of vibration; their number is chosen by validation error; not full LS
  /// kTwo: two masses, the encoder at the motor or at the load as it fits better. kChosen: if they
  /// predict the last third of the training data clearly better than a rigid axis. Joint only,
  /// without modes.
  Masses masses = Masses::kRigid;
  /// Try also what belongs to an axis beyond loop, friction and a constant force: a load that
  /// swings with a rotary axis; where much is left, a filter of the control (joint only, without
  /// modes, another axis and two masses). The diagnosis seeks both itself.
  bool beyond_loop = true;
  /// Where a torque was recorded: add it to the model (motor_torque.h), and fit both together
  /// (joint only) unless they contradict each other (torque_output.h). Not full LS.
  bool with_torque = true;
  bool coupling = false;  ///< identify the force that another axis causes on this one; not full LS
  /// An earlier model of this axis: its structure is kept, and steps 2 to 4 of
  /// identification/loop/joint.h start from its loop. Not for full LS.
  std::optional<Model> start;
  /// Apply the training share to every segment instead of to all segments in order. For segments of
  /// different motions, so that training and held-out data contain all of them.
  bool split_each = false;
  /// Refuse a model whose held-out residual is not below the tracking error, or whose loop is too
  /// fast for the recording.
  bool must_predict = true;
};

/// One structure that was tried, for output.
struct StructureTrial {
  int order = 3;
  std::vector<std::size_t> effects;  ///< kinds
  double validation_rms = kAbsent;   ///< on the last third of the training data [m | rad]
  bool chosen = false;
  int modes = 0;          ///< number of modes of vibration
  std::string ruled_out;  ///< why it was excluded, whatever its error; empty: it was compared
  bool moving = false;    ///< its modes change with position
};

struct Identified {
  ModelRecord record;
  std::vector<StructureTrial> trials;
  /// Why the model must not be used (no valid loop, predicts nothing); empty: it may be used. What
  /// the motion does not excite is in record.excitation: a user may accept that, the daemon does
  /// not.
  std::vector<std::string> refusals;
  /// Why the recorded torque is no output of the model; empty: it is, or none was recorded.
  std::string no_torque;
  /// That of them which says that command and encoder seem to be exchanged; empty: they do not.
  /// Nothing else that was recorded can be trusted then either.
  std::string exchanged;
};

/// Throws std::runtime_error, with the remedy, if nothing can be identified from the recording
/// whatever is fitted: no motion, too short, a copy of the command. Any thread.
void require_usable(const SegmentedAxis& axis, const IdentifyOptions& options = {});

/// Throws std::runtime_error, with the remedy, if the data cannot be identified (as above);
/// std::invalid_argument for options out of range. Any thread. Does not read the clock: the caller
/// sets `created` and `time_taken_s`.
[[nodiscard]] Identified identify(const SegmentedAxis& axis, const IdentifyOptions& options = {});

/// The residual of free simulation over all segments, without the samples that determine the
/// starting state, at least `skip_s` of each: models whose starting states differ in length are
/// compared on the same samples. NaN if every segment is too short.
[[nodiscard]] ErrorFigures judge(const Model& model, const std::vector<Segment>& segments,
                                 double skip_s = 0.0);

/// Why a loop whose pair of poles has this natural frequency [rad/s] may be faster than its
/// recording shows; empty: it is not.
[[nodiscard]] std::string why_too_few_samples(double omega, double sample_time_s);

/// Whether zeros in the right half plane cause most of this loop's lag: the loop imitates a delay.
[[nodiscard]] bool delay_in_disguise(const Loop& loop);

/// Whether the delay of this model is compensated by more acceleration feed-forward than any drive
/// has: the model imitates a velocity lag.
[[nodiscard]] bool lag_in_disguise(const Model& model);

/// For every sample and the end: the sum before it of the squared changes of the command's
/// velocity, over 10 ms each [m^2 | rad^2]; single jumps count for little.
[[nodiscard]] std::vector<double> squared_acceleration(const std::vector<Segment>& segments);

/// 0.6; more, up to 0.85, where most of what the axis accelerates comes after that: a model of the
/// slow motion before it would be judged by motion of which it has seen nothing.
[[nodiscard]] double training_share_of(const std::vector<Segment>& segments);

/// The first `share` of the time of all segments together, or of every segment (`each`), and the
/// rest. Gaps do not count.
[[nodiscard]] std::pair<std::vector<Segment>, std::vector<Segment>> split(
    const std::vector<Segment>& segments, double share, bool each = false);

/// Why command and encoder cannot have the same unit and sign; empty if they can.
[[nodiscard]] std::string why_scaled(const std::vector<Segment>& segments);

}  // namespace servotwin
