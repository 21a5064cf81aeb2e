// What follows something with two poles: a mass on a spring, the loop of another axis.
//
//   q'' + 2 zeta w q' + w^2 q = w^2 rest
//
// By exact steps with `rest` held over each.
#pragma once

#include <cmath>
#include <numbers>

namespace servotwin {

/// q and its rate.
template <class T>
struct Swing {
  T q = T(0.0), rate = T(0.0);
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
    damped_ = w * sqrt(1.0 - zeta_ * zeta_);
    fade_ = exp(-zeta_ * w * step_s);
    sine_ = sin(damped_ * step_s);
    cosine_ = cos(damped_ * step_s);
  }

  void advance(Swing<T>& swing, const T& rest) const {
    const T q = swing.q - rest;  // about where it would rest
    const T along = (swing.rate + zeta_ * w * q) / damped_;
    swing.q = rest + fade_ * (q * cosine_ + along * sine_);
    swing.rate = fade_ * (swing.rate * cosine_ -
                          (w * q * w / damped_ + zeta_ * w * swing.rate / damped_) * sine_);
  }

  const T w;  ///< angular frequency, undamped [1/s]

 private:
  T zeta_, damped_, fade_, sine_, cosine_;
};

}  // namespace servotwin
