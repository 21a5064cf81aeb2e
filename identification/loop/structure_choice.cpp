#include "identification/loop/structure_choice.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <optional>
#include <stdexcept>
#include <tuple>

#include "identification/loop/free_elements.h"
#include "identification/loop/joint.h"
#include "identification/loop/message.h"
#include "identification/loop/moving_modes.h"
#include "identification/recording/noise_floor.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// Validation RMS of a richer structure over that of a simpler one, at most, to accept the richer.
// The validation data are not used to fit either.
constexpr double kMaxRmsRatioToAccept = 0.97;
// The same for a mode or a coupled axis, which have five or six parameters each. Without any mode
// an improvement of 7 % was observed (EMPS), with a two-mass axis driven by another one 15 %.
constexpr double kMaxRmsRatioForMode = 0.9;
// The same for a filter of the control, with six parameters. A swinging load, whose force two poles
// cannot be, was followed to 0.3 with the damping at its bound, EMPS to 0.94.
constexpr double kMaxRmsRatioForFilter = 0.7;
constexpr double kMaxFrequencyOfRate = 0.3;  // of a start: faster poles are not seen in the samples
// A loop in which zeros in the right half plane account for more than this share of the lag
// imitates a delay.
constexpr double kMaxLagShareOfUnstableZeros = 0.5;
// Acceleration feed-forward beyond this multiple of the moved mass compensates a delay that does
// not exist.
constexpr double kMaxAccelerationFeedforward = 1.5;

// Time that is not judged at the start of a segment: friction and integrator forget their initial
// state within it.
constexpr double kSettlingTime_s = 0.5;
constexpr double kNotFitted = 1e300;  // residual of a structure that could not be fitted
constexpr const char* kNoFit = "no stable fit within the bounds";

/// The share of the loop's lag that is caused by zeros in the right half plane. Servo loops with
/// feed-forward have no such zeros (docs/theory.md 1.3); a rational loop needs them to imitate a
/// delay.
double imitated_delay_share(const Loop& loop) {
  const int n = loop.order;
  const double an = loop.denominator[static_cast<std::size_t>(n - 1)];
  const double lag = loop.numerator[static_cast<std::size_t>(n - 1)] / an;
  // x / x_r = (b_0 s^n + ... + b_n) / P with b_i = a_i - c_i.
  Eigen::VectorXd b(n + 1);
  b(0) = 1.0 - loop.numerator[0];
  for (int i = 1; i < n; ++i)
    b(i) = loop.denominator[static_cast<std::size_t>(i - 1)] -
           loop.numerator[static_cast<std::size_t>(i)];
  b(n) = an;
  int lead = 0;
  while (lead < n && std::abs(b(lead)) < 1e-9) ++lead;
  const int degree = n - lead;
  if (degree < 1 || !(lag > 0.0)) return 0.0;
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(degree, degree);
  for (int i = 0; i + 1 < degree; ++i) companion(i + 1, i) = 1.0;
  for (int i = 0; i < degree; ++i) companion(i, degree - 1) = -b(n - i) / b(lead);
  double imitated = 0.0;
  const Eigen::VectorXcd zeros = eigenvalues(companion);
  for (const std::complex<double>& zero : zeros) {
    if (zero.real() > 0.0) imitated += 2.0 * zero.real() / std::norm(zero);
  }
  return imitated / lag;
}

struct Trial {
  Structure structure;
  double cost = kNotFitted;  // on what it was fitted to
  double validation = kNotFitted;
  std::string ruled_out = kNoFit;
};

/// Why this loop without a delay imitates one; empty if it does not.
std::string why_delay(const Loop& loop, double delay_max_s) {
  const double imitated = delay_max_s > 0.0 ? imitated_delay_share(loop) : 0.0;
  if (imitated <= kMaxLagShareOfUnstableZeros) return {};
  return message("zeros in the right half plane account for ", 100.0 * imitated,
                 " % of its lag: the loop imitates a delay");
}

