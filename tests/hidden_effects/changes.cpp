#include "tests/hidden_effects/changes.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "tests/hidden_effects/machine.h"

namespace servotwin::hidden_effects {
namespace {

constexpr int kMaxChangedMachines = 100;  // draws until the change is large enough
// Least effect of the change on the error, over the noise, ..
constexpr double kMinChangeOverNoise = 6.0;
// .. and in metres: a model without effects is accurate to about this.
constexpr double kMinChange_m = 0.5e-6;

/// Puts the change into the rig; returns the ratio of what changed.
double change(Rig& rig, const std::string& id, Random& random) {
  const double up = random.between(1.15, 1.6), ratio = random.chance(0.5) ? up : 1.0 / up;
  if (id == "inertia_change") {
    rig.body.mass *= ratio;
    return ratio;
  }
  if (id == "gain_change") {
    rig.drive.position_gain *= ratio;
    return ratio;
  }
  if (id == "feedforward_mismatch") {
    const double before = rig.drive.velocity_feedforward;
    rig.drive.velocity_feedforward +=
        before > 0.5 ? -random.between(0.03, 0.2) : random.between(0.03, 0.2);
    return rig.drive.velocity_feedforward - before;
  }
  if (id == "added_friction") {
    const double more = random.between(1.3, 2.5);
    rig.friction.level *= more;
    return more;
  }
  if (id == "time_delay") {
    rig.reading.delay += random.between(0.5, 3.0) * rig.reading.sample_time;
    return rig.reading.delay;
  }
  if (id == "cogging") {
    rig.body.cogging = 0.3 * rig.friction.level * up;
    rig.body.cogging_period = random.between(0.004, 0.012);
    return rig.body.cogging;
  }
  if (!id.empty()) throw std::invalid_argument("hidden effects: no change " + id);
  return 1.0;
}

}  // namespace

const std::vector<std::string>& change_ids() {
  static const std::vector<std::string> ids{"inertia_change", "gain_change", "feedforward_mismatch",
                                            "added_friction", "time_delay",  "cogging"};
  return ids;
}

ChangedMachine changed_machine(Part part, const std::string& id, int index) {
  const std::string name = std::string(part == Part::kDev ? "dev" : "test") + "/changed-" + id +
                           '/' + std::to_string(index);
  Random random(seed_of(name));
  const Needs needs{.inside = true};
  for (int i = 0; i < kMaxChangedMachines; ++i) {
    Machine machine = draw_machine(ranges_of(part), needs, random);
    const Machine other_motion = draw_machine(ranges_of(part), needs, random);
    Rig before = machine.scene.rig;
    before.external_force = machine.torque_noise;
    Rig after = before;
    after.external_force = other_motion.torque_noise;
    after.reading.noise_seed = before.reading.noise_seed + 1;
    const Rig same = after;
    ChangedMachine out;
    out.ratio = change(after, id, random);
    const Trace first = simulate(before, machine.scene.command),
                unchanged = simulate(same, other_motion.scene.command),
                second = simulate(after, other_motion.scene.command);
    if (first.runaway || unchanged.runaway || second.runaway) continue;
    out.noise_rms = noise_rms(unchanged);
    const double least = std::max(kMinChangeOverNoise * out.noise_rms, kMinChange_m);
    if (!id.empty() && rms_apart(unchanged, second) < least) continue;
    out.before_csv = csv_of(first, before.reading.sample_time);
    out.after_csv = csv_of(second, after.reading.sample_time);
    out.machine = describe(after);
    out.own = own_effects(before);
    return out;
  }
  throw std::runtime_error("hidden effects: the change is too small on all machines of " + name);
}

}  // namespace servotwin::hidden_effects
