#include "twin/feed_axis/ball_screw.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "twin/linear_algebra.h"

namespace servotwin {
namespace {

double area(double diameter) { return std::numbers::pi * diameter * diameter / 4.0; }
double polar_moment(double diameter) { return std::numbers::pi * std::pow(diameter, 4) / 32.0; }

Eigen::VectorXd equal(double from, double to, int elements) {
  return Eigen::VectorXd::LinSpaced(elements + 1, from, to);
}

}  // namespace

BallScrew::BallScrew(const FeedAxisParts& parts)
    : BallScrew(parts, equal(0.0, parts.screw.length, parts.screw.elements)) {}

BallScrew BallScrew::remeshed(const FeedAxisParts& parts, double nut) {
  Eigen::VectorXd nodes(9);
  nodes << equal(0.0, nut, 4).head(4), equal(nut, parts.screw.length, 4);
  return {parts, std::move(nodes)};
}

BallScrew::BallScrew(const FeedAxisParts& parts, Eigen::VectorXd nodes)
    : radius(parts.screw.lead / (2.0 * std::numbers::pi)),
      nut(parts.nut.spring),
      nodes_(std::move(nodes)) {
  const ScrewParts& screw = parts.screw;
  const Eigen::Index count = nodes_.size(), turning = 2, along = turning + count,
                     at_table = along + count, size = at_table + (parts.added_mass ? 2 : 1);
  mass = damping = stiffness = Eigen::MatrixXd::Zero(size, size);
  const auto spring = [&](Eigen::Index i, Eigen::Index j, const SpringDamper& s) {
    const Eigen::Matrix2d between{{1.0, -1.0}, {-1.0, 1.0}};
    stiffness({i, j}, {i, j}) += s.stiffness * between;
    damping({i, j}, {i, j}) += s.damping * between;
  };
  // Linear shape functions, consistent mass.
  const auto element = [&](Eigen::Index i, Eigen::Index j, double m, double k,
                           const MaterialDamping& material) {
    const Eigen::Matrix2d consistent = m * Eigen::Matrix2d{{1.0 / 3, 1.0 / 6}, {1.0 / 6, 1.0 / 3}};
    mass({i, j}, {i, j}) += consistent;
    damping({i, j}, {i, j}) += material.mass * consistent;
    spring(i, j, {k, material.stiffness * k});
  };

  mass(0, 0) += parts.motor_inertia + parts.coupling.inertia / 2.0;
  mass(1, 1) += parts.coupling.inertia / 2.0;
  spring(0, 1, parts.coupling.spring);
  const double end = polar_moment(screw.end_diameter), thread = polar_moment(screw.diameter);
  element(1, turning, screw.density * end * screw.end_length,
          screw.shear_modulus * end / screw.end_length, screw.torsional);
  for (Eigen::Index e = 0; e + 1 < count; ++e) {
    const double length = nodes_(e + 1) - nodes_(e), section = area(screw.diameter);
    element(turning + e, turning + e + 1, screw.density * thread * length,
            screw.shear_modulus * thread / length, screw.torsional);
    element(along + e, along + e + 1, screw.density * section * length,
            screw.youngs_modulus * section / length, screw.axial);
  }
  stiffness(along, along) += parts.bearing.stiffness;
  damping(along, along) += parts.bearing.damping;
  mass(at_table, at_table) += parts.table_mass;
  if (parts.added_mass) {
    mass(at_table + 1, at_table + 1) += parts.added_mass->mass;
    spring(at_table, at_table + 1, parts.added_mass->spring);
  }

  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(size, size);
  motor = unit.col(0);
  table = unit.col(at_table);
  turning_ = unit.middleRows(turning, count);
  along_ = unit.middleRows(along, count);
  rigid = Eigen::VectorXd::Zero(size);
  rigid.head(along).setConstant(1.0 / radius);
  rigid.tail(size - at_table).setOnes();
}

Eigen::VectorXd BallScrew::nut_vector(double nut_position) const {
  const double* first = nodes_.data();
  const Eigen::Index above = std::upper_bound(first, first + nodes_.size(), nut_position) - first,
                     e = std::clamp<Eigen::Index>(above - 1, 0, nodes_.size() - 2);
  const double share = (nut_position - nodes_(e)) / (nodes_(e + 1) - nodes_(e));
  const auto at_nut = [&](const Eigen::MatrixXd& branch) -> Eigen::VectorXd {
    return (1.0 - share) * branch.row(e) + share * branch.row(e + 1);
  };
  return table - at_nut(along_) - radius * at_nut(turning_);
}

Eigen::MatrixXd BallScrew::stiffness_at(double nut_position) const {
  const Eigen::VectorXd h = nut_vector(nut_position);
  return stiffness + nut.stiffness * h * h.transpose();
}

Eigen::MatrixXd BallScrew::damping_at(double nut_position) const {
  const Eigen::VectorXd h = nut_vector(nut_position);
  return damping + nut.damping * h * h.transpose();
}

BallScrew BallScrew::in(const Eigen::MatrixXd& v) const {
  BallScrew out = *this;
  const auto square = [&](Eigen::MatrixXd& matrix) {
    matrix = (v.transpose() * matrix * v).eval();
  };
  square(out.mass);
  square(out.damping);
  square(out.stiffness);
  out.rigid = solve_symmetric(out.mass, Eigen::VectorXd(v.transpose() * (mass * rigid)));
  out.motor = v.transpose() * motor;
  out.table = v.transpose() * table;
  out.turning_ = turning_ * v;
  out.along_ = along_ * v;
  return out;
}

Eigen::VectorXd mode_frequencies(const BallScrew& screw, double nut) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> solver(
      screw.stiffness_at(nut), screw.mass, Eigen::EigenvaluesOnly | Eigen::Ax_lBx);
  // The rigid motion is 0 but for rounding, which may be below it.
  return solver.eigenvalues().cwiseMax(0.0).cwiseSqrt() / (2.0 * std::numbers::pi);
}

