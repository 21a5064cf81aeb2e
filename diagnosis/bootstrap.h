// Resampling of pieces of a recording (Efron 1979; blocks as long as the loop remembers).
#pragma once

#include <algorithm>
#include <random>
#include <vector>

namespace servotwin {

inline constexpr int kResamples = 500;

/// Resamples pieces; `value` of each sample of their places, sorted.
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
