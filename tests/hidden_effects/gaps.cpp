#include "tests/hidden_effects/gaps.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <optional>
#include <vector>

#include "diagnosis/search/extension.h"
#include "diagnosis/search/search.h"
#include "drivers/recordings/recording_file.h"
#include "identification/recording/noise_floor.h"
#include "identification/recording/segments.h"
#include "tests/support/temporary_directory.h"

namespace servotwin::hidden_effects {
namespace {

/// The laws of friction that a machine of this family may need.
std::vector<std::size_t> laws_of(const Case& made) {
  std::vector<std::string> own = made.own;
  for (const Truth& truth : made.hidden) own.push_back(truth.id);
  const auto has = [&](const char* id) {
    return std::find(own.begin(), own.end(), id) != own.end();
  };
  if (has("presliding") && has("stribeck"))
    return {kind_of<LuGre>(), kind_of<PreslidingStribeck>(), kind_of<Gms>()};
  if (has("presliding")) return {kind_of<Presliding>(), kind_of<Gms>(), kind_of<LuGre>()};
  if (has("stribeck")) return {kind_of<CoulombFriction>(), kind_of<PreslidingStribeck>()};
  return {kind_of<CoulombFriction>()};
}

/// The effects beside the law that stand for the true cause; one past the catalogue: none, the law
/// is the cause.
std::vector<std::size_t> kinds_of(const std::string& id) {
  std::vector<std::size_t> out;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (cause_of(kind) == id && !is_friction_law(kind)) out.push_back(kind);
  }
  if (id == "presliding" || id == "stribeck") out.push_back(kEffectKinds);
  return out;
}

/// The true value of a shape, by the keys that truths have.
std::optional<double> true_shape(const Truth& truth, std::string_view shape) {
  const std::string name(shape);
  const bool travel = name == "breakaway_displacement" || name == "length";
  for (const std::string& key :
       {name, name + "_m", name + "_mps", std::string(travel ? "distance_m" : "")}) {
    const auto found = truth.parameters.find(key);
    if (found != truth.parameters.end()) return found->second;
  }
  return std::nullopt;
}

/// Fits one structure after the other and keeps the least error in free simulation.
class Fits {
 public:
  Fits(const Case& made, const SegmentedAxis& axis)
      : truth_(made.hidden.front()),
        order_(made.machine.find("no integrator") == std::string::npos ? 3 : 2),
        noise_rms_(made.noise_rms),
        search_(axis.segments, 1e300, PoleBounds{}, noise_floor(axis.segments)) {}

  Gaps ask(const std::vector<std::size_t>& laws, const std::vector<std::size_t>& kinds) {
    Gaps out{kNone, kNone, "none"};
    for (const std::size_t law : laws) {
      for (const std::size_t kind : kinds) {
        // Near the noise no other structure leaves noticeably less.
        if (out.represented_rms < kNearNoise * noise_rms_) break;
        const std::optional<Hypothesis> base = without_effect(law, kind, true);
        if (!base) continue;
        const double from_truth = least(*base, kind, true);
        if (from_truth < out.represented_rms) {
          out.represented_rms = from_truth;
          out.structure = std::string(identity_of(law).id);
          if (kind < kEffectKinds) out.structure += " " + std::string(identity_of(kind).id);
          // Of a law that is the cause itself, the start is what differs.
          const std::optional<Hypothesis> own =
              kind < kEffectKinds ? base : without_effect(law, kind, false);
          out.searched_rms = own ? least(*own, kind, false) : kNone;
        }
      }
    }
    // A start that finds less than the truth's is the better answer to the first question as well.
    out.represented_rms = std::min(out.represented_rms, out.searched_rms);
    return out;
  }

 private:
  static constexpr double kNone = 1e300;
  static constexpr double kNearNoise = 1.05;

