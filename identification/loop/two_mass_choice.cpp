#include "identification/loop/two_mass_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "identification/least_squares/parallel.h"
#include "identification/loop/free_elements.h"
#include "identification/loop/joint.h"
#include "identification/loop/message.h"
#include "identification/loop/output_error.h"
#include "identification/loop/structure_choice.h"
#include "identification/recording/noise_floor.h"
#include "twin/twin.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

// Of the training data; the rest validates.
constexpr double kFittedShare = 2.0 / 3.0;
// RMS on the validation part over that of a rigid axis, at most, to choose two masses: they have
// four parameters more.
constexpr double kMaxRmsRatioOfTwoMasses = 0.8;
// RMS over that of the law before, at most, to choose another law of friction.
constexpr double kMaxRmsRatioOfLaw = 0.97;
// RMS over noise floor up to which no other law is tried: to be chosen in place of this one it
// would have to leave less than the noise.
constexpr double kMaxRmsOverFloorToStop = 1.0 / kMaxRmsRatioOfLaw;
constexpr std::size_t kFreeElements = kind_of<MaxwellSlip>();
constexpr std::ptrdiff_t kFittedOfLaw = 2;  // starts of one law that are fitted on

/// Whether frequency and share of the load are within their bounds, and not at them.
bool determined(const Model& model) {
  constexpr double kMargin = 0.02;  // of the logarithm of the bounds' ratio
  const Effect& two_mass = *two_mass_of(model);
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(two_mass.kind)) {
    const double value = two_mass.shape[i++];
    if (p.name != "frequency_hz" && p.name != "load_share") continue;
    const double place = std::log(value / p.lower) / std::log(p.upper / p.lower);
    if (!(place > kMargin && place < 1.0 - kMargin)) return false;
  }
  return true;
}

bool less_left(const TwoMassFit& l, const TwoMassFit& r) { return l.rms < r.rms; }

/// Two masses that are compared, each fitted to the same data.
struct Candidates {
  const std::vector<Segment>& fitted;
  double encoder_step = 0.0;
  std::vector<TwoMassFit> all;

  /// These starts after a few rounds, the best first.
  [[nodiscard]] std::vector<TwoMassFit> tried(const std::vector<TwoMassFit>& starts,
                                              const Held& held) const {
    std::vector<std::optional<TwoMassFit>> fits(starts.size());
    in_parallel(fits.size(), [&](std::size_t i) {
      fits[i] = refined(starts[i], fitted, encoder_step, kFrictionRounds, kTryPasses, held);
    });
    std::vector<TwoMassFit> out;
    for (auto& fit : fits) {
      if (fit) out.push_back(std::move(*fit));
    }
    std::sort(out.begin(), out.end(), less_left);
    return out;
  }
  /// The best of one law: of these starts, all at once, and of those that know the drive also with
  /// their friction first; or what is fitted already.
  void add_best(std::vector<TwoMassFit> starts, const std::vector<TwoMassFit>& of_drive,
                const std::optional<TwoMassFit>& as_is) {
    for (TwoMassFit& one : tried(of_drive, {.effects = {}, .drive = true}))
      starts.push_back(std::move(one));
    starts.insert(starts.end(), of_drive.begin(), of_drive.end());
    starts = tried(starts, {});
    if (std::ssize(starts) > kFittedOfLaw)
      starts.erase(starts.begin() + kFittedOfLaw, starts.end());
    std::vector<std::optional<TwoMassFit>> fits(starts.size());
    in_parallel(fits.size(), [&](std::size_t i) {
      fits[i] = refined(starts[i], fitted, encoder_step, kFitRounds, kFitPasses);
    });
    fits.push_back(as_is);
    std::optional<TwoMassFit> best;
    for (const auto& fit : fits) {
      if (fit && determined(fit->model) && (!best || less_left(*fit, *best))) best = fit;
    }
    if (best) all.push_back(without_empty_gap(*best));
  }
  /// With this law, from this fit and from the drive that it began from.
  void add_with_law(const TwoMassFit& fit, std::size_t law) {
    std::vector<TwoMassFit> starts, of_drive;
    const bool is_free = law == kFreeElements;
    for (const double form : kFormsOfFreeElements) {
      if (!is_free && form != kFormsOfFreeElements.front()) break;
      if (const auto one = with_law(fit, law, form)) starts.push_back(*one);
      if (const auto one = sliding_with_law(fit, law, form)) of_drive.push_back(*one);
    }
    add_best(starts, of_drive, law == law_of(fit.structure) ? std::optional(fit) : std::nullopt);
  }
};

}  // namespace

