// Starts of friction with free elements (twin/effects/maxwell_slip.h) from a law that was fitted
// before: virgin curves over the travel after which that law slides.
//
// Units: SI, rad for m on rotary axes. Any thread. Errors: none.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "twin/catalogue.h"
#include "twin/virgin_curve.h"

namespace servotwin {

/// Shape factors of the starts (twin/virgin_curve.h), from nearly straight to steep. One start is
/// not enough: from it the fit may end with an element that no motion needs (measurements 20).
inline constexpr std::array kFormsOfFreeElements{0.3, 0.6, 0.85};

/// Its shapes, and levels that sum to 1.
struct FreeElements {
  std::array<double, MaxwellSlip::kElements> shapes{}, levels{};
};

/// The travel after which the law with these shapes slides; that of the catalogue, where it does
/// not say one.
[[nodiscard]] inline double sliding_travel(std::size_t law, const double* shapes) {
  constexpr double kTravelOverDeflection = 4.0;  // Dahl and LuGre are at 98 % there
  if (law == kind_of<Dahl>() || law == kind_of<LuGre>()) return kTravelOverDeflection * shapes[0];
  const bool is_free = law == kind_of<MaxwellSlip>();
  if (!is_free && shapes_of(law).front().unit == "m") return shapes[0];
  double travel = 1.0;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(kind_of<MaxwellSlip>()))
    travel *= is_free ? shapes[i++] : p.start;
  return travel;
}

/// `law`: the one before, with these shapes.
[[nodiscard]] inline FreeElements free_elements(std::size_t law, const double* shapes,
                                                double form) {
  const auto elements = reduced_elements<MaxwellSlip::kElements>(sliding_travel(law, shapes), form);
  FreeElements out;
  double displacement = 1.0;  // of the element before, as the shapes say it
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(kind_of<MaxwellSlip>())) {
    const double wanted = elements.level[i] / elements.stiffness[i] / displacement;
    // The first one may be larger on a rotary axis, whose bounds are stretched.
    out.shapes[i] = i == 0 ? std::max(wanted, p.lower) : std::clamp(wanted, p.lower, p.upper);
    out.levels[i] = elements.level[i];
    displacement *= out.shapes[i];
    ++i;
  }
  return out;
}

}  // namespace servotwin