double static_stiffness(const BallScrew& screw, double nut) {
  const Eigen::Index n = screw.size() - 1;
  const Eigen::MatrixXd held = screw.stiffness_at(nut).bottomRightCorner(n, n);
  const Eigen::VectorXd force = screw.table.tail(n);
  return 1.0 / force.dot(solve_symmetric(held, force));
}

Eigen::MatrixXd modal_basis(const BallScrew& screw, double from, double to, int modes) {
  constexpr int kPositions = 5;
  // Share of the largest direction below which a direction depends on the others.
  constexpr double kMinDirectionShare = 1e-6;
  const Eigen::Index wanted = std::min<Eigen::Index>(modes, screw.size() - 1);
  const Eigen::LLT<Eigen::MatrixXd> mass(screw.mass);
  const Eigen::VectorXd rigid = screw.rigid / std::sqrt(screw.rigid.dot(screw.mass * screw.rigid));
  Eigen::MatrixXd all(screw.size(), kPositions * wanted);
  for (int i = 0; i < kPositions; ++i) {
    const double nut = from + (to - from) * i / (kPositions - 1.0);
    const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> solver(screw.stiffness_at(nut),
                                                                           screw.mass);
    all.middleCols(i * wanted, wanted) = solver.eigenvectors().middleCols(1, wanted);
  }
  all -= rigid * (rigid.transpose() * screw.mass * all);
  const Eigen::MatrixXd scaled = mass.matrixU() * all;
  const auto [vectors, size] = left_singular(scaled);
  const Eigen::Index kept = (size.array() > kMinDirectionShare * size(0)).count();
  Eigen::MatrixXd basis(screw.size(), 1 + kept);
  basis << rigid, mass.matrixU().solve(vectors.leftCols(kept));
  return basis;
}

}  // namespace servotwin
