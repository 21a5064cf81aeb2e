#include "twin/low_pass.h"

#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>
#include <string>

namespace servotwin {

namespace {

using Complex = std::complex<double>;

void require(int order, double cutoff) {
  if (order < 2 || order % 2 != 0)
    throw std::invalid_argument("low-pass order " + std::to_string(order) + " must be even");
  if (!(cutoff > 0.0 && cutoff < 0.5)) {
    throw std::invalid_argument("low-pass cutoff " + std::to_string(cutoff) +
                                " of the sampling rate must be within (0, 0.5)");
  }
}

/// The pole pair of section k of a unit-frequency prototype lies at (-x sin, y cos) of these
/// angles.
LowPass from_ellipse(int order, double cutoff, double x, double y) {
  const double warped = 2.0 * std::tan(std::numbers::pi * cutoff);
  LowPass out;
  for (int k = 0; k < order / 2; ++k) {
    const double angle = std::numbers::pi * (2.0 * k + 1.0) / (2.0 * order);
    const Complex s = warped * Complex(-x * std::sin(angle), y * std::cos(angle));
    const Complex z = (2.0 + s) / (2.0 - s);
    out.push_back({-2.0 * z.real(), std::norm(z)});
  }
  return out;
}

/// `Count` sections one behind the other. Each waits for its own last value; side by side, the
/// processor works on all of them in that time.
template <std::size_t Count>
void run_together(const FilterSection* sections, Eigen::ArrayXd& x) {
  struct State {
    double gain, a1, a2, first, second;
  };
  std::array<State, Count> states;
  double at_rest = x(0);
  for (std::size_t i = 0; i < Count; ++i) {
    const auto [a1, a2] = sections[i];
    const double gain = (1.0 + a1 + a2) / 4.0;
    // At rest on the first sample.
    states[i] = {gain, a1, a2, at_rest * (1.0 - gain), at_rest * (gain - a2)};
    at_rest = gain * at_rest + states[i].first;  // the same, but for rounding
  }
  for (double& value : x) {
#pragma GCC unroll 4
    for (State& s : states) {
      const double u = s.gain * value;
      const double y = u + s.first;
      s.first = 2.0 * u - s.a1 * y + s.second;
      s.second = u - s.a2 * y;
      value = y;
    }
  }
}

void run(const LowPass& filter, Eigen::ArrayXd& x) {
  constexpr std::size_t kTogether = 4;  // their eight remembered values fit into registers
  std::size_t done = 0;
  for (; done + kTogether <= filter.size(); done += kTogether)
    run_together<kTogether>(&filter[done], x);
  for (; done + 2 <= filter.size(); done += 2) run_together<2>(&filter[done], x);
  for (; done < filter.size(); ++done) run_together<1>(&filter[done], x);
}

}  // namespace

LowPass butterworth(int order, double cutoff) {
  require(order, cutoff);
  return from_ellipse(order, cutoff, 1.0, 1.0);
}

LowPass chebyshev(int order, double ripple_db, double cutoff) {
  require(order, cutoff);
  if (!(ripple_db > 0.0))
    throw std::invalid_argument("low-pass ripple " + std::to_string(ripple_db) +
                                " dB must be positive");
  const double width = std::asinh(1.0 / std::sqrt(std::pow(10.0, ripple_db / 10.0) - 1.0)) / order;
  return from_ellipse(order, cutoff, std::sinh(width), std::cosh(width));
}

Eigen::ArrayXd zero_phase(const LowPass& filter, const Eigen::ArrayXd& x) {
  const Eigen::Index n = x.size();
  const Eigen::Index pad = 6 * static_cast<Eigen::Index>(filter.size());
  if (n <= pad) {
    throw std::invalid_argument("low-pass: " + std::to_string(n) + " samples, needs more than " +
                                std::to_string(pad));
  }
  Eigen::ArrayXd longer(n + 2 * pad);
  longer.head(pad) = 2.0 * x(0) - x.segment(1, pad).reverse();
  longer.segment(pad, n) = x;
  longer.tail(pad) = 2.0 * x(n - 1) - x.segment(n - 1 - pad, pad).reverse();
  for (int pass = 0; pass < 2; ++pass) {
    run(filter, longer);
    longer.reverseInPlace();
  }
  return longer.segment(pad, n);
}

}  // namespace servotwin
