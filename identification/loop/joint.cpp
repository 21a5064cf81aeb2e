#include "identification/loop/joint.h"

#include <algorithm>
#include <cmath>

#include "identification/least_squares/chart.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/mode_search.h"
#include "identification/recording/motion_range.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kCoarseStep_s = 4e-3;  // of the data on which starts are compared
// Optima whose costs differ by less than this share count as one.
constexpr double kMaxCostDifferenceOfOneOptimum = 1e-4;
// Quantisation RMS over residual RMS from which on the encoder hides the motion within its steps:
// friction is then computed along the simulated motion.
constexpr double kMinQuantisationShare = 0.5;
// Residual deviation over encoder step below which the fit depends on the times at which readings
// change, and has several optima.
constexpr double kMaxDeviationOverStep = 0.1;

/// Start values of the shapes of one effect, on a grid about the catalogue's, on an axis with this
/// stretch (twin/effect.h).
std::vector<std::vector<double>> shape_grid(std::size_t kind, double length_scale) {
  constexpr std::size_t kGriddedShapes = 3;  // an effect lists its most influential shapes first
  std::vector<std::vector<double>> grid{{}};
  for (std::size_t i = 0; i < shapes_of(kind).size(); ++i) {
    const Parameter p = stretched(shapes_of(kind)[i], length_scale);
    std::vector<double> values{p.start};
    if (i < kGriddedShapes && p.lower > 0.0)
      values = {std::max(0.3 * p.start, p.lower), p.start, std::min(3.0 * p.start, p.upper)};
    std::vector<std::vector<double>> longer;
    for (double value : values) {
      for (const auto& begun : grid) {
        longer.push_back(begun);
        longer.back().push_back(value);
      }
    }
    grid = std::move(longer);
  }
  return grid;
}

/// The place of the friction in the structure; its size where there is none.
std::size_t friction_place(const Structure& structure) {
  const auto kinds = friction_kinds();
  std::size_t i = 0;
  while (i < structure.effects.size() &&
         std::find(kinds.begin(), kinds.end(), structure.effects[i]) == kinds.end()) {
    ++i;
  }
  return i;
}

/// Step 2: with these poles, the best shapes of the friction for every value of its first one. The
/// poles of step 1 favour a wrong value, so step 3 starts from each of them. `held`: the friction
/// whose shapes `rough` has.
std::vector<Point> friction_starts(const Projection& data, const Structure& structure,
                                   std::size_t place, const Point& rough, std::size_t held,
                                   int& evaluations) {
  std::size_t first = 0;
  for (std::size_t i = 0; i < place; ++i) first += shapes_of(structure.effects[i]).size();
  // Behind the shapes of that friction.
  const auto rest =
      rough.shapes.begin() + static_cast<std::ptrdiff_t>(first + shapes_of(held).size());
  const Projection coarse = thinned(data, kCoarseStep_s);
  std::vector<std::pair<double, Point>> best;
  for (const std::vector<double>& shapes :
       shape_grid(structure.effects[place], length_scale(data.segments()))) {
    Point point{rough.denominator,
                {rough.shapes.begin(), rough.shapes.begin() + static_cast<std::ptrdiff_t>(first)},
                rough.modes};
    point.shapes.insert(point.shapes.end(), shapes.begin(), shapes.end());
    point.shapes.insert(point.shapes.end(), rest, rough.shapes.end());
    const double cost = coarse.solve(point).cost;
    ++evaluations;
    auto same = std::find_if(best.begin(), best.end(), [&](const auto& other) {
      return other.second.shapes[first] == shapes.front();
    });
    if (same == best.end()) {
      best.emplace_back(cost, point);
    } else if (cost < same->first) {
      *same = {cost, point};
    }
  }
  std::vector<Point> out;
  for (auto& [cost, point] : best) out.push_back(std::move(point));
  return out;
}