/// Why the delay of this model imitates a velocity lag; empty if it does not. `before`: the
/// structures without it.
std::string why_no_delay(const Model& model, double delay_max_s, const Trial& trial,
                         const std::vector<Trial>& before) {
  if (model.command_delay_s() > delay_max_s) {
    return message("its delay, ", 1e3 * model.command_delay_s(),
                   " ms, exceeds the search limit of ", 1e3 * delay_max_s, " ms");
  }
  if (lag_in_disguise(model)) {
    return message(
        "acceleration feed-forward of ", 1.0 - model.loop.numerator[0],
        " times the moved mass compensates the delay: the model imitates a velocity lag");
  }
  // A delay in place of the velocity lag has as many parameters, so the costs of the fits compare.
  std::vector<std::size_t> without = trial.structure.effects;
  std::erase(without, kind_of<TimeDelay>());
  for (const Trial& rival : before) {
    if (rival.structure.order == trial.structure.order && rival.structure.effects == without &&
        rival.ruled_out.empty() && rival.cost <= trial.cost) {
      return "a velocity lag with the same number of parameters fits better than the delay";
    }
  }
  return {};
}

std::vector<Structure> structures(const IdentifyOptions& options, bool rotary) {
  const std::size_t friction = kind_of<CoulombFriction>(), constant = kind_of<ConstantForce>(),
                    delay = kind_of<TimeDelay>();
  std::vector<Structure> out;
  for (int order : {2, 3}) {
    if (options.order != 0 && options.order != order) continue;
    // With an integrator a constant force causes no steady tracking error.
    out.push_back({order, {friction}, false});
    if (order == 2) out.push_back({order, {friction, constant}, false});
    if (rotary && options.beyond_loop)
      out.push_back({order, {friction, kind_of<SwingingLoad>()}, false});
    if (options.delay_max_s > 0.0) {
      out.push_back({order, {friction, delay}, true});
      if (order == 2) out.push_back({order, {friction, constant, delay}, true});
    }
  }
  return out;
}

/// The trial to take, of these orders: a richer one only if it is clearly better. Null if none is
/// valid.
const Trial* best_of(const std::vector<Trial>& trials, const std::vector<int>& orders) {
  const Trial* best = nullptr;
  for (const Trial& trial : trials) {
    if (std::find(orders.begin(), orders.end(), trial.structure.order) != orders.end() &&
        trial.ruled_out.empty() && std::isfinite(trial.validation) &&
        (best == nullptr || trial.validation < kMaxRmsRatioToAccept * best->validation))
      best = &trial;
  }
  return best;
}

std::vector<Signals> signals_of(const std::vector<Segment>& segments) {
  std::vector<Signals> signals;
  for (const Segment& s : segments) signals.push_back(servotwin::signals_of(s));
  return signals;
}

Projection projection_of(const std::vector<Segment>& segments, const Structure& structure) {
  return {signals_of(segments), structure};
}

/// A fit with constant modes and its RMS on the validation data.
struct Stood {
  Structure structure;
  Model model;
  std::optional<std::size_t> coupling;
  double validation = 0.0;
};

/// The same with modes that change with position.
struct Moved {
  std::optional<OutputErrorFit> fit;
  bool asked = false;
  std::string ruled_out;
  double validation = kAbsent;
};

/// Laws with a level per direction contain the constant force. Whether it was taken out.
bool without_constant_force(Structure& structure, std::size_t law) {
  const bool both = law == kind_of<Stribeck>() || law == kind_of<ModifiedStribeck>();
  return both && std::erase(structure.effects, kind_of<ConstantForce>()) > 0;
}

Structure moving_of(Structure structure) {
  structure.moving = true;
  return structure;
}

/// The fits for which modes that change with position are tried: the best one and the one with
/// presliding, because an unsuitable friction model hides the change.
std::vector<std::size_t> asked_whether_modes_move(const std::vector<Stood>& stood) {
  const auto best =
      std::min_element(stood.begin(), stood.end(),
                       [](const Stood& l, const Stood& r) { return l.validation < r.validation; });
  const auto presliding = std::find_if(stood.begin(), stood.end(), [](const Stood& one) {
    return one.model.find(kind_of<Presliding>()) != nullptr;
  });
  std::vector<std::size_t> out{static_cast<std::size_t>(best - stood.begin())};
  if (presliding != stood.end() && presliding != best)
    out.push_back(static_cast<std::size_t>(presliding - stood.begin()));
  return out;
}

