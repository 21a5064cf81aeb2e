#include "twin/neighbour.h"

#include <algorithm>
#include <stdexcept>

#include "twin/hold.h"
#include "twin/twin.h"

namespace servotwin {

Eigen::ArrayXd neighbour_acceleration(const Segment& segment, bool by_motion) {
  const bool moves = by_motion && segment.neighbour_motion.size() == segment.size();
  const Eigen::ArrayXd& of = moves ? segment.neighbour_motion : segment.neighbour;
  if (of.size() != segment.size()) return {};
  return Spline::through(of, segment.sample_time_s).second;
}

void predict_neighbour(Segment& segment, const Model& model, const Model& other, bool pushes_back) {
  if (segment.neighbour.size() != segment.size()) return;
  Segment there;
  there.start_s = segment.start_s;
  there.sample_time_s = segment.sample_time_s;
  there.command = segment.neighbour;
  there.actual = segment.neighbour_motion;
  const auto moves = [&](const Model& by) -> Eigen::ArrayXd {
    return there.command - simulate(by, there);
  };
  if (!pushes_back) {
    Model alone = other;
    std::erase_if(alone.effects, [](const Effect& effect) { return couples(effect.kind); });
    segment.neighbour_motion = moves(alone);
    return;
  }
  // By turns, until it changes by less than any encoder shows [m | rad]. Every turn multiplies the
  // change by r1 r2 s^4 / (P1 P2), the ratios and the responses of both loops to a force: a quarter
  // where both tables of docs/measurements.md 20 vibrate.
  constexpr double kUnseen = 1e-9;
  constexpr double kSettled = 1e-2;  // of the first change; friction may keep the rest alive
  constexpr double kGrown = 100.0;   // a change that is as many times the first one does not settle
  constexpr int kMostTurns = 200;
  there.neighbour = there.neighbour_motion = segment.command;
  segment.neighbour_motion = moves(other);
  double first = 0.0, change = 0.0;
  for (int turn = 0; turn < kMostTurns; ++turn) {
    const Eigen::ArrayXd before = segment.neighbour_motion;
    there.neighbour_motion = segment.command - simulate(model, segment);
    segment.neighbour_motion = moves(other);
    change = (segment.neighbour_motion - before).abs().maxCoeff();
    if (change < kUnseen) return;
    if (turn == 0) first = change;
    if (!(change < kGrown * first)) break;
  }
  if (change < kSettled * first) return;
  throw std::invalid_argument(
      "the models of two axes push each other so strongly that their motions do not settle; "
      "predict "
      "each with its own model alone");
}

}  // namespace servotwin