/// Step 3 from each of these; the best first, without duplicates.
std::vector<PoleFit> refined(const Projection& data, const std::vector<Point>& starts,
                             const PoleSearchOptions& options, int& evaluations) {
  std::vector<std::optional<PoleFit>> all(starts.size());
  in_parallel(starts.size(), [&](std::size_t i) {
    PoleSearchOptions from = options;
    from.from = {starts[i]};
    all[i] = pole_search(data, from);
  });
  std::vector<PoleFit> fits;
  for (std::optional<PoleFit>& found : all) {
    if (!found) continue;
    evaluations += found->evaluations;
    const bool known = std::any_of(fits.begin(), fits.end(), [&](const PoleFit& other) {
      return std::abs(other.solution.cost - found->solution.cost) <
             kMaxCostDifferenceOfOneOptimum * other.solution.cost;
    });
    if (!known) fits.push_back(std::move(*found));
  }
  std::sort(fits.begin(), fits.end(),
            [](const auto& l, const auto& r) { return l.solution.cost < r.solution.cost; });
  return fits;
}

/// The same data with the motion of the model's free simulation for what friction sees.
std::vector<Signals> along_simulation(const std::vector<Segment>& segments, const Model& model) {
  std::vector<Signals> out;
  for (const Segment& s : segments) {
    Signals signals = signals_of(s);
    set_motion(signals, s.command - simulate(model, s));
    add_drive(model, signals);
    out.push_back(std::move(signals));
  }
  return out;
}

/// - log of likelihood times prior. Where a coarse encoder hides the presliding travel, optima of
/// very different travel are as likely as each other: the one that is nearest to what axes have, in
/// standard deviations of a factor of kFactorOfOneDeviation, is kept then. The prior is worth
/// kMaxPriorWorth at most, which is about chance: it decides nothing else, whatever the axis
/// measures its travel in.
double improbability(const OutputErrorFit& fit) {
  constexpr double kFactorOfOneDeviation = 3.0, kMaxPriorWorth = 3.0;
  double prior = 0.0;
  for (const Effect& effect : fit.model.effects) {
    if (!is_friction_law(effect.kind)) continue;
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      const double shape = effect.shape[i++];
      if (p.unit != "m" || !(p.start > 0.0) || !(shape > 0.0)) continue;
      const double deviations = std::log(shape / p.start) / std::log(kFactorOfOneDeviation);
      prior += 0.5 * deviations * deviations;
    }
  }
  return fit.minus_log_likelihood + std::min(prior, kMaxPriorWorth);
}

}  // namespace

std::vector<std::size_t> friction_kinds() { return {kFrictionLaws.begin(), kFrictionLaws.end()}; }

std::vector<std::size_t> compared_frictions() {
  return {kind_of<CoulombFriction>(), kind_of<Dahl>(),     kind_of<Presliding>(),
          kind_of<LuGre>(),           kind_of<Stribeck>(), kind_of<PreslidingStribeck>()};
}

FirstStep::FirstStep(std::vector<Signals> signals, Structure structure, PoleSearchOptions options)
    : signals_(std::move(signals)),
      structure_(std::move(structure)),
      options_(std::move(options)),
      rigid_(pole_search(Projection(signals_, structure_), options_)) {}

bool FirstStep::follow_friction() {
  if (fit_ || !rigid_) return fit_.has_value();
  Structure structure = structure_;
  const std::size_t place = friction_place(structure);
  const bool slides = place < structure.effects.size();
  if (slides) structure.effects[place] = kind_of<Presliding>();
  data_.emplace(signals_, structure);
  if (!slides) {
    fit_ = rigid_;
    return true;
  }
  int evaluations = 0;
  auto fits = refined(*data_,
                      friction_starts(*data_, structure, place, rigid_->point,
                                      kind_of<CoulombFriction>(), evaluations),
                      options_, evaluations);
  if (!fits.empty()) fit_ = std::move(fits.front());
  // An axis that slides more than it creeps is followed better by friction that turns at once.
  if (!fit_ || rigid_->solution.cost < fit_->solution.cost) {
    data_.emplace(signals_, structure_);
    fit_ = rigid_;
  }
  return true;
}