/// The fit so far as a start of a search for friction with free elements.
Point with_free_elements(Point point, const Structure& structure, std::size_t place, double form) {
  std::ptrdiff_t before = 0;
  for (std::size_t i = 0; i < place; ++i)
    before += static_cast<std::ptrdiff_t>(shapes_of(structure.effects[i]).size());
  const std::size_t law = structure.effects[place];
  const auto at = point.shapes.begin() + before;
  const auto shapes = free_elements(law, &*at, form).shapes;
  const auto rest = point.shapes.erase(at, at + static_cast<std::ptrdiff_t>(shapes_of(law).size()));
  point.shapes.insert(rest, shapes.begin(), shapes.end());
  return point;
}

class StructureChoice {
 public:
  StructureChoice(const std::string& name, bool rotary, const std::vector<Segment>& training,
                  const IdentifyOptions& options, double encoder_step,
                  std::vector<StructureTrial>& tried)
      : name_(name),
        rotary_(rotary),
        options_(options),
        encoder_step_(encoder_step),
        tried_(tried) {
    std::tie(fitted_, validated_) = split(training, 2.0 / 3.0, options.split_each);
    const auto moves = [](const Segment& s) { return (s.command != s.command(0)).any(); };
    if (std::none_of(fitted_.begin(), fitted_.end(), moves))
      throw std::runtime_error(message(
          name, ": the command rests for the first ",
          fitted_.empty() ? 0.0 : fitted_.back().end_s() - training.front().start_s,
          " s, which is all that a structure can be fitted to: select a part that begins with "
          "motion (--from), or record a longer one"));
    validated_ = with_lead_in(validated_, training);
    // The first segments begin with friction and integrator in an unknown state. The transient
    // until that state has decayed is the same for every structure and would hide the differences
    // between them, so it is not judged.
    for (Segment& s : validated_) {
      const auto forgotten =
          static_cast<Eigen::Index>(std::lround(kSettlingTime_s / s.sample_time_s));
      if (s.size() > 4 * forgotten) s.lead = std::max(s.lead, forgotten);
    }
    noise_ = noise_floor(training).rms;
    search_.bounds = options.bounds;
    search_.starts = 3;
    search_.tolerance = 1e-6;  // enough to rank structures that must differ by 3 %
  }

  /// Order, constant force and delay, with Coulomb friction.
  void choose_loop() {
    std::vector<Trial> trials;
    for (const Structure& structure : structures(options_, rotary_)) {
      Trial trial;
      trial.structure = structure;
      const Projection data = projection_of(fitted_, structure);
      if (const auto fit = pole_search(data, search_)) {
        const Model model = data.model_of(fit->point, fit->solution.linear);
        trial.ruled_out = why_invalid(model);
        if (trial.ruled_out.empty()) {
          trial.cost = fit->solution.cost;
          trial.validation = judge(model, validated_).rms;
          trial.ruled_out = structure.matched_feedforward
                                ? why_no_delay(model, options_.delay_max_s, trial, trials)
                                : why_delay(model.loop, options_.delay_max_s);
        }
      }
      trials.push_back(trial);
    }
    const Trial* chosen = best_of(trials, {2, 3});
    if (chosen == nullptr) {
      // If no structure passes, the best of the ruled-out ones is still a model.
      for (const Trial& trial : trials) {
        if (trial.validation < kNotFitted &&
            (chosen == nullptr || trial.validation < chosen->validation))
          chosen = &trial;
      }
    }
    if (chosen == nullptr)
      throw std::runtime_error(name_ +
                               ": no stable loop within the bounds fits this motion; check units, "
                               "signs and the column mapping");
    for (const Trial& trial : trials)
      tried_.push_back({trial.structure.order, trial.structure.effects,
                        trial.validation < kNotFitted ? trial.validation : kAbsent,
                        &trial == chosen, 0, trial.ruled_out});
    begin_with(chosen->structure);
    out_.structure = simple_;
    least_ = chosen->validation;
    if (const Trial* other = best_of(trials, {simple_.order == 2 ? 3 : 2}))
      other_ = other->structure;
  }

