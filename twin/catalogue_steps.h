// The steps of all effects of the catalogue: what twin/catalogue.h declares. Every scalar for which
// they are compiled takes its minute of the build, so that only the files named there include this.
#pragma once

#include "twin/catalogue.h"

namespace servotwin {

template <class T>
void start_memory(std::size_t kind, const T* shape, EffectMemory<T>& memory) noexcept {
  // Not emplace(): a static checker would assume that it throws.
  visit_effect(kind, [&]<class E, std::size_t I>() {
    memory = EffectMemory<T>(std::in_place_index<I>, shape);
  });
}

template <class T>
void copy_memory(std::size_t kind, const EffectMemory<T>& from, EffectMemory<T>& to) noexcept {
  visit_effect(kind,
               [&]<class E, std::size_t I>() { *std::get_if<I>(&to) = *std::get_if<I>(&from); });
}

template <class T, class M>
void unit_forces(std::size_t kind, const T* shape, EffectMemory<T>& memory, const MotionOf<M>& m,
                 T* force) noexcept {
  visit_effect(kind, [&]<class E, std::size_t I>() {
    E::template unit_forces<T, M>(shape, *std::get_if<I>(&memory), m, force);
  });
}

/// f(value) for every value of the memory that a step changes.
template <class T, class F>
void each_value(std::size_t kind, EffectMemory<T>& memory, const F& f) noexcept {
  visit_effect(kind, [&]<class E, std::size_t I>() {
    if constexpr (!std::is_same_v<typename E::template Memory<T>, NoMemory>)
      std::get_if<I>(&memory)->each(f);
  });
}

}  // namespace servotwin
