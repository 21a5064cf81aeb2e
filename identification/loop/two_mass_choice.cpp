#include "identification/loop/two_mass_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "identification/least_squares/parallel.h"
#include "identification/loop/joint.h"
#include "identification/loop/message.h"
#include "identification/loop/output_error.h"
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
  if (std::all_of(training.begin(), training.end(),
                  [](const Segment& s) { return s.actual_motor.size() == s.size(); }))
    kinds.insert(kinds.end(), {kind_of<TwoMassOutside>(), kind_of<PlayOutside>()});
  else
    kinds.insert(kinds.begin(), {kind_of<TwoMassMotorEncoder>(), kind_of<PlayMotorEncoder>()});
  std::optional<JointFit> rigid;
  std::vector<TwoMassFit> all;
  // A rigid loop takes over a part of the vibration, with an integrator that the drive need not
  // have: the other order is tried as well.
  for (const int order : {structure.order, structure.order == 2 ? 3 : 2}) {
    if (fitted.empty() || validation.empty()) break;
    if (order != structure.order && options.order != 0) break;
    Structure of_order = structure;
    of_order.order = order;
    if (order == 3) std::erase(of_order.effects, kind_of<ConstantForce>());  // not observable
    const auto loop = joint_fit(fitted, of_order, search, encoder_step, true);
    if (order == structure.order) rigid = loop;
    if (!rigid) break;
    const auto found = loop ? fit_two_masses(fitted, of_order, loop->model, loop->model, kinds,
                                             encoder_step, determined)
                            : std::nullopt;
    if (!found) continue;
    const TwoMassFit first = without_empty_gap(*found);
    all.push_back(first);
    if (options.friction) continue;
    std::array<std::optional<TwoMassFit>, kLawsOnLoad.size()> others;
    in_parallel(others.size(), [&](std::size_t i) {
      if (const auto other = with_law(first, kLawsOnLoad[i]))
        others[i] = refined(*other, fitted, encoder_step, kFitRounds, kFitPasses);
    });
    for (const auto& other : others) {
      if (other && determined(other->model)) all.push_back(without_empty_gap(*other));
    }
  }
  if (all.empty()) {
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
    if (i == 0 || rms < kMaxRmsRatioOfLaw * least) chosen = i, least = rms;
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
