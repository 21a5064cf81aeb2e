#include "identification/least_squares/unit_columns.h"

#include <ceres/jet.h>

#include <algorithm>
#include <array>

#include "twin/catalogue_steps.h"

namespace servotwin {

// Few effects have more shapes than lanes: those take several passes, and the others half the time
// of a number that has lanes for all shapes.
constexpr std::size_t kLanes = 4;
using Jet = ceres::Jet<double, static_cast<int>(kLanes)>;
template void start_memory<Jet>(std::size_t, const Jet*, EffectMemory<Jet>&) noexcept;
template void unit_forces<Jet, double>(std::size_t, const Jet*, EffectMemory<Jet>&, const Motion&,
                                       Jet*) noexcept;

UnitColumns unit_columns(std::size_t kind, const double* shapes, std::span<const Motion> motion,
                         bool derivatives) {
  const auto n = static_cast<Eigen::Index>(motion.size());
  const std::size_t coefficients = coefficients_of(kind).size(),
                    shape_count = shapes_of(kind).size();
  UnitColumns out;
  out.force.resize(n, static_cast<Eigen::Index>(coefficients));
  if (!derivatives || shape_count == 0) {
    EffectMemory<double> memory;
    start_memory<double>(kind, shapes, memory);
    std::array<double, kMaxCoefficients> force{};
    for (Eigen::Index k = 0; k < n; ++k) {
      unit_forces<double>(kind, shapes, memory, motion[static_cast<std::size_t>(k)], force.data());
      for (std::size_t c = 0; c < coefficients; ++c)
        out.force(k, static_cast<Eigen::Index>(c)) = force[c];
    }
    return out;
  }
  out.by_shape.assign(shape_count, out.force);
  for (std::size_t first = 0; first < shape_count; first += kLanes) {
    const std::size_t end = std::min(first + kLanes, shape_count);
    std::array<Jet, kMaxShapes> shape{};
    for (std::size_t p = 0; p < shape_count; ++p) {
      shape[p] =
          p >= first && p < end ? Jet(shapes[p], static_cast<int>(p - first)) : Jet(shapes[p]);
    }
    EffectMemory<Jet> memory;
    start_memory<Jet>(kind, shape.data(), memory);
    std::array<Jet, kMaxCoefficients> force{};
    for (Eigen::Index k = 0; k < n; ++k) {
      unit_forces<Jet>(kind, shape.data(), memory, motion[static_cast<std::size_t>(k)],
                       force.data());
      for (std::size_t c = 0; c < coefficients; ++c) {
        const auto column = static_cast<Eigen::Index>(c);
        out.force(k, column) = force[c].a;
        for (std::size_t p = first; p < end; ++p)
          out.by_shape[p](k, column) = force[c].v(static_cast<Eigen::Index>(p - first));
      }
    }
  }
  return out;
}

}  // namespace servotwin
