#include "diagnosis/search/acting_axis.h"

#include <algorithm>
#include <stdexcept>

#include "diagnosis/search/screen.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/loop/identify.h"
#include "identification/loop/structure_choice.h"
#include "identification/recording/excerpt.h"
#include "identification/recording/segments.h"
#include "twin/catalogue.h"

namespace servotwin {

double share_of_neighbour(const Model& model, const std::vector<Segment>& own,
                          const std::vector<Segment>& beside) {
  if (beside.empty() || own.size() != beside.size()) return 0.0;
  std::vector<Signals> signals;
  for (std::size_t i = 0; i < own.size(); ++i) {
    if (beside[i].neighbour.size() != own[i].size() || beside[i].size() != own[i].size())
      return 0.0;
    signals.push_back(signals_of(beside[i]));
  }
  // Beside the loop and its law of friction alone: what acts on one axis may depend on its own
  // motion as well, but what the other axis does must not be in the comparison.
  Model alone = model;
  std::erase_if(alone.effects, [](const Effect& effect) {
    return !is_friction_law(effect.kind) && effect.kind != kind_of<TimeDelay>();
  });
  alone.loop.modes.clear();
  const Projection coarse =
      thinned(Projection(std::move(signals), structure_of(alone)), kScreenStep_s);
  constexpr double kAnyEncoder = 0.0;  // its step matters for periods of position alone
  return Screen(coarse, point_of(alone), model, left_by_simulation(coarse, own, model), kAnyEncoder)
      .look(kind_of<CrossCoupling>())
      .gain;
}

std::string acting_axis(const Recording& recording, const std::string& axis) {
  std::vector<SegmentedAxis> beside;
  for (const AxisRecord& other : recording.axes) {
    if (other.name == axis) continue;
    SegmentedAxis one = segment_axis(recording, axis, {}, other.name);
    if (one.neighbour == other.name) beside.push_back(std::move(one));
  }
  if (beside.size() < 2) return {};
  for (SegmentedAxis& one : beside) one.segments = excerpt(one.segments);
  // What friction or a vibration leave hides what another axis does: 0.2 % of the error that
  // Coulomb friction leaves, 95 % beside presliding (tests/diagnosis/acting_axis_test.cpp).
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.friction = kind_of<Presliding>();
  options.must_predict = false;
  for (const int modes : {0, 1}) {
    options.modes = modes;
    std::string best;
    // Of axes that do not act at most 0.01.
    double most = 0.05;
    try {
      const Identified found = identify(beside.front(), options);
      if (!found.refusals.empty()) return {};
      const ModelRecord& record = found.record;
      for (const SegmentedAxis& one : beside) {
        const std::vector<Segment> training = cut(one.segments, -1e300, record.training_to_s);
        if (const double share = share_of_neighbour(record.model, training, training); share > most)
          most = share, best = one.neighbour;
      }
    } catch (const std::runtime_error&) {
      return {};  // the fit that wants to know says why
    }
    if (!best.empty()) return best;
  }
  return {};
}

}  // namespace servotwin
