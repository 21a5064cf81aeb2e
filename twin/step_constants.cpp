// The constants of a step of one mass: the loop and its modes, discretised exactly.
#include <algorithm>

#include "twin/hold_of.h"
#include "twin/mode_step.h"
#include "twin/twin.h"

namespace servotwin {

template <class S>
void TwinOf<S>::discretise_loop(const LoopOf<S>& loop) {
  const int n = loop.order;
  linear_.states = 2 * n + 2 * static_cast<int>(loop.modes.size());
  denominator_ = loop.denominator;
  numerator_ = loop.numerator;
  travel_ = loop.travel;
  std::copy(loop.modes.begin(), loop.modes.end(), modes_.begin());
  moves_ = std::any_of(loop.modes.begin(), loop.modes.end(),
                       [](const ModeOf<S>& mode) { return mode.moves(); });
  const auto last = static_cast<std::size_t>(n - 1);
  SquareOf<S, kMaxOrder> a{};
  std::array<S, kMaxOrder> input{};
  for (std::size_t i = 0; i <= last; ++i) {
    if (i < last) a[i][i + 1] = 1.0;
    a[last][i] = -loop.denominator[last - i];
  }
  input[last] = 1.0;
  const HoldOf<S, kMaxOrder> hold = hold_of<S, kMaxOrder>(
      n, a, input,
      [&](const Eigen::MatrixXd& system, const Eigen::VectorXd& b) {
        return discretise(system, b, h_, 2);
      },
      [&](const Eigen::MatrixXd& system, const Eigen::VectorXd& b, const Eigen::MatrixXd& da,
          const Eigen::VectorXd& db) { return discretise_derivative(system, b, da, db, h_, 2); });
  for (int first : {0, n}) {
    for (std::size_t r = 0; r <= last; ++r) {
      auto& row = linear_.rows[static_cast<std::size_t>(first) + r];
      row.first = first;
      row.width = n;
      for (std::size_t c = 0; c <= last; ++c) row.phi[c] = hold.phi[r][c];
      if (first == 0) {
        row.command = hold.g[r];
      } else {
        row.force_end = hold.g[r][1] / h_;
        row.force_begin = hold.g[r][0] - row.force_end;
      }
    }
  }
  linear_.rest[static_cast<std::size_t>(n)] =
      1.0 / loop.denominator[static_cast<std::size_t>(n - 1)];
  place_modes(0.0, 0.0);
}

// A mode in the form whose first state is its part of the error, so that any start shows in it:
//   w1' = -2 zeta omega w1 + w2 + b1 u,   w2' = -omega^2 w1 + b2 u:   w1 = (b1 s + b2) / M u
template <class S>
void TwinOf<S>::place_modes(const S& over, const S& at_end) noexcept {
  using Constants = StepConstantsOf<S>;
  using Vibration = ModeOf<S>;
  const auto n = static_cast<std::size_t>(linear_.order);
  const auto size = static_cast<std::size_t>(linear_.states);
  typename Constants::State error{};
  for (std::size_t i = 0; i < n; ++i) error[i] = numerator_[n - 1 - i];
  S share = 1.0;  // disturbance_share
  std::array<Vibration, kMaxModes> here;

  for (std::size_t first = 2 * n; first < size; first += 2) {
    const std::size_t place = (first - 2 * n) / 2;
    const Vibration mode =
        at_place(modes_[place], travel_.place(over), linear_.order, denominator_).mode;
    const ModeStepOf<S> step(2.0 * mode.zeta * mode.omega, mode.omega * mode.omega, h_);
    const auto left = step.times(0, 1.0, 0.0), right = step.times(0, 0.0, 1.0);
    for (std::size_t r = 0; r < 2; ++r) {
      typename Constants::Row& row = linear_.rows[first + r];
      row.first = static_cast<int>(first);
      row.width = 2;
      row.phi[0] = left[r];
      row.phi[1] = right[r];
      double power = h_;
      for (std::size_t k = 0; k < 3; ++k, power *= h_)
        row.command[k] = power * step.times(k + 1, mode.alpha, mode.beta)[r];
      row.force_end = h_ * step.times(2, mode.gamma, mode.delta)[r];
      row.force_begin = h_ * step.times(1, mode.gamma, mode.delta)[r] - row.force_end;
    }
    const PlacedMode<S> placed =
        at_place(modes_[place], travel_.place(at_end), linear_.order, denominator_);
    const Vibration& end = here[place] = placed.mode;
    const S damping = 2.0 * end.zeta * end.omega, stiffness = end.omega * end.omega;
    error[first] = 1.0;
    error[0] += placed.lag;
    error[2 * n - 1] -= end.gamma;
    if (n == 3) error[n] -= end.delta * denominator_[2] / stiffness;
    share -= end.gamma * (denominator_[0] - damping) + end.delta;
    // At rest w1 = delta / omega^2, w2 = damping w1 - gamma.
    linear_.rest[first] = end.delta / stiffness;
    linear_.rest[first + 1] = damping * end.delta / stiffness - end.gamma;
  }
  error[2 * n - 2] += share;

  // d/dt of a reading, and what of the inputs is in it at once.
  const auto rate_of = [&](const typename Constants::State& of) {
    typename Constants::State out{};
    for (const std::size_t first : {std::size_t{0}, n}) {
      for (std::size_t c = 0; c < n; ++c)
        out[first + c] =
            (c > 0 ? of[first + c - 1] : S(0.0)) - of[first + n - 1] * denominator_[n - 1 - c];
    }
    for (std::size_t first = 2 * n; first < size; first += 2) {
      const Vibration& mode = here[(first - 2 * n) / 2];
      out[first] =
          -2.0 * mode.zeta * mode.omega * of[first] - mode.omega * mode.omega * of[first + 1];
      out[first + 1] = of[first];
    }
    return out;
  };
  const auto at_once = [&](const typename Constants::State& of, std::size_t block,
                           S Vibration::*first, S Vibration::*second) {
    S sum = of[block + n - 1];
    for (std::size_t at = 2 * n; at < size; at += 2) {
      const Vibration& mode = here[(at - 2 * n) / 2];
      sum += of[at] * (mode.*first) + of[at + 1] * (mode.*second);
    }
    return sum;
  };
  const auto keep = [&](const typename Constants::State& of, typename Constants::Reading& reading) {
    reading.state = of;
    reading.force_end = 0.0;
    for (std::size_t i = 0; i < size; ++i) reading.force_end += of[i] * linear_.rows[i].force_end;
  };
  const typename Constants::State rate = rate_of(error);
  keep(error, linear_.error);
  keep(rate, linear_.rate);
  keep(rate_of(rate), linear_.second);
  linear_.rate.velocity = at_once(error, 0, &Vibration::alpha, &Vibration::beta);
  linear_.second.velocity = at_once(rate, 0, &Vibration::alpha, &Vibration::beta);
  linear_.second.acceleration = linear_.rate.velocity;
  linear_.second.force = at_once(rate, n, &Vibration::gamma, &Vibration::delta);
}

template void TwinOf<double>::discretise_loop(const Loop& loop);
template void TwinOf<TwinDual>::discretise_loop(const LoopOf<TwinDual>& loop);
template void TwinOf<double>::place_modes(const double& over, const double& at_end) noexcept;
template void TwinOf<TwinDual>::place_modes(const TwinDual& over, const TwinDual& at_end) noexcept;

}  // namespace servotwin
