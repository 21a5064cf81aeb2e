// Free simulation of whole segments: `simulate` of twin/twin.h.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "twin/difference.h"
#include "twin/linear_algebra.h"
#include "twin/neighbour.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {

namespace {

/// The commanded motion of a segment as the loop gets it, delayed.
template <class S>
struct Input {
  S delay_s = 0.0;
  Spline motion;
  Spline by_delay;  ///< d motion / d delay; empty if the delay does not change
  Eigen::ArrayXd neighbour, neighbour_motion;  // accelerations

  [[nodiscard]] S position(Eigen::Index k) const {
    S out = 0.0;
    set(out, &Spline::value, k);
    return out;
  }
  /// The cycle that ends at sample k; `piece` had been set for another one.
  void set(CommandPieceOf<S>& piece, const Segment& segment, Eigen::Index k) const {
    set(piece.velocity, &Spline::first, k - 1);
    set(piece.acceleration, &Spline::second, k - 1);
    set(piece.jerk, &Spline::third, k - 1);
    set(piece.end_position, &Spline::value, k);
    set(piece.end_velocity, &Spline::first, k);
    piece.end_acceleration = piece.acceleration + motion.h * piece.jerk;
    if (neighbour.size() > 0) piece.neighbour_acceleration = neighbour(k);
    if (neighbour_motion.size() > 0) piece.neighbour_motion_acceleration = neighbour_motion(k);
    if (segment.in_cut.size() > 0) piece.in_cut = segment.in_cut(k);
  }

 private:
  void set(S& x, Eigen::ArrayXd Spline::*what, Eigen::Index k) const {
    if constexpr (is_dual<S>) {
      x.value = (motion.*what)(k);
      if (by_delay.h > 0.0) {
        for (std::size_t i = 0; i < S::kLanes; ++i) x.by[i] = (by_delay.*what)(k)*delay_s.by[i];
      }
    } else {
      x = (motion.*what)(k);
    }
  }
};

template <class S>
Input<S> input_of(const Segment& segment, const S& delay_s) {
  Input<S> out;
  out.delay_s = delay_s;
  const Spline original = Spline::through(segment.command, segment.sample_time_s);
  out.motion = Spline::through(original.delayed(value_of(delay_s)), segment.sample_time_s);
  if constexpr (is_dual<S>) {
    if (std::any_of(delay_s.by.begin(), delay_s.by.end(), [](double by) { return by != 0.0; }))
      out.by_delay =
          Spline::through(original.delayed_derivative(delay_s.value), segment.sample_time_s);
  }
  out.neighbour = neighbour_acceleration(segment, false);
  out.neighbour_motion = neighbour_acceleration(segment, true);
  return out;
}

/// keep(k, error, twin) for the first `count` samples of a run from rest, or from this free
/// response.
template <class S, class Keep>
void run(const TwinOf<S>& model, const Segment& segment, Eigen::Index count, const Input<S>& input,
         std::span<const S> free_response, const Keep& keep) {
  TwinOf<S> twin = model;
  twin.start(input.position(0), free_response, segment.start_s);
  keep(Eigen::Index{0}, S(segment.command(0) - twin.position()), twin);
  CommandPieceOf<S> piece;
  if (!free_response.empty() && count > 1) {
    input.set(piece, segment, 1);
    twin.start_filters(piece.velocity, piece.acceleration);
  }
  for (Eigen::Index k = 1; k < count; ++k) {
    input.set(piece, segment, k);
    keep(k, S(twin.step(piece) + (segment.command(k) - piece.end_position)), twin);
  }
}

constexpr int kStartRounds = 3;  // corrections of the starting state, at most
// What a correction has to take from the sum of squares: this times what noise gives away to every
// state that is fitted, its share of the rows. So neither noise nor rounding decides.
constexpr double kGainOverChance = 3.0;

/// One reading throughout, or two that an encoder's last digit changes between.
bool stands(const Eigen::ArrayXd& readings) {
  const double low = readings.minCoeff(), high = readings.maxCoeff();
  return (readings == low || readings == high).all();
}

/// The axis without forces and play. It keeps its delay: modes that change with position are
/// placed by the delayed command.
template <class S>
ModelOf<S> linear_part(const ModelOf<S>& model) {
  ModelOf<S> out = model;
  std::erase_if(out.effects, [](const EffectOf<S>& effect) {
    return identity_of(effect.kind).acts != Acts::kCommandDelay;
  });
  if (const EffectOf<S>* two_mass = two_mass_of(model))
    out.effects.push_back(without_play(*two_mass));
  return out;
}

template <class S>
Eigen::MatrixXd part(const std::vector<S>& x, Eigen::Index rows, std::size_t lane) {
  Eigen::MatrixXd out(rows, static_cast<Eigen::Index>(x.size()) / rows);
  for (std::size_t i = 0; i < x.size(); ++i) {
    if constexpr (is_dual<S>) {
      out(static_cast<Eigen::Index>(i)) = lane == S::kLanes ? x[i].value : x[i].by[lane];
    } else {
      out(static_cast<Eigen::Index>(i)) = x[i];
    }
  }
  return out;
}

/// What the starting state of a segment is found by: the free responses of the axis.
template <class S>
class Start {
 public:
  Start(const ModelOf<S>& model, int order, const Input<S>& input, Eigen::Index settle)
      : rows_(settle - 1) {
    const TwinOf<S> bare(linear_part(model));
    for (int i = 0; i < order; ++i) {
      TwinOf<S> free = bare;
      std::array<S, kMaxOrder + 2 * kMaxModes> unit{};
      unit[static_cast<std::size_t>(i)] = 1.0;
      free.start(input.position(0),
                 std::span<const S>(unit.data(), static_cast<std::size_t>(order)));
      for (Eigen::Index k = 0; k + 1 < settle; ++k) {
        // Modes that change with position are those of the commanded position at rest.
        CommandPieceOf<S> still;
        still.end_position = input.position(k + 1);
        response_.push_back(free.step(still));
      }
    }
    const Eigen::MatrixXd response = part(response_, rows_, kValue);
    scale_ = response.colwise().norm().cwiseMax(1e-300);
    scaled_ = response * scale_.cwiseInverse().asDiagonal();
    solver_.emplace(scaled_);
  }

