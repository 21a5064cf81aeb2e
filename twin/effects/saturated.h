// The sign of a velocity, saturated: friction is fully developed from a limit velocity on.
//
// Any thread; allocates nothing, throws nothing.
#pragma once

namespace servotwin {

/// min(1, max(-1, velocity / limit))
template <class V, class T>
T saturated(const V& velocity, const T& limit) noexcept {
  const T q = velocity / limit;
  return q > 1.0 ? T(1.0) : (q < -1.0 ? T(-1.0) : q);
}

}  // namespace servotwin
