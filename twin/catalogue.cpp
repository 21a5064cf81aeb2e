#include "twin/catalogue.h"

#include "twin/catalogue_steps.h"

namespace servotwin {

template void start_memory<double>(std::size_t, const double*, EffectMemory<double>&) noexcept;
template void copy_memory<double>(std::size_t, const EffectMemory<double>&,
                                  EffectMemory<double>&) noexcept;
template void unit_forces<double, double>(std::size_t, const double*, EffectMemory<double>&,
                                          const Motion&, double*) noexcept;

template void start_memory<TwinDual>(std::size_t, const TwinDual*,
                                     EffectMemory<TwinDual>&) noexcept;
template void copy_memory<TwinDual>(std::size_t, const EffectMemory<TwinDual>&,
                                    EffectMemory<TwinDual>&) noexcept;
template void unit_forces<TwinDual, TwinDual>(std::size_t, const TwinDual*, EffectMemory<TwinDual>&,
                                              const MotionOf<TwinDual>&, TwinDual*) noexcept;

}  // namespace servotwin
