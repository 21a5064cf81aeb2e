#include "diagnosis/search/observability.h"

#include "diagnosis/search/extension.h"
#include "diagnosis/search/suggested_motion.h"
#include "diagnosis/statistics/text.h"
#include "identification/recording/excitation.h"

namespace servotwin {

namespace {

// In a shorter recording nothing warms up measurably.
constexpr double kMinWarmUp_s = 10.0;
// Share of the time in motion. A recording with less motion than this in one of the directions
// counts as motion in one direction only.
constexpr double kMinDirectionShare = 0.02;

/// Why this cause is not observable; empty: it is observable.
std::string why_not(std::string_view id, const SegmentedAxis& axis, const Beside& beside) {
  const Channels channels(axis.segments);
  const Excitation e = excitation_of(axis.segments);
  const double moving = e.forward_share + e.backward_share;
  const bool one_way =
      e.reversals < 2 || std::min(e.forward_share, e.backward_share) < kMinDirectionShare * moving;
  const double duration_s = axis.segments.back().end_s() - axis.segments.front().start_s;
  if (id == "cross_coupling" && !channels.neighbour) return "the recording contains no other axis";
  if (id == "cutting_force" && !beside.cuts_heard) return "no cut was detected in the recording";
  if (id == "gravity_offset" && beside.integrator && !has_torque(axis))
    return "the integrator of the loop compensates a constant force without a tracking error: "
           "record the torque";
  if (id == "feedforward_mismatch" && !beside.earlier_model)
    return "the identified loop includes it: give an earlier model to compare with (--model)";
  if ((id == "lead_error" || id == "thermal_growth") && beside.encoder_in_loop)
    return "the loop controls the reading of its own encoder: record an encoder at the load or a "
           "laser interferometer";
  if ((id == "presliding" || id == "backlash" || id == "asymmetric_friction") && one_way)
    return text("the axis reverses %d times: record at least two strokes in both directions",
                e.reversals);
  if (id == "dwell_stiction" && !channels.rests)
    return "the axis rests too rarely: record moves after rests of different length";
  if ((id == "viscous_drift" || id == "thermal_growth") && duration_s < kMinWarmUp_s)
    return text("nothing warms up in %.2g s: record several minutes from a cold start", duration_s);
  return {};
}

}  // namespace

std::vector<NotObservable> not_observable(const SegmentedAxis& axis, const Beside& beside) {
  std::vector<NotObservable> out;
  for (const std::string_view id : contract_ids()) {
    if (std::string why = why_not(id, axis, beside); !why.empty())
      out.push_back({std::string(id), std::move(why)});
  }
  return out;
}

}  // namespace servotwin
