#include "identification/loop/moving_modes.h"

#include <algorithm>

#include "identification/loop/identify.h"

namespace servotwin {

namespace {

// Start values of the slope. Within a factor of about two of one of them a search converges.
constexpr double kStartSlopes[] = {-0.1, -0.03, 0.03, 0.1};
// Residual RMS after one round from either of these slopes over that of fixed modes, at most, to
// continue: 0.37 to 0.8 was observed with modes that move, 0.976 and more with modes that do not
// (vibration_study --moving, coupling_test.cpp).
constexpr double kTrialSlopes[] = {-0.03, 0.03};
constexpr double kMaxRmsRatioToContinue = 0.95;

/// Of these segments and, where modes move over one already, of that.
Travel travel_of(const std::vector<Segment>& segments, const Travel& before) {
  Travel out{segments.front().command(0), segments.front().command(0)};
  if (before.to > before.from) out = before;
  for (const Segment& s : segments) {
    out.from = std::min(out.from, s.command.minCoeff());
    out.to = std::max(out.to, s.command.maxCoeff());
  }
  return out;
}

/// The same loop with the laws of its modes told over another travel, whose middle is in the old
/// one.
Loop over(const Loop& loop, const Travel& travel) {
  const double half = 0.5 * (travel.to - travel.from), middle = 0.5 * (travel.from + travel.to);
  Loop out = at_position(loop, middle);
  out.travel = travel;
  const double was = 0.5 * (loop.travel.to - loop.travel.from);
  const double wider = half / was, place = loop.travel.place(middle);
  for (std::size_t i = 0; i < loop.modes.size(); ++i) {
    const Mode& mode = loop.modes[i];
    const auto bounded = [](double value) {
      return std::clamp(value, -kMaxModeTravel, kMaxModeTravel);
    };
    out.modes[i].slope = bounded(wider * (mode.slope + 2.0 * mode.curve * place));
    out.modes[i].curve = bounded(wider * wider * mode.curve);
    out.modes[i].zeta_slope = bounded(wider * mode.zeta_slope);
  }
  return out;
}

}  // namespace

std::optional<OutputErrorFit> with_moving_modes(const std::vector<Segment>& segments,
                                                Structure structure, const Model& standing,
                                                double encoder_step) {
  if (segments.empty() || standing.loop.modes.empty()) return std::nullopt;
  structure.moving = true;
  Model from = standing;
  const bool moves = std::any_of(from.loop.modes.begin(), from.loop.modes.end(),
                                 [](const Mode& mode) { return mode.moves(); });
  const Travel travel = travel_of(segments, moves ? from.loop.travel : Travel{});
  if (!(travel.to > travel.from)) return std::nullopt;
  if (moves) {
    from.loop = over(from.loop, travel);
  } else {
    from.loop.travel = travel;
    const auto left = [&](std::size_t i, double slope, int rounds, Model& out) {
      Model start = from;
      start.loop.modes[i].slope = slope;
      const auto brief = output_error(segments, structure, start, {encoder_step, rounds, 1e-3, 1});
      if (!brief) return 1e300;
      out = brief->model;
      return judge(out, segments).rms;
    };
    const double worth = kMaxRmsRatioToContinue * judge(standing, segments).rms;
    bool hinted = false;
    for (std::size_t i = 0; i < from.loop.modes.size(); ++i) {
      for (const double slope : kTrialSlopes) {
        Model unused;
        hinted = hinted || left(i, slope, 1, unused) < worth;
      }
    }
    if (!hinted) return std::nullopt;
    // One mode after the other, from the slope with the least residual after a few rounds.
    double least = 1e300;
    for (std::size_t i = 0; i < from.loop.modes.size(); ++i) {
      Model best = from;
      for (const double slope : kStartSlopes) {
        Model found;
        const double rms = left(i, slope, 6, found);
        if (!(rms < least)) continue;
        least = rms;
        best = std::move(found);
      }
      from = std::move(best);
    }
  }
  return output_error(segments, structure, from, {encoder_step});
}

}  // namespace servotwin