  /// Friction, from the simplest model to the richest, and modes of vibration as long as one more
  /// of them passes. With both present neither can be identified without the other, so every
  /// friction model is tried with every number of modes.
  void choose_friction_and_modes() {
    const bool other_friction =
        joint() && options_.friction && *options_.friction != kind_of<CoulombFriction>();
    std::vector<std::size_t> compared{kind_of<CoulombFriction>()};
    if (joint())
      compared = options_.friction ? std::vector{*options_.friction} : compared_frictions();
    if (other_friction) least_ = kNotFitted;
    std::vector<std::optional<std::size_t>> couplings{std::nullopt};
    if (options_.coupling) {
      const auto moves = [](const Segment& s) { return s.neighbour_motion.size() == s.size(); };
      if (std::all_of(fitted_.begin(), fitted_.end(), moves) &&
          std::all_of(validated_.begin(), validated_.end(), moves))
        couplings.emplace_back(kind_of<CrossCouplingByMotion>());
      couplings.emplace_back(kind_of<CrossCoupling>());
    }
    if (compared.size() > 1 || other_friction || options_.modes > 0 || options_.coupling) {
      FirstStep first(signals_of(fitted_), simple_, search_);
      for (int modes = 0; modes <= options_.modes && modes <= out_.structure.modes + 1; ++modes) {
        if (modes > 0 && !first.add_mode()) break;
        std::vector<Stood> stood;
        // Without the other axis, then with it: in a coupled fit first, modes would be mistaken for
        // the coupling.
        for (const std::optional<std::size_t> coupling : couplings) {
          // Where its motion is recorded, by its command beside the best law only; not with more
          // modes than it takes by its motion, which would stand for what its friction does.
          const bool other_form = coupling && coupling != couplings[1];
          if (other_form && coupling_ == couplings[1] && out_.structure.modes != modes) break;
          const std::optional<Point> begun = first.start(coupling);
          if (!begun) break;
          for (const std::size_t kind : other_form ? std::vector{law_of(out_.structure)} : compared)
            try_standing(kind, modes, coupling, *begun, stood);
        }
        if (modes == 0 && joint()) try_other_order(compared, first);
        if (joint() && modes > 0 && !stood.empty()) ask_whether_they_move(modes, std::move(stood));
      }
    }
    if (joint() && !options_.friction) try_free_elements();
    if (other_friction && !best_)
      throw std::runtime_error(message(name_, ": ", identity_of(*options_.friction).id,
                                       " has no valid fit to this motion; choose another friction "
                                       "model"));
  }

