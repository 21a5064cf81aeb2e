// Prints the noise study of the thesis (3.6.1): pole search, joint identification and full LS at
// encoder steps of 0, 1, 5 and 10 um, beside the truth of the simulated drive and what the thesis
// prints.

#include <cmath>
#include <cstdio>
#include <numbers>

#include "identification/loop/full_ls.h"
#include "identification/loop/identify.h"
#include "identification/loop/joint.h"
#include "tests/support/full_ls_prediction.h"
#include "tests/support/thesis_study.h"
#include "twin/twin.h"

namespace {

using namespace servotwin;

constexpr double kTwoPi = 2.0 * std::numbers::pi;

Segment encoder(const ThesisStudy& study, double step_mm) {
  Segment s;
  s.sample_time_s = study.sample_time_s;
  s.command = study.command_mm * 1e-3;
  s.actual = quantised(study.actual_mm, step_mm) * 1e-3;
  return s;
}

void print_search(const char* name, const Signals& signals) {
  const Projection data({signals}, {3, {kind_of<CoulombFriction>()}}, false);
  PoleSearchOptions options;
  options.search_shapes = false;
  options.shapes = {1e-3};
  const auto fit = pole_search(data, options);
  if (!fit) return;
  const double rms = std::sqrt(2.0 * fit->solution.cost / static_cast<double>(data.rows()));
  std::printf(
      "  %-28s p %6.3f Hz, pair %6.3f Hz / %.4f, friction %6.1f mm/s^2, RMS %6.3f um, MAX %6.2f "
      "um, cond %6.1f\n",
      name, fit->poles.real / kTwoPi, fit->poles.omega / kTwoPi, fit->poles.zeta,
      1e3 * fit->solution.linear(3), 1e6 * rms, 1e6 * fit->solution.residual.cwiseAbs().maxCoeff(),
      condition_number(data, fit->point));
}

void print_full_ls(const char* name, const Segment& segment, bool constrained) {
  const auto fit = full_ls({segment}, {}, constrained);
  if (!fit) return;
  std::printf("  %-28s poles", name);
  for (const auto& root : roots_of(fit->model.loop))
    std::printf(" %.1f%+.1fi", root.real() / kTwoPi, root.imag() / kTwoPi);
  std::printf(" Hz, cond %.2e", fit->condition_number);
  if (why_invalid(fit->model).empty()) {
    const ErrorFigures free = judge(fit->model, {segment});
    const Eigen::ArrayXd left =
        (segment.command - segment.actual) - test::full_ls_prediction(*fit, segment).array();
    std::printf(", RMS %.3f um, MAX %.1f um (free simulation: %.3f, %.1f)\n",
                1e6 * std::sqrt(left.square().mean()), 1e6 * left.abs().maxCoeff(), 1e6 * free.rms,
                1e6 * free.max);
  } else {
    std::printf(", no usable model: %s\n", why_invalid(fit->model).c_str());
  }
}

/// Loop and friction together, and how far the result is from the position no encoder has rounded.
void print_joint(const ThesisStudy& study, const Segment& segment, double step_m) {
  const auto fit = joint_fit({segment}, {3, {kind_of<Presliding>()}}, {}, step_m, true);
  if (!fit) return;
  const PoleSet poles = labels_of(fit->model.loop).set[0];
  const Effect& friction = fit->model.effects[0];
  const auto sd = [&](Eigen::Index i) { return std::sqrt(fit->covariance(i, i)); };
  const Eigen::ArrayXd truth = 1e-3 * (study.command_mm - study.actual_mm);
  std::printf(
      "  %-28s p %6.3f Hz, pair %6.3f Hz / %.4f, breakaway %.1f +- %.1f mm/s^2 at %.2f +- %.2f um, "
      "shape %.4f +- %.4f, RMS against the unrounded position %.4f um\n",
      "joint", poles.real / kTwoPi, poles.omega / kTwoPi, poles.zeta, 1e3 * friction.coefficient[0],
      1e3 * sd(3), 1e6 * friction.shape[0], 1e6 * sd(fit->linear + 3), friction.shape[1],
      sd(fit->linear + 4),
      1e6 * std::sqrt((truth - simulate(fit->model, segment)).square().mean()));
}

}  // namespace

int main() {
  const ThesisStudy study = thesis_study();
  std::printf(
      "truth: p 9.870 Hz, pair 31.310 Hz / 0.4400, friction 286 mm/s^2 (GMS); 0.6 ms, %ld "
      "samples\n",
      static_cast<long>(study.command_mm.size()));
  std::printf(
      "thesis table 3.1, cond of the pole search at 1, 5, 10 um: 508.3, 577.2, 734.3; table 3.2, "
      "its biased pair at 5 um: 31.47 Hz / 0.71\n");
  for (const double step_mm : {0.0, 1e-3, 5e-3, 10e-3}) {
    std::printf("encoder step %g um\n", step_mm * 1e3);
    const Segment segment = encoder(study, step_mm);
    Signals signals = signals_of(segment);
    print_search("pole search", signals);
    signals.velocity =
        study.friction_mm_s2 / 286.0 * 1e-3;  // sat(v / 1 mm/s) is now the true force
    print_search("with the true friction force", signals);
    print_joint(study, segment, 1e-3 * step_mm);
    print_full_ls("full LS", segment, false);
    print_full_ls("full LS, poles in the box", segment, true);
  }
  return 0;
}
