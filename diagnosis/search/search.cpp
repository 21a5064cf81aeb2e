#include "diagnosis/search/search.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "diagnosis/evidence/cuts.h"
#include "diagnosis/search/plausibility.h"
#include "diagnosis/search/variation.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/identify.h"
#include "identification/loop/joint.h"
#include "identification/loop/output_error.h"
#include "identification/loop/two_mass_fit.h"
#include "identification/recording/motion_range.h"
#include "twin/twin.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

constexpr int kBlocks = 4;  // of the cross-validation
// Cost along the simulated motion over cost along the measured one, below which the simulated
// motion is used.
constexpr double kMaxCostRatioToUseSimulation = 0.7;
// Travel after which friction and play have forgotten where they were [m], times the stretch of
// the axis (twin/effect.h): some times what guides and gaps have.
constexpr double kForgets = 1e-3;
constexpr double kFitStep_s = 1e-3;  // sampling time of the data for fits
// RMS with friction that grows over a travel over that with Coulomb friction, at most, for it to be
// the friction of a load.
constexpr double kMaxRmsRatioOfTravel = 0.8;

// Allowed deviation of the saturation coefficient from 1: along a measured motion, where it is
// estimated roughly, and along a simulated one.
constexpr double kMaxDeviationMeasured = 0.5, kMaxDeviationSimulated = 0.1;

/// Copies the intermittent effects from `found` to a model that was refitted to other data.
void keep_intermittent(const Model& found, Model& model) {
  for (std::size_t i = 0; i < model.effects.size(); ++i) {
    if (is_intermittent(model.effects[i].kind)) model.effects[i] = found.effects[i];
  }
}

/// Along an inaccurate motion a wide gap is fitted as a narrow one with a coefficient above 1: sets
/// the width to width times coefficient, and the coefficient to 1. True where the model was
/// changed.
bool widen_gap(Model& model) {
  for (Effect& effect : model.effects) {
    if (effect.kind != kind_of<Backlash>()) continue;
    const Parameter& width = shapes_of(effect.kind)[0];
    const Parameter& share = coefficients_of(effect.kind)[0];
    double& seen = effect.coefficient[0];
    if (!(seen > 0.0) || (seen > share.lower && seen < share.upper)) return false;
    effect.shape[0] = std::clamp(effect.shape[0] * seen, width.lower, width.upper);
    seen = 1.0;
    return true;
  }
  return false;
}

}  // namespace

Search::Search(std::vector<Segment> recorded, double training_to_s, const PoleBounds& bounds,
               const NoiseFloor& floor, bool rotary)
    : recorded_(std::move(recorded)),
      training_to_s_(training_to_s),
      bounds_(bounds),
      floor_(floor),
      rotary_(rotary) {
  divide();
}

double Search::ratio_beyond_noise(const Hypothesis& better, const Hypothesis& other) const {
  // The true noise is not above what any model leaves.
  const double noise =
      std::min({std::isfinite(floor_.rms) ? floor_.rms : 0.0, better.rms(), other.rms()});
  const double below = other.rms() * other.rms() - noise * noise;
  return below > 0.0 ? std::sqrt((better.rms() * better.rms() - noise * noise) / below) : 1.0;
}

void Search::detect_cuts(const Model& model) {
  std::vector<Eigen::ArrayXd> left;
  for (const Segment& s : recorded_) left.emplace_back(s.command - s.actual - simulate(model, s));
  if (find_cuts(recorded_, left)) divide();
}

void Search::divide() {
  training_ = cut(recorded_, -1e300, training_to_s_);
  held_.clear();
  begun_.clear();
  led_.clear();
  rest_.clear();
  // Blocks of equal duration; a gap in the recording shortens its block.
  const double from = training_.front().start_s, to = training_.back().end_s();
  const double forgets = kForgets * length_scale(training_);
  for (int b = 0; b < kBlocks; ++b) {
    const double begin = from + (to - from) * b / kBlocks,
                 end = from + (to - from) * (b + 1) / kBlocks;
    held_.push_back(cut(training_, begin, end - 1e-9));
    begun_.push_back(with_lead_in(held_.back(), training_, forgets));
    led_.push_back(with_lead_in(held_.back(), training_));
    std::vector<Segment> rest = cut(training_, -1e300, begin - 1e-9);
    for (Segment& s : cut(training_, end, 1e300)) rest.push_back(std::move(s));
    rest_.push_back(std::move(rest));
  }
  make_signals();
}