  /// Where much is left: a filter of the control, with the laws of friction compared beside it.
  void choose_filter() {
    if (!joint() || !options_.beyond_loop || options_.modes > 0 || options_.coupling ||
        options_.masses != Masses::kRigid || !(least_ > kMinRmsOverFloorToGoOn * noise_))
      return;
    Structure filtered = simple_;
    filtered.effects.push_back(kind_of<ControlFilter>());
    const std::optional<Point> begun = start_of_filter(filtered);
    if (!begun) return;
    std::vector<std::size_t> laws =
        options_.friction ? std::vector{*options_.friction} : compared_frictions();
    // Beside Coulomb friction and the law that was chosen; the others only where a filter is seen.
    const auto first = std::stable_partition(
        laws.begin(), laws.end(), [chosen = law_of(out_.structure)](std::size_t law) {
          return law == chosen || law == kind_of<CoulombFriction>();
        });
    bool accepted = false;
    for (auto at = laws.begin(); at != laws.end(); ++at) {
      const std::size_t law = *at;
      if (at >= first && !(accepted && least_ > kMinRmsOverFloorToGoOn * noise_)) return;
      Structure richer = filtered;
      richer.effects[place_] = law;
      (void)without_constant_force(richer, law);
      StructureTrial trial{richer.order, richer.effects, kAbsent, false, 0, kNoFit};
      // In free simulation: along the measured motion the noise of the encoder at rest is motion.
      const auto fit = joint_fit(fitted_, richer, search_, encoder_step_, true, &*begun);
      if (fit) trial.ruled_out = why_invalid(fit->model);
      if (trial.ruled_out.empty() &&
          !ControlFilter::is_one(fit->model.find(kind_of<ControlFilter>())->shape.data()))
        trial.ruled_out = "its filter is none: frequency or damping ratio at a bound";
      if (trial.ruled_out.empty()) trial.validation_rms = judge(fit->model, validated_).rms;
      if (trial.validation_rms <
          (accepted ? kMaxRmsRatioToAccept : kMaxRmsRatioForFilter) * least_) {
        take(trial.validation_rms, richer);
        out_.from = {point_of(fit->model)};
        accepted = true;
      }
      tried_.push_back(trial);
    }
  }

  [[nodiscard]] ChosenStructure chosen() {
    for (std::size_t i = 0; best_ && i < tried_.size(); ++i) tried_[i].chosen = i == *best_;
    return std::move(out_);
  }

 private:
  [[nodiscard]] bool joint() const { return options_.method == Method::kJoint; }

  void begin_with(const Structure& loop) {
    simple_ = loop;
    const auto& effects = simple_.effects;
    place_ = static_cast<std::size_t>(
        std::find(effects.begin(), effects.end(), kind_of<CoulombFriction>()) - effects.begin());
  }

  /// If a large residual remains, Coulomb friction may have chosen the wrong order: an axis that
  /// its friction lets give way looks like one with an integrator. Tries the other order with the
  /// same laws, and goes on with it if one of them is clearly better.
  void try_other_order(const std::vector<std::size_t>& laws, FirstStep& first) {
    if (!other_ || !(least_ > kMinRmsOverFloorToGoOn * noise_)) return;
    const Structure before = simple_;
    begin_with(*other_);
    FirstStep of_other(signals_of(fitted_), simple_, search_);
    std::vector<Stood> stood;
    if (const std::optional<Point> begun = of_other.start()) {
      for (const std::size_t kind : laws) try_standing(kind, 0, std::nullopt, *begun, stood);
    }
    if (out_.structure.order == simple_.order) {
      first = std::move(of_other);
    } else {
      begin_with(before);
    }
  }

  /// Records the trial that is appended next as the best so far.
  void take(double validation, const Structure& structure) {
    least_ = validation;
    out_.structure = structure;
    best_ = tried_.size();
  }

  void try_standing(std::size_t kind, int modes, std::optional<std::size_t> coupling,
                    const Point& begun, std::vector<Stood>& stood) {
    if (kind == kind_of<CoulombFriction>() && modes == 0 && !coupling) return;
    Structure richer = simple_;
    richer.modes = modes;
    richer.effects[place_] = kind;
    const bool same = !without_constant_force(richer, kind);
    if (coupling) richer.effects.push_back(*coupling);
    StructureTrial trial{richer.order, richer.effects, kAbsent, false, modes, kNoFit};
    // At rest a vibrating encoder reverses more often than it is sampled: friction along the
    // measured motion is wrong there, so the fit is refined in free simulation.
    const auto fit = joint_fit(fitted_, richer, search_, encoder_step_, joint() && modes > 0,
                               modes > 0 || same ? &begun : nullptr);
    if (fit) {
      trial.ruled_out = why_invalid(fit->model);
      if (trial.ruled_out.empty()) trial.validation_rms = judge(fit->model, validated_).rms;
    }
    if (trial.validation_rms < kNotFitted)
      stood.push_back({richer, fit->model, coupling, trial.validation_rms});
    const bool more = modes > out_.structure.modes || (coupling && !coupling_);
    const bool richer_form =
        coupling == kind_of<CrossCoupling>() && coupling_ == kind_of<CrossCouplingByMotion>();
    if (trial.validation_rms < (richer_form ? kMaxRmsRatioForRichModel
                                : more      ? kMaxRmsRatioForMode
                                            : kMaxRmsRatioToAccept) *
                                   least_) {
      take(trial.validation_rms, richer);
      coupling_ = coupling;
      out_.from.clear();
      if (modes > 0 || coupling) out_.from.push_back(point_of(fit->model));
    }
    tried_.push_back(trial);
  }