  /// The state whose free response is the nearest to `miss`, by least squares.
  [[nodiscard]] std::vector<S> nearest(const std::vector<S>& miss) const {
    const Eigen::VectorXd wanted = part(miss, rows_, kValue);
    const Eigen::VectorXd found =
        (solver_->solve(wanted).array() / scale_.transpose().array()).matrix();
    std::vector<S> out(found.begin(), found.end());
    if constexpr (is_dual<S>) {
      // d (R+ m) = R+ (dm - dR x) + (R' R)^-1 dR' (m - R x)
      const Eigen::VectorXd left = wanted - part(response_, rows_, kValue) * found;
      for (std::size_t lane = 0; lane < kParametersPerPass; ++lane) {
        const Eigen::MatrixXd by = part(response_, rows_, lane);
        const Eigen::VectorXd change = part(miss, rows_, lane) - by * found;
        Eigen::VectorXd moved = solver_->solve(change);
        const Eigen::VectorXd turned = scale_.cwiseInverse().asDiagonal() * (by.transpose() * left);
        moved += solve_symmetric(scaled_.transpose() * scaled_, turned);
        for (std::size_t i = 0; i < out.size(); ++i) {
          const auto at = static_cast<Eigen::Index>(i);
          out[i].by[lane] = moved(at) / scale_(at);
        }
      }
    }
    return out;
  }