bool FirstStep::add_mode() {
  if (!follow_friction()) return false;
  auto more = with_one_more_mode(*data_, *fit_, options_);
  if (!more) return false;
  data_ = std::move(more->data);
  fit_ = std::move(more->fit);
  return true;
}

std::optional<Point> FirstStep::start(std::optional<std::size_t> coupling) {
  if (!coupling && !data_) {
    if (!rigid_) return std::nullopt;
    return rigid_->point;
  }
  if (!follow_friction()) return std::nullopt;
  Point out = fit_->point;
  if (coupling) {
    Structure structure = data_->structure();
    structure.effects.push_back(*coupling);
    PoleSearchOptions beside = options_;
    if (*coupling == kind_of<CrossCoupling>()) {
      // The damping of the other axis' loop is unknown.
      constexpr double kDamping = 1.0;
      for (const double hz : {5.0, 20.0, 80.0}) {
        beside.from.push_back(out);
        beside.from.back().shapes.insert(beside.from.back().shapes.end(), {hz, kDamping});
      }
    } else {
      beside.from.push_back(out);
    }
    auto found = pole_search(Projection(signals_, structure), beside);
    if (!found) return std::nullopt;
    out = std::move(found->point);
  }
  const std::size_t place = friction_place(structure_);
  if (place < structure_.effects.size() &&
      data_->structure().effects[place] == kind_of<Presliding>()) {
    std::ptrdiff_t before = 0;
    for (std::size_t i = 0; i < place; ++i)
      before += static_cast<std::ptrdiff_t>(shapes_of(structure_.effects[i]).size());
    const auto at = out.shapes.begin() + before;
    const auto end = at + static_cast<std::ptrdiff_t>(shapes_of(kind_of<Presliding>()).size());
    const auto coulomb = out.shapes.erase(at, end);
    std::vector<double> starts;
    for (const Parameter& p : shapes_of(kind_of<CoulombFriction>())) starts.push_back(p.start);
    out.shapes.insert(coulomb, starts.begin(), starts.end());
  }
  return out;
}

