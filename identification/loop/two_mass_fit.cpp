#include "identification/loop/two_mass_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlopt.hpp>
#include <stdexcept>

#include "identification/least_squares/chart.h"
#include "identification/least_squares/interruption.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/free_elements.h"
#include "identification/loop/gap_scan.h"
#include "identification/loop/identify.h"
#include "identification/loop/output_error.h"
#include "identification/loop/two_mass_search.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/segments.h"
#include "twin/twin.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

constexpr double kShortPart_s = 8.0;   // for the comparison of fitted starts
constexpr double kRankedPart_s = 4.0;  // for that of starts as they are, and after a few rounds
constexpr double kUnfittedRms = 1e300;
constexpr int kMostFitsToAll = 2;  // if the first one is not plausible
// Starts of the grid that are tried in a few rounds on the shorter part, of one kind and in all,
// and those of them that are fitted on.
constexpr std::ptrdiff_t kTriedOfKind = 4, kTriedStarts = 16, kFittedStarts = 6;
// The same beside other causes, for springs as well: with their parameters a round takes several
// times as long, and the rigid loop beside them is nearer.
constexpr std::ptrdiff_t kTriedOfKindBesideCauses = 2, kTriedStartsBesideCauses = 6,
                         kFittedStartsBesideCauses = 3;
// On the shorter part, over that of the model to beat, above which a start beside causes is given
// up: a spring or a gap that a rigid model with these causes lacks lowers it at once. Not where the
// model to beat vibrates or has a gap itself.
constexpr double kMaxRmsRatioBesideCauses = 0.97;
// Over that of the model to beat, above which a gap is given up after a few rounds on the shorter
// part, and after more on the longer one. Of ten attempts that began within 2.5, on five machines
// with play (dev/backlash/240 to 244), none ended below 0.86 of what it began with.
constexpr double kMaxRmsRatioOfGapToTry = 2.0, kMaxRmsRatioOfGapToGoOn = 1.5;
constexpr double kMaxRmsRatioOfSpringToGoOn = 3.0;  // the same of a spring, on the longer part
// How far what a spring may leave at least (two_mass_search.h) may be above what is asked for: the
// forces of causes are known of a rigid axis, and a phase begins before all of the friction that
// builds up over a travel has done so.
constexpr double kMarginOfLeast = 1.1;
constexpr double kMaxRmsRatioOfPlay = 0.9;  // on either part, over that without play

// Contacts are stiff: two frequencies are near enough.
constexpr std::array kContacts_hz{80.0, 250.0};
constexpr std::array kWidths{1e-6, 4e-6, 16e-6, 64e-6};  // m | rad
constexpr int kMaxSeekSimulations = 400;
constexpr double kSeekStep = 0.1;        // the first one, of the logarithm of a parameter
constexpr double kSeekTolerance = 1e-5;  // of the RMS
// Difference of log likelihoods up to which chance decides: odds of 20 to 1.
constexpr double kMinEvidence = 3.0;
constexpr double kMaxStartShare = 0.9;    // of load and friction on it, away from their bounds
constexpr double kFrictionOnMotor = 0.1;  // share on the load

struct Start {
  Model model;
  double rms = kUnfittedRms;
};

/// The geometric mean of both encoders where both are recorded, as the likelihood weighs them:
/// which of them closes the loop shows at either.
double rms_on(const Model& model, const std::vector<Segment>& segments) {
  const ErrorFigures left = judge(model, segments);
  const double rms =
      std::isfinite(left.motor_rms) ? std::sqrt(left.rms * left.motor_rms) : left.rms;
  return std::isfinite(rms) ? rms : kUnfittedRms;
}

/// Gaps of several widths, with a stiff contact.
std::vector<Start> gaps_of(const Model& rigid, std::size_t kind) {
  std::vector<Start> out;
  Effect effect;
  effect.kind = kind;
  std::size_t width = 0, i = 0;
  for (const Parameter& p : shapes_of(kind)) {
    if (p.name == "width") width = i;
    effect.shape[i++] = p.start;
  }
  effect.shape[TwoMassLoadEncoder::kFrictionShareAt] = kMaxStartShare;
  for (const double gap : kWidths) {
    effect.shape[width] = gap;
    for (const double f : kContacts_hz) {
      effect.shape[0] = f;
      Model model = rigid;
      model.effects.push_back(effect);
      if (why_invalid(model).empty()) out.push_back({std::move(model)});
    }
  }
  return out;
}

