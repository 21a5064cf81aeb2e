// Hypotheses about what acts on an axis, fitted and judged within the training data.
#pragma once

#include <vector>

#include "diagnosis/screen.h"
#include "identification/loop/pole_search.h"
#include "identification/recording/noise_floor.h"

namespace servotwin {

/// A structure with its best fit, and how well it predicts blocks that its coefficients were not
/// fitted to.
struct Hypothesis {
  Structure structure;
  Point point;
  Model model;
  double cost = 1e300;         ///< on the training data
  std::vector<double> pieces;  ///< mean squares of the cross-validation, piece by piece [m^2]

  [[nodiscard]] double rms() const;
  [[nodiscard]] bool has(std::size_t kind) const;
};

/// The starting point of a structure: this model's loop and shapes, the catalogue's where the model
/// has none.
[[nodiscard]] Point point_of(const Model& model, const Structure& structure);

/// What happened at a moment is not in the other blocks, and a limit may hardly be met there: it
/// stays as it was found, and a few pieces hold all that it explains.
[[nodiscard]] bool happens_now_and_then(std::size_t kind);

/// A shape parameter by its name; NaN where the model or the effect has none.
[[nodiscard]] double shape_of(const Model& model, std::size_t kind, std::string_view name);

/// What a model leaves in free simulation: the mean square of every piece of a quarter of a second.
[[nodiscard]] std::vector<double> left_by(const Model& model, const std::vector<Segment>& segments);

/// z of the mean of paired differences; 0 where there are fewer than four.
[[nodiscard]] double paired_z(const std::vector<double>& before, const std::vector<double>& after);
/// z of the signed ranks of paired differences (Wilcoxon, Biometrics Bulletin 1 (1945) 80), which
/// does not fall when a few pieces hold most of the error; 0 where there are fewer than ten.
[[nodiscard]] double signed_rank_z(const std::vector<double>& before,
                                   const std::vector<double>& after);

class Search {
 public:
  /// `recorded`: hypotheses are fitted to what lies before `training_to_s`.
  Search(std::vector<Segment> recorded, double training_to_s, const PoleBounds& bounds,
         const NoiseFloor& floor);

  /// Refines from this point on the training data; from the grid of the poles where `from` is
  /// empty. False where there is no valid fit.
  [[nodiscard]] bool fit(Hypothesis& h, const std::vector<Point>& from);
  /// The same for a structure with a law of friction, by the steps of identification/loop/joint.h:
  /// from a grid of its shapes, along the simulated motion where the encoder is coarse, and
  /// polished.
  [[nodiscard]] bool fit_friction(Hypothesis& h, const Point& from);
  /// This kind beside a model that is held, fitted in free simulation; judged like `judge`, by what
  /// the other blocks say of the addition. False where there is no valid fit.
  [[nodiscard]] bool vary(Hypothesis& h, const Model& held, std::size_t kind,
                          const std::vector<double>& shapes) const;
  /// The pieces of a model as it is, fitted to all blocks.
  void judge_as_is(Hypothesis& h) const;
  /// Predicts every block in free simulation by the coefficients that the other blocks say. Poles
  /// and shapes are those of all blocks: to search them in a part would judge the search.
  void judge(Hypothesis& h) const;
  /// The same with poles, shapes and coefficients polished in free simulation on the other blocks,
  /// where their measured motion is too coarse to say the coefficients. Takes a polish per block.
  void judge_polished(Hypothesis& h) const;
  /// What each of these kinds could explain of what the hypothesis leaves.
  [[nodiscard]] std::vector<Screened> screen(const Hypothesis& h,
                                             const std::vector<std::size_t>& kinds) const;
  /// Polishes in free simulation, where that predicts the training data better.
  void polish(Hypothesis& h);
  /// What the bounds of single parameters do not say, of a model whose coefficients are those of
  /// the simulation.
  [[nodiscard]] bool is_plausible(const Model& model) const;
  /// From here on effects are driven by the motion of this hypothesis: those on the reading always,
  /// all where less is left of it by its own motion than by the encoder's. A coarse encoder or a
  /// long sampling time does not say when the axis turned.
  void follow(const Hypothesis& h);
  /// Listens for the cuts of the tool in what this model leaves.
  void listen(const Model& model);

  /// All that was recorded, with the cuts as they were heard last.
  [[nodiscard]] const std::vector<Segment>& recorded() const { return recorded_; }
  [[nodiscard]] const NoiseFloor& floor() const { return floor_; }
  [[nodiscard]] const std::vector<Segment>& training() const { return training_; }
  [[nodiscard]] int fits() const { return fits_; }

 private:
  /// A model whose simulated motion drives effects.
  struct Driver {
    Model model;
    double rms = 1e300;  ///< that it leaves on the training data
    bool knows_motion = false;
  };
  [[nodiscard]] std::vector<Signals> signals(const std::vector<Segment>& segments,
                                             const std::optional<Driver>& driver) const;

  /// Where an addition is begun: as it was screened, and elsewhere where that is not enough.
  [[nodiscard]] std::vector<std::vector<double>> starts_of(std::size_t kind,
                                                           const std::vector<double>& shapes) const;
  /// What a model leaves of a block, piece by piece.
  [[nodiscard]] std::vector<double> left_in(std::size_t block, const Model& model) const;
  /// Cuts the training data and their blocks out of the recording.
  void divide();

  std::vector<Segment> recorded_, training_;
  double training_to_s_;
  PoleBounds bounds_;
  std::vector<std::vector<Segment>> held_, rest_;
  NoiseFloor floor_;
  std::optional<Driver> followed_;
  int fits_ = 0;
};

}  // namespace servotwin
