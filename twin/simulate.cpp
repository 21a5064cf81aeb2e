// Free simulation of whole segments: `simulate` of twin/twin.h.
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

#include "twin/twin.h"

namespace servotwin {

namespace {

/// The error of a run from rest, or from this free response.
Eigen::ArrayXd run(const Twin& model, const Segment& segment, const Spline& motion,
                   const Eigen::ArrayXd& delayed, const Eigen::ArrayXd& neighbour,
                   std::span<const double> free_response) {
  Twin twin = model;
  const Eigen::Index n = segment.size();
  Eigen::ArrayXd error(n);
  twin.start(delayed(0), free_response, segment.start_s);
  error(0) = segment.command(0) - twin.position();
  const double h = motion.h;
  for (Eigen::Index k = 1; k < n; ++k) {
    CommandPiece piece;
    piece.velocity = motion.first(k - 1);
    piece.acceleration = motion.second(k - 1);
    piece.jerk = motion.third(k - 1);
    piece.end_position = delayed(k);
    piece.end_velocity = motion.first(k);
    piece.end_acceleration = piece.acceleration + h * piece.jerk;
    if (neighbour.size() > 0) piece.neighbour_acceleration = neighbour(k);
    if (segment.in_cut.size() > 0) piece.in_cut = segment.in_cut(k);
    error(k) = twin.step(piece) + (segment.command(k) - delayed(k));
  }
  return error;
}

/// One reading throughout, or two that an encoder's last digit changes between.
bool stands(const Eigen::ArrayXd& readings) {
  const double low = readings.minCoeff(), high = readings.maxCoeff();
  return (readings == low || readings == high).all();
}

/// The axis without forces and play.
Model linear_part(const Model& model) {
  Model out = model;
  out.effects.clear();
  if (const Effect* two_mass = two_mass_of(model)) out.effects.push_back(without_play(*two_mass));
  return out;
}

}  // namespace

double starting_state_s(const Model& model) {
  // Long enough to see every mode of the loop, and at least 20 samples for the encoder's steps.
  double slowest = 1e9;
  const auto roots = roots_of(model.loop);
  for (int i = 0; i < model.loop.order; ++i)
    slowest = std::min(slowest, -roots[static_cast<std::size_t>(i)].real());
  for (const Mode& mode : model.loop.modes) slowest = std::min(slowest, mode.zeta * mode.omega);
  return std::clamp(3.0 / slowest, 20.0 * model.sample_time_s, 0.25);
}

Eigen::Index starting_state_samples(const Model& model, const Segment& segment) {
  return static_cast<Eigen::Index>(starting_state_s(model) / segment.sample_time_s) + 4;
}

Eigen::ArrayXd simulate(const Model& model, const Segment& segment) {
  const Twin twin(model);
  const Eigen::Index n = segment.size();
  if (n < 4) return Eigen::ArrayXd::Zero(n);
  const Spline original = Spline::through(segment.command, segment.sample_time_s);
  const Eigen::ArrayXd delayed = original.delayed(twin.command_delay_s());
  const Spline motion = Spline::through(delayed, segment.sample_time_s);
  const Eigen::ArrayXd neighbour =
      segment.neighbour.size() == n
          ? Spline::through(segment.neighbour, segment.sample_time_s).second
          : Eigen::ArrayXd();
  if (segment.actual.size() != n) return run(twin, segment, motion, delayed, neighbour, {});

  // The starting state: none where the axis stands, whatever the encoder's rounding says; else the
  // free response that brings the simulation onto the first encoder values.
  const auto settle = std::min(n, starting_state_samples(model, segment));
  if (stands(segment.command.head(settle)) && stands(segment.actual.head(settle)))
    return run(twin, segment, motion, delayed, neighbour, {});
  const int order = twin.free_states();
  Segment head = segment;
  head.command.conservativeResize(settle);
  const Twin bare(linear_part(model));
  std::array<double, kMaxOrder + 2 * kMaxModes> start{};
  const std::span<const double> state(start.data(), static_cast<std::size_t>(order));
  Eigen::MatrixXd response(settle - 1, order);
  for (int i = 0; i < order; ++i) {
    Twin free = bare;
    std::array<double, kMaxOrder + 2 * kMaxModes> unit{};
    unit[static_cast<std::size_t>(i)] = 1.0;
    free.start(delayed(0), {unit.data(), static_cast<std::size_t>(order)});
    for (Eigen::Index k = 0; k + 1 < settle; ++k) {
      // Modes that change with position are those of the commanded position at rest.
      CommandPiece still;
      still.end_position = delayed(k + 1);
      response(k, i) = free.step(still);
    }
  }
  const Eigen::RowVectorXd scale = response.colwise().norm().cwiseMax(1e-300);
  const auto solver = (response * scale.cwiseInverse().asDiagonal()).eval().colPivHouseholderQr();
  // Friction depends on the starting motion, so a second round improves the estimate.
  for (int round = 0; round < 3; ++round) {
    const Eigen::ArrayXd error = run(twin, head, motion, delayed, neighbour, state);
    const Eigen::VectorXd miss =
        ((segment.command - segment.actual).head(settle) - error).tail(settle - 1).matrix();
    const Eigen::VectorXd correction =
        (solver.solve(miss).array() / scale.transpose().array()).matrix();
    for (int i = 0; i < order; ++i) start[static_cast<std::size_t>(i)] += correction(i);
  }
  return run(twin, segment, motion, delayed, neighbour, state);
}

}  // namespace servotwin