/// Two masses with the gap that the recorded motion shows. A rigid axis that was fitted to play may
/// have too little friction: it gets what decelerates the load in the gap. Nothing if it has none.
std::optional<Start> start_of(const Model& rigid, const GapFound& gap) {
  Start out{rigid};
  double level = 0.0;
  for (const Effect& effect : rigid.effects) {
    if (is_friction_law(effect.kind)) level += level_of(effect);
  }
  if (!(level > 0.0)) return std::nullopt;
  const double on_load = gap.deceleration * gap.load_share;
  if (level < on_load) {
    for (Effect& effect : out.model.effects) {
      if (!is_friction_law(effect.kind)) continue;
      for (double& c : effect.coefficient) c *= on_load / level;
    }
  }
  Effect play;
  play.kind = kind_of<PlayMotorEncoder>();
  const std::array shapes{kContacts_hz.front(), 0.1, std::min(gap.load_share, kMaxStartShare),
                          on_load / std::max(level, on_load), gap.width};
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(play.kind)) {
    play.shape[i] = std::clamp(shapes[i], p.lower, p.upper);
    ++i;
  }
  out.model.effects.push_back(play);
  return out;
}

/// Seeks the parameters of the two masses and the level of friction in free simulation, without
/// derivatives: from one gap to another the load hits at other moments, and the error jumps.
void seek(Start& start, const std::vector<Segment>& segments) {
  struct Sought {
    Model model;
    const std::vector<Segment>& segments;
    std::vector<ShapeAxis> axes;
    double unit;

    [[nodiscard]] Model at(const double* x) const {
      Model out = model;
      for (Effect& effect : out.effects) {
        if (acts_on_axis(effect.kind)) {
          for (std::size_t i = 0; i < axes.size(); ++i) effect.shape[i] = axes[i].value(x[i]);
        } else if (is_friction_law(effect.kind)) {
          for (double& c : effect.coefficient) c *= std::exp(x[axes.size()]);
        }
      }
      return out;
    }
    static double cost(unsigned, const double* x, double*, void* given) {
      if (interruption().stop_requested()) throw nlopt::forced_stop();
      const auto& all = *static_cast<Sought*>(given);
      const Model model = all.at(x);
      return why_invalid(model).empty() ? rms_on(model, all.segments) / all.unit : kUnfittedRms;
    }
  };
  start.rms = rms_on(start.model, segments);
  if (start.rms == kUnfittedRms) return;
  const Effect& play = *two_mass_of(start.model);
  Sought sought{start.model, segments, shape_axes({play.kind}, length_scale(segments)), start.rms};
  std::vector<double> x, lower, upper;
  for (const ShapeAxis& axis : sought.axes) {
    x.push_back(axis.coordinate(play.shape[x.size()]));
    lower.push_back(axis.lower);
    upper.push_back(axis.upper);
  }
  constexpr double kMaxLevel = 1.5;  // logarithm of the factor of the level
  x.push_back(0.0);
  lower.push_back(-kMaxLevel);
  upper.push_back(kMaxLevel);
  nlopt::opt optimizer(nlopt::LN_SBPLX, static_cast<unsigned>(x.size()));
  optimizer.set_lower_bounds(lower);
  optimizer.set_upper_bounds(upper);
  optimizer.set_initial_step(kSeekStep);
  optimizer.set_maxeval(kMaxSeekSimulations);
  optimizer.set_min_objective(Sought::cost, &sought);
  optimizer.set_ftol_rel(kSeekTolerance);
  double least = 0.0;
  try {
    optimizer.optimize(x, least);
  } catch (const std::runtime_error&) {  // its steps have become too small
    throw_if_interrupted();
    return;
  }
  start = {sought.at(x.data()), least * sought.unit};
}

