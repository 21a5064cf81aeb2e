// How a loop with modes answers a disturbance force, with the derivatives of the answer by the
// poles and the modes: the columns of a projection.
//
// Units: m | rad, s. Const members may be called from several threads at once. Source:
// docs/theory.md 4.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstddef>
#include <vector>

#include "twin/hold.h"
#include "twin/loop.h"

namespace servotwin {

/// The nonlinear parameters of a mode: omega, zeta, gamma, delta.
inline constexpr int kModeShapes = 4;

/// 1/P and, behind it, a second 1/P: y = u/P and g = u/P^2 with all their derivatives below the
/// order.
template <int N>
struct FilterBank {
  static constexpr int kStates = 2 * N;
  Eigen::Matrix<double, kStates, kStates> phi;
  Eigen::Matrix<double, kStates, 3>
      command;  // input: velocity, acceleration, jerk at the start of the step
  Eigen::Matrix<double, kStates, 1> begin, end;  // input: force at both ends of the step
  std::array<double, kMaxOrder> a;

  FilterBank(const std::array<double, kMaxOrder>& denominator, double h, bool second)
      : a(denominator) {
    const int n = second ? kStates : N;
    Eigen::MatrixXd system = Eigen::MatrixXd::Zero(n, n);
    for (int block = 0; block < n / N; ++block) {
      const int o = block * N;
      for (int i = 0; i + 1 < N; ++i) system(o + i, o + i + 1) = 1.0;
      for (int i = 0; i < N; ++i)
        system(o + N - 1, o + i) = -a[static_cast<std::size_t>(N - 1 - i)];
    }
    if (second) system(kStates - 1, 0) = 1.0;
    Eigen::VectorXd input = Eigen::VectorXd::Zero(n);
    input(N - 1) = 1.0;
    const Hold hold =
        discretise(system, input, h, 2);  // its first two input columns are the first-order hold's
    phi.setZero();
    command.setZero();
    begin.setZero();
    end.setZero();
    phi.topLeftCorner(n, n) = hold.phi;
    command.topRows(n) = hold.g;
    end.head(n) = hold.g.col(1) / h;
    begin.head(n) = hold.g.col(0) - hold.g.col(1) / h;
  }

  /// s^m u / P^2 for m = 0 .. 2N - 1, from the state (Horner on P g = y).
  void derivatives(const Eigen::Matrix<double, kStates, 1>& state, double* out) const {
    for (int m = 0; m < N; ++m) out[m] = state(N + m);
    for (int m = N; m < 2 * N; ++m) {
      double value = state(m - N);
      for (int i = 1; i <= N; ++i) value -= a[static_cast<std::size_t>(i - 1)] * out[m - i];
      out[m] = value;
    }
  }
};

[[nodiscard]] inline std::array<double, kMaxOrder> denominator_of(const Mode& mode) {
  return {2.0 * mode.zeta * mode.omega, mode.omega * mode.omega, 0.0};
}

/// Deflection of a mode in equilibrium with a constant force behind an integrator; delta / (omega^2
/// P) removes it.
template <int N>
[[nodiscard]] double held(const Mode& mode, double a_last) {
  return N == 3 ? a_last / (mode.omega * mode.omega) : 0.0;
}

/// Response of the error to a force, from equilibrium with the force that acts at the start.
template <int N>
class ForceFilter {
 public:
  ForceFilter(const std::array<double, kMaxOrder>& denominator, const std::vector<Mode>& modes,
              double h, bool derivatives)
      : bank_(denominator, h, derivatives), modes_(modes) {
    for (const Mode& mode : modes) banks_.emplace_back(denominator_of(mode), h, derivatives);
  }

  [[nodiscard]] const FilterBank<N>& bank() const { return bank_; }
  [[nodiscard]] const std::vector<FilterBank<2>>& modes() const { return banks_; }

  /// `by`: its derivatives by a1..an and by omega, zeta, gamma, delta of every mode, or none.
  template <class Force, class Column, class By>
  void run(const Force& force, Column&& column, By* by) const {
    if (by != nullptr) {
      rigid<2 * N>(force, column, [&](Eigen::Index k, const auto& w) { derive(k, w, *by); });
    } else {
      rigid<N>(force, column, [](Eigen::Index, const auto&) {});
    }
    for (std::size_t i = 0; i < modes_.size(); ++i) {
      if (by != nullptr) {
        mode<4>(i, force, column, [&](Eigen::Index k, const auto& w) { derive(i, k, w, *by); });
      } else {
        mode<2>(i, force, column, [](Eigen::Index, const auto&) {});
      }
    }
  }
  template <class Force, class Column>
  void run(const Force& force, Column&& column, std::nullptr_t) const {
    run(force, column, static_cast<Eigen::MatrixXd*>(nullptr));
  }

