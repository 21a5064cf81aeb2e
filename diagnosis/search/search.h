// Hypotheses about the effects that act on an axis, fitted and judged on the training data only.
// Units: SI, rad instead of m on rotary axes. `fit`, `fit_friction`, `polish`, `vary` and the
// `judge`s of several hypotheses may run at the same time after `follow`; everything else on one
// thread.
#pragma once

#include <atomic>
#include <vector>

#include "diagnosis/search/hypothesis.h"
#include "diagnosis/search/screen.h"
#include "diagnosis/statistics/pieces.h"
#include "identification/loop/pole_search.h"
#include "identification/recording/noise_floor.h"

namespace servotwin {

/// Fits hypotheses to the training data and judges them by cross-validation over blocks of it.
class Search {
 public:
  /// `recorded`: the whole recording; hypotheses are fitted to the part before `training_to_s`.
  Search(std::vector<Segment> recorded, double training_to_s, const PoleBounds& bounds,
         const NoiseFloor& floor, bool rotary = false);

  /// Fits the hypothesis to the training data, starting from these points; from the grid of poles
  /// where `from` is empty. False where there is no valid fit.
  [[nodiscard]] bool fit(Hypothesis& h, const std::vector<Point>& from);
  /// The same for a model without one of the effects of `model`: the better one of that fit and of
  /// one in free simulation that begins with the rest of `model`. Along a measured motion the other
  /// parameters may take over less than they can, and the effect would seem to be worth more.
  [[nodiscard]] bool fit_less(Hypothesis& h, const std::vector<Point>& from, const Model& model);
  /// Fits it to other segments than the training data, and in free simulation. False where there is
  /// no valid fit.
  [[nodiscard]] bool fit_elsewhere(Hypothesis& h, const std::vector<Segment>& segments);
  /// The same for a structure with a law of friction, by the steps of identification/loop/joint.h:
  /// from a grid of its shape parameters, along the simulated motion where the encoder is coarse,
  /// and refitted in free simulation.
  [[nodiscard]] bool fit_friction(Hypothesis& h, const Point& from);
  /// Fits an axis of two masses, of the best of these kinds, in place of the rigid axis of `rigid`;
  /// `to_beat` is the best model without them, `most` the RMS in the training data above which two
  /// masses are of no use. Below that of the model to beat, these laws of friction are tried in
  /// place of Coulomb friction. False where no valid fit is better than `rigid`.
  [[nodiscard]] bool part_masses(Hypothesis& h, const Hypothesis& rigid, const Model& to_beat,
                                 double most, const std::vector<std::size_t>& kinds,
                                 const std::vector<std::size_t>& laws);
  /// Fits an effect of this kind in free simulation while the model `held` is fixed, and judges it
  /// as `judge` does, with the parameters of the effect from the other blocks. False where there is
  /// no valid fit.
  [[nodiscard]] bool vary(Hypothesis& h, const Model& held, std::size_t kind,
                          const std::vector<double>& shapes) const;
  /// Fills in `pieces` by the model as it is, which was fitted to all blocks.
  void judge_as_is(Hypothesis& h) const;
  /// Fills in `pieces` by cross-validation: every block is simulated with coefficients fitted to
  /// the other blocks. Poles and shape parameters are those of all blocks, so that the model is
  /// judged and not the search for its poles.
  void judge(Hypothesis& h) const;
  /// The same with poles, shape parameters and coefficients refitted in free simulation on the
  /// other blocks, for motion that is measured too coarsely to estimate the coefficients directly.
  /// From the fit to all blocks, which `h` must be, by one step per block
  /// (identification/loop/output_error.h).
  void judge_polished(Hypothesis& h) const;
  /// How much of the residual of the hypothesis each of these kinds could explain, the best first.
  [[nodiscard]] std::vector<Screened> screen(const Hypothesis& h,
                                             const std::vector<std::size_t>& kinds) const;
  /// Refits the hypothesis in free simulation; keeps the result where its error on the training
  /// data is smaller.
  void polish(Hypothesis& h);
  /// RMS of the one over that of the other, both without the noise; 1 where the other is noise.
  [[nodiscard]] double ratio_beyond_noise(const Hypothesis& better, const Hypothesis& other) const;
  /// Whether a model fitted in free simulation is physically plausible beyond the bounds of its
  /// single parameters.
  [[nodiscard]] bool is_plausible(const Model& model) const;
  /// From here on the motion simulated with this hypothesis drives the effects: those on the
  /// encoder reading always, and all effects where the residual is smaller with the simulated
  /// motion than with the measured one. A coarse encoder or a long sampling time does not resolve
  /// the reversals.
  void follow(const Hypothesis& h);
  /// Detects the cuts of the tool in the residual of this model (diagnosis/evidence/cuts.h).
  void detect_cuts(const Model& model);

  /// The whole recording, with the cuts as detected last.
  [[nodiscard]] const std::vector<Segment>& recorded() const { return recorded_; }
  [[nodiscard]] const NoiseFloor& floor() const { return floor_; }
  [[nodiscard]] bool rotary() const { return rotary_; }
  [[nodiscard]] const std::vector<Segment>& training() const { return training_; }
  [[nodiscard]] int fits() const { return fits_; }

 private:
  /// A model whose simulated motion drives effects.
  struct Driver {
    Model model;
    double rms = 1e300;         ///< of its simulation error on the training data
    bool knows_motion = false;  ///< its motion is more accurate than the measured one
  };
  [[nodiscard]] std::vector<Signals> signals(const std::vector<Segment>& segments,
                                             const std::optional<Driver>& driver) const;
  /// Makes those of the training data, and of the blocks other than one, by `followed_`.
  void make_signals();

  /// Two masses have no forces along a measured motion, and its noise spoils the coefficients of a
  /// filter of the control: both are fitted in free simulation.
  [[nodiscard]] bool only_in_simulation(const Structure& structure) const;
  /// From the model of `h`, or from the one that is followed with the effects of `h`. False where
  /// neither has them.
  [[nodiscard]] bool refit_in_simulation(Hypothesis& h);
  /// The sum of the mean squares that its simulation leaves, interval by interval: the cost of what
  /// is fitted in simulation.
  [[nodiscard]] double left_in_training(const Model& model) const;
  [[nodiscard]] std::optional<Model> start_in_simulation(const Hypothesis& h) const;

  /// Starting points of the fit of an added effect: the screened one, and further ones where that
  /// is not enough.
  [[nodiscard]] std::vector<std::vector<double>> starts_of(std::size_t kind,
                                                           const std::vector<double>& shapes) const;
  [[nodiscard]] Screen simulated_screen(const Projection& coarse, const Hypothesis& h) const;
  /// The mean squares of the simulation error in a block, interval by interval.
  [[nodiscard]] std::vector<double> left_in(std::size_t block, const Model& model) const;
  /// Divides the recording into training data and hold-out, and the training data into blocks.
  void divide();

  std::vector<Segment> recorded_, training_;
  double training_to_s_;
  PoleBounds bounds_;
  // The blocks; with a lead-in that friction forgets; with all before them; the training data
  // without each.
  std::vector<std::vector<Segment>> held_, begun_, led_, rest_;
  NoiseFloor floor_;
  bool rotary_;
  std::optional<Driver> followed_;
  std::vector<Signals> training_signals_;
  std::vector<std::vector<Signals>> rest_signals_;
  std::atomic<int> fits_{0};
};

}  // namespace servotwin
