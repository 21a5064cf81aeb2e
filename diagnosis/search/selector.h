// The search behind select_causes: adds causes one by one, as long as each improves the model
// enough (docs/theory.md 10). Its steps are in selection_*.cpp.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "diagnosis/search/judgement.h"
#include "diagnosis/search/search.h"
#include "diagnosis/search/selection.h"
#include "diagnosis/statistics/text.h"
#include "twin/shown_units.h"

namespace servotwin {

// RMS over RMS of the current model below which a model is clearly better; demanded of a law of
// friction that implies more than is known.
constexpr double kMaxRmsRatioClearlyBetter = 0.8;
// Share of the squared error that a mode or a gap must promise beside a filter of the control, or a
// mode where one is added: as much as two masses have to explain. The filter takes what a strongly
// damped load would do.
constexpr double kMinGainOfMasses = 1.0 - kMaxRmsRatioClearlyBetter * kMaxRmsRatioClearlyBetter;
// RMS over noise floor above which an axis of two masses is tried.
constexpr double kMinRmsOverFloorForTwoMasses = 1.5;

/// One search. One thread; throws std::runtime_error where the options ask to stop.
class Selector {
 public:
  Selector(Search& search, Hypothesis baseline, const DiagnoseOptions& options)
      : search_(search), now_{std::move(baseline), {}, {}, {}}, options_(options) {}

  void run();
  [[nodiscard]] const Hypothesis& current() const { return now_.current; }
  [[nodiscard]] const Hypothesis& settled() const { return settled_; }
  [[nodiscard]] const std::optional<Hypothesis>& undelayed() const { return undelayed_; }
  [[nodiscard]] const std::map<std::string, Found>& found() const { return now_.found; }
  [[nodiscard]] const std::vector<std::string>& steps() const { return steps_; }

 private:
  /// Everything that an attempt changes; restored if the attempt improves nothing.
  struct State {
    Hypothesis current;  ///< the present model, refitted in free simulation
    Hypothesis fitted;   ///< the same structure fitted by projection, to compare candidates with
    Hypothesis as_is;    ///< `current` with its error on all blocks, its coefficients fixed
    std::map<std::string, Found> found;
    bool filter_for_mode = false;  ///< a filter may have taken the place of a mode
  };
  void back_to(const State& before);

  // Any step.
  void add_causes();
  /// An error as the steps show it.
  [[nodiscard]] std::string size_of(double rms) const { return micro_text(rms, search_.rotary()); }
  /// Refits the present structure as well as possible, before candidates are added to it.
  void settle();
  /// The cause that the present model has and that one had not.
  [[nodiscard]] Cause cause_by_improvement(std::string id, const Hypothesis& before) const;
  /// Removes a cause that a later one has made unnecessary; true if there was one.
  bool remove_unnecessary();

  // The delay, the order and the integrator of the loop.
  /// Removes the delay if a loop with free numerator fits as well without it: unmodelled friction
  /// can look like a delay.
  void delay();
  /// Adds a delay to a loop with a velocity error; the structures of the baseline do not combine
  /// the two. False where it does not improve the model enough.
  bool add_delay();
  /// Replaces a mode by a delay where that fits better: the poles and zeros of a mode can imitate a
  /// delay, which needs one parameter instead of four.
  bool delay_does_better(Hypothesis mode);
  /// Where to search the poles of a loop of the other order, with the present shape parameters:
  /// with a slow pole more, or without one of the real ones.
  [[nodiscard]] std::vector<Point> starts_in_other_order(const Structure& structure) const;
  /// Tries a loop with an integrator where the model has none. An integrator is not a cause but
  /// part of the loop beside which causes are searched; a missing cause may have hidden it.
  void integrator();
  /// What the integrator does at the limit of the motor: takes the form of the limit that leaves
  /// least.
  void anti_windup();
  // Where much stays unexplained, the loop that was fitted to all motion may be that of an axis
  // which the cause has changed, from which no fit leads to the true one.
  /// Fits the loop to a part of the motion that the cause does not reach, and the cause beside it:
  /// a limit of the motor to the motion without hard accelerations, and what sets in at some time
  /// to the motion before. True where that is clearly better: the causes found before are
  /// forgotten.
  bool begin_with_part();
  /// The loop of a part; nothing where it does not leave much less there than the present model.
  [[nodiscard]] std::optional<Hypothesis> loop_of_part(const std::vector<Segment>& part,
                                                       const std::string& name);
  bool limit_beside(const Hypothesis& loop);
  bool change_beside(const Hypothesis& loop);
  /// Refits these and makes the best the present model, with its last effect as the cause.
  bool best_beside(std::vector<Hypothesis> tried);

  // A filter of the control: part of the loop, and no cause.
  /// Adds one where much is left and the screen forecasts that it explains `min_gain` of the
  /// squared error. False where the RMS beyond the noise does not fall to `max_ratio` of what it
  /// was, or where a delay does as much: that is then added in its place.
  bool add_filter(double max_ratio, double min_gain);
  /// The present model with a filter; without effects where no fit is one.
  [[nodiscard]] Hypothesis with_filter(const Screened& screened);
  /// Refits in free simulation until that hardly helps any more.
  void converge(Hypothesis& h);
  /// Puts a filter in the place of this vibration or gap, where that fits clearly better.
  bool filter_does_better(Hypothesis mode);
  /// Where the filter alone leaves less than all causes found: takes it in their place.
  bool filter_in_place_of_causes();
  /// Forgets the causes that stood for the filter, and what was tried without it.
  void ask_again_beside_filter();
  /// The filter is part of the loop that the causes are compared with.
  void give_filter_to_baseline();

