// Block bootstrap (Efron 1979): resamples intervals of a recording that are longer than the memory
// of the loop. Any thread.
#pragma once

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

namespace servotwin {

inline constexpr int kResamples = 500;

/// Resamples every stratum kResamples times, each with as many of its own indices as it has, and
/// returns `value` of each resample of all strata, sorted.
template <class Value>
std::vector<double> bootstrap(const std::vector<std::vector<std::size_t>>& strata,
                              const Value& value) {
  std::mt19937_64 random(1);
  std::vector<double> out;
  std::vector<std::size_t> places;
  for (int i = 0; i < kResamples; ++i) {
    places.clear();
    for (const std::vector<std::size_t>& stratum : strata) {
      if (stratum.empty()) continue;
      std::uniform_int_distribution<std::size_t> any(0, stratum.size() - 1);
      for (std::size_t k = 0; k < stratum.size(); ++k) places.push_back(stratum[any(random)]);
    }
    out.push_back(value(places));
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// The same of the indices 0 .. pieces - 1 in one stratum.
template <class Value>
std::vector<double> bootstrap(std::size_t pieces, const Value& value) {
  std::vector<std::vector<std::size_t>> one(1, std::vector<std::size_t>(pieces));
  std::iota(one.front().begin(), one.front().end(), std::size_t{0});
  return bootstrap(one, value);
}

}  // namespace servotwin
