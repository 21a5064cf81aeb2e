// A number with its derivatives by a few parameters: the scalar on which a twin is stepped to get
// the derivatives of its simulation (forward differentiation; docs/theory.md 5.1).
//
// The value of every operation is that of the same operation on double, to the last bit; where a
// function has a kink the derivative is that of the side which the value is on. Any thread;
// allocates nothing, throws nothing.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <type_traits>

namespace servotwin {

template <std::size_t N>
struct Dual {
  static constexpr std::size_t kLanes = N;
  using Derivatives = Eigen::Array<double, static_cast<int>(N), 1>;
  Derivatives by;
  double value;

  /// As of a double: no value, or 0 where it is initialised by {}.
  Dual() = default;
  // Not explicit: a constant is a number without derivatives.
  Dual(double constant) noexcept
      : by(Derivatives::Zero()), value(constant) {}  // NOLINT(google-explicit-constructor)

  Dual& operator+=(const Dual& r) noexcept {
    value += r.value;
    by += r.by;
    return *this;
  }
  Dual& operator-=(const Dual& r) noexcept {
    value -= r.value;
    by -= r.by;
    return *this;
  }
  Dual& operator*=(const Dual& r) noexcept { return *this = *this * r; }
  Dual& operator/=(const Dual& r) noexcept { return *this = *this / r; }

  friend Dual operator-(const Dual& x) noexcept { return scaled(x, -x.value, -1.0); }
  friend Dual operator+(const Dual& l, const Dual& r) noexcept {
    Dual out;
    out.value = l.value + r.value;
    out.by = l.by + r.by;
    return out;
  }
  friend Dual operator-(const Dual& l, const Dual& r) noexcept {
    Dual out;
    out.value = l.value - r.value;
    out.by = l.by - r.by;
    return out;
  }
  friend Dual operator*(const Dual& l, const Dual& r) noexcept {
    Dual out;
    out.value = l.value * r.value;
    out.by = l.by * r.value + l.value * r.by;
    return out;
  }
  friend Dual operator/(const Dual& l, const Dual& r) noexcept {
    Dual out;
    out.value = l.value / r.value;
    const double factor = 1.0 / r.value;
    out.by = (l.by - out.value * r.by) * factor;
    return out;
  }
  // With a constant, which has no derivatives to multiply.
  friend Dual operator+(Dual l, double r) noexcept { return l.value += r, l; }
  friend Dual operator+(double l, Dual r) noexcept { return r.value = l + r.value, r; }
  friend Dual operator-(Dual l, double r) noexcept { return l.value -= r, l; }
  friend Dual operator-(double l, const Dual& r) noexcept { return scaled(r, l - r.value, -1.0); }
  friend Dual operator*(const Dual& l, double r) noexcept { return scaled(l, l.value * r, r); }
  friend Dual operator*(double l, const Dual& r) noexcept { return scaled(r, l * r.value, l); }
  friend Dual operator/(const Dual& l, double r) noexcept {
    return scaled(l, l.value / r, 1.0 / r);
  }

  friend bool operator<(const Dual& l, const Dual& r) noexcept { return l.value < r.value; }
  friend bool operator>(const Dual& l, const Dual& r) noexcept { return l.value > r.value; }
  friend bool operator<=(const Dual& l, const Dual& r) noexcept { return l.value <= r.value; }
  friend bool operator>=(const Dual& l, const Dual& r) noexcept { return l.value >= r.value; }
  friend bool operator==(const Dual& l, const Dual& r) noexcept { return l.value == r.value; }
  friend bool operator!=(const Dual& l, const Dual& r) noexcept { return l.value != r.value; }

  friend Dual abs(const Dual& x) noexcept {
    return scaled(x, std::abs(x.value), x.value < 0.0 ? -1.0 : 1.0);
  }
  friend Dual exp(const Dual& x) noexcept {
    const double e = std::exp(x.value);
    return scaled(x, e, e);
  }
  friend Dual log(const Dual& x) noexcept { return scaled(x, std::log(x.value), 1.0 / x.value); }
  friend Dual sqrt(const Dual& x) noexcept {
    const double root = std::sqrt(x.value);
    return scaled(x, root, 0.5 / root);
  }
  friend Dual sin(const Dual& x) noexcept {
    return scaled(x, std::sin(x.value), std::cos(x.value));
  }
  friend Dual cos(const Dual& x) noexcept {
    return scaled(x, std::cos(x.value), -std::sin(x.value));
  }
  friend Dual tanh(const Dual& x) noexcept {
    const double t = std::tanh(x.value);
    return scaled(x, t, 1.0 - t * t);
  }
  /// For a positive base.
  friend Dual pow(const Dual& base, const Dual& exponent) noexcept {
    Dual out;
    out.value = std::pow(base.value, exponent.value);
    const double by_base = exponent.value * out.value / base.value,
                 by_exponent = out.value * std::log(base.value);
    out.by = by_base * base.by + by_exponent * exponent.by;
    return out;
  }

 private:
  /// f(x) from f and its derivative there.
  static Dual scaled(const Dual& x, double value, double slope) noexcept {
    Dual out;
    out.value = value;
    out.by = slope * x.by;
    return out;
  }
};

template <class S>
inline constexpr bool is_dual = false;
template <std::size_t N>
inline constexpr bool is_dual<Dual<N>> = true;

[[nodiscard]] inline double value_of(double x) noexcept { return x; }
template <std::size_t N>
[[nodiscard]] double value_of(const Dual<N>& x) noexcept {
  return x.value;
}

/// sum += constant * x, where only the first derivatives of both may not be 0: so many of the
/// constant, and so many of x.
inline void add_product(double& sum, double constant, double x, std::size_t /*of_constant*/,
                        std::size_t /*of_x*/) noexcept {
  sum += constant * x;
}
template <std::size_t N>
void add_product(Dual<N>& sum, const Dual<N>& constant, const Dual<N>& x, std::size_t of_constant,
                 std::size_t of_x) noexcept {
  sum.value += constant.value * x.value;
  if (of_x == N) {
    sum.by += constant.value * x.by;
  } else {
    for (std::size_t i = 0; i < of_x; ++i)
      sum.by(static_cast<Eigen::Index>(i)) += constant.value * x.by(static_cast<Eigen::Index>(i));
  }
  for (std::size_t i = 0; i < of_constant; ++i) sum.by[i] += constant.by[i] * x.value;
}
/// How many of the first derivatives of x may not be 0, if it were `before` of others.
inline std::size_t lanes_with(double /*x*/, std::size_t before) noexcept { return before; }
template <std::size_t N>
[[nodiscard]] std::size_t lanes_with(const Dual<N>& x, std::size_t before) noexcept {
  for (std::size_t i = N; i > before; --i) {
    if (x.by[i - 1] != 0.0) return i;
  }
  return before;
}

/// What one pass over a simulation gives: the derivatives by so many parameters, and within a step
/// those by the forces that are solved for there (on motor, load and play).
inline constexpr std::size_t kParametersPerPass = 13, kForcesPerStep = 3;
using TwinDual = Dual<kParametersPerPass + kForcesPerStep>;

}  // namespace servotwin