  // A round: candidates are screened, fitted and compared, and one is added.
  /// False where no candidate improves the model enough.
  bool add_one();
  [[nodiscard]] std::vector<std::size_t> kinds_to_screen() const;
  /// Those of these kinds that the screen forecasts a gain for, the best first.
  [[nodiscard]] std::vector<Screened> promising_of(const std::vector<std::size_t>& kinds);
  struct Fitted {
    std::vector<Tried> tried;  ///< the best first
    /// Those that explain much of the training data, for a second judgement where the left-out
    /// blocks disagree.
    std::vector<Tried> doubted;
  };
  [[nodiscard]] Fitted fitted(const std::vector<Screened>& promising);
  /// A candidate fitted together with the loop, which may have absorbed a part of the effect; and
  /// with the loop fixed, which is better where the measured motion is less accurate than the
  /// simulated.
  struct Candidate {
    Hypothesis h, beside;
    bool fits = false, varies = false;
  };
  /// Fits the next `count` of these, as far as there are so many.
  void fit_some(const std::vector<Screened>& promising, std::size_t count,
                std::vector<Candidate>& candidates);
  /// Judges the doubted ones by their best fit, and adds to `tried` those that stay good.
  void judge_again(std::vector<Tried>& doubted, std::vector<Tried>& tried);
  /// Refits the two best candidates in free simulation where they explain nearly the same, so that
  /// the better one is chosen by its best fit. So does a limit beside pushes at free moments: the
  /// loop that was fitted without the limit stands for a part of it.
  void polish_rivals(std::vector<Tried>& tried);
  /// The time at which an effect sets in; nothing where it acts all the time.
  [[nodiscard]] static std::optional<double> moment_of(const Hypothesis& h, std::size_t kind);
  [[nodiscard]] static std::size_t shapes_before(const Structure& structure, std::size_t kind);
  [[nodiscard]] Point start_of(const Structure& structure, const Screened& s) const;

  // Laws of friction.
  /// Replaces presliding and falling friction, two effects, by one law of friction where that
  /// predicts better.
  void one_law_of_friction();
  /// The law of friction was chosen before the causes beside it were known: where much is left with
  /// them, tries the other ones, but for an axis with play. True where one is clearly better and
  /// was accepted.
  bool better_law();
  /// A law whose breakaway force is high and falls at once stands for one that grows at rest: tries
  /// that beside every law of friction. True where it is clearly better.
  bool law_beside_rests();
  /// Fits each of these laws in place of the present one, in free simulation, and returns the best.
  /// `beside`: an effect that is fitted with it; may be null. Nothing where no law can be fitted.
  [[nodiscard]] std::optional<Hypothesis> best_of_laws(const std::vector<std::size_t>& laws,
                                                       const Screened* beside);
  /// Judges it on blocks whose models are refitted in free simulation.
  void judge_in_simulation(Hypothesis& h) const;
  /// Makes it the present model. False where it is not clearly better, also once it is refitted.
  bool accept_law(Hypothesis h);
  /// The misfit of a wrong law of friction can look like backlash, a mode or dwell stiction:
  /// removes such a cause where another law of friction fits as well without it.
  void replace_misfit_by_law();
  /// Names the causes contained in a law of friction: presliding always, stribeck if it was named
  /// before or if the friction of the law changes enough with speed.
  void named_by(std::size_t law, const Cause& evidence);

  // Two masses.
  /// Where much stays unexplained, a mode or a gap beside a rigid axis was found, or a filter may
  /// stand for one, the axis may not be rigid: tries one of two masses, beside its law of friction
  /// alone, beside all causes found so far, and in a loop of the other order, since a rigid loop
  /// takes over a part of the vibration. True where one is clearly better: the causes that stood
  /// for it are forgotten.
  bool part_masses();
  [[nodiscard]] bool may_have_two_masses() const;
  /// Whether one of these effects beside the present model would explain this share of the squared
  /// error.
  [[nodiscard]] bool promised(std::vector<std::size_t> kinds, double min_gain) const;
  [[nodiscard]] std::vector<std::size_t> two_mass_kinds() const;
  [[nodiscard]] std::vector<std::size_t> permitted_laws() const;
  /// A rigid axis with its law of friction, its delay if `delayed`, and a loop of this order;
  /// without effects where it cannot be fitted.
  [[nodiscard]] Hypothesis law_alone(int order, bool delayed);
  /// The present model without what two masses stand for.
  [[nodiscard]] Hypothesis without_vibration() const;
  /// Makes it the present model. False where it is not clearly better once it is refitted.
  bool accept_two_masses(Hypothesis two_masses);

  Search& search_;
  State now_;
  const DiagnoseOptions& options_;
  Hypothesis settled_;
  std::optional<Hypothesis> undelayed_;
  std::optional<Hypothesis> filtered_;  // a filter before any cause, which was too little alone
  std::set<std::size_t> rejected_;
  double baseline_ = 0.0;  // RMS before any cause [m | rad]
  double friction_ = 0.0;  // RMS that laws of friction have removed
  std::string last_;       // the cause added last
  std::vector<std::string> steps_;
};

}  // namespace servotwin
