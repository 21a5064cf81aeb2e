#include "diagnosis/search/plausibility.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

/// Whether the effect consists of short impulses at separate times. Impulses all at one time, or a
/// single one of nearly the longest possible duration, model something else.
bool are_impulses(const Effect& effect) {
  // An impulse smaller than kMinShare of the largest one does not count. kMaxDurationShare: of the
  // longest duration that the catalogue allows. kMinSpread_s: between first and last.
  constexpr double kMinShare = 0.2, kMaxDurationShare = 0.9, kMinSpread_s = 0.25;
  constexpr std::size_t kPushes = ImpulseDisturbance::kPushes;
  double most = 0.0;
  for (std::size_t i = 0; i < kPushes; ++i) most = std::max(most, std::abs(effect.coefficient[i]));
  std::vector<double> moments;
  for (std::size_t i = 0; i < kPushes; ++i) {
    if (std::abs(effect.coefficient[i]) > kMinShare * most) moments.push_back(effect.shape[i]);
  }
  if (moments.empty()) return false;
  const auto [first, last] = std::minmax_element(moments.begin(), moments.end());
  if (*last - *first > kMinSpread_s) return true;
  return moments.size() == 1 &&
         effect.shape[kPushes] < kMaxDurationShare * shapes_of(effect.kind)[kPushes].upper;
}

/// Whether the fit has taken all force from an effect that is a cause: what it was added for is
/// explained by better values of the others.
bool does_nothing(const Effect& effect) {
  const std::size_t count = coefficients_of(effect.kind).size();
  return count > 0 && !identity_of(effect.kind).cause.empty() &&
         std::all_of(effect.coefficient.begin(),
                     effect.coefficient.begin() + static_cast<std::ptrdiff_t>(count),
                     [](double value) { return value == 0.0; });
}

/// Whether the fit has all but closed the gap of this effect, or made it narrower than the encoder
/// can see: it then stands for something else. Of two masses the gap is taken out instead
/// (identification/loop/two_mass_fit.h).
bool is_closed_gap(const Effect& effect, double encoder_step) {
  constexpr double kNarrow = 2.0;  // times the narrowest gap
  if (acts_on_axis(effect.kind)) return false;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(effect.kind)) {
    if (p.name == "width" && effect.shape[i] < std::max(kNarrow * p.lower, encoder_step))
      return true;
    ++i;
  }
  return false;
}

/// The largest magnitude of the loop's poles [rad/s].
double fastest_pole(const Loop& loop) {
  double out = 0.0;
  const auto roots = roots_of(loop);
  for (int i = 0; i < loop.order; ++i)
    out = std::max(out, std::abs(roots[static_cast<std::size_t>(i)]));
  return out;
}

/// Whether two masses without play ring on a spring as machines have it. Not where the spring
/// hardly rings (a lag), or is too fast for the samples. A fit takes all damping from a spring that
/// the lag of the drive feeds, which is not in the model; but only where it is fast beside the
/// loop: a slow one without damping is a part of the control (a healthy axis got one of 8.7 Hz).
/// Nor where the velocity loop's integrator takes all of the position gain: no drive is set like
/// that.
bool is_spring(const Model& model, const Effect& axis) {
  constexpr double kMaxDamping = 0.2, kMaxFrequency = 0.4;  // of the sampling rate
  constexpr double kUndamped = 1.5;            // times the least damping of the catalogue
  constexpr double kMinOverFastestPole = 3.0;  // of the frequency of one without damping
  const double frequency_hz = axis.shape[0], damping = axis.shape[1];
  if (damping > kMaxDamping || frequency_hz * model.sample_time_s > kMaxFrequency) return false;
  const TwoMassParameters parameters = two_mass_parameters(axis);
  if (parameters.encoders == Encoders::kLoad && model.loop.order == 3 &&
      model.loop.denominator[0] * parameters.reset >= model.loop.denominator[1])
    return false;
  return damping > kUndamped * shapes_of(axis.kind)[1].lower ||
         2.0 * std::numbers::pi * frequency_hz > kMinOverFastestPole * fastest_pole(model.loop);
}

