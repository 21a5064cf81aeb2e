#include "twin/feed_axis/reduced_mechanics.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <stdexcept>
#include <tuple>

#include "twin/linear_algebra.h"

namespace servotwin {
namespace {

using Complex = std::complex<double>;

// In spacings; beyond it another grid point is used.
constexpr double kMaxDistanceFromGridPoint = 0.75;
// Of the decomposition, relative to the system's matrix.
constexpr double kMaxEigenvectorError = 1e-7;

/// (e^x - 1) / x and (e^x - 1 - x) / x^2.
struct Holds {
  Complex first, second;
};
Holds holds(Complex x) {
  if (std::abs(x) < 1e-2) {
    Holds out{0.0, 0.0};
    Complex term = 1.0;
    for (int k = 1; k <= 8; ++k) {
      out.first += term / static_cast<double>(k);
      out.second += term / static_cast<double>(k * (k + 1));
      term *= x / static_cast<double>(k);
    }
    return out;
  }
  const Complex first = (std::exp(x) - 1.0) / x;
  return {first, (first - 1.0) / x};
}

}  // namespace

ReducedMechanics::ReducedMechanics(const BallScrew& screw, const NutGrid& grid, double step_s)
    : screw_(screw),
      grid_(grid),
      per_metre_(grid.intervals() / (grid.to - grid.from)),
      rigid_motor_(screw.radius * screw.motor(0)),
      rigid_table_(screw.table(0)) {
  for (int i = 0; i <= grid.intervals(); ++i) places_.push_back(place_at(grid.at(i), step_s));
  state_ = Eigen::VectorXd::Zero(2 * screw.size() - 1);
  amplitudes_ = Eigen::VectorXd::Zero(2 * state_.size());  // room for eigenvalues that are all real
}

ReducedMechanics::Place ReducedMechanics::place_at(double nut, double step_s) const {
  // z = (velocity of the rigid motion, deformations in units of 1 / rate, their velocities).
  const Eigen::Index bends = screw_.size() - 1, size = 2 * bends + 1;
  const Eigen::MatrixXd stiffness = screw_.stiffness_at(nut).bottomRightCorner(bends, bends),
                        damping = screw_.damping_at(nut);
  const double rate = std::sqrt(screw_.stiffness_at(grid_.from).norm());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(size, size);
  a(0, 0) = -damping(0, 0);
  a.topRightCorner(1, bends) = -damping.topRightCorner(1, bends);
  a.bottomLeftCorner(bends, 1) = -damping.bottomLeftCorner(bends, 1);
  a.block(1, bends + 1, bends, bends).diagonal().setConstant(rate);
  a.block(bends + 1, 1, bends, bends) = -stiffness / rate;
  a.bottomRightCorner(bends, bends) = -damping.bottomRightCorner(bends, bends);
  Eigen::MatrixXd in = Eigen::MatrixXd::Zero(size, 2), out = Eigen::MatrixXd::Zero(5, size);
  for (const auto& [column, vector, sign] :
       {std::tuple{0, screw_.motor, 1.0}, std::tuple{1, screw_.table, -1.0}}) {
    in(0, column) = sign * vector(0);
    in.col(column).tail(bends) = sign * vector.tail(bends);
    const double unit = column == 0 ? screw_.radius : 1.0;
    out.row(1 + column).segment(1, bends) = unit / rate * vector.tail(bends);
    out(3 + column, 0) = unit * vector(0);
    out.row(3 + column).tail(bends) = unit * vector.tail(bends);
  }

  const auto [values, vectors] = eigenpairs(a);
  const Eigen::MatrixXcd inverted = inverse(vectors);
  const double missed = (vectors * values.asDiagonal() * inverted - a).norm() / a.norm();
  if (!(missed < kMaxEigenvectorError)) {
    throw std::runtime_error(
        "the axis has a critically damped mode, which cannot be reduced; change one damping value "
        "slightly");
  }
  Place place;
  std::vector<Eigen::Index> kept;  // of a conjugate pair one
  for (Eigen::Index i = 0; i < size; ++i) {
    if (values(i).imag() >= 0.0) kept.push_back(i);
  }
  const auto amplitudes = 2 * static_cast<Eigen::Index>(kept.size());
  place.to_state = Eigen::MatrixXd::Zero(size, amplitudes);
  place.to_amplitudes = Eigen::MatrixXd::Zero(amplitudes, size);
  const Eigen::MatrixXcd gains = inverted * in;
  for (std::size_t j = 0; j < kept.size(); ++j) {
    const Eigen::Index i = kept[j], column = 2 * static_cast<Eigen::Index>(j);
    const bool real = values(i).imag() == 0.0;
    const double both = real ? 1.0 : 2.0;  // the amplitude stands for its conjugate as well
    place.to_state.col(column) = vectors.col(i).real();
    place.to_amplitudes.row(column) = both * inverted.row(i).real();
    if (!real) {
      place.to_state.col(column + 1) = -vectors.col(i).imag();
      place.to_amplitudes.row(column + 1) = both * inverted.row(i).imag();
    }
    const Complex turn = std::exp(values(i) * step_s);
    const Holds hold = holds(values(i) * step_s);
    Mode mode;
    mode.turn_re = turn.real();
    mode.turn_im = turn.imag();
    for (Eigen::Index k = 0; k < 2; ++k) {
      const Complex gain = both * gains(i, k), held = step_s * hold.first * gain;
      mode.gain_re[k] = held.real();
      mode.gain_im[k] = held.imag();
      place.travel[k] += (vectors(0, i) * step_s * step_s * hold.second * gain).real();
    }
    Eigen::Vector<Complex, 5> shown = out * vectors.col(i);
    shown(0) = vectors(0, i) * step_s * hold.first;
    for (Eigen::Index k = 0; k < 5; ++k) {
      mode.out_re[k] = shown(k).real();
      mode.out_im[k] = -shown(k).imag();
    }
    place.modes.push_back(mode);
  }
  return place;
}

void ReducedMechanics::reset(double nut) {
  amplitudes_.setZero();
  travel_ = next_travel_ = 0.0;
  here_ = std::clamp(static_cast<int>(std::lround((nut - grid_.from) * per_metre_)), 0,
                     grid_.intervals());
  now_ = {};
}

void ReducedMechanics::move_to(int place) noexcept {
  const Place& from = places_[here_];
  const Place& to = places_[place];
  state_.noalias() = from.to_state * amplitudes_.head(from.to_state.cols());
  amplitudes_.head(to.to_state.cols()).noalias() = to.to_amplitudes * state_;
  here_ = place;
  read();
}

void ReducedMechanics::step(double torque, double friction, double nut) noexcept {
  const double where = (nut - grid_.from) * per_metre_;
  if (std::abs(where - here_) > kMaxDistanceFromGridPoint)
    move_to(std::clamp(static_cast<int>(std::lround(where)), 0, grid_.intervals()));
  const Place& place = places_[here_];
  travel_ += next_travel_ + place.travel[0] * torque + place.travel[1] * friction;
  double* w = amplitudes_.data();
  for (const Mode& mode : place.modes) {
    const double re = w[0], im = w[1];
    w[0] = mode.turn_re * re - mode.turn_im * im + mode.gain_re[0] * torque +
           mode.gain_re[1] * friction;
    w[1] = mode.turn_im * re + mode.turn_re * im + mode.gain_im[0] * torque +
           mode.gain_im[1] * friction;
    w += 2;
  }
  read();
}

void ReducedMechanics::read() noexcept {
  std::array<double, 6> sum{};
  const double* w = amplitudes_.data();
  for (const Mode& mode : places_[here_].modes) {
    for (std::size_t k = 0; k < sum.size(); ++k)
      sum[k] += mode.out_re[k] * w[0] + mode.out_im[k] * w[1];
    w += 2;
  }
  next_travel_ = sum[0];
  now_ = {rigid_motor_ * travel_ + sum[1], sum[3], rigid_table_ * travel_ + sum[2], sum[4]};
}

}  // namespace servotwin