 private:
  static constexpr std::size_t kValue = [] {
    if constexpr (is_dual<S>) return S::kLanes;
    return std::size_t{0};
  }();
  Eigen::Index rows_;
  std::vector<S> response_;
  Eigen::RowVectorXd scale_;
  Eigen::MatrixXd scaled_;
  std::optional<LeastSquares> solver_;
};

/// keep(row, error) for every sample of the segment and output; `values`: the model without
/// derivatives.
template <class S, class Keep>
void simulate_with(const ModelOf<S>& model, const Model& values, const Segment& segment,
                   Outputs outputs, const Keep& keep) {
  const TwinOf<S> twin(model);
  const Eigen::Index n = segment.size();
  const Input<S> input = input_of(segment, twin.command_delay_s());
  std::vector<S> state;
  // The starting state: none where the axis stands, whatever the encoder's rounding says; else the
  // free response that brings the simulation onto the first encoder values.
  const auto settle = std::min(n, starting_state_samples(values, segment));
  if (segment.actual.size() == n &&
      !(stands(segment.command.head(settle)) && stands(segment.actual.head(settle)))) {
    state.resize(static_cast<std::size_t>(twin.free_states()));
    const Start<S> start(model, twin.free_states(), input, settle);
    // Friction depends on the starting motion, so further rounds improve the estimate. But what
    // holds the axis at rest is not in the free responses: there a correction by the encoder's
    // noise would set it swinging.
    const double chance =
        static_cast<double>(state.size()) / static_cast<double>(std::max<Eigen::Index>(settle, 1));
    std::vector<S> trial = state;
    double least = std::numeric_limits<double>::infinity();
    for (int round = 0; round <= kStartRounds; ++round) {
      std::vector<S> miss;
      double squares = 0.0;
      run<S>(twin, segment, settle, input, trial,
             [&](Eigen::Index k, const S& error, const TwinOf<S>&) {
               if (k == 0) return;
               miss.push_back((segment.command(k) - segment.actual(k)) - error);
               squares += value_of(miss.back()) * value_of(miss.back());
             });
      if (!(squares * (1.0 + kGainOverChance * chance) < least)) break;
      least = squares;
      state = trial;
      if (round == kStartRounds) break;
      const std::vector<S> correction = start.nearest(miss);
      for (std::size_t i = 0; i < trial.size(); ++i) trial[i] += correction[i];
    }
  }
  run<S>(twin, segment, n, input, state,
         [&](Eigen::Index k, const S& error, const TwinOf<S>& there) {
           const Eigen::Index row = outputs.per_sample() * k;
           keep(row, error);
           if (outputs.motor) keep(row + 1, S(segment.command(k) - there.motor_position()));
           if (outputs.torque) {
             keep(row + outputs.torque_at(), there.motor_force());
             keep(row + outputs.torque_at() + 1, there.motor_velocity());
           }
         });
}

/// The model with its derivatives along these directions.
ModelOf<TwinDual> moved(const Model& model, std::span<const Model* const> directions) {
  auto out = empty_like<TwinDual>(model);
  each_parameter(out, model, [](TwinDual& x, double value) { x.value = value; });
  for (std::size_t lane = 0; lane < directions.size(); ++lane) {
    each_parameter(out, *directions[lane], [lane](TwinDual& x, double by) { x.by[lane] = by; });
  }
  return out;
}

/// Whether the loop, or the delay of its command, changes along this direction.
bool moves_command(const Model& direction) {
  bool moves = direction.command_delay_s() != 0.0;
  Loop loop = direction.loop;
  each_parameter(loop, direction.loop, [&](double, double by) { moves = moves || by != 0.0; });
  for (const Effect& effect : direction.effects) {
    for (const double by : effect.shape) moves = moves || (acts_on_axis(effect.kind) && by != 0.0);
  }
  return moves;
}

/// Along a motion that chatters in a gap a derivative can grow without bounds, though the motion
/// does not: the derivative of the error by a parameter, for a change as large as the parameter,
/// over the largest value of that output [1].
constexpr double kMaxRelativeDerivative = 1e4;

constexpr Eigen::Index kFewestSamples = 4;  // for a cubic through the command

}  // namespace

