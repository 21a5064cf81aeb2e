// How long learning takes: 10 s at 1 kHz, two axes with presliding friction, ten virtual trials;
// and one step of the norm-optimal law over 10,000 samples. CPU time of one core, as JSON.
//
//   bench_learn PATH.csv      also writes the commands [m], for the peer (learn_peer.py)
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <numbers>

#include "ilc/feedforward.h"
#include "ilc/learn.h"
#include "ilc/norm_optimal.h"
#include "ilc/uncertainty.h"
#include "twin/twin.h"

namespace {

using namespace servotwin;
using Eigen::ArrayXd;

constexpr Eigen::Index kSamples = 10'000;
constexpr double kStep_s = 1e-3, kTwoPi = 2.0 * std::numbers::pi;
constexpr double kWeight = 1e-2;  // rho; also in learn_peer.py

/// Rests, circles of 10 mm at 100 mm/s faded in and out, rests.
ArrayXd command(double phase) {
  ArrayXd out(kSamples);
  for (Eigen::Index k = 0; k < kSamples; ++k) {
    const double t = kStep_s * static_cast<double>(k);
    const double edge = std::clamp(std::min(t - 0.5, 9.5 - t) / 0.5, 0.0, 1.0);
    const double fade = edge * edge * edge * (10.0 - edge * (15.0 - 6.0 * edge));
    out(k) = 0.01 * fade * std::sin(10.0 * t + phase);
  }
  return out;
}

/// The drive of the thesis's study; the second axis is a little slower.
Model drive(double slower) {
  Model model;
  model.sample_time_s = kStep_s;
  model.loop.denominator =
      denominator_of({kTwoPi * 9.87 * slower, kTwoPi * 31.31 * slower, 0.44}, 3);
  model.loop.numerator = {1.0, model.loop.denominator[0],
                          model.loop.denominator[2] / (75.0 * slower)};
  Effect presliding = make_effect<Presliding>();
  presliding.shape[0] = 20e-6;
  presliding.shape[1] = 0.7;
  presliding.coefficient[0] = 0.286;
  model.effects = {presliding};
  return model;
}

double cpu_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

}  // namespace

int main(int argc, char** argv) {
  std::vector<LearnAxis> axes(2);
  for (std::size_t i = 0; i < 2; ++i) {
    axes[i].name = i == 0 ? "X" : "Y";
    axes[i].model = drive(i == 0 ? 1.0 : 0.9);
    axes[i].path.sample_time_s = kStep_s;
    axes[i].path.command = command(i == 0 ? 0.0 : 1.0);
  }
  if (argc > 1) {
    std::ofstream out(argv[1]);
    out.precision(17);
    for (Eigen::Index k = 0; k < kSamples; ++k)
      out << axes[0].path.command(k) << ',' << axes[1].path.command(k) << '\n';
  }

  double start = cpu_s();
  for (LearnAxis& axis : axes) {
    axis.law.model = transfer_of(axis.model);
    TransferUncertainty uncertainty = relative_uncertainty(axis.law.model, 0.05);
    uncertainty.timing_s = kStep_s;
    const auto models = models_within(axis.law.model, uncertainty);
    axis.law.bandwidth_hz = robust_bandwidth(axis.law, models, kStep_s);
    axis.basis_bandwidth_hz = harmless_bandwidth(axis.law, models, kStep_s);
  }
  const double bandwidth_s = cpu_s() - start;
  LearnOptions options;
  options.patience = options.trials;
  start = cpu_s();
  const Learned learned = learn(axes, on_twins(axes), options);
  const double learning_s = cpu_s() - start;

  LearningLaw law = axes[0].law;
  law.law = Law::kNormOptimal;
  law.weight = kWeight;
  law.bandwidth_hz = std::numeric_limits<double>::infinity();
  const ArrayXd error = simulate(axes[0].model, axes[0].path), none = ArrayXd::Zero(kSamples);
  start = cpu_s();
  NormOptimal optimal(law, {}, kSamples, kStep_s);
  const ArrayXd found = optimal.next(none, error);
  const double lifted_s = cpu_s() - start;
  const CorrectionLimits limits{0.5 * found.abs().maxCoeff(), 5e-3};
  start = cpu_s();
  NormOptimal bound(law, limits, kSamples, kStep_s);
  const ArrayXd within = bound.next(none, error);
  const double limited_s = cpu_s() - start;

  std::printf(
      "{\"bandwidth_s\": %.4f, \"learning_s\": %.4f, \"trials\": %zu, \"bandwidth_hz\": %.17g,\n"
      " \"rms_um\": [%.6g, %.6g], \"best_um\": [%.6g, %.6g],\n"
      " \"lifted_s\": %.4f, \"lifted_cost\": %.12g, \"lifted_limited_s\": %.4f, \"limited_cost\": "
      "%.12g}\n",
      bandwidth_s, learning_s, learned.trials.size() - 1, axes[0].law.bandwidth_hz,
      1e6 * learned.trials[0].axis[0].rms, 1e6 * learned.trials[0].axis[1].rms,
      1e6 * learned.trials[learned.best].axis[0].rms,
      1e6 * learned.trials[learned.best].axis[1].rms, lifted_s, optimal.cost(found, none, error),
      limited_s, bound.cost(within, none, error));
  return 0;
}