void Search::follow(const Hypothesis& h) {
  followed_ = Driver{h.model, servotwin::judge(h.model, training_).rms, false};
  const auto left = [&] {
    return thinned(signals(training_, followed_), h.structure, kFitStep_s).solve(h.point).cost;
  };
  const double by_encoder = left();
  followed_->knows_motion = true;
  followed_->knows_motion = left() < kMaxCostRatioToUseSimulation * by_encoder;
  make_signals();
}

void Search::make_signals() {
  training_signals_ = signals(training_, followed_);
  rest_signals_.resize(rest_.size());
  in_parallel(rest_.size(),
              [&](std::size_t b) { rest_signals_[b] = signals(rest_[b], followed_); });
}

std::vector<Signals> Search::signals(const std::vector<Segment>& segments,
                                     const std::optional<Driver>& driver) const {
  std::vector<Signals> out;
  for (const Segment& s : segments) {
    out.push_back(signals_of(s));
    if (!driver) continue;
    Model loop = driver->model;
    std::erase_if(loop.effects,
                  [](const Effect& e) { return identity_of(e.kind).acts == Acts::kReading; });
    out.back().loop_position = s.command - simulate(loop, s);
    if (driver->knows_motion) set_motion(out.back(), out.back().loop_position);
    add_drive(loop, out.back());
  }
  return out;
}

namespace {

OutputErrorOptions polishing(const NoiseFloor& floor) {
  OutputErrorOptions options;
  options.encoder_step = floor.encoder_step;
  options.rounds = 12;
  options.passes = 2;
  options.tolerance = 1e-3;
  options.covariance = false;
  return options;
}

}  // namespace

void Search::polish(Hypothesis& h) {
  const auto polished = output_error(training_, h.structure, h.model, polishing(floor_));
  if (!polished || !why_invalid(polished->model).empty()) return;
  if (servotwin::judge(polished->model, training_).rms >= servotwin::judge(h.model, training_).rms)
    return;
  h.model = polished->model;
  h.point = point_of(h.model, h.structure);
}

bool Search::is_plausible(const Model& model) const {
  return plausible(model, training_.front().start_s, training_.back().end_s(),
                   kMaxDeviationSimulated, floor_.encoder_step);
}

std::optional<Model> Search::start_in_simulation(const Hypothesis& h) const {
  const auto is_of = [](const Effect& effect, std::size_t kind) { return effect.kind == kind; };
  if (std::equal(h.model.effects.begin(), h.model.effects.end(), h.structure.effects.begin(),
                 h.structure.effects.end(), is_of))
    return h.model;
  if (!followed_ || followed_->model.loop.order != h.structure.order) return std::nullopt;
  const Model& followed = followed_->model;
  const bool has_law = std::any_of(followed.effects.begin(), followed.effects.end(),
                                   [](const Effect& e) { return is_friction_law(e.kind); });
  for (const std::size_t kind : h.structure.effects) {
    if (followed.find(kind) == nullptr && !(is_friction_law(kind) && has_law)) return std::nullopt;
  }
  return begun_from(followed, h.structure);
}

bool Search::refit_in_simulation(Hypothesis& h) {
  const std::optional<Model> start = start_in_simulation(h);
  if (!start || !why_invalid(*start).empty()) return false;
  h.model = *start;
  ++fits_;
  const auto found = output_error(training_, h.structure, h.model, polishing(floor_));
  if (!found || !why_invalid(found->model).empty() || !is_plausible(found->model)) return false;
  h.model = found->model;
  h.point = point_of(h.model, h.structure);
  h.cost = left_in_training(h.model);
  return true;
}