/// The places of what is more than friction, a constant force and a delay.
std::vector<std::size_t> causes_in(const Structure& structure) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < structure.effects.size(); ++i) {
    const std::size_t kind = structure.effects[i];
    if (!is_friction_law(kind) && kind != kind_of<ConstantForce>() && kind != kind_of<TimeDelay>())
      out.push_back(i);
  }
  return out;
}

/// Whether an effect stands for a spring or a gap.
bool vibrates(const Effect& effect) {
  constexpr std::array kKinds{kind_of<Compliance>(), kind_of<Backlash>(), kind_of<BacklashInLoop>(),
                              kind_of<BacklashBehindEncoder>()};
  return acts_on_axis(effect.kind) ||
         std::find(kKinds.begin(), kKinds.end(), effect.kind) != kKinds.end();
}

double& share_of_friction(Model& model) {
  const auto axis = std::find_if(model.effects.begin(), model.effects.end(),
                                 [](const Effect& effect) { return acts_on_axis(effect.kind); });
  return axis->shape[TwoMassLoadEncoder::kFrictionShareAt];
}

/// Friction by this law, with the level and travel of the old one.
Effect with_law(const Effect& old, std::size_t law) {
  Effect out;
  out.kind = law;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(law)) out.shape[i++] = p.start;
  if (shapes_of(old.kind)[0].unit == shapes_of(law)[0].unit)
    out.shape[0] = std::clamp(old.shape[0], shapes_of(law)[0].lower, shapes_of(law)[0].upper);
  out.coefficient[0] = level_of(old);
  return out;
}

/// Friction of free elements, with the level and travel of the old one.
Effect with_free_elements(const Effect& old, double form) {
  const FreeElements elements = free_elements(old.kind, old.shape.data(), form);
  Effect out;
  out.kind = kind_of<MaxwellSlip>();
  std::copy(elements.shapes.begin(), elements.shapes.end(), out.shape.begin());
  for (std::size_t i = 0; i < elements.levels.size(); ++i)
    out.coefficient[i] = level_of(old) * elements.levels[i];
  return out;
}

/// The same law and travel, its other shapes as they are in the catalogue.
Effect with_plain_shapes(const Effect& law) {
  Effect out = law;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(law.kind)) {
    if (i > 0) out.shape[i] = p.start;
    ++i;
  }
  return out;
}

/// A spring of one kind, by which the loop is closed or which encoder is recorded.
struct Spring {
  std::vector<Start> starts;
  double least = 0.0;  ///< RMS that fits hardly get below (two_mass_search.h)

  [[nodiscard]] const Model& drive() const { return starts.front().model; }
};

/// Of each of these kinds, that which may leave least first: with the friction of the rigid axis,
/// and, since that was fitted as if there were no spring, with the plain shapes of its law, and
/// with Coulomb friction of its level.
std::vector<Spring> springs_of(const std::vector<Segment>& segments, const Structure& structure,
                               const Model& rigid, const std::vector<std::size_t>& kinds) {
  std::vector<Spring> out;
  for (const std::size_t kind : kinds) {
    Effect effect;
    effect.kind = kind;
    if (without_play(effect).kind != kind) continue;
    const auto one = two_mass_start(segments, structure, rigid, kind);
    if (!one) continue;
    Spring spring{{{one->model}}, one->least};
    for (std::size_t at = 0; at < one->model.effects.size(); ++at) {
      const Effect& old = one->model.effects[at];
      if (!is_friction_law(old.kind) || old.kind == kind_of<CoulombFriction>()) continue;
      if (shapes_of(old.kind).size() > 1) {
        spring.starts.push_back({one->model});
        spring.starts.back().model.effects[at] = with_plain_shapes(old);
      }
      spring.starts.push_back({one->model});
      spring.starts.back().model.effects[at] = with_law(old, kind_of<CoulombFriction>());
      break;
    }
    out.push_back(std::move(spring));
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const Spring& l, const Spring& r) { return l.least < r.least; });
  return out;
}