  /// Tries modes that change with position: such a mode may not improve the fit as a constant one.
  /// If one of the fits tried improves, all friction models are tried from its result.
  void ask_whether_they_move(int modes, std::vector<Stood> stood) {
    const std::optional<std::size_t> coupling =
        std::min_element(stood.begin(), stood.end(), [](auto& l, auto& r) {
          return l.validation < r.validation;
        })->coupling;
    std::erase_if(stood, [&](const Stood& one) { return one.coupling != coupling; });
    std::vector<Moved> moved(stood.size());
    const auto moved_from = [&](const Model& start, const Stood& one) {
      Moved now;
      now.asked = true;
      now.fit = with_moving_modes(fitted_, moving_of(one.structure), start, encoder_step_);
      now.ruled_out = now.fit ? why_invalid(now.fit->model)
                              : "modes that change with position improve the fit by too little";
      if (now.ruled_out.empty()) now.validation = judge(now.fit->model, validated_).rms;
      return now;
    };
    std::size_t lead = stood.size();
    double least = kNotFitted;
    for (const std::size_t i : asked_whether_modes_move(stood)) {
      moved[i] = moved_from(stood[i].model, stood[i]);
      if (moved[i].validation < least) {
        least = moved[i].validation;
        lead = i;
      }
    }
    bool moving = false;
    for (std::size_t i = 0; i < stood.size(); ++i) {
      const Stood& one = stood[i];
      if (lead < stood.size() && i != lead)
        moved[i] = moved_from(with_modes_moving_as(moved[lead].fit->model.loop, one.model), one);
      else if (!moved[i].asked)
        continue;
      if (moved[i].validation <
          (moving ? kMaxRmsRatioToAccept : kMaxRmsRatioForRichModel) * least_) {
        take(moved[i].validation, moving_of(one.structure));
        coupling_ = one.coupling;
        moving = true;
        out_.from = {point_of(one.model)};
        out_.moving = moved[i].fit->model.loop;
      }
      tried_.push_back({one.structure.order, one.structure.effects, moved[i].validation, false,
                        modes, moved[i].ruled_out, true});
    }
  }

  /// The loop with Coulomb friction and a filter, from a grid of its two poles.
  [[nodiscard]] std::optional<Point> start_of_filter(const Structure& filtered) const {
    const auto rigid = pole_search(projection_of(fitted_, simple_), search_);
    if (!rigid) return std::nullopt;
    PoleSearchOptions near = search_;
    for (const double hz : {2.0, 5.0, 12.0, 30.0, 80.0, 200.0}) {
      if (!(hz < kMaxFrequencyOfRate / fitted_.front().sample_time_s)) break;
      for (const double damping : {0.5, 1.0}) {
        near.from.push_back(rigid->point);
        near.from.back().shapes.insert(near.from.back().shapes.end(), {hz, damping});
      }
    }
    const auto found = pole_search(projection_of(fitted_, filtered), near);
    if (!found) return std::nullopt;
    return found->point;
  }

