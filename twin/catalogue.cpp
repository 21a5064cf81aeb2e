#include "twin/catalogue.h"

#include "twin/catalogue_steps.h"

namespace servotwin {

template void start_memory<double>(std::size_t, const double*, EffectMemory<double>&) noexcept;
template void copy_memory<double>(std::size_t, const EffectMemory<double>&,
                                  EffectMemory<double>&) noexcept;
template void unit_forces<double>(std::size_t, const double*, EffectMemory<double>&, const Motion&,
                                  double*) noexcept;

}  // namespace servotwin
