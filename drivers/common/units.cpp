#include "drivers/common/units.h"

#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

namespace servotwin {
namespace {

struct KnownUnit {
  std::string_view name;
  Quantity quantity;
  double multiply;
  double divide;
  std::string_view si;
};

constexpr double kPi = std::numbers::pi;
constexpr std::array kUnits{
    KnownUnit{"s", Quantity::kTime, 1, 1, "s"},
    KnownUnit{"ms", Quantity::kTime, 1, 1e3, "s"},
    KnownUnit{"us", Quantity::kTime, 1, 1e6, "s"},
    KnownUnit{"\u00b5s", Quantity::kTime, 1, 1e6, "s"},
    KnownUnit{"ns", Quantity::kTime, 1, 1e9, "s"},
    KnownUnit{"m", Quantity::kLength, 1, 1, "m"},
    KnownUnit{"mm", Quantity::kLength, 1, 1e3, "m"},
    KnownUnit{"um", Quantity::kLength, 1, 1e6, "m"},
    KnownUnit{"\u00b5m", Quantity::kLength, 1, 1e6, "m"},
    KnownUnit{"nm", Quantity::kLength, 1, 1e9, "m"},
    KnownUnit{"in", Quantity::kLength, 254, 1e4, "m"},
    KnownUnit{"inch", Quantity::kLength, 254, 1e4, "m"},
    KnownUnit{"rad", Quantity::kAngle, 1, 1, "rad"},
    KnownUnit{"deg", Quantity::kAngle, kPi, 180, "rad"},
    KnownUnit{"rev", Quantity::kAngle, 2 * kPi, 1, "rad"},
    KnownUnit{"rpm", Quantity::kAngularVelocity, 2 * kPi, 60, "rad/s"},
    KnownUnit{"N", Quantity::kTorque, 1, 1, "N"},
    KnownUnit{"kN", Quantity::kTorque, 1e3, 1, "N"},
    KnownUnit{"Nm", Quantity::kTorque, 1, 1, "Nm"},
    KnownUnit{"A", Quantity::kTorque, 1, 1, "A"},
    KnownUnit{"V", Quantity::kTorque, 1, 1, "V"},
    KnownUnit{"%", Quantity::kTorque, 1, 1, "%"},
};

std::optional<Unit> known_unit(std::string_view name) {
  for (const KnownUnit& unit : kUnits) {
    if (unit.name == name) {
      return Unit{unit.quantity, unit.multiply, unit.divide, std::string(unit.si)};
    }
  }
  return std::nullopt;
}

// A scale of a unit: finite and not 0. A negative one reads what counts backwards.
std::optional<double> scale(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && std::isfinite(value) && value != 0.0 ? std::optional(value) : std::nullopt;
}

}  // namespace

std::optional<Unit> parse_unit(std::string_view text) {
  const std::size_t at = text.find_first_of("*/");
  auto unit = known_unit(text.substr(0, at));
  if (!unit || at == std::string_view::npos) return unit;

  const std::string_view right = text.substr(at + 1);
  const bool per = text[at] == '/';
  if (const auto factor = scale(right)) {
    if (unit->quantity == Quantity::kTime && *factor < 0.0) return std::nullopt;
    (per ? unit->divide : unit->multiply) *= *factor;
    return unit;
  }
  const bool position = unit->quantity == Quantity::kLength || unit->quantity == Quantity::kAngle;
  if (!per || !position || (right != "s" && right != "min")) return std::nullopt;
  unit->quantity =
      unit->quantity == Quantity::kLength ? Quantity::kVelocity : Quantity::kAngularVelocity;
  unit->divide *= right == "min" ? 60.0 : 1.0;
  unit->si += "/s";
  return unit;
}

}  // namespace servotwin
