// What one axis costs in one servo cycle: the twin's step along the record of record.h.
//
// `follow` is what the real-time loop calls (commands only); `step` is the same without the
// delay's interpolation and the cubic. The friction is solved within the step, so that the cost
// depends on the motion: a real one, with dwells and reversals, and not a constant.
#include <benchmark/benchmark.h>

#include <array>
#include <numbers>
#include <vector>

#include "cli/export/unit.h"
#include "tests/bench/record.h"
#include "tests/support/temporary_directory.h"
#include "twin/twin.h"
#include "twin/virgin_curve.h"

extern "C" {
#include "cli/export/sources/fmi2.h"
}

namespace {

using namespace servotwin;

const Segment& motion() {
  static const Segment segment = bench::production_record();
  return segment;
}

Model with_delay(Model model) {
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 8.2e-3;  // [s], as long as a real recording showed
  model.effects.push_back(delay);
  return model;
}

/// Order 2 with Coulomb friction and a constant force: the structure of a drive without integrator.
Model without_integrator() {
  Model model = bench::production_model();
  model.loop.order = 2;
  model.loop.denominator = denominator_of({0.0, 2.0 * std::numbers::pi * 31.31, 0.7}, 2);
  model.loop.numerator = {1.0, model.loop.denominator[0]};
  Effect constant = make_effect<ConstantForce>();
  constant.coefficient[0] = 0.05;  // [m/s^2]
  model.effects.push_back(constant);
  return model;
}

/// The production axis with presliding (10 elements) or LuGre in place of Coulomb friction.
Model with_friction(Effect friction) {
  Model model = bench::production_model();
  friction.coefficient[0] = 0.286;  // [m/s^2]
  model.effects = {friction};
  return model;
}

/// GMS with eight free elements and Stribeck curve.
Model with_gms() {
  Model model = with_friction(make_effect<Gms>());
  for (std::size_t i = 0; i < Gms::kElements; ++i)
    model.effects[0].coefficient[i] = 0.286 / static_cast<double>(Gms::kElements);
  return model;
}

void follow(benchmark::State& state, const Model& model) {
  const Segment& segment = motion();
  const Twin at_rest = [&] {
    Twin twin(model);
    twin.start(segment.command(0));
    return twin;
  }();
  for ([[maybe_unused]] auto _ : state) {
    Twin twin = at_rest;
    double sum = 0.0;
    for (const double command : segment.command) sum += twin.follow(command);
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * segment.size());
}

void step(benchmark::State& state, const Model& model) {
  const Segment& segment = motion();
  const Spline spline = Spline::through(segment.command, segment.sample_time_s);
  std::vector<CommandPiece> pieces;
  for (Eigen::Index k = 1; k < segment.size(); ++k) {
    CommandPiece piece;
    piece.velocity = spline.first(k - 1);
    piece.acceleration = spline.second(k - 1);
    piece.jerk = spline.third(k - 1);
    piece.end_position = segment.command(k);
    piece.end_velocity = spline.first(k);
    piece.end_acceleration = piece.acceleration + spline.h * piece.jerk;
    pieces.push_back(piece);
  }
  const Twin at_rest = [&] {
    Twin twin(model);
    twin.start(segment.command(0));
    return twin;
  }();
  for ([[maybe_unused]] auto _ : state) {
    Twin twin = at_rest;
    double sum = 0.0;
    for (const CommandPiece& piece : pieces) sum += twin.step(piece);
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(pieces.size()));
}

/// The derivatives of a simulation by every parameter of the model: exactly, and by differences of
/// whole simulations, one after the other.
std::vector<Model> directions_of(const Model& model) {
  std::vector<Model> out;
  std::size_t count = 0;
  Model same = model;
  each_parameter(same, model, [&](double, double value) { count += value != 0.0 ? 1 : 0; });
  for (std::size_t i = 0; i < count; ++i) {
    out.push_back(empty_like<double>(model));
    std::size_t at = 0;
    each_parameter(out.back(), model, [&](double& by, double value) {
      if (value != 0.0 && at++ == i) by = value;
    });
  }
  return out;
}

void derivatives(benchmark::State& state, const Model& model) {
  const std::vector<Model> directions = directions_of(model);
  for ([[maybe_unused]] auto _ : state)
    benchmark::DoNotOptimize(simulate(model, directions, motion()).by.data());
  state.counters["parameters"] = static_cast<double>(directions.size());
}

void differences(benchmark::State& state, const Model& model) {
  const std::vector<Model> directions = directions_of(model);
  for ([[maybe_unused]] auto _ : state) {
    const Eigen::ArrayXd here = simulate(model, motion());
    Eigen::MatrixXd by(here.size(), static_cast<Eigen::Index>(directions.size()));
    for (std::size_t i = 0; i < directions.size(); ++i) {
      constexpr double kStep = 1e-5;
      Model moved = model;
      each_parameter(moved, directions[i], [](double& x, double rate) { x += kStep * rate; });
      by.col(static_cast<Eigen::Index>(i)) = (simulate(moved, motion()) - here).matrix() / kStep;
    }
    benchmark::DoNotOptimize(by.data());
  }
  state.counters["parameters"] = static_cast<double>(directions.size());
}

/// The production axis as a diagnosis fits it: LuGre, cogging, asymmetric friction.
Model with_causes() {
  Model model = with_friction(make_effect<LuGre>());
  Effect cogging = make_effect<Cogging>();
  cogging.coefficient = {0.02, 0.01, 0.01, 0.01};  // [m/s^2]
  Effect asymmetric = make_effect<AsymmetricFriction>();
  asymmetric.coefficient = {0.02, 0.01};  // [m/s^2], [1/s]
  model.effects.push_back(cogging);
  model.effects.push_back(asymmetric);
  return model;
}

Model with_two_masses() {
  Model model = bench::production_model();
  Effect two_masses = make_effect<TwoMassMotorEncoder>();
  two_masses.shape = {80.0, 0.05, 0.4, 0.6};
  model.effects.push_back(two_masses);
  return model;
}

/// `follow` in an exported unit, through its interface: command set, step done, error asked for.
void unit(benchmark::State& state, const Model& model) {
  const Segment& segment = motion();
  const test::TemporaryDirectory folder;
  (void)folder.file("model.txt", model_text(model, "{guid}"));
  fmi2CallbackFunctions functions{};
  const fmi2Component one =
      fmi2Instantiate("measured", fmi2CoSimulation, "{guid}",
                      ("file://" + folder.path().string()).c_str(), &functions, 0, 0);
  const fmi2ValueReference command = 0, error = 3;
  const double h = segment.sample_time_s;
  for ([[maybe_unused]] auto _ : state) {
    fmi2Reset(one);
    fmi2EnterInitializationMode(one);
    fmi2SetReal(one, &command, 1, &segment.command(0));
    fmi2ExitInitializationMode(one);
    double sum = 0.0, last = 0.0;
    for (Eigen::Index k = 0; k < segment.size(); ++k) {
      fmi2SetReal(one, &command, 1, &segment.command(k));
      if (fmi2DoStep(one, static_cast<double>(k) * h, h, 1) != fmi2OK) {
        state.SkipWithError("a step was refused");
        break;
      }
      fmi2GetReal(one, &error, 1, &last);
      sum += last;
    }
    benchmark::DoNotOptimize(sum);
  }
  fmi2FreeInstance(one);
  state.SetItemsProcessed(state.iterations() * segment.size());
}

/// The force of reduced GMS friction with this many elements, alone: what grows with them. The
/// catalogue's effect has ten, and the step that is solved with it evaluates them more than once.
template <std::size_t kElements>
void presliding_force(benchmark::State& state) {
  const Segment& segment = motion();
  const auto elements = reduced_elements<kElements>(20e-6, 0.7);
  for ([[maybe_unused]] auto _ : state) {
    std::array<double, kElements> force{};
    double sum = 0.0;
    for (Eigen::Index k = 1; k < segment.size(); ++k) {
      const double travel = segment.command(k) - segment.command(k - 1);
      for (std::size_t i = 0; i < kElements; ++i) {
        force[i] = slip(force[i], elements.stiffness[i], elements.level[i], travel);
        sum += force[i];
      }
    }
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * (segment.size() - 1));
}

}  // namespace