std::optional<JointFit> joint_fit(const std::vector<Segment>& segments, const Structure& structure,
                                  const PoleSearchOptions& options, double encoder_step,
                                  bool polish, const Point* first, double step_s) {
  std::vector<Signals> signals;
  for (const Segment& s : segments) signals.push_back(signals_of(s));
  const std::size_t place = friction_place(structure);
  Structure simple = structure;
  if (place < structure.effects.size()) simple.effects[place] = kind_of<CoulombFriction>();

  const bool simplest = simple.effects == structure.effects, given = !options.from.empty();
  const auto coupled = std::find_if(simple.effects.begin(), simple.effects.end(), couples);
  const auto coupling =
      coupled != simple.effects.end() ? std::optional(*coupled) : std::optional<std::size_t>();
  std::optional<Point> begun;
  std::optional<PoleFit> fit;
  if (first != nullptr) {
    begun = *first;
  } else if (!given) {
    Structure rigid = simple;
    rigid.modes = 0;
    std::erase_if(rigid.effects, couples);
    FirstStep step(signals, rigid, options);
    for (int i = 0; i < structure.modes; ++i) {
      if (!step.add_mode()) return std::nullopt;
    }
    begun = step.start(coupling);
    if (!begun) return std::nullopt;
    if (structure.modes == 0 && !coupling) fit = step.rigid();
  }
  if (simplest && !fit) {
    PoleSearchOptions from = options;
    if (begun) from.from = {*begun};
    fit = pole_search(Projection(signals, simple), from);
    if (!fit) return std::nullopt;
  }
  const auto projection = [&](std::vector<Signals> all) {
    return simplest || !(step_s > 0.0) ? Projection(std::move(all), structure)
                                       : thinned(all, structure, step_s);
  };
  Projection data = projection(std::move(signals));
  const auto model_of = [&](const Point& at, const Eigen::VectorXd& linear) {
    Model model = data.model_of(at, linear);
    model.sample_time_s = segments.front().sample_time_s;  // of the data before thinning
    return model;
  };
  std::vector<Point> rivals;
  if (!simplest) {
    int evaluations = fit ? fit->evaluations : 0;
    const Point rough = begun ? *begun : options.from.front();
    const std::size_t held = begun ? kind_of<CoulombFriction>() : structure.effects[place];
    std::vector<Point> starts = friction_starts(data, structure, place, rough, held, evaluations);
    starts.insert(starts.end(), options.from.begin(), options.from.end());
    const auto from_starts = [&](const std::vector<Point>& from) {
      if (!(step_s > 0.0)) return refined(data, from, options, evaluations);
      for (const PoleFit& one : refined(thinned(data, kCoarseStep_s), from, options, evaluations)) {
        if (auto found = refined(data, {one.point}, options, evaluations); !found.empty())
          return found;
      }
      return std::vector<PoleFit>{};
    };
    auto fits = from_starts(starts);
    // Where quantisation dominates the model's error, the simulated motion is more accurate.
    for (int round = 0; round < 2 && !fits.empty(); ++round) {
      const Model model = model_of(fits.front().point, fits.front().solution.linear);
      const double left =
          std::sqrt(2.0 * fits.front().solution.cost / static_cast<double>(data.rows()));
      if (!why_invalid(model).empty() ||
          encoder_step / std::sqrt(12.0) < kMinQuantisationShare * left)
        break;
      data = projection(along_simulation(segments, model));
      for (Point& start : starts) {
        start.denominator = fits.front().point.denominator;
        start.modes = fits.front().point.modes;
      }
      starts.push_back(fits.front().point);
      auto better = from_starts(starts);
      starts.pop_back();
      if (better.empty()) break;
      fits = std::move(better);
    }
    if (fits.empty()) return std::nullopt;
    fit = fits.front();
    fit->evaluations = evaluations;
    rivals = std::move(starts);
    for (std::size_t i = 1; i < fits.size(); ++i) rivals.push_back(fits[i].point);
  }

  JointFit out;
  out.fit = *fit;
  out.projected = model_of(fit->point, fit->solution.linear);
  out.model = out.projected;
  out.condition_number = condition_number(data, fit->point);
  if (polish) {
    auto polished = output_error(segments, structure, out.projected, {encoder_step});
    // Along the measured motion, friction at the ends of an oscillation is wrong: step 3 may have
    // left the optimum from which it started.
    if (given && structure.modes > 0) {
      std::vector<std::optional<OutputErrorFit>> direct(options.from.size());
      in_parallel(direct.size(), [&](std::size_t i) {
        const Point& from = options.from[i];
        direct[i] = output_error(segments, structure, model_of(from, data.solve(from).linear),
                                 {encoder_step});
      });
      for (auto& one : direct) {
        if (one && (!polished || one->minus_log_likelihood < polished->minus_log_likelihood))
          polished = std::move(one);
      }
    }
    // With a coarse encoder there are several optima: the most probable one is kept.
    if (polished && polished->sigma < kMaxDeviationOverStep * encoder_step) {
      double least = improbability(*polished);
      for (const Point& rival : rivals) {
        const Model from = model_of(rival, data.solve(rival).linear);
        const auto brief = output_error(segments, structure, from, {encoder_step, 30, 1e-6, 3});
        if (!brief || improbability(*brief) >= least) continue;
        auto full = output_error(segments, structure, brief->model, {encoder_step});
        if (!full || improbability(*full) >= least) continue;
        least = improbability(*full);
        polished = std::move(full);
      }
    }
    if (polished) {
      out.model = polished->model;
      out.covariance = polished->covariance;
      out.linear = data.model_columns();
      return out;
    }
  }
  out.covariance = covariance(data, *fit);
  out.linear = fit->solution.linear.size();
  return out;
}

}  // namespace servotwin
