// Exact discretisation of a small system (twin/hold.h) whose matrices are of any scalar, with the
// derivatives of the result. Allocates; any thread.
#pragma once

#include <array>
#include <cstddef>

#include "twin/dual.h"
#include "twin/hold.h"

namespace servotwin {

template <class S, std::size_t N>
using SquareOf = std::array<std::array<S, N>, N>;

/// Of the first states; `g` as in Hold.
template <class S, std::size_t N>
struct HoldOf {
  SquareOf<S, N> phi{};
  std::array<std::array<S, 3>, N> g{};
};

/// Of the first `count` states of w' = a w + b u. `discretised(a, b)` and `derivative(a, b, da,
/// db)` give Holds.
template <class S, std::size_t N, class Discretised, class Derivative>
[[nodiscard]] HoldOf<S, N> hold_of(int count, const SquareOf<S, N>& a, const std::array<S, N>& b,
                                   const Discretised& discretised, const Derivative& derivative) {
  // `part` is the value of an entry, or one of its derivatives.
  const auto matrix = [&](const auto& part) {
    Eigen::MatrixXd out(count, count);
    for (int r = 0; r < count; ++r) {
      for (int c = 0; c < count; ++c)
        out(r, c) = part(a[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)]);
    }
    return out;
  };
  const auto vector = [&](const auto& part) {
    Eigen::VectorXd out(count);
    for (int r = 0; r < count; ++r) out(r) = part(b[static_cast<std::size_t>(r)]);
    return out;
  };
  HoldOf<S, N> out;
  const auto keep = [&](const Hold& hold, const auto& set) {
    for (int r = 0; r < count; ++r) {
      const auto row = static_cast<std::size_t>(r);
      for (int c = 0; c < count; ++c)
        set(out.phi[row][static_cast<std::size_t>(c)], hold.phi(r, c));
      for (int k = 0; k < hold.g.cols(); ++k)
        set(out.g[row][static_cast<std::size_t>(k)], hold.g(r, k));
    }
  };
  const auto value = [](const S& x) { return value_of(x); };
  const Eigen::MatrixXd at = matrix(value);
  const Eigen::VectorXd input = vector(value);
  keep(discretised(at, input), [](S& entry, double x) { entry = x; });
  if constexpr (is_dual<S>) {
    for (std::size_t lane = 0; lane < S::kLanes; ++lane) {
      const auto rate = [lane](const S& x) { return x.by[lane]; };
      const Eigen::MatrixXd da = matrix(rate);
      const Eigen::VectorXd db = vector(rate);
      if (da.isZero(0.0) && db.isZero(0.0)) continue;
      keep(derivative(at, input, da, db), [lane](S& entry, double x) { entry.by[lane] = x; });
    }
  }
  return out;
}

}  // namespace servotwin