std::optional<TwoMassFit> chosen_masses(const std::string& axis,
                                        const std::vector<Segment>& training,
                                        const Structure& structure, const PoleSearchOptions& search,
                                        const IdentifyOptions& options, double encoder_step,
                                        std::vector<StructureTrial>& trials) {
  const auto halves = split(training, kFittedShare);
  const std::vector<Segment>& fitted = halves.first;
  const std::vector<Segment> validation = with_lead_in(halves.second, training);
  std::vector<std::size_t> kinds{kind_of<TwoMassLoadEncoder>(), kind_of<PlayLoadEncoder>()};
  // What is recorded beside the motor's encoder is that of the load. By one encoder alone play
  // outside the loop is not told from an error of the reading.
  const bool both_recorded = std::all_of(training.begin(), training.end(), [](const Segment& s) {
    return s.actual_motor.size() == s.size();
  });
  if (both_recorded)
    kinds.insert(kinds.end(), {kind_of<TwoMassOutside>(), kind_of<PlayOutside>()});
  else
    kinds.insert(kinds.begin(), {kind_of<TwoMassMotorEncoder>(), kind_of<PlayMotorEncoder>()});
  Candidates candidates{fitted, encoder_step, {}};
  std::vector<TwoMassFit>& all = candidates.all;
  bool found_two = false;
  // The floor is that of one encoder.
  const double noise = both_recorded ? 0.0 : kMaxRmsOverFloorToStop * noise_floor(training).rms;
  const auto only_noise_left = [&] {
    return std::any_of(all.begin(), all.end(),
                       [&](const TwoMassFit& fit) { return fit.rms < noise; });
  };
  std::optional<JointFit> rigid;
  if (!fitted.empty() && !validation.empty())
    rigid = joint_fit(fitted, structure, search, encoder_step, true);
  // A rigid loop takes over a part of the vibration, with an integrator that the drive need not
  // have: both orders are tried, that with fewer parameters first.
  for (const int order : {2, 3}) {
    if (!rigid || only_noise_left()) break;
    if (order != structure.order && options.order != 0) continue;
    Structure of_order = structure;
    of_order.order = order;
    if (order == 3) std::erase(of_order.effects, kind_of<ConstantForce>());  // not observable
    const auto loop =
        order == structure.order ? rigid : joint_fit(fitted, of_order, search, encoder_step, true);
    const auto found = loop ? fit_two_masses(fitted, of_order, loop->model, loop->model,
                                             std::numeric_limits<double>::infinity(), kinds,
                                             encoder_step, determined)
                            : std::nullopt;
    if (!found) continue;
    found_two = true;
    const TwoMassFit first = without_empty_gap(*found);
    const std::size_t law = law_of(first.structure);
    if (options.friction) {
      candidates.add_with_law(first, *options.friction);
    } else {
      if (first.rms < noise ||
          std::find(kLawsOnLoad.begin(), kLawsOnLoad.end(), law) == kLawsOnLoad.end())
        all.push_back(first);
      for (const std::size_t other : kLawsOnLoad) {
        if (!only_noise_left()) candidates.add_with_law(first, other);
      }
    }
    // As beside modes: where more is left, the law of friction may have another virgin curve.
    const auto best = std::min_element(all.begin(), all.end(), less_left);
    if (options.friction.value_or(kFreeElements) == kFreeElements && best != all.end() &&
        best->structure.order == order && !only_noise_left())
      candidates.add_with_law(TwoMassFit(*best), kFreeElements);  // a copy: `all` grows
  }
  if (all.empty()) {
    if (options.masses == Masses::kTwo && found_two && options.friction)
      throw std::runtime_error(
          message(axis, ": two masses are found, but ", identity_of(*options.friction).id,
                  " has no valid fit beside them; choose another friction model, or none"));
    if (options.masses == Masses::kTwo)
      throw std::runtime_error(axis +
                               ": the training data do not determine two masses; identify a rigid "
                               "axis, or record reversals after which the load swings");
    return std::nullopt;
  }
  double skip_s = starting_state_s(rigid->model);
  for (const TwoMassFit& one : all) skip_s = std::max(skip_s, starting_state_s(one.model));
  const double of_rigid = judge(rigid->model, validation, skip_s).rms;
  trials.push_back({structure.order, structure.effects, of_rigid, false, 0, "", false});
  const std::size_t first = trials.size();
  std::size_t chosen = 0;
  double least = 0.0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double rms = judge(all[i].model, validation, skip_s).rms;
    const double most =
        law_of(all[i].structure) == kFreeElements ? kMaxRmsRatioForRichModel : kMaxRmsRatioOfLaw;
    if (i == 0 || rms < most * least) chosen = i, least = rms;
    trials.push_back({all[i].structure.order, all[i].structure.effects, rms, false, 0, "", false});
  }
  if (options.masses == Masses::kChosen && !(least < kMaxRmsRatioOfTwoMasses * of_rigid)) {
    trials[first + chosen].ruled_out =
        message("not below ", kMaxRmsRatioOfTwoMasses, " of the error of the rigid axis");
    return std::nullopt;
  }
  for (StructureTrial& trial : trials) trial.chosen = false;
  trials[first + chosen].chosen = true;
  return all[chosen];
}

}  // namespace servotwin
