#include "ilc/uncertainty.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unsupported/Eigen/FFT>

namespace servotwin {
namespace {

constexpr Eigen::Index kUncertain = 3 + kMaxOrder + 1;  // poles, numerator, delay
using Theta = Eigen::Matrix<double, kUncertain, 1>;
using Information = Eigen::Matrix<double, kUncertain, kUncertain>;

constexpr double kBinRatio = 1.05;    // of the spectrum's groups of frequencies
constexpr double kDifference = 1e-4;  // relative, of the derivatives
constexpr double kLeastPole = 0.05;   // a pole stays stable, however little is known of it

/// Normal, the same on every platform (splitmix64; Box and Muller).
class Normal {
 public:
  double next() {
    const double radius = std::sqrt(-2.0 * std::log(uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * uniform());
  }

 private:
  double uniform() {
    state_ += 0x9e3779b97f4a7c15U;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return (static_cast<double>((z ^ (z >> 31)) >> 11) + 0.5) * 0x1p-53;
  }
  std::uint64_t state_ = 6;
};

double known(double deviation) { return std::isfinite(deviation) ? std::abs(deviation) : 0.0; }

/// The model with its values moved.
Transfer moved(const Transfer& transfer, const PoleSet& named, const Theta& by) {
  const auto pole = [](double value, double change) {
    return std::max(kLeastPole * value, value + change);
  };
  Transfer out = transfer;
  const PoleSet set{pole(named.real, by(0)), pole(named.omega, by(1)), pole(named.zeta, by(2))};
  out.loop.denominator = denominator_of(set, transfer.loop.order);
  for (std::size_t i = 0; i < kMaxOrder; ++i)
    out.loop.numerator[i] += by(3 + static_cast<Eigen::Index>(i));
  out.delay_s += by(3 + kMaxOrder);
  return out;
}

/// S G S / missed^2
Information seen_information(const Transfer& transfer, const PoleSet& named, const Theta& deviation,
                             const SeenOfModel& seen) {
  Information out = Information::Zero();
  std::array<std::pair<Transfer, Transfer>, kUncertain> sides;
  Theta step = Theta::Zero();
  const std::array<double, kUncertain> size{named.real,
                                            named.omega,
                                            named.zeta,
                                            transfer.loop.numerator[0],
                                            transfer.loop.numerator[1],
                                            transfer.loop.numerator[2],
                                            transfer.lag_s()};
  for (Eigen::Index p = 0; p < kUncertain; ++p) {
    if (deviation(p) == 0.0) continue;
    step(p) = kDifference * std::max(std::abs(size[static_cast<std::size_t>(p)]), deviation(p));
    Theta by = Theta::Zero();
    by(p) = step(p);
    sides[static_cast<std::size_t>(p)] = {moved(transfer, named, by), moved(transfer, named, -by)};
  }
  Eigen::Matrix<std::complex<double>, kUncertain, 1> change;
  for (Eigen::Index k = 0; k < seen.omega.size(); ++k) {
    const double omega = seen.omega(k);
    for (Eigen::Index p = 0; p < kUncertain; ++p) {
      const auto& [more, less] = sides[static_cast<std::size_t>(p)];
      change(p) = deviation(p) == 0.0
                      ? 0.0
                      : deviation(p) * (more.at(omega) - less.at(omega)) / (2.0 * step(p) * omega);
    }
    out += seen.weight(k) * (change.conjugate() * change.transpose()).real();
  }
  return out / (seen.missed_rms * seen.missed_rms);
}

}  // namespace

SeenOfModel seen_of_model(const Eigen::ArrayXd& command, double h, double missed_rms) {
  const Eigen::Index n = command.size();
  Eigen::Index padded = 4;
  while (padded < 2 * n) padded *= 2;
  std::vector<double> velocity(static_cast<std::size_t>(padded), 0.0);
  for (Eigen::Index k = 1; k < n; ++k)
    velocity[static_cast<std::size_t>(k)] = (command(k) - command(k - 1)) / h;
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<std::complex<double>> spectrum;
  fft.fwd(spectrum, velocity);
  const double unit = 2.0 * std::numbers::pi / (h * static_cast<double>(padded));
  std::vector<double> omega, weight;
  for (std::size_t k = 1, end = 1; k < spectrum.size(); k = end) {
    end = std::max(k + 1, static_cast<std::size_t>(kBinRatio * static_cast<double>(k)));
    double sum = 0.0;
    for (std::size_t i = k; i < std::min(end, spectrum.size()); ++i) sum += std::norm(spectrum[i]);
    omega.push_back(unit * 0.5 * static_cast<double>(k + end - 1));
    weight.push_back(2.0 * sum / (static_cast<double>(padded) * static_cast<double>(n)));
  }
  const auto size = static_cast<Eigen::Index>(omega.size());
  return {Eigen::Map<const Eigen::ArrayXd>(omega.data(), size),
          Eigen::Map<const Eigen::ArrayXd>(weight.data(), size), missed_rms};
}

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
  Theta deviation = Theta::Zero();
  deviation << known(uncertainty.poles.real), known(uncertainty.poles.omega),
      known(uncertainty.poles.zeta), known(uncertainty.numerator[0]),
      known(uncertainty.numerator[1]), known(uncertainty.numerator[2]), known(uncertainty.delay_s);
  if (transfer.loop.order == 2) deviation(0) = deviation(5) = 0.0;
  Information information = Information::Identity();
  if (uncertainty.seen && uncertainty.seen->missed_rms > 0.0)
    information += seen_information(transfer, named, deviation, *uncertainty.seen);
  const Eigen::SelfAdjointEigenSolver<Information> axes(information);
  const Information spread =
      deviation.asDiagonal() * axes.eigenvectors() *
      axes.eigenvalues().cwiseMax(1.0).cwiseSqrt().cwiseInverse().asDiagonal();

  std::vector<Transfer> out;
  const auto add = [&](const Theta& z, double timing) {
    out.push_back(moved(transfer, named, uncertainty.deviations * spread * z));
    out.back().delay_s += timing * known(uncertainty.timing_s);
  };
  out.push_back(transfer);
  for (const double timing : {-1.0, 1.0}) add(Theta::Zero(), timing);
  for (Eigen::Index i = 0; i < kUncertain; ++i) {
    for (const double side : {-1.0, 1.0}) {
      for (const double timing : {-1.0, 0.0, 1.0}) add(side * Theta::Unit(i), timing);
    }
  }
  Normal normal;
  for (int draw = 0; draw < draws; ++draw) {
    Theta z;
    for (double& value : z) value = normal.next();
    add(z.normalized(), static_cast<double>(draw % 3 - 1));
  }
  return out;
}

}  // namespace servotwin