  /// The machine with Coulomb friction alone; nothing where it cannot be fitted.
  const std::optional<Hypothesis>& plain(bool matched_feedforward) {
    auto [at, is_new] = plain_.try_emplace(matched_feedforward);
    if (is_new) {
      Hypothesis simple;
      simple.structure.order = order_;
      simple.structure.effects = {kind_of<CoulombFriction>()};
      simple.structure.matched_feedforward = matched_feedforward;
      if (search_.fit(simple, {})) {
        search_.polish(simple);
        at->second = std::move(simple);
      }
    }
    return at->second;
  }

  /// The machine without the effect; nothing where it cannot be fitted.
  std::optional<Hypothesis> without_effect(std::size_t law, std::size_t kind, bool from_truth) {
    const std::optional<Hypothesis>& known = plain(kind == kind_of<TimeDelay>());
    if (!known) return std::nullopt;
    const Hypothesis& simple = *known;
    search_.follow(simple);
    if (law == kind_of<CoulombFriction>()) return simple;
    Hypothesis out;
    out.structure = simple.structure;
    out.structure.effects = {law};
    Point from = point_of(simple.model, out.structure);
    for (std::size_t i = 0; from_truth && i < from.shapes.size(); ++i) {
      const Parameter& p = shapes_of(law)[i];
      from.shapes[i] =
          std::clamp(true_shape(truth_, p.name).value_or(from.shapes[i]), p.lower, p.upper);
    }
    if (!search_.fit_friction(out, from)) return std::nullopt;
    search_.follow(out);
    return out;
  }

  double rms_of(Hypothesis h) {
    search_.judge_as_is(h);
    return h.rms();
  }

  /// What the structure with this effect leaves, from the true shapes or from those of the screen.
  double least(const Hypothesis& base, std::size_t kind, bool from_truth) {
    if (kind == kEffectKinds) return rms_of(base);
    if (kind == kind_of<CuttingForce>()) search_.detect_cuts(base.model);
    std::vector<double> shapes = search_.screen(base, {kind}).front().shapes;
    if (shapes.size() != shapes_of(kind).size()) {  // nothing that the screen could use
      shapes.clear();
      for (const Parameter& p : shapes_of(kind)) shapes.push_back(p.start);
    }
    for (std::size_t i = 0; from_truth && i < shapes.size(); ++i) {
      const Parameter& p = shapes_of(kind)[i];
      shapes[i] = std::clamp(true_shape(truth_, p.name).value_or(shapes[i]), p.lower, p.upper);
    }
    double out = kNone;
    const auto take = [&](Hypothesis& h) {
      for (int round = 0; round < 3; ++round) search_.polish(h);
      out = std::min(out, rms_of(h));
    };
    Hypothesis with, beside;
    with.structure = beside.structure = extended_by(base.structure, kind);
    Point from = point_of(base.model, with.structure);
    std::size_t at = 0;
    for (const std::size_t one : with.structure.effects) {
      if (one == kind)
        std::copy(shapes.begin(), shapes.end(),
                  from.shapes.begin() + static_cast<std::ptrdiff_t>(at));
      at += shapes_of(one).size();
    }
    if (search_.fit(with, {from})) take(with);
    if (search_.vary(beside, base.model, kind, shapes)) take(beside);
    return out;
  }

  const Truth& truth_;
  int order_;
  double noise_rms_;
  Search search_;
  std::map<bool, std::optional<Hypothesis>> plain_;  // by matched_feedforward
};

}  // namespace

Gaps gaps_of(const Case& made) {
  const std::string& id = made.hidden.front().id;
  if (id == "dropped_samples") return {0.0, 0.0, "data"};
  try {
    const test::TemporaryDirectory directory;
    const SegmentedAxis axis =
        segment_axis(read_recording(directory.file("recording.csv", made.csv)), "X");
    return Fits(made, axis).ask(laws_of(made), kinds_of(id));
  } catch (const std::exception& error) {
    return {1e300, 1e300, error.what()};
  }
}

}  // namespace servotwin::hidden_effects