 private:
  template <int States, class Bank, class Force, class Each>
  static void filter(const Bank& bank, double stiffness, const Force& force, const Each& each) {
    using State = Eigen::Matrix<double, States, 1>;
    const Eigen::Matrix<double, States, States> phi =
        bank.phi.template topLeftCorner<States, States>();
    const State begin = bank.begin.template head<States>(), end = bank.end.template head<States>();
    State w = State::Zero();
    w(0) = force(0) / stiffness;
    if constexpr (States == Bank::kStates) w(States / 2) = w(0) / stiffness;
    for (Eigen::Index k = 0; k < force.size(); ++k) {
      each(k, w);
      if (k + 1 < force.size()) w = (phi * w + begin * force(k) + end * force(k + 1)).eval();
    }
  }
  template <int States, class Force, class Column, class Each>
  void rigid(const Force& force, Column& column, const Each& each) const {
    const double share = disturbance_share(bank_.a, modes_);
    double gamma = 0.0, delta = 0.0;
    for (const Mode& m : modes_) gamma += m.gamma, delta += m.delta * held<N>(m, bank_.a[N - 1]);
    filter<States>(bank_, bank_.a[N - 1], force, [&](Eigen::Index k, const auto& w) {
      column(k) = share * w(N - 2) - gamma * w(N - 1) - delta * w(0);
      each(k, w);
    });
  }
  template <int States, class Force, class Column, class Each>
  void mode(std::size_t i, const Force& force, Column& column, const Each& each) const {
    const Mode& m = modes_[i];
    filter<States>(banks_[i], banks_[i].a[1], force, [&](Eigen::Index k, const auto& w) {
      column(k) += m.gamma * w(1) + m.delta * w(0);
      each(k, w);
    });
  }
  template <class State, class By>
  void derive(Eigen::Index k, const State& w, By& by) const {
    std::array<double, 2 * N> g{};  // s^m / P^2
    bank_.derivatives(w, g.data());
    const double own = disturbance_share(bank_.a, modes_);
    for (int i = 1; i <= N; ++i) {
      double sum = -own * g[static_cast<std::size_t>(2 * N - 2 - i)];
      for (const Mode& m : modes_) {
        sum += m.gamma * g[static_cast<std::size_t>(2 * N - 1 - i)] +
               m.delta * held<N>(m, bank_.a[N - 1]) * g[static_cast<std::size_t>(N - i)];
        if (i == N) sum -= m.delta * held<N>(m, 1.0) * w(0);
        if (i == 1) sum -= m.gamma * w(N - 2);
      }
      by(k, i - 1) = sum;
    }
    for (std::size_t i = 0; i < modes_.size(); ++i) {
      const double share = held<N>(modes_[i], bank_.a[N - 1]) * w(0);
      const auto at = N + kModeShapes * static_cast<Eigen::Index>(i);
      const Mode& m = modes_[i];
      by(k, at) = 2.0 * m.delta * share / m.omega + 2.0 * m.gamma * m.zeta * w(N - 2);
      by(k, at + 1) = 2.0 * m.gamma * m.omega * w(N - 2);
      by(k, at + 2) = -w(N - 1) - (bank_.a[0] - 2.0 * m.zeta * m.omega) * w(N - 2);
      by(k, at + 3) = -share - w(N - 2);
    }
  }
  template <class State, class By>
  void derive(std::size_t i, Eigen::Index k, const State& w, By& by) const {
    const Mode& m = modes_[i];
    std::array<double, 4> g{};  // s^m / M^2
    banks_[i].derivatives(w, g.data());
    const double by_damping = -(m.gamma * g[2] + m.delta * g[1]),
                 by_stiffness = -(m.gamma * g[1] + m.delta * g[0]);
    const auto at = N + kModeShapes * static_cast<Eigen::Index>(i);
    by(k, at) += 2.0 * m.zeta * by_damping + 2.0 * m.omega * by_stiffness;
    by(k, at + 1) += 2.0 * m.omega * by_damping;
    by(k, at + 2) += w(1);
    by(k, at + 3) += w(0);
  }

  FilterBank<N> bank_;
  std::vector<Mode> modes_;
  std::vector<FilterBank<2>> banks_;
};

}  // namespace servotwin
