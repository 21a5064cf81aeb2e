// The response of a system with two poles: a mass on a spring, the loop of another axis.
//
//   q'' + 2 zeta w q' + w^2 q = w^2 rest
//
// Stepped exactly with `rest` held over the step, for any damping. Any thread; allocates nothing,
// throws nothing.
#pragma once

#include <cmath>
#include <numbers>

namespace servotwin {

/// q and its derivative.
template <class T>
struct Swing {
  T q = T(0.0), rate = T(0.0);
  template <class F>
  void each(const F& f) {
    f(q);
    f(rate);
  }
};

template <class T>
class SwingStep {
 public:
  SwingStep(const T& frequency_hz, const T& damping_ratio, double step_s)
      : w(2.0 * std::numbers::pi * frequency_hz), zeta_(damping_ratio) {
    using std::cos;
    using std::exp;
    using std::sin;
    using std::sqrt;
    const T turned = w * w * (1.0 - zeta_ * zeta_) * step_s * step_s, faded = zeta_ * w * step_s;
    if (turned > kMaxSquaredAngleOfSeries_rad2) {
      const T angle = sqrt(turned);
      cosine_ = exp(-faded) * cos(angle);
      sine_ = exp(-faded) * sin(angle) / angle * step_s;
    } else if (turned < -kMaxSquaredAngleOfSeries_rad2) {
      const T apart = sqrt(-turned), slow = exp(apart - faded), fast = exp(-apart - faded);
      cosine_ = 0.5 * (slow + fast);
      sine_ = 0.5 * (slow - fast) / apart * step_s;
    } else {  // both are smooth in `turned`
      cosine_ = exp(-faded) * (1.0 - turned / 2.0 * (1.0 - turned / 12.0));
      sine_ = exp(-faded) * (1.0 - turned / 6.0 * (1.0 - turned / 20.0)) * step_s;
    }
  }

  void advance(Swing<T>& swing, const T& rest) const {
    const T q = swing.q - rest;  // deviation from rest
    const T drag = zeta_ * w;
    swing.q = rest + q * cosine_ + (swing.rate + drag * q) * sine_;
    swing.rate = swing.rate * cosine_ - (w * w * q + drag * swing.rate) * sine_;
  }

  const T w;  ///< angular frequency, undamped [1/s]

 private:
  static constexpr double kMaxSquaredAngleOfSeries_rad2 =
      1e-4;  // truncation error of the series below 1e-14
  T zeta_;
  T cosine_, sine_;  // e^(-zeta w h) cos(wd h), e^(-zeta w h) sin(wd h) / wd
};

}  // namespace servotwin
