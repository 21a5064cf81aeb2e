// The direction of friction as an elastic-plastic contact has it: it turns over a travel.
#pragma once

namespace servotwin {

/// What a contact remembers: its deflection [m | rad].
template <class T>
struct Sliding {
  T deflection = T(0.0);

  /// From -1 to 1: how far the contact is taken along after this displacement.
  T direction(double displacement, const T& breakaway) noexcept {
    deflection += displacement;
    if (deflection > breakaway) deflection = breakaway;
    if (deflection < -breakaway) deflection = -breakaway;
    return deflection / breakaway;
  }
};

}  // namespace servotwin