/// When the sample of this number is taken, counted through all segments.
double time_of(const std::vector<Segment>& segments, std::size_t sample) {
  for (const Segment& s : segments) {
    const auto size = static_cast<std::size_t>(s.size());
    if (sample < size) return s.start_s + s.sample_time_s * static_cast<double>(sample);
    sample -= size;
  }
  return segments.back().end_s();
}

/// The samples in which the axis accelerates most; with a gap between them they take longer.
std::vector<Segment> short_part(const std::vector<Segment>& segments, double duration_s) {
  const std::vector<double> sums = squared_acceleration(segments);
  const double h = segments.front().sample_time_s;
  const auto length = static_cast<std::size_t>(duration_s / h);
  if (sums.size() < length + 1) return segments;
  std::size_t best = 0;
  for (std::size_t from = 0; from + length < sums.size(); ++from) {
    if (sums[from + length] - sums[from] > sums[best + length] - sums[best]) best = from;
  }
  std::vector<Segment> out = cut(segments, time_of(segments, best) - 0.5 * h,
                                 time_of(segments, best + length - 1) + 0.5 * h);
  return out.empty() ? segments : out;
}

/// Fits springs and gaps to a part of the segments, and the best of them to all.
class Contest {
 public:
  Contest(const std::vector<Segment>& segments, const Structure& structure, const Model& rigid,
          const Model& to_beat, const std::vector<std::size_t>& kinds, double encoder_step,
          const Plausible& plausible)
      : segments_(segments),
        part_(short_part(segments, kShortPart_s)),
        ranked_(short_part(segments, kRankedPart_s)),
        structure_(structure),
        rigid_(rigid),
        to_beat_(to_beat),
        kinds_(kinds),
        encoder_step_(encoder_step),
        plausible_(plausible),
        both_recorded_(
            std::all_of(segments.begin(), segments.end(),
                        [](const Segment& s) { return s.actual_motor.size() == s.size(); })),
        causes_(causes_in(structure)),
        over_rigid_(std::none_of(to_beat.effects.begin(), to_beat.effects.end(), vibrates)),
        enough_(enough_on_part()) {}

  /// The best plausible one; nothing where none leaves little enough on the part. `most`: as of
  /// fit_two_masses.
  std::optional<TwoMassFit> winner(double most) {
    std::vector<Spring> springs = springs_of(segments_, structure_, rigid_, kinds_);
    // Of both encoders the mean counts, of which that of the load alone says nothing.
    if (!both_recorded_) exclude_above(kMarginOfLeast * most, springs);
    if (causes_.empty()) {
      fit_each(springs);
    } else {
      fit_ranked(springs);
    }
    fit_gaps();
    sort(fitted_);
    if (both_recorded_ && !fitted_.empty() && !plays(fitted_.front().model)) add_closings();
    int tries = kMostFitsToAll;
    for (Start& one : fitted_) {
      if (!goes_on(one) || !plausible_(one.model)) continue;
      if (tries-- == 0) break;
      fit_to_all(one);
      if (!(one.rms < kUnfittedRms) || !plausible_(one.model)) continue;
      if (plays(one.model)) one = or_without_play(one);
      TwoMassFit out{structure_of(one.model), one.model, one.rms};
      const std::size_t kind = without_play(*two_mass_of(one.model)).kind;
      const auto spring = std::find_if(springs.begin(), springs.end(), [&](const Spring& s) {
        return two_mass_of(s.drive())->kind == kind;
      });
      if (spring != springs.end()) out.sliding = spring->drive();
      return out;
    }
    return std::nullopt;
  }

 private:
  // Enough to rank starts, to see which are worth more, and to end a fit that others begin from.
  static constexpr int kRankingRounds = 3, kPartRounds = 8, kRoundsToAll = 14, kPassesToAll = 2;

  void exclude_above(double most, std::vector<Spring>& springs) {
    std::erase_if(springs, [&](const Spring& spring) {
      if (!(spring.least > most)) return false;
      std::erase(kinds_, two_mass_of(spring.drive())->kind);
      return true;
    });
  }

