#include "diagnosis/observability.h"

#include "diagnosis/extension.h"
#include "diagnosis/suggested_motion.h"
#include "diagnosis/text.h"
#include "diagnosis/torque.h"
#include "identification/recording/excitation.h"

namespace servotwin {

namespace {

constexpr double kWarmUp_s = 10.0;  // less is no time for anything to warm up in
constexpr double kHardly = 0.02;    // of the time under way, in a direction

/// Why this cause cannot show; empty: it can.
std::string why_not(std::string_view id, const SegmentedAxis& axis, const Beside& beside) {
  const Channels channels(axis.segments);
  const Excitation e = excitation_of(axis.segments);
  const double moving = e.forward_share + e.backward_share;
  const bool one_way =
      e.reversals < 2 || std::min(e.forward_share, e.backward_share) < kHardly * moving;
  const double duration_s = axis.segments.back().end_s() - axis.segments.front().start_s;
  if (id == "cross_coupling" && !channels.neighbour) return "no other axis is in the recording";
  if (id == "cutting_force" && !beside.cuts_heard) return "no cut is heard in the recording";
  if (id == "gravity_offset" && beside.integrator && !has_torque(axis))
    return "the integrator of the loop holds a constant force without an error: it takes the "
           "torque";
  if (id == "feedforward_mismatch" && !beside.earlier_model)
    return "it is part of the loop as identified: it takes an earlier model (--model)";
  if ((id == "lead_error" || id == "thermal_growth") && beside.encoder_in_loop)
    return "the loop makes its own encoder's reading right: it takes one at the load or a laser";
  if ((id == "presliding" || id == "backlash" || id == "asymmetric_friction") && one_way)
    return text("the axis turns round %d times: it takes motion there and back, at least twice",
                e.reversals);
  if (id == "dwell_stiction" && !channels.rests)
    return "the axis hardly rests: it takes moves after rests of unlike length";
  if ((id == "viscous_drift" || id == "thermal_growth") && duration_s < kWarmUp_s)
    return text("nothing warms up in %.2g s: it takes minutes, from cold", duration_s);
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
