// What 10 s of the feed axis of paper 002 cost at 16 kHz, in full and reduced, and by how much the
// reduced one misses the other's torque. Both run in turn in one process, five times; the best
// counts.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "cli/recording/feed_axis_file.h"
#include "twin/feed_axis/feed_axis.h"
#include "twin/feed_axis/reversing_motion.h"

namespace {

using namespace servotwin;

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <class Make>
double timed(Make make) {
  const double begin = seconds();
  make();
  return seconds() - begin;
}

void compare(const char* name, const FeedAxisParts& parts, const ReversingMotion& motion) {
  constexpr int kTurns = 5;
  constexpr double kSeconds = 10.0;
  const double rate = parts.control.rate_hz;
  const Eigen::ArrayXd command =
      sampled(motion, rate).head(static_cast<Eigen::Index>(kSeconds * rate)) +
      ((parts.nut.from + parts.nut.to - motion.travel) / 2.0 - parts.nut.at_zero);
  std::optional<FullAxis> full;
  std::optional<ReducedAxis> reduced;
  const double full_setup = timed([&] { full.emplace(full_axis(parts)); });
  const double reduced_setup = timed([&] { reduced.emplace(reduced_axis(parts)); });
  FeedAxisRun want, got;
  double full_s = 1e9, reduced_s = 1e9;
  for (int turn = 0; turn < kTurns; ++turn) {
    full_s = std::min(full_s, timed([&] { want = run(*full, command); }));
    reduced_s = std::min(reduced_s, timed([&] { got = run(*reduced, command); }));
  }
  const Eigen::ArrayXd error = got.torque - want.torque;
  const auto line = [&](const char* which, double run_s, double setup_s) {
    std::printf("  %-8s %8.4f s  %6.0f times real time  %6.0f ns a cycle  (setup %.3f s)\n", which,
                run_s, kSeconds / run_s, 1e9 * run_s / static_cast<double>(command.size()),
                setup_s);
  };
  std::printf("%s: %.0f s at %.0f Hz\n", name, kSeconds, rate);
  line("full", full_s, full_setup);
  line("reduced", reduced_s, reduced_setup);
  const double size = std::sqrt(want.torque.square().mean());
  std::printf(
      "  torque misses %.5f Nm RMS (%.4f %% of %.3f Nm RMS), at most %.5f Nm; table %.3f um\n",
      std::sqrt(error.square().mean()), 100.0 * std::sqrt(error.square().mean()) / size, size,
      error.abs().maxCoeff(), 1e6 * (got.table_position - want.table_position).abs().maxCoeff());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "bench_feed_axis: usage: bench_feed_axis examples/feed_axis.toml\n");
    return 2;
  }
  try {
    const FeedAxisParts parts = read_feed_axis(argv[1]);
    compare("interval 1, 400 mm/s", parts, {.speed = 0.4, .travel = 0.36, .cycles = 5});
    compare("interval 2, 50 mm/s", parts, {.speed = 0.05, .travel = 0.05, .cycles = 5});
    compare("interval 3, 5 mm/s", parts, {.speed = 0.005, .travel = 0.005, .cycles = 5});
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_feed_axis: %s\n", error.what());
    return 1;
  }
  return 0;
}
