// Files and variables of the library for MATLAB files, closed and freed with their owner.
#pragma once

#include <matio.h>

#include <memory>

namespace servotwin {

using MatFile = std::unique_ptr<mat_t, decltype([](mat_t* file) { Mat_Close(file); })>;
using MatVariableHandle =
    std::unique_ptr<matvar_t, decltype([](matvar_t* variable) { Mat_VarFree(variable); })>;

}  // namespace servotwin
