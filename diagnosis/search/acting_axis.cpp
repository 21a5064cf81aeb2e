#include "diagnosis/search/acting_axis.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "diagnosis/search/screen.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/loop/identify.h"
#include "identification/loop/structure_choice.h"
#include "identification/recording/excerpt.h"
#include "identification/recording/segments.h"
#include "twin/catalogue.h"

namespace servotwin {

double share_of_neighbour(const Model& model, const std::vector<Segment>& beside) {
  std::vector<Signals> signals;
  bool moves = true;
  for (const Segment& s : beside) {
    if (s.neighbour.size() != s.size()) return 0.0;
    moves = moves && s.neighbour_motion.size() == s.size();
    signals.push_back(signals_of(s));
  }
  if (signals.empty()) return 0.0;
  Model without = model;
  std::erase_if(without.effects, [](const Effect& effect) { return couples(effect.kind); });
  // What the loop and its friction could absorb is not counted.
  Model loop = without;
  std::erase_if(loop.effects, [](const Effect& effect) {
    return !is_friction_law(effect.kind) && effect.kind != kind_of<TimeDelay>();
  });
  loop.loop.modes.clear();
  const Projection coarse = thinned(signals, structure_of(loop), kScreenStep_s);
  constexpr double kAnyEncoder = 0.0;  // its step matters for periods of position alone
  return Screen(coarse, point_of(loop), without, left_by_simulation(coarse, beside, without),
                kAnyEncoder)
      .look(moves ? kind_of<CrossCouplingByMotion>() : kind_of<CrossCoupling>())
      .gain;
}

ActingAxis acting_axis(const Recording& recording, const std::string& axis) {
  constexpr ExcerptLimits kPart{.longest_s = 30.0, .used_s = 30.0};
  ActingAxis out;
  std::vector<SegmentedAxis> beside;
  for (const AxisRecord& other : recording.axes) {
    const auto known = [](double x) { return std::isfinite(x); };
    if (other.name == axis || std::none_of(other.command.begin(), other.command.end(), known))
      continue;
    SegmentedAxis one = segment_axis(recording, axis, {}, other.name);
    if (one.neighbour != other.name) {
      out.apart.push_back(other.name);
      continue;
    }
    one.segments = excerpt(one.segments, kPart);
    beside.push_back(std::move(one));
  }
  out.sought = beside.size() + out.apart.size() > 1;
  if (beside.empty() || !out.sought) return out;
  // What friction or a vibration leave hides what another axis does: 17 % of the error that
  // Coulomb friction leaves, 95 % beside presliding (tests/diagnosis/acting_axis_test.cpp).
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.friction = kind_of<Presliding>();
  options.must_predict = false;
  options.with_torque = false;
  for (const int modes : {0, 1}) {
    options.modes = modes;
    try {
      const Identified found = identify(beside.front(), options);
      if (!found.refusals.empty()) return out;
      for (const SegmentedAxis& one : beside) {
        const double share = share_of_neighbour(
            found.record.model, cut(one.segments, -1e300, found.record.training_to_s));
        if (share > std::max(out.share, kMinShareOfActing))
          out.share = share, out.name = one.neighbour;
      }
    } catch (const std::runtime_error&) {
      return out;  // the fit that wants to know says why
    }
    if (!out.name.empty()) return out;
  }
  return out;
}

}  // namespace servotwin