double starting_state_s(const Model& model) {
  // Long enough to see every mode of the loop and the load on its spring, and at least 20 samples
  // for the encoder's steps.
  double slowest = 1e9;
  const auto roots = roots_of(model.loop);
  for (int i = 0; i < model.loop.order; ++i)
    slowest = std::min(slowest, -roots[static_cast<std::size_t>(i)].real());
  for (const Mode& mode : model.loop.modes) slowest = std::min(slowest, mode.zeta * mode.omega);
  if (const Effect* two_mass = two_mass_of(model)) {
    const TwoMassParameters load = two_mass_parameters(*two_mass);
    slowest = std::min(slowest, load.zeta * load.omega);
  }
  if (const Effect* filter = model.find(kind_of<ControlFilter>())) {
    const double zeta = filter->shape[1];
    const double slower = zeta > 1.0 ? zeta - std::sqrt(zeta * zeta - 1.0) : zeta;
    slowest = std::min(slowest, kTwoPi * filter->shape[0] * slower);
  }
  return std::clamp(3.0 / slowest, 20.0 * model.sample_time_s, 0.25);
}

Eigen::Index starting_state_samples(const Model& model, const Segment& segment) {
  return static_cast<Eigen::Index>(starting_state_s(model) / segment.sample_time_s) + 4;
}

Eigen::ArrayXd simulate(const Model& model, const Segment& segment, Outputs outputs) {
  const Eigen::Index rows = outputs.per_sample() * segment.size();
  if (segment.size() < kFewestSamples) {
    const Twin checked(model);
    return Eigen::ArrayXd::Zero(rows);
  }
  Eigen::ArrayXd out(rows);
  simulate_with(model, model, segment, outputs,
                [&](Eigen::Index row, double error) { out(row) = error; });
  return out;
}

Simulated simulate(const Model& model, std::span<const Model> directions, const Segment& segment,
                   Outputs outputs) {
  const Eigen::Index rows = outputs.per_sample() * segment.size();
  const auto count = static_cast<Eigen::Index>(directions.size());
  if (segment.size() < kFewestSamples || count == 0)
    return {simulate(model, segment, outputs), Eigen::MatrixXd::Zero(rows, count)};
  Simulated out;
  out.error.resize(rows);
  out.by.resize(rows, count);
  // Those first that change more than the forces: the twin is faster without the others.
  std::vector<const Model*> order;
  for (const Model& direction : directions) order.push_back(&direction);
  std::stable_partition(order.begin(), order.end(),
                        [](const Model* direction) { return moves_command(*direction); });
  for (std::size_t first = 0; first < order.size(); first += kParametersPerPass) {
    const std::span<const Model* const> some = std::span<const Model* const>(order).subspan(
        first, std::min(kParametersPerPass, order.size() - first));
    simulate_with(moved(model, some), model, segment, outputs,
                  [&](Eigen::Index row, const TwinDual& error) {
                    out.error(row) = error.value;
                    for (std::size_t i = 0; i < some.size(); ++i)
                      out.by(row, some[i] - directions.data()) = error.by[i];
                  });
  }
  Eigen::ArrayXd largest(outputs.per_sample());
  const auto of_output = [&](Eigen::Index output) {
    return Eigen::seqN(output, segment.size(), outputs.per_sample());
  };
  for (Eigen::Index output = 0; output < largest.size(); ++output)
    largest(output) = out.error(of_output(output)).abs().maxCoeff();
  for (Eigen::Index i = 0; i < count; ++i) {
    const Model& direction = directions[static_cast<std::size_t>(i)];
    const double rate = relative_rate(model, direction);
    if (!(rate > 0.0)) continue;
    bool bounded = out.by.col(i).allFinite();
    for (Eigen::Index output = 0; bounded && output < largest.size(); ++output)
      bounded = out.by.col(i)(of_output(output)).cwiseAbs().maxCoeff() <=
                kMaxRelativeDerivative * rate * largest(output);
    if (bounded) continue;
    out.by.col(i) = difference(model, direction, segment, outputs, out.error);
  }
  return out;
}

}  // namespace servotwin
