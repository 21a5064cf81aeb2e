// The pole search and the joint identification of the records of record.h.
//
//   bench_identification [Google Benchmark's options]
//   bench_identification --record FILE.csv              writes the 12 s of production
//   bench_identification --joint-record FILE.csv        writes 12 s of fast motion and 12 s of slow
//                                                       reversals
//   bench_identification --at REAL_HZ OMEGA_HZ ZETA     prints the pole search's RMS [um] there
//
// "as the peer" is the problem of pole_search_peer.py: the three poles are searched, the velocity
// limit of the friction is held, the axis starts at rest. "in full" is what the daemon asks for:
// the velocity limit is searched too, and an unknown starting state is projected out. What was
// found is given as counters.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <numbers>

#include "identification/loop/joint.h"
#include "identification/loop/pole_search.h"
#include "identification/response/frequency_response.h"
#include "tests/bench/record.h"

namespace {

using namespace servotwin;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kVelocityLimit = 1e-3;  // [m/s], also in pole_search_peer.py
constexpr double kEncoderStep = 1e-6;    // [m], of the records

enum class Problem { kAsThePeer, kInFull };

const Segment& record() {
  static const Segment segment = bench::production_record();
  return segment;
}

/// From the samples on: the splines of the command and the velocity are part of the work.
Projection projection(Problem problem) {
  const Structure structure{.order = 3, .effects = {kind_of<CoulombFriction>()}};
  return {{signals_of(record())}, structure, /*free_response=*/problem == Problem::kInFull};
}

double rms_um(const Projection& data, double cost) {
  return 1e6 * std::sqrt(2.0 * cost / static_cast<double>(data.rows()));
}

void pole_search(benchmark::State& state, Problem problem) {
  (void)record();
  PoleSearchOptions options;
  if (problem == Problem::kAsThePeer) {
    options.search_shapes = false;
    options.shapes = {kVelocityLimit};
  }
  for ([[maybe_unused]] auto _ : state) {
    const Projection data = projection(problem);
    const auto fit = pole_search(data, options);
    if (!fit) {
      state.SkipWithError("the pole search found nothing");
      return;
    }
    state.counters["real_hz"] = fit->poles.real / kTwoPi;
    state.counters["omega_hz"] = fit->poles.omega / kTwoPi;
    state.counters["zeta"] = fit->poles.zeta;
    state.counters["rms_um"] = rms_um(data, fit->solution.cost);
    state.counters["evaluations"] = fit->evaluations;
  }
}

Point point_at(double real_hz, double omega_hz, double zeta) {
  return {denominator_of({kTwoPi * real_hz, kTwoPi * omega_hz, zeta}, 3), {kVelocityLimit}};
}

/// One evaluation of the projected objective, on all samples.
void evaluation(benchmark::State& state) {
  const Projection data = projection(Problem::kAsThePeer);
  const Point point = point_at(10.0, 30.0, 0.5);
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(data.solve(point).cost);
}

/// Loop and presliding together, on as many seconds: steps 1 to 3, the problem of joint_peer.py,
/// and with the output-error polish, which knows the encoder's step.
void joint(benchmark::State& state, bool polish) {
  const Segment segment = bench::fast_and_slow_record(static_cast<double>(state.range(0)));
  const Structure structure{.order = 3, .effects = {kind_of<Presliding>()}};
  for ([[maybe_unused]] auto _ : state) {
    const auto fit = joint_fit({segment}, structure, {}, polish ? kEncoderStep : 0.0, polish);
    if (!fit) {
      state.SkipWithError("the joint identification found nothing");
      return;
    }
    const PoleSet poles = labels_of(fit->model.loop).set[0];
    const Effect& friction = fit->model.effects[0];
    state.counters["real_hz"] = poles.real / kTwoPi;
    state.counters["omega_hz"] = poles.omega / kTwoPi;
    state.counters["zeta"] = poles.zeta;
    state.counters["breakaway_mm_s2"] = 1e3 * friction.coefficient[0];
    state.counters["breakaway_um"] = 1e6 * friction.shape[0];
    state.counters["shape_factor"] = friction.shape[1];
    state.counters["rms_um"] =
        1e6 * std::sqrt(2.0 * fit->fit.solution.cost / static_cast<double>(segment.size()));
    state.counters["evaluations"] = fit->fit.evaluations;
  }
}

/// As long as the EMPS record, in windows of 2 s: frequency_response_peer.py.
void response(benchmark::State& state) {
  const std::vector<ResponseRecord> records{
      {{Eigen::ArrayXd::Random(24841)}, Eigen::ArrayXd::Random(24841), {}}};
  for ([[maybe_unused]] auto _ : state)
    benchmark::DoNotOptimize(
        frequency_response(records, 1e-3, {.window_s = 2.0, .differenced = true}));
}

void lengths(benchmark::internal::Benchmark* run) {
  for (const int seconds : {6, 12, 24, 48}) run->Arg(seconds);
  run->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(joint, steps 1 to 3, false)->Apply(lengths);
BENCHMARK_CAPTURE(joint, with polish, true)->Apply(lengths);
BENCHMARK_CAPTURE(pole_search, as the peer, Problem::kAsThePeer)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(pole_search, in full, Problem::kInFull)->Unit(benchmark::kMillisecond);
BENCHMARK(response)->Unit(benchmark::kMillisecond);
BENCHMARK(evaluation)->Unit(benchmark::kMillisecond);

int write(const Segment& segment, const char* path) {
  std::ofstream file(path);
  if (file) bench::write_csv(segment, file);
  file.close();
  if (file) return 0;
  std::fprintf(stderr, "bench_identification: cannot write %s\n", path);
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "--record") == 0) return write(record(), argv[2]);
  if (argc == 3 && std::strcmp(argv[1], "--joint-record") == 0)
    return write(bench::fast_and_slow_record(24.0), argv[2]);
  if (argc == 5 && std::strcmp(argv[1], "--at") == 0) {
    const Projection data = projection(Problem::kAsThePeer);
    const Point point = point_at(std::atof(argv[2]), std::atof(argv[3]), std::atof(argv[4]));
    std::printf("%.9g\n", rms_um(data, data.solve(point).cost));
    return 0;
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
