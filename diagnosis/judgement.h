// Whether an addition to a model has earned its place (docs/theory.md 10).
#pragma once

#include "diagnosis/search.h"

namespace servotwin {

constexpr double kWorthIt = 0.98;   // a cause must bring the error below this
constexpr double kLawLeaves = 0.1;  // of what a law of friction explains, fitted to another one
constexpr double kChance = 0.01;    // false causes of a clean machine
constexpr double kAgrees = 1.64;    // z of the pieces that does not contradict
constexpr double kMuch = 0.7;       // of the squared error, and of the error: explains much

/// A candidate beside the model without it, fitted by the same means.
struct Tried {
  Hypothesis model;
  const Hypothesis* before;
  Screened screened;
  [[nodiscard]] double left() const { return model.rms() / before->rms(); }
};

struct Judgement {
  double z = 0.0, p = 1.0;
  bool earned = false;
};

/// What a candidate has to be more than.
struct Bar {
  double baseline = 0.0;       ///< RMS before anything was added [m | rad]
  double friction = 0.0;       ///< RMS that laws of friction have taken away so far
  std::size_t candidates = 1;  ///< that were looked at
};

/// Either by what the pieces say, or by the coefficients themselves, if the pieces agree.
[[nodiscard]] Judgement judged(const Tried& one, const Bar& bar);

/// The error that an addition takes away, in quadrature [m | rad].
[[nodiscard]] double taken(const Hypothesis& before, const Hypothesis& after);

/// Share of resamples in which the best takes more away than the rival, each from its own before.
[[nodiscard]] double share_beaten(const Tried& best, const Tried& rival);

/// Whether what a law of friction leaves could be taken for this: what acts at reversals and low
/// speed all the time. A period, a moment or another signal is none of friction's, and a law that
/// is the same both ways leaves the same both ways.
[[nodiscard]] bool like_friction(std::size_t kind);

}  // namespace servotwin