BENCHMARK(presliding_force<5>)->Name("friction alone, 5 elements");
BENCHMARK(presliding_force<10>)->Name("friction alone, 10 elements");
BENCHMARK(presliding_force<20>)->Name("friction alone, 20 elements");
BENCHMARK(presliding_force<40>)->Name("friction alone, 40 elements");
BENCHMARK_CAPTURE(step, order 3 + Coulomb, bench::production_model());
BENCHMARK_CAPTURE(step, order 2 + Coulomb + constant, without_integrator());
BENCHMARK_CAPTURE(step, order 3 + presliding of 10, with_friction(make_effect<Presliding>()));
BENCHMARK_CAPTURE(step, order 3 + GMS of 8, with_gms());
BENCHMARK_CAPTURE(step, order 3 + LuGre, with_friction(make_effect<LuGre>()));
BENCHMARK_CAPTURE(follow, order 3 + Coulomb, bench::production_model());
BENCHMARK_CAPTURE(follow, order 2 + Coulomb + constant, without_integrator());
BENCHMARK_CAPTURE(follow, order 3 + Coulomb + delay, with_delay(bench::production_model()));
BENCHMARK_CAPTURE(follow, order 2 + Coulomb + constant + delay, with_delay(without_integrator()));
BENCHMARK_CAPTURE(follow, order 3 + presliding of 10, with_friction(make_effect<Presliding>()));
BENCHMARK_CAPTURE(unit, order 3 + Coulomb, bench::production_model());
BENCHMARK_CAPTURE(unit, order 2 + Coulomb + constant, without_integrator());
BENCHMARK_CAPTURE(unit, order 3 + Coulomb + delay, with_delay(bench::production_model()));
BENCHMARK_CAPTURE(unit, order 3 + presliding of 10, with_friction(make_effect<Presliding>()));
BENCHMARK_CAPTURE(derivatives, order 3 + Coulomb, bench::production_model());
BENCHMARK_CAPTURE(differences, order 3 + Coulomb, bench::production_model());
BENCHMARK_CAPTURE(derivatives, order 3 + LuGre + two causes, with_causes());
BENCHMARK_CAPTURE(differences, order 3 + LuGre + two causes, with_causes());
BENCHMARK_CAPTURE(derivatives, two masses, with_two_masses());
BENCHMARK_CAPTURE(differences, two masses, with_two_masses());

BENCHMARK_MAIN();
