// The sign of a velocity as friction has it, fully developed from a limit on.
#pragma once

namespace servotwin {

/// min(1, max(-1, velocity / limit))
template <class V, class T>
T saturated(const V& velocity, const T& limit) noexcept {
  const T q = velocity / limit;
  return q > 1.0 ? T(1.0) : (q < -1.0 ? T(-1.0) : q);
}

}  // namespace servotwin