double Search::left_in_training(const Model& model) const {
  const std::vector<double> squares = left_by(model, training_);
  return std::accumulate(squares.begin(), squares.end(), 0.0);
}

bool Search::only_in_simulation(const Structure& structure) const {
  return has_two_masses(structure) || (has_filter(structure) && followed_ &&
                                       followed_->model.find(kind_of<ControlFilter>()) != nullptr);
}

bool Search::fit(Hypothesis& h, const std::vector<Point>& from) {
  if (only_in_simulation(h.structure)) return refit_in_simulation(h);
  const Projection all = thinned(training_signals_, h.structure, kFitStep_s);
  PoleSearchOptions options;
  options.bounds = bounds_;
  options.tolerance = 1e-5;
  options.from = from;
  ++fits_;
  const auto found = pole_search(all, options);
  if (!found) return false;
  h.model = all.model_of(found->point, found->solution.linear);
  h.model.sample_time_s = training_.front().sample_time_s;  // of the data before thinning
  const bool widened = widen_gap(h.model);
  if (!why_invalid(h.model).empty() ||
      !plausible(h.model, training_.front().start_s, training_.back().end_s(),
                 kMaxDeviationMeasured, floor_.encoder_step))
    return false;
  h.point = point_of(h.model, h.structure);
  h.cost = found->solution.cost;
  if (widened) polish(h);
  return true;
}

bool Search::part_masses(Hypothesis& h, const Hypothesis& rigid, const Model& to_beat, double most,
                         const std::vector<std::size_t>& kinds,
                         const std::vector<std::size_t>& laws) {
  ++fits_;
  const double worth = servotwin::judge(to_beat, training_).rms;
  auto found = servotwin::fit_two_masses(training_, rigid.structure, rigid.model, to_beat, most,
                                         kinds, floor_.encoder_step,
                                         [this](const Model& m) { return is_plausible(m); });
  if (!found) return false;
  // Not with play, where the laws took a third of a diagnosis and gained little: 0.100 instead of
  // 0.116 um on the hold-out of test/backlash/2700, in 80 instead of 54 s.
  if (found->rms < worth && found->model.find(kind_of<CoulombFriction>()) != nullptr &&
      !plays(found->model)) {
    std::vector<std::optional<TwoMassFit>> others(laws.size());
    in_parallel(laws.size(), [&](std::size_t i) {
      if (const auto other = with_law(*found, laws[i]))
        others[i] = refined(*other, training_, floor_.encoder_step, kTryRounds, kTryPasses);
    });
    // The best of them is fitted on, and taken if it is clearly better.
    const std::optional<TwoMassFit>* best = nullptr;
    for (const auto& other : others) {
      if (other && is_plausible(other->model) &&
          (best == nullptr || other->rms < kMaxRmsRatioToAdd * (*best)->rms))
        best = &other;
    }
    if (best != nullptr) {
      auto other = refined(**best, training_, floor_.encoder_step, kFitRounds, kFitPasses);
      if (!other) other = *best;
      if (other->rms < kMaxRmsRatioOfTravel * found->rms && is_plausible(other->model))
        found = std::move(other);
    }
  }
  *found = without_empty_gap(std::move(*found));
  h.structure = found->structure;
  h.model = found->model;
  h.point = point_of(h.model, h.structure);
  return true;
}

bool Search::fit_less(Hypothesis& h, const std::vector<Point>& from, const Model& model) {
  Hypothesis simulated = h;
  const bool fits = fit(h, from);
  if (only_in_simulation(h.structure) || model.loop.order != h.structure.order) return fits;
  simulated.model = begun_from(model, simulated.structure);
  if (!why_invalid(simulated.model).empty()) return fits;
  polish(simulated);
  simulated.point = point_of(simulated.model, simulated.structure);
  simulated.cost = left_in_training(simulated.model);
  if (!std::isfinite(simulated.cost) || !is_plausible(simulated.model) ||
      (fits && left_in_training(h.model) <= simulated.cost))
    return fits;
  h = std::move(simulated);
  return true;
}

