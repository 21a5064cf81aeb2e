#include "diagnosis/search/judgement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "diagnosis/statistics/bootstrap.h"

#include "diagnosis/search/cause_nature.h"
#include "diagnosis/statistics/pieces.h"
#include "diagnosis/statistics/text.h"
#include "identification/loop/identify.h"

namespace servotwin {

namespace {

/// Whether the paired test does not contradict the score test. An effect that sets in at some time,
/// or an intermittent one, is present in few of the blocks and needs only a positive z; impulses
/// always pass.
bool blocks_agree(const Tried& one) {
  const auto shapes = shapes_of(one.screened.kind);
  const bool sets_in = !shapes.empty() && shapes.front().scan == Scan::kTime;
  // If a few breakaways make most of the error, the mean is uncertain; the rank test is used then.
  const double z = std::max(paired_z(one.before->pieces, one.model.pieces),
                            signed_rank_z(one.before->pieces, one.model.pieces));
  const bool impulses = !shapes.empty() && shapes.front().scan == Scan::kMoments;
  return impulses || z > (sets_in || is_intermittent(one.screened.kind) ? 0.0 : kMinBlockZ);
}

}  // namespace

double removed_rms(const Hypothesis& before, const Hypothesis& after) {
  return removed_rms(before.pieces, after.pieces);
}

double share_won(const Tried& best, const Tried& rival) {
  // As shares of what each began with: models fitted in different ways begin with different errors.
  const double of_best = best.before->rms() * best.before->rms(),
               of_rival = rival.before->rms() * rival.before->rms();
  const auto removed_by = [](const Tried& one, double before, std::size_t i) {
    return (one.before->pieces[i] - one.model.pieces[i]) / before;
  };
  const std::size_t n = std::min({best.model.pieces.size(), best.before->pieces.size(),
                                  rival.model.pieces.size(), rival.before->pieces.size()});
  const auto differences = bootstrap(n, [&](const std::vector<std::size_t>& places) {
    double sum = 0.0;
    for (const std::size_t i : places)
      sum += removed_by(best, of_best, i) - removed_by(rival, of_rival, i);
    return sum;
  });
  return static_cast<double>(std::count_if(differences.begin(), differences.end(),
                                           [](double d) { return d > 0.0; })) /
         static_cast<double>(differences.size());
}

bool like_friction(std::size_t kind) {
  constexpr std::array kAlike{
      kind_of<Presliding>(), kind_of<FallingFriction>(), kind_of<PositionDependentFriction>(),
      kind_of<Backlash>(),   kind_of<BacklashInLoop>(),  kind_of<BacklashBehindEncoder>(),
      kind_of<Compliance>(), kind_of<DwellStiction>(),   kind_of<TorqueSaturation>()};
  return std::find(kAlike.begin(), kAlike.end(), kind) != kAlike.end();
}

Judgement judged(const Tried& one, const Bar& bar) {
  Judgement out;
  out.z = paired_z(one.before->pieces, one.model.pieces);
  out.p = 0.5 * std::erfc(out.z / std::sqrt(2.0));
  if (blocks_agree(one)) out.p = std::min(out.p, one.screened.p);
  const double ratio = one.left();
  const bool much = ratio < kMaxErrorRatioOfLargeGain,
             misfit = like_friction(one.screened.kind) && !(ratio < kMaxErrorRatioOfNearlyAll);
  // If a few breakaways make most of the error, the mean is uncertain; the rank test is used then.
  if (much)
    out.p = std::min(out.p, 0.5 * std::erfc(signed_rank_z(one.before->pieces, one.model.pieces) /
                                            std::sqrt(2.0)));
  out.earned = ratio < kMaxRmsRatioToAdd &&
               removed_rms(*one.before, one.model) >
                   std::max(kMinRemovedShareOfCause * bar.baseline,
                            misfit ? kLawMisfitShare * bar.friction : 0.0) &&
               out.p < kFalseAlarmRate / static_cast<double>(bar.candidates);
  return out;
}

std::optional<Vibration> vibration_of(const Model& model, const Effect& mode) {
  constexpr double kNyquist = 0.5;  // of the sampling rate
  if (mode.shape[0] * model.sample_time_s < kNyquist)
    return Vibration{mode.shape[0], mode.shape[1]};
  for (const std::complex<double>& root : roots_of(model.loop)) {
    if (root.imag() > 0.0)
      return Vibration{std::abs(root) / (2.0 * std::numbers::pi), -root.real() / std::abs(root)};
  }
  return std::nullopt;
}

std::string end_text(std::string_view cause, const Model& model, const Effect& effect,
                     double length_scale) {
  if (effect.kind == kind_of<Compliance>()) {
    const std::optional<Vibration> vibration = vibration_of(model, effect);
    const double most = shapes_of(effect.kind)[1].upper;
    if (!vibration || vibration->damping_ratio > most)
      return text("no vibration with a damping ratio below %g: a filter or a delay", most);
  }
  constexpr double kAtLimit = 0.99;  // of the limit; a fit stops a little before it
  if (effect.kind == kind_of<TimeDelay>()) {
    const double delay_s = effect.shape[0],
                 longest_s = std::min(shapes_of(effect.kind)[0].upper,
                                      kMaxDelayCycles * model.sample_time_s);
    if (delay_s < kMinDelaySamplesOfCause * model.sample_time_s)
      return "shorter than half a sampling time: it may come from the recording";
    if (delay_s > kAtLimit * longest_s)
      return text("at its limit of %g ms: it stands for something else", 1e3 * longest_s);
    if (lag_in_disguise(model))
      return "compensated by more acceleration feed-forward than any drive has: it imitates a "
             "velocity lag";
  }
  const CauseNature& nature = nature_of(cause);
  const auto shapes = shapes_of(effect.kind);
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    // A fit that wants still less friction at rest beside that at speed is no friction of a guide.
    if (shapes[i].name == "breakaway_ratio" && effect.shape[i] < shapes[i].lower / kAtLimit)
      return text("breakaway ratio at its limit %g: it stands for something else", shapes[i].lower);
    const double most = stretched(shapes[i], length_scale).upper;
    if (shapes[i].name != nature.ends_at || !(effect.shape[i] > kAtLimit * most)) continue;
    std::string name(shapes[i].name);
    std::replace(name.begin(), name.end(), '_', ' ');
    return text("%s at its limit %g: %s", name.c_str(), most, nature.beyond);
  }
  return "";
}

bool at_end_of(std::string_view cause, const Model& model, const Effect& effect,
               double length_scale) {
  return !end_text(cause, model, effect, length_scale).empty();
}

}  // namespace servotwin
