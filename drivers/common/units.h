// Units of files and options: the text in brackets, and its factor to SI.
//
//   s ms us ns | m mm um nm in | rad deg rev | N kN Nm A V % | m/s mm/min deg/s rpm ...
//   (velocities)
// A number may scale a unit, for files in counts: [rev/8192], [um*0.1]. A negative one turns a
// channel that counts backwards: [deg*-1].
// Any thread; errors: none, an unknown unit is an empty optional.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace servotwin {

/// kTorque stands for any quantity that drives the axis: force, torque, current, voltage or percent
/// of the rated value.
enum class Quantity { kTime, kLength, kAngle, kVelocity, kAngularVelocity, kTorque };

struct Unit {
  Quantity quantity = Quantity::kTime;
  // A decimal unit divides by a power of ten, which rounds once; multiplying by 0.001 rounds twice.
  double multiply = 1.0;
  double divide = 1.0;
  std::string si;  ///< the name of the unit after to_si

  [[nodiscard]] double to_si(double value) const noexcept { return value * multiply / divide; }
};

/// The units that parse_unit accepts, for error messages.
inline constexpr std::string_view kKnownUnits =
    "s ms us ns, m mm um nm in, rad deg rev, N kN Nm A V %";

[[nodiscard]] std::optional<Unit> parse_unit(std::string_view text);

}  // namespace servotwin