  /// Springs that may leave less than those before them do.
  void fit_each(const std::vector<Spring>& springs) {
    double reached = kUnfittedRms;
    for (const Spring& spring : springs) {
      if (!both_recorded_ && spring.least > reached) break;
      std::vector<Start> some = starts_of(spring);
      fit_and_sort(some, part_, kPartRounds);
      const Start& best = some.front();
      if (best.rms < kUnfittedRms && plausible_(best.model))
        reached = std::min(reached, rms_on(best.model, segments_));
      fitted_.insert(fitted_.end(), some.begin(), some.end());
    }
  }
  /// Beside causes: those of all springs that are the best after a few rounds.
  void fit_ranked(const std::vector<Spring>& springs) {
    std::vector<Start> all;
    for (const Spring& spring : springs) {
      for (Start& one : starts_of(spring)) all.push_back(std::move(one));
    }
    fit_and_sort(all, ranked_, kRankingRounds, {causes_});
    all.resize(std::min(all.size(), fitted_on()));
    fit_to_part(std::move(all));
  }
  void fit_gaps() {
    std::vector<Start> some = promising_gaps();
    fit_and_sort(some, ranked_, kRankingRounds, {causes_});
    // What no machine has comes last.
    std::stable_partition(some.begin(), some.end(), [&](const Start& s) {
      return s.rms < kUnfittedRms && plausible_(s.model);
    });
    some.resize(std::min(some.size(), fitted_on()));
    const double there =
        joins_causes() ? joined_on(ranked_) : kMaxRmsRatioOfGapToTry * rms_on(to_beat_, ranked_);
    std::erase_if(some, [&](const Start& s) { return !(s.rms < there); });
    fit_to_part(std::move(some));
  }

  [[nodiscard]] std::size_t fitted_on() const {
    return static_cast<std::size_t>(causes_.empty() ? kFittedStarts : kFittedStartsBesideCauses);
  }
  /// Whether causes are beside them, and nothing yet that vibrates.
  [[nodiscard]] bool joins_causes() const { return !causes_.empty() && over_rigid_; }
  [[nodiscard]] double joined_on(const std::vector<Segment>& some) const {
    return std::min(rms_on(rigid_, some), kMaxRmsRatioBesideCauses * rms_on(to_beat_, some));
  }
  /// Whether what is fitted to the part is fitted to all.
  [[nodiscard]] bool goes_on(const Start& one) const {
    return one.rms < (plays(one.model) ? enough_.gap : enough_.spring);
  }
  struct Enough {
    double spring, gap;
  };
  [[nodiscard]] Enough enough_on_part() const {
    if (joins_causes()) return {joined_on(part_), joined_on(part_)};
    const double beaten = rms_on(to_beat_, part_), rigid = rms_on(rigid_, part_);
    return {std::min(rigid, kMaxRmsRatioOfSpringToGoOn * beaten),
            std::min(rigid, kMaxRmsRatioOfGapToGoOn * beaten)};
  }
  [[nodiscard]] Structure structure_of(const Model& model) const {
    Structure out = structure_;
    for (std::size_t i = 0; i < out.effects.size(); ++i) out.effects[i] = model.effects[i].kind;
    out.effects.push_back(two_mass_of(model)->kind);
    return out;
  }
  /// Play counts for less where it is hardly better.
  static double rank(const Start& s) { return s.rms / (plays(s.model) ? kMaxRmsRatioOfPlay : 1.0); }
  static void sort(std::vector<Start>& some) {
    std::sort(some.begin(), some.end(),
              [](const Start& l, const Start& r) { return rank(l) < rank(r); });
  }

  void fit(Start& one, const std::vector<Segment>& to, int rounds, int passes,
           const Held& held = {}) const {
    auto found =
        refined({structure_of(one.model), one.model}, to, encoder_step_, rounds, passes, held);
    one.rms = kUnfittedRms;
    if (found) one = {std::move(found->model), found->rms};
  }
  void fit_to_all(Start& one) const { fit(one, segments_, kRoundsToAll, kPassesToAll); }
  void fit_and_sort(std::vector<Start>& some, const std::vector<Segment>& to, int rounds,
                    const Held& held = {}) const {
    in_parallel(some.size(), [&](std::size_t i) { fit(some[i], to, rounds, 1, held); });
    sort(some);
  }
  void fit_to_part(std::vector<Start> some) {
    fit_and_sort(some, part_, kPartRounds);
    fitted_.insert(fitted_.end(), some.begin(), some.end());
  }