bool Search::fit_friction(Hypothesis& h, const Point& from) {
  if (has_two_masses(h.structure)) return refit_in_simulation(h);
  PoleSearchOptions options;
  options.bounds = bounds_;
  options.tolerance = 1e-5;
  options.from = {from};
  ++fits_;
  const auto found =
      joint_fit(training_, h.structure, options, floor_.encoder_step, false, nullptr, kFitStep_s);
  if (!found || !why_invalid(found->model).empty()) return false;
  h.model = found->model;
  h.point = point_of(h.model, h.structure);
  h.cost = found->fit.solution.cost;
  polish(h);
  if (only_in_simulation(h.structure)) h.cost = left_in_training(h.model);
  return true;
}

bool Search::fit_elsewhere(Hypothesis& h, const std::vector<Segment>& segments) {
  PoleSearchOptions options;
  options.bounds = bounds_;
  ++fits_;
  const auto found = joint_fit(segments, h.structure, options, floor_.encoder_step, true);
  if (!found || !why_invalid(found->model).empty()) return false;
  h.model = found->model;
  h.point = point_of(h.model, h.structure);
  return true;
}

std::vector<std::vector<double>> Search::starts_of(std::size_t kind,
                                                   const std::vector<double>& shapes) const {
  std::vector<std::vector<double>> out{shapes};
  if (kind != kind_of<TorqueSaturation>()) return out;
  // Along a measured motion the limit is estimated wrongly, and a limit above all demands has no
  // derivative. The search therefore starts below the largest demands, for several values of the
  // viscous friction that the motor has to overcome.
  std::optional<Driver> simulated = followed_;
  if (simulated) simulated->knows_motion = true;
  const std::vector<Signals> motion = signals(training_, simulated);
  for (const double viscous : {0.1, 1.0, 2.0}) {
    std::vector<double> asked;
    for (const Signals& s : motion) {
      const Eigen::ArrayXd here = (s.demand + viscous * s.velocity).abs();
      asked.insert(asked.end(), here.begin(), here.end());
    }
    if (asked.empty()) break;
    std::sort(asked.begin(), asked.end());
    for (const double beyond : {0.001, 0.01}) {
      std::vector<double> start = shapes;
      start[0] =
          asked[static_cast<std::size_t>((1.0 - beyond) * static_cast<double>(asked.size() - 1))];
      start[2] = viscous;
      out.push_back(std::move(start));
    }
  }
  return out;
}

bool Search::vary(Hypothesis& h, const Model& held, std::size_t kind,
                  const std::vector<double>& shapes) const {
  Varied all;
  all.cost = 1e300;
  const Variation variation(held, training_);
  for (const std::vector<double>& from : starts_of(kind, shapes)) {
    Varied one;
    one.add(addition_to(held, kind, from));
    if (variation.fit(one) && one.cost < all.cost && is_plausible(one.of(held)))
      all = std::move(one);
  }
  if (!(all.cost < 1e300)) return false;
  h.model = all.of(held);
  h.point = point_of(h.model, h.structure);
  h.cost = 0.5 * all.cost;
  if (is_intermittent(kind)) {
    judge_as_is(h);
    return true;
  }
  h.pieces.clear();
  const std::vector<Varied> others = left_out(held, all, begun_);
  for (std::size_t b = 0; b < held_.size(); ++b) {
    if (held_[b].empty() || rest_[b].empty()) continue;
    const std::vector<double> left = left_in(b, others[b].of(held));
    h.pieces.insert(h.pieces.end(), left.begin(), left.end());
  }
  return true;
}

std::vector<double> Search::left_in(std::size_t block, const Model& model) const {
  std::vector<double> out;
  for (std::size_t i = 0; i < held_[block].size(); ++i) {
    const Segment& s = led_[block][i];
    const Eigen::ArrayXd left = s.command - s.actual - simulate(model, s);
    add_pieces(held_[block][i], left.tail(held_[block][i].size()), out);
  }
  return out;
}

