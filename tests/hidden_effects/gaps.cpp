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

/// e'' + a1 e' + a2 e + a3 int e = c0 r'' + c1 r' + c2 r of a rigid axis in this control
/// (tests/hidden_effects/rig.h), with its drag B; the periods of the control and its filters apart.
Loop loop_of(const Rig& rig) {
  const Drive& drive = rig.drive;
  const double mass = rig.body.mass, gain = drive.velocity_gain / mass,
               drag = rig.friction.viscous / mass, lag = 1.0 - drive.velocity_feedforward,
               reset = drive.integral_time > 0.0 ? 1.0 / drive.integral_time : 0.0;
  Loop out;
  out.order = reset > 0.0 ? 3 : 2;
  out.denominator = {gain + drag, gain * (drive.position_gain + reset),
                     gain * drive.position_gain * reset};
  out.numerator = {1.0 - drive.acceleration_feedforward / mass, gain * lag + drag,
                   gain * lag * reset};
  return out;
}

/// A law of friction of the machine's family with its values, as far as the law has them.
Effect friction_of(const Friction& friction, double mass, std::size_t law) {
  Effect out;
  out.kind = law;
  const auto value_of = [&](std::string_view name, double otherwise) {
    if (name == "velocity_limit") return friction.saturation_velocity;
    if (name == "deflection" || name == "breakaway_displacement" || name == "last_displacement")
      return friction.presliding_distance;
    if (name == "breakaway_ratio") return 1.0 + friction.stribeck_rise;
    if (name == "stribeck_velocity") return friction.stribeck_velocity;
    if (name == "damping_time") return friction.bristle_damping;
    return otherwise;
  };
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(law))
    out.shape[i++] = std::clamp(value_of(p.name, p.start), p.lower, p.upper);
  const auto levels = coefficients_of(law);
  const auto count = static_cast<double>(levels.size() - 1);  // the last one is viscous
  for (std::size_t c = 0; c + 1 < levels.size(); ++c)
    out.coefficient[c] = friction.level / mass / count;
  return out;
}

/// Fits one structure after the other and keeps the least error in free simulation.
class Fits {
 public:
  Fits(const Case& made, const SegmentedAxis& axis)
      : truth_(made.hidden.front()),
        rig_(made.rig),
        order_(loop_of(made.rig).order),
        noise_rms_(made.noise_rms),
        search_(axis.segments, 1e300, PoleBounds{}, noise_floor(axis.segments)) {}

  Gaps ask(const std::vector<std::size_t>& laws, const std::vector<std::size_t>& kinds) {
    Gaps out{kNone, kNone, "none"};
    for (const std::size_t law : laws) {
      for (const std::size_t kind : kinds) {
        // Near the noise no other structure leaves noticeably less.
        if (out.represented_rms < kNearNoise * noise_rms_) break;
        const std::optional<Hypothesis> base = without_effect(law, kind, true);
        const double fitted = base ? least(*base, kind, true) : kNone;
        const double from_truth = std::min(fitted, from_machine(law, kind));
        if (from_truth < out.represented_rms) {
          out.represented_rms = from_truth;
          out.structure = std::string(identity_of(law).id);
          if (kind < kEffectKinds) out.structure += " " + std::string(identity_of(kind).id);
          // Of a law that is the cause itself, the start is what differs.
          const std::optional<Hypothesis> own =
              kind < kEffectKinds ? base : without_effect(law, kind, false);
          out.searched_rms = !own                                        ? kNone
                             : kind < kEffectKinds && acts_on_axis(kind) ? as_two_masses(*own, kind)
                                                                         : least(*own, kind, false);
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

  /// The error that remains from the loop and the friction that the machine has, with the effect
  /// from its true shapes. Without a fit before: that of a loop without the effect, or beside
  /// another law of friction, may lead far away.
  double from_machine(std::size_t law, std::size_t kind) {
    Hypothesis base;
    base.structure.order = order_;
    base.structure.effects = {law};
    base.model.sample_time_s = search_.training().front().sample_time_s;
    base.model.loop = loop_of(rig_);
    base.model.effects = {friction_of(rig_.friction, rig_.body.mass, law)};
    base.point = point_of(base.model, base.structure);
    if (kind == kEffectKinds || acts_on_axis(kind)) {
      if (kind != kEffectKinds) {
        base.structure.effects.push_back(kind);
        base.model.effects.push_back(axis_of(kind));
      }
      return refined(base);
    }
    search_.follow(base);
    return least(base, kind, true);
  }

  [[nodiscard]] Effect axis_of(std::size_t kind) const {
    const auto value_of = [&](std::string_view name, double otherwise) {
      if (name == "frequency_hz") return rig_.body.spring_frequency_hz;
      if (name == "damping_ratio") return rig_.body.damping_ratio;
      if (name == "load_share") return 1.0 - rig_.body.motor_share;
      if (name == "reset" && rig_.drive.integral_time > 0.0) return 1.0 / rig_.drive.integral_time;
      if (name == "width") return rig_.body.gap;
      return otherwise;
    };
    Effect out;
    out.kind = kind;
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(kind))
      out.shape[i++] = std::clamp(value_of(p.name, p.start), p.lower, p.upper);
    return out;
  }

  /// The error that the program's own search for two masses leaves.
  double as_two_masses(const Hypothesis& rigid, std::size_t kind) {
    Hypothesis h;
    return search_.part_masses(h, rigid, rigid.model, kNone, {kind}, {}) ? refined(h) : kNone;
  }

  /// What a hypothesis leaves once it is refitted in free simulation.
  double refined(Hypothesis h) {
    if (!why_invalid(h.model).empty()) return kNone;
    for (int round = 0; round < 3; ++round) search_.polish(h);
    return rms_of(h);
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
    if (search_.fit(with, {from})) out = std::min(out, refined(with));
    if (search_.vary(beside, base.model, kind, shapes)) out = std::min(out, refined(beside));
    return out;
  }

  const Truth& truth_;
  const Rig& rig_;
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