/// Whether both sides of a spring or a gap have a mass. Two per cent of it on one side stand for
/// something else: presliding of an axis in degrees got a spring of 271 Hz, and a gap of 5 urad.
bool has_two_masses(const Effect& axis) {
  constexpr double kMinShareOfMass = 0.025;
  const double share = two_mass_parameters(axis).load_share;
  return std::min(share, 1.0 - share) >= kMinShareOfMass;
}

}  // namespace

bool plausible(const Model& model, double begin_s, double end_s, double max_deviation,
               double encoder_step) {
  const auto closed = [&](const Effect& effect) { return is_closed_gap(effect, encoder_step); };
  if (std::any_of(model.effects.begin(), model.effects.end(), closed) ||
      std::any_of(model.effects.begin(), model.effects.end(), does_nothing))
    return false;
  // An effect that sets in within this share of the recording from its begin or end is not
  // accepted: there is too little data before or after it.
  constexpr double kMinShareToEnds = 0.06;
  for (const Effect& effect : model.effects) {
    const auto shapes = shapes_of(effect.kind);
    if (shapes.empty() || shapes.front().scan != Scan::kTime) continue;
    const double share = (effect.shape[0] - begin_s) / (end_s - begin_s);
    if (share < kMinShareToEnds || share > 1.0 - kMinShareToEnds) return false;
  }
  // Saturation removes all of the torque above the limit, so that its coefficient must be near 1.
  const Effect* limit = motor_limit_of(model);
  if (limit != nullptr && !(std::abs(limit->coefficient[0] - 1.0) < max_deviation)) return false;
  // A damping ratio above kMaxDamping, more than tables and screws have, can only come from the
  // loop when the frequency is near its poles. Beyond kMaxOverFastestPole times the fastest pole it
  // is a lag of the control and not a mode.
  constexpr double kMaxDamping = 0.1, kMaxOverFastestPole = 2.0;
  if (const Effect* mode = model.find(kind_of<Compliance>());
      mode != nullptr && mode->shape[1] > kMaxDamping &&
      2.0 * std::numbers::pi * mode->shape[0] > kMaxOverFastestPole * fastest_pole(model.loop))
    return false;
  if (const Effect* axis = two_mass_of(model);
      axis != nullptr && (!has_two_masses(*axis) ||
                          (two_mass_parameters(*axis).width == 0.0 && !is_spring(model, *axis))))
    return false;
  if (const Effect* pushes = model.find(kind_of<ImpulseDisturbance>());
      pushes != nullptr && !are_impulses(*pushes))
    return false;
  // The part behind a gap must carry at least this share of the friction or of the mass.
  constexpr double kMinPartShare = 0.02;
  if (const Effect* gap = model.find(kind_of<BacklashBehindEncoder>()); gap != nullptr) {
    double level = 0.0;
    for (const Effect& effect : model.effects) {
      if (is_friction_law(effect.kind)) level += level_of(effect);
    }
    if (std::abs(gap->coefficient[0]) <= kMinPartShare * level &&
        gap->coefficient[1] < kMinPartShare)
      return false;
  }
  // Viscous friction is some per cent of the gain of the velocity loop, which makes most of the
  // first denominator coefficient: it cannot fall by more than it was.
  constexpr double kMaxViscousShare = 0.1;
  if (const Effect* added = model.find(kind_of<AddedFriction>());
      added != nullptr && added->coefficient[1] < -kMaxViscousShare * model.loop.denominator[0])
    return false;
  // A gap is crossed with the gain of the velocity loop, which makes most of the first denominator
  // coefficient: their ratio must lie between these.
  constexpr double kMinGainRatio = 0.3, kMaxGainRatio = 2.0;
  const Effect* play = model.find(kind_of<BacklashInLoop>());
  if (play == nullptr) return true;
  const double share = play->coefficient[0] / model.loop.denominator[0];
  return share > kMinGainRatio && share < kMaxGainRatio;
}

}  // namespace servotwin
