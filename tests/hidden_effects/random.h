// Random numbers that are the same on every platform and with every standard library.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>

namespace servotwin::hidden_effects {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double between(double low, double high) { return low + (high - low) * uniform(); }
  /// Spread evenly in the logarithm; 0 < low <= high.
  double log_between(double low, double high) {
    return std::exp(between(std::log(low), std::log(high)));
  }
  /// 0 .. count - 1
  int below(int count) { return static_cast<int>(uniform() * count); }
  bool chance(double probability) { return uniform() < probability; }
  double sign() { return chance(0.5) ? 1.0 : -1.0; }
  /// Unit normal as the sum of twelve uniform numbers.
  double normal() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += uniform();
    return sum;
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace servotwin::hidden_effects
