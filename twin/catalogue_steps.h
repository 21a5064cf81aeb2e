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

template <class T>
void unit_forces(std::size_t kind, const T* shape, EffectMemory<T>& memory, const Motion& m,
                 T* force) noexcept {
  visit_effect(kind, [&]<class E, std::size_t I>() {
    E::template unit_forces<T>(shape, *std::get_if<I>(&memory), m, force);
  });
}

}  // namespace servotwin
