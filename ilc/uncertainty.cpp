#include "ilc/uncertainty.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace servotwin {
namespace {

constexpr std::size_t kUncertain = 3 + kMaxOrder + 2;  // poles, numerator, delay, timing

/// Uniform in -1..1, the same on every platform (splitmix64).
class Uniform {
 public:
  double next() {
    state_ += 0x9e3779b97f4a7c15U;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-52 - 1.0;
  }

 private:
  std::uint64_t state_ = 6;
};

double known(double deviation) { return std::isfinite(deviation) ? std::abs(deviation) : 0.0; }

}  // namespace

TransferUncertainty relative_uncertainty(const Transfer& transfer, double share) {
  TransferUncertainty out;
  out.poles = labels_of(transfer.loop).set[0];
  out.poles.real *= share, out.poles.omega *= share, out.poles.zeta *= share;
  for (std::size_t i = 0; i < out.numerator.size(); ++i)
    out.numerator[i] = share * std::abs(transfer.loop.numerator[i]);
  return out;
}

std::vector<Transfer> models_within(const Transfer& transfer,
                                    const TransferUncertainty& uncertainty, int draws) {
  const PoleSet named = labels_of(transfer.loop).set[0];
  // What is off by how many bounds.
  const auto moved = [&](const std::array<double, kUncertain>& off) {
    const auto pole = [&](double value, double deviation, double share) {
      // A pole stays where it is stable, however little is known of it.
      return std::max(0.05 * value, value + share * uncertainty.deviations * known(deviation));
    };
    Transfer out = transfer;
    PoleSet set;
    set.real = pole(named.real, uncertainty.poles.real, off[0]);
    set.omega = pole(named.omega, uncertainty.poles.omega, off[1]);
    set.zeta = pole(named.zeta, uncertainty.poles.zeta, off[2]);
    out.loop.denominator = denominator_of(set, transfer.loop.order);
    for (std::size_t i = 0; i < kMaxOrder; ++i)
      out.loop.numerator[i] +=
          off[3 + i] * uncertainty.deviations * known(uncertainty.numerator[i]);
    out.delay_s += off[3 + kMaxOrder] * uncertainty.deviations * known(uncertainty.delay_s) +
                   off[4 + kMaxOrder] * known(uncertainty.timing_s);
    return out;
  };
  std::vector<Transfer> out{transfer};
  for (std::size_t i = 0; i < kUncertain; ++i) {
    for (const double side : {-1.0, 1.0}) {
      std::array<double, kUncertain> off{};
      off[i] = side;
      out.push_back(moved(off));
    }
  }
  Uniform uniform;
  for (int draw = 0; draw < draws; ++draw) {
    std::array<double, kUncertain> off{};
    for (double& value : off) value = uniform.next();
    out.push_back(moved(off));
  }
  return out;
}

}  // namespace servotwin