  /// If a large residual remains with modes or another axis, the friction law may be wrong: tries a
  /// law with a free virgin curve, from the result of the chosen one.
  void try_free_elements() {
    const Structure& structure = out_.structure;
    if (out_.from.empty() || structure.moving || !(least_ > kMinRmsOverFloorToGoOn * noise_))
      return;
    // A law with a level per direction contains the constant force, so it is added again here.
    Structure free = simple_;
    free.modes = structure.modes;
    free.effects[place_] = kind_of<MaxwellSlip>();
    if (coupling_) free.effects.push_back(*coupling_);
    PoleSearchOptions near = search_;
    for (const double form : kFormsOfFreeElements)
      near.from.push_back(with_free_elements(out_.from.front(), structure, place_, form));
    StructureTrial trial{free.order, free.effects, kAbsent, false, free.modes, kNoFit};
    const auto fit = joint_fit(fitted_, free, near, encoder_step_, true);
    if (fit) trial.ruled_out = why_invalid(fit->model);
    if (trial.ruled_out.empty()) trial.validation_rms = judge(fit->model, validated_).rms;
    if (trial.validation_rms < kMaxRmsRatioForRichModel * least_) {
      take(trial.validation_rms, free);
      out_.from = {point_of(fit->model)};
    }
    tried_.push_back(trial);
  }

  const std::string& name_;
  bool rotary_;
  const IdentifyOptions& options_;
  double encoder_step_, noise_ = 0.0;
  std::vector<StructureTrial>& tried_;
  std::vector<Segment> fitted_, validated_;
  PoleSearchOptions search_;
  Structure simple_;                // of the loop, with Coulomb friction
  std::optional<Structure> other_;  // the best of the other order, likewise
  std::size_t place_ = 0;           // of the friction in it
  ChosenStructure out_;
  double least_ = kNotFitted;            // validation RMS of the chosen structure
  std::optional<std::size_t> best_;      // index in tried_; none: the loop as chosen first
  std::optional<std::size_t> coupling_;  // of the other axis, if it contains it
};

}  // namespace

bool delay_in_disguise(const Loop& loop) {
  return imitated_delay_share(loop) > kMaxLagShareOfUnstableZeros;
}

bool lag_in_disguise(const Model& model) {
  return model.command_delay_s() > 0.0 &&
         1.0 - model.loop.numerator[0] > kMaxAccelerationFeedforward;
}

std::size_t law_of(const Structure& structure) {
  const auto at = std::find_if(structure.effects.begin(), structure.effects.end(), is_friction_law);
  return at == structure.effects.end() ? kind_of<CoulombFriction>() : *at;
}

Structure structure_of(const Model& model) {
  Structure structure;
  structure.order = model.loop.order;
  for (const Effect& effect : model.effects) structure.effects.push_back(effect.kind);
  structure.matched_feedforward = model.find(kind_of<TimeDelay>()) != nullptr;
  structure.modes = static_cast<int>(model.loop.modes.size());
  structure.moving = std::any_of(model.loop.modes.begin(), model.loop.modes.end(),
                                 [](const Mode& mode) { return mode.moves(); });
  return structure;
}

Point point_of(const Model& model) {
  Point point{model.loop.denominator, {}, model.loop.modes};
  for (Mode& mode : point.modes) mode.slope = mode.curve = mode.zeta_slope = 0.0;
  for (const Effect& effect : model.effects) {
    for (std::size_t i = 0; i < shapes_of(effect.kind).size(); ++i)
      point.shapes.push_back(effect.shape[i]);
  }
  return point;
}

Model with_modes_moving_as(const Loop& as, Model model) {
  model.loop.travel = as.travel;
  for (std::size_t i = 0; i < std::min(as.modes.size(), model.loop.modes.size()); ++i) {
    model.loop.modes[i].slope = as.modes[i].slope;
    model.loop.modes[i].curve = as.modes[i].curve;
    model.loop.modes[i].zeta_slope = as.modes[i].zeta_slope;
  }
  return model;
}

ChosenStructure chosen_structure(const std::string& name, bool rotary,
                                 const std::vector<Segment>& training,
                                 const IdentifyOptions& options, double encoder_step,
                                 std::vector<StructureTrial>& tried) {
  StructureChoice choice(name, rotary, training, options, encoder_step, tried);
  choice.choose_loop();
  choice.choose_friction_and_modes();
  choice.choose_filter();
  return choice.chosen();
}

}  // namespace servotwin