  /// The drive is known from where the axis slides, and not where most of its friction acts: that
  /// is fitted alone as well, else a wrong place takes the drive away with it.
  [[nodiscard]] std::vector<Start> starts_of(const Spring& spring) const {
    std::vector<Start> out = spring.starts, on_load = out, on_motor = out;
    for (Start& one : on_motor) share_of_friction(one.model) = kFrictionOnMotor;
    in_parallel(2 * on_load.size(), [&](std::size_t i) {
      fit((i % 2 == 0 ? on_load : on_motor)[i / 2], part_, kFrictionRounds, 1,
          {.effects = causes_, .drive = true});
    });
    for (std::size_t i = 0; i < on_load.size(); ++i)
      out.push_back(on_motor[i].rms < on_load[i].rms ? on_motor[i] : on_load[i]);
    return out;
  }

  /// Of a grid, and by when the load hits, not fitted yet: the best of every kind.
  [[nodiscard]] std::vector<Start> promising_gaps() const {
    std::vector<Start> all;
    for (const std::size_t kind : kinds_) {
      Effect effect;
      effect.kind = kind;
      if (without_play(effect).kind == kind) continue;
      for (Start& one : gaps_of(rigid_, kind)) all.push_back(std::move(one));
    }
    in_parallel(all.size(), [&](std::size_t i) { all[i].rms = rms_on(all[i].model, ranked_); });
    if (std::find(kinds_.begin(), kinds_.end(), kind_of<PlayMotorEncoder>()) != kinds_.end()) {
      if (const auto gap = scan_gap(part_, structure_, rigid_, encoder_step_)) {
        if (auto one = start_of(rigid_, *gap); one && why_invalid(one->model).empty()) {
          seek(*one, part_);
          one->rms = rms_on(one->model, ranked_);
          all.push_back(std::move(*one));
        }
      }
    }
    std::sort(all.begin(), all.end(), [](const Start& l, const Start& r) { return l.rms < r.rms; });
    const std::ptrdiff_t of_kind = causes_.empty() ? kTriedOfKind : kTriedOfKindBesideCauses,
                         most = causes_.empty() ? kTriedStarts : kTriedStartsBesideCauses;
    std::vector<Start> out;
    for (const Start& one : all) {
      const auto there = std::count_if(out.begin(), out.end(), [&](const Start& s) {
        return two_mass_of(s.model)->kind == two_mass_of(one.model)->kind;
      });
      if (std::ssize(out) < most && there < of_kind) out.push_back(one);
    }
    return out;
  }

  /// Which encoder closes the loop changes the error by less than a fit that has not ended yet: the
  /// best of each is fitted to all, and comes before the others.
  void add_closings() {
    std::vector<Start> closings;
    for (const Start& one : fitted_) {
      const std::size_t kind = two_mass_of(one.model)->kind;
      const bool is_new = std::none_of(closings.begin(), closings.end(), [&](const Start& other) {
        return two_mass_of(other.model)->kind == kind;
      });
      if (is_new && !plays(one.model) && goes_on(one)) closings.push_back(one);
    }
    fit_and_sort(closings, segments_, kFitRounds);
    // Where chance decides, the load's encoder closes it: few machines have one for less.
    double readings = 0.0;
    for (const Segment& s : segments_) readings += 2.0 * static_cast<double>(s.size());
    std::stable_partition(closings.begin(), closings.end(), [&](const Start& one) {
      return two_mass_parameters(*two_mass_of(one.model)).encoders == Encoders::kLoad &&
             readings * std::log(one.rms / closings.front().rms) < kMinEvidence;
    });
    fitted_.insert(fitted_.begin(), closings.begin(), closings.end());
  }

