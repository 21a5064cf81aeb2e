// From a recording to a model: splits the data, chooses the structure, fits, and judges on what was
// not fitted.
//
// Structure (order 3 or 2, with or without a delay, with or without a constant force) is chosen
// inside the training data, on a part of it held back for that; the hold-out has no say in
// anything. The joint method goes on from there: the friction model is chosen the same way, and the
// whole model is polished in free simulation (identification/loop/joint.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "identification/loop/pole_search.h"
#include "identification/model/model_file.h"
#include "identification/recording/segments.h"

namespace servotwin {

enum class Method { kPoleSearch, kFullLs, kJoint };

struct IdentifyOptions {
  Method method = Method::kPoleSearch;
  PoleBounds bounds;
  bool pole_constraints = true;         ///< full LS only
  double training_share = 0.6;          ///< of the time of the data; the rest is held out
  int order = 0;                        ///< 0: by held-out error
  std::optional<std::size_t> friction;  ///< joint only: its place in the catalogue; none: compared
  double delay_max_s = 0.02;            ///< 0: no delay is sought
  int modes = 0;  ///< of vibration, at most; as many as the held-out error asks for; not full LS
  bool coupling = false;  ///< look for what another axis does to this one; not full LS
  /// A model of this axis whose friction is to be found again: its structure is kept, and steps 2
  /// to 4 of identification/loop/joint.h start from its loop. Not for full LS.
  std::optional<Model> start;
  /// The share is taken of every segment, not of all of them in order: where they show unlike
  /// things, so that both parts show all of it.
  bool split_each = false;
  /// A model that is no better than none on the hold-out is refused.
  bool must_predict = true;
};

/// What was tried on the way to the structure, for people.
struct StructureTrial {
  int order = 3;
  std::vector<std::size_t> effects;  ///< kinds
  double validation_rms = kAbsent;   ///< inside the training data
  bool chosen = false;
  int modes = 0;          ///< of vibration
  std::string ruled_out;  ///< why not, whatever its error; empty: it was in the running
  bool moving = false;    ///< its modes move with position
};

struct Identified {
  ModelRecord record;
  std::vector<StructureTrial> trials;
  /// Why the model must not be used at all (no valid loop, predicts nothing); empty: it may. What
  /// the motion did not excite is in record.excitation: a person may accept that, the daemon does
  /// not.
  std::vector<std::string> refusals;
};

/// Throws std::runtime_error where there is nothing to identify (no motion, too short), with what
/// to do. Any thread; does not ask the clock: `created` and `time_taken_s` are the caller's.
[[nodiscard]] Identified identify(const SegmentedAxis& axis, const IdentifyOptions& options = {});

/// Free simulation against the encoder over all segments; the starting state's samples do not
/// count.
[[nodiscard]] ErrorFigures judge(const Model& model, const std::vector<Segment>& segments);

/// Whether zeros in the right half plane make most of this loop's lag: a delay that it imitates.
[[nodiscard]] bool delay_in_disguise(const Loop& loop);

/// Whether more acceleration feed-forward than any drive has makes up for the delay of this model:
/// a velocity lag that it imitates.
[[nodiscard]] bool lag_in_disguise(const Model& model);

/// The first share of the time of the data (gaps do not count), of all or of each, and the rest.
[[nodiscard]] std::pair<std::vector<Segment>, std::vector<Segment>> split(
    const std::vector<Segment>& segments, double share, bool each = false);

/// Why command and encoder of an axis cannot be of one unit and sign; empty if they can.
[[nodiscard]] std::string why_scaled(const std::vector<Segment>& segments);

/// The part of the segments between two times of the recording [s].
[[nodiscard]] std::vector<Segment> cut(const std::vector<Segment>& segments, double from_s,
                                       double to_s);

}  // namespace servotwin
