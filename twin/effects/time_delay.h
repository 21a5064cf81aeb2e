// The feedback record lags the command record: transport, buffering, time stamps of two clocks.
//
//   the loop responds to x_r(t - delay), while e is taken against x_r(t)
//
// A delay has linear phase at all frequencies. A missing feed-forward or a low gain looks the same
// at low frequency (e = delay * v); accelerated motion separates them. Source: docs/theory.md 3.4.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct TimeDelay {
  static constexpr Identity kIdentity{
      .id = "time_delay",
      .meaning = "delay of the recorded encoder against the recorded command",
      .acts = Acts::kCommandDelay,
      .cause = "time_delay",
      .check = "recording method; cycles and filters between command and encoder"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"delay_s", "s", 0.0, 0.05, 0.0, "delay of the recorded encoder"}}};
  static constexpr std::array<Parameter, 0> kCoefficients{};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& /*m*/,
                          T* /*force*/) noexcept {}
};

}  // namespace servotwin