  /// The same without its gap, where that leaves hardly more. `one`: fitted to all.
  [[nodiscard]] Start or_without_play(const Start& one) const {
    Start spring{one.model};
    for (Effect& effect : spring.model.effects) {
      if (acts_on_axis(effect.kind)) effect = without_play(effect);
    }
    const std::size_t kind = two_mass_of(spring.model)->kind;
    if (std::find(kinds_.begin(), kinds_.end(), kind) != kinds_.end()) fit_to_all(spring);
    return rank(spring) < rank(one) && plausible_(spring.model) ? spring : one;
  }

  const std::vector<Segment>& segments_;
  const std::vector<Segment> part_, ranked_;
  const Structure& structure_;
  const Model& rigid_;
  const Model& to_beat_;
  std::vector<std::size_t> kinds_;  // without the springs that are excluded
  double encoder_step_;
  const Plausible& plausible_;
  bool both_recorded_;
  const std::vector<std::size_t> causes_;  // places of the causes beside them
  bool over_rigid_;                        // nothing in the model to beat vibrates
  const Enough enough_;
  std::vector<Start> fitted_;  // to the part; which encoder closes the loop, to all
};

}  // namespace

std::optional<TwoMassFit> refined(TwoMassFit fit, const std::vector<Segment>& segments,
                                  double encoder_step, int rounds, int passes, const Held& held) {
  OutputErrorOptions options;
  options.held = held;
  options.encoder_step = encoder_step;
  options.rounds = rounds;
  options.passes = passes;
  options.tolerance = 1e-3;
  options.covariance = false;
  const auto found = output_error(segments, fit.structure, fit.model, options);
  if (!found || !why_invalid(found->model).empty()) return std::nullopt;
  fit.model = found->model;
  fit.rms = rms_on(fit.model, segments);
  return fit;
}

std::optional<TwoMassFit> with_law(TwoMassFit fit, std::size_t law, double form) {
  const auto is_law = [](const Effect& effect) { return is_friction_law(effect.kind); };
  const auto at = std::find_if(fit.model.effects.begin(), fit.model.effects.end(), is_law);
  const bool is_free = law == kind_of<MaxwellSlip>();
  if (at == fit.model.effects.end() || (at->kind == law && !is_free)) return std::nullopt;
  fit.structure.effects[static_cast<std::size_t>(at - fit.model.effects.begin())] = law;
  *at = is_free ? with_free_elements(*at, form) : with_law(*at, law);
  return fit;
}

std::optional<TwoMassFit> sliding_with_law(const TwoMassFit& fit, std::size_t law, double form) {
  if (!fit.sliding) return std::nullopt;
  TwoMassFit out{fit.structure, *fit.sliding};
  bool has_law = false;
  for (std::size_t i = 0; i < out.structure.effects.size(); ++i) {
    Effect& effect = out.model.effects[i];
    if (is_friction_law(effect.kind)) {
      has_law = true;
      Effect plain = make_effect<CoulombFriction>();
      plain.coefficient[0] = level_of(effect);
      effect =
          law == kind_of<MaxwellSlip>() ? with_free_elements(plain, form) : with_law(plain, law);
    }
    out.structure.effects[i] = effect.kind;
  }
  return has_law ? std::optional(out) : std::nullopt;
}

TwoMassFit without_empty_gap(TwoMassFit fit) {
  for (std::size_t i = 0; i < fit.model.effects.size(); ++i) {
    Effect& effect = fit.model.effects[i];
    if (!acts_on_axis(effect.kind)) continue;
    constexpr double kNarrow = 2.0;  // times the narrowest gap
    const double width = two_mass_parameters(effect).width;
    if (!(width > 0.0) || width > kNarrow * shapes_of(effect.kind).back().lower) continue;
    effect = without_play(effect);
    fit.structure.effects[i] = effect.kind;
  }
  return fit;
}

std::optional<TwoMassFit> fit_two_masses(const std::vector<Segment>& segments,
                                         const Structure& structure, const Model& rigid,
                                         const Model& to_beat, double most,
                                         const std::vector<std::size_t>& kinds, double encoder_step,
                                         const Plausible& plausible) {
  return Contest(segments, structure, rigid, to_beat, kinds, encoder_step, plausible).winner(most);
}

}  // namespace servotwin