void Search::judge_as_is(Hypothesis& h) const {
  h.pieces.clear();
  std::vector<Eigen::ArrayXd> left;
  for (const Segment& s : training_) left.emplace_back(s.command - s.actual - simulate(h.model, s));
  for (std::size_t b = 0; b < held_.size(); ++b) {
    if (held_[b].empty() || rest_[b].empty()) continue;
    for (std::size_t i = 0; i < held_[b].size(); ++i) {
      const Segment& s = led_[b][i];
      const auto whole = std::find_if(training_.begin(), training_.end(),
                                      [&](const Segment& one) { return one.start_s == s.start_s; });
      const Eigen::Index size = held_[b][i].size();
      add_pieces(
          held_[b][i],
          left[static_cast<std::size_t>(whole - training_.begin())].segment(s.size() - size, size),
          h.pieces);
    }
  }
}

void Search::judge(Hypothesis& h) const {
  // With saturation nothing is refitted: along a measured motion the limit is estimated wrongly,
  // and the state of the integrator at the start of a cut-out block is not known.
  if (motor_limit_of(h.model) != nullptr) return judge_as_is(h);
  if (has_two_masses(h.structure) || has_filter(h.structure)) return judge_polished(h);
  h.pieces.clear();
  // Effects are driven by the motion of the better model, so that a law of friction is not judged
  // by the motion of a model without it.
  const double own = servotwin::judge(h.model, training_).rms;
  const bool better = !followed_ || own < followed_->rms;
  const Driver of_own{h.model, own, followed_ && followed_->knows_motion};
  std::vector<std::vector<double>> pieces(held_.size());
  in_parallel(held_.size(), [&](std::size_t b) {
    if (held_[b].empty() || rest_[b].empty()) return;
    const Projection rest(better ? signals(rest_[b], of_own) : rest_signals_[b], h.structure);
    Model model = rest.model_of(h.point, rest.solve(h.point).linear);
    keep_intermittent(h.model, model);
    if (!why_invalid(model).empty()) model = h.model;
    pieces[b] = left_in(b, model);
  });
  for (const std::vector<double>& left : pieces)
    h.pieces.insert(h.pieces.end(), left.begin(), left.end());
}

void Search::judge_polished(Hypothesis& h) const {
  h.pieces.clear();
  const std::vector<Model> models = left_out(begun_, h.structure, h.model, floor_.encoder_step);
  for (std::size_t b = 0; b < held_.size(); ++b) {
    if (held_[b].empty() || rest_[b].empty()) continue;
    Model model = models[b];
    keep_intermittent(h.model, model);
    const std::vector<double> left = left_in(b, model);
    h.pieces.insert(h.pieces.end(), left.begin(), left.end());
  }
}

/// What the simulation leaves; the derivatives of two masses are those of a rigid axis.
Screen Search::simulated_screen(const Projection& coarse, const Hypothesis& h) const {
  Eigen::MatrixXd tangent = coarse.full_jacobian(h.point, coarse.solve(h.point).linear);
  if (has_two_masses(h.structure))
    tangent = tangent.leftCols(h.structure.order + h.structure.coefficient_count()).eval();
  return {coarse.segments(), h.model, left_by_simulation(coarse, training_, h.model),
          std::move(tangent)};
}

std::vector<Screened> Search::screen(const Hypothesis& h,
                                     const std::vector<std::size_t>& kinds) const {
  const Projection coarse = thinned(training_signals_, h.structure, kScreenStep_s);
  const Screen screen = only_in_simulation(h.structure)
                            ? simulated_screen(coarse, h)
                            : Screen(coarse, h.point, floor_.encoder_step);
  std::vector<Screened> out;
  out.resize(kinds.size());
  in_parallel(kinds.size(), [&](std::size_t i) { out[i] = screen.look(kinds[i]); });
  std::sort(out.begin(), out.end(), [](const auto& l, const auto& r) { return l.gain > r.gain; });
  return out;
}

}  // namespace servotwin
