// Block bootstrap (Efron 1979): resamples intervals of a recording that are longer than the memory
// of the loop. Any thread.
#pragma once

#include <algorithm>
#include <random>
#include <vector>

namespace servotwin {

inline constexpr int kResamples = 500;

/// Resamples the indices 0 .. pieces - 1 kResamples times and returns `value` of each resample,
/// sorted.
template <class Value>
std::vector<double> bootstrap(std::size_t pieces, const Value& value) {
  std::mt19937_64 random(1);
  std::uniform_int_distribution<std::size_t> any(0, std::max<std::size_t>(pieces, 1) - 1);
  std::vector<double> out;
  std::vector<std::size_t> places(pieces);
  for (int i = 0; i < kResamples; ++i) {
    for (std::size_t& place : places) place = any(random);
    out.push_back(value(places));
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace servotwin
