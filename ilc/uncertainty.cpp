#include "ilc/uncertainty.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace servotwin {
namespace {

using Theta = Eigen::Matrix<double, kLoopValues, 1>;
using Masses = Eigen::Vector4d;  // changes of omega, zeta, load share and reset rate

constexpr double kMinPole = 0.05;  // least factor of a pole: it stays stable for any uncertainty
constexpr double kMaxLoadShare = 0.98;  // as in the catalogue

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

/// The model with its values moved.
Transfer moved(const Transfer& transfer, const PoleSet& named, const Theta& by,
               const Masses& masses_by) {
  const auto pole = [](double value, double change) {
    return std::max(kMinPole * value, value + change);
  };
  Transfer out = transfer;
  const PoleSet set{pole(named.real, by(0)), pole(named.omega, by(1)), pole(named.zeta, by(2))};
  out.loop.denominator = denominator_of(set, transfer.loop.order);
  for (std::size_t i = 0; i < kMaxOrder; ++i)
    out.loop.numerator[i] += by(3 + static_cast<Eigen::Index>(i));
  out.delay_s += by(3 + kMaxOrder);
  if (!out.two_masses) return out;
  TwoMassParameters& two = *out.two_masses;
  two.omega = pole(two.omega, masses_by(0));
  two.zeta = pole(two.zeta, masses_by(1));
  two.load_share = std::min(pole(two.load_share, masses_by(2)), kMaxLoadShare);
  two.reset = pole(two.reset, masses_by(3));
  return out;
}

/// The same; with two masses as far in this direction as it is stable.
Transfer moved_if_stable(const Transfer& transfer, const PoleSet& named, Theta by,
                         Masses masses_by) {
  constexpr int kMaxHalvings = 30;
  for (int i = 0; i < kMaxHalvings; ++i, by *= 0.5, masses_by *= 0.5) {
    Transfer out = moved(transfer, named, by, masses_by);
    if (!out.two_masses || stable(out.loop, *out.two_masses)) return out;
  }
  return transfer;
}

}  // namespace

LoopCovariance one_by_one(const PoleSet& poles, const std::array<double, kMaxOrder>& numerator,
                          double delay_s) {
  Theta deviation;
  deviation << poles.real, poles.omega, poles.zeta, numerator[0], numerator[1], numerator[2],
      delay_s;
  return deviation.unaryExpr([](double sd) { return std::isfinite(sd) ? sd * sd : 0.0; })
      .asDiagonal();
}

TransferUncertainty relative_uncertainty(const Transfer& transfer, double share) {
  const PoleSet poles = labels_of(transfer.loop).set[0];
  std::array<double, kMaxOrder> numerator = transfer.loop.numerator;
  for (double& c : numerator) c *= share;
  TransferUncertainty out;
  out.covariance =
      one_by_one({share * poles.real, share * poles.omega, share * poles.zeta}, numerator, 0.0);
  if (const auto& two = transfer.two_masses)
    out.two_masses = {share * two->omega, share * two->zeta, share * two->load_share,
                      share * two->reset};
  return out;
}

std::vector<Transfer> models_within(const Transfer& transfer,
                                    const TransferUncertainty& uncertainty, int draws) {
  const PoleSet named = labels_of(transfer.loop).set[0];
  const Theta deviation = uncertainty.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  const Theta unit = deviation.unaryExpr([](double sd) { return sd > 0.0 ? 1.0 / sd : 0.0; });
  const Eigen::SelfAdjointEigenSolver<LoopCovariance> axes(
      unit.asDiagonal() * uncertainty.covariance * unit.asDiagonal());
  const LoopCovariance spread = deviation.asDiagonal() * axes.eigenvectors() *
                                axes.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();

  const TwoMassDeviations& two = uncertainty.two_masses;
  const Masses masses_deviation =
      Masses(two.omega, two.zeta, two.load_share, two.reset).unaryExpr([](double sd) {
        return std::isfinite(sd) ? sd : 0.0;
      });

  std::vector<Transfer> out;
  const auto add = [&](const Theta& z, const Masses& y, double timing) {
    out.push_back(moved_if_stable(transfer, named, uncertainty.deviations * spread * z,
                                  uncertainty.deviations * masses_deviation.cwiseProduct(y)));
    out.back().delay_s += timing * uncertainty.timing_s;
  };
  const Theta same = Theta::Zero();
  const Masses same_masses = Masses::Zero();
  out.push_back(transfer);
  for (const double timing : {-1.0, 1.0}) add(same, same_masses, timing);
  for (Eigen::Index i = 0; i < kLoopValues; ++i) {
    for (const double side : {-1.0, 1.0}) {
      for (const double timing : {-1.0, 0.0, 1.0}) add(side * Theta::Unit(i), same_masses, timing);
    }
  }
  for (Eigen::Index i = 0; transfer.two_masses && i < same_masses.size(); ++i) {
    for (const double side : {-1.0, 1.0}) {
      for (const double timing : {-1.0, 0.0, 1.0}) add(same, side * Masses::Unit(i), timing);
    }
  }
  Normal normal;
  for (int draw = 0; draw < draws; ++draw) {
    Theta z;
    for (double& value : z) value = normal.next();
    Masses y = same_masses;
    if (transfer.two_masses) {
      for (double& value : y) value = normal.next();
    }
    const double length = std::sqrt(z.squaredNorm() + y.squaredNorm());
    add(z / length, y / length, static_cast<double>(draw % 3 - 1));
  }
  return out;
}

}  // namespace servotwin
