// The mechanics of a feed axis: the ball screw in finite elements, with motor, coupling and table
// (Ferkl et al. 2021, section 3; docs/theory.md 16.1).
//
//   M q'' + (C + c_n h h') q' + (K + k_n h h') q = b_m T - b_t F
//
// q: motor with half of the coupling, the other half, rotations of the thread's nodes, their axial
// displacements, table, added mass. h(x_n) = d delta / dq is the vector of the nut's deflection
// delta = x_table - u(x_n) - lead / 2 pi theta(x_n); it alone depends on the position x_n of the
// nut, while the mesh is fixed. The paper moves the mesh instead (4 + 4 elements); `remeshed` is
// that version.
//
// SI units. Errors: none, the parts are not checked here. Allocates. Any thread.
#pragma once

#include <Eigen/Core>

#include "twin/feed_axis/parts.h"

namespace servotwin {

/// `rigid` is the motion without deformation, for 1 m of the table: K rigid = 0, h' rigid = 0.
struct BallScrew {
  BallScrew() = default;
  /// With the thread in parts.screw.elements equal elements.
  explicit BallScrew(const FeedAxisParts& parts);
  /// With the nut on a node between four equal elements on either side.
  [[nodiscard]] static BallScrew remeshed(const FeedAxisParts& parts, double nut);

  [[nodiscard]] Eigen::VectorXd nut_vector(double nut) const;  ///< h, nut from the bearing [m]
  [[nodiscard]] Eigen::MatrixXd stiffness_at(double nut) const;
  [[nodiscard]] Eigen::MatrixXd damping_at(double nut) const;
  [[nodiscard]] Eigen::Index size() const { return mass.rows(); }

  /// The same in other coordinates, q = V y.
  [[nodiscard]] BallScrew in(const Eigen::MatrixXd& v) const;

  double radius = 0.0;  ///< lead / 2 pi [m/rad]
  SpringDamper nut;
  Eigen::MatrixXd mass, damping, stiffness;  ///< M, C, K, without the nut
  Eigen::VectorXd motor, table, rigid;       ///< theta_1 = motor' q, x_table = table' q

 private:
  BallScrew(const FeedAxisParts& parts, Eigen::VectorXd nodes);

  Eigen::VectorXd nodes_;    // of the thread, from the bearing [m]
  Eigen::MatrixXd turning_;  // node i turns by turning_.row(i) q
  Eigen::MatrixXd along_;
};

/// Undamped natural frequencies, rising [Hz]; the first is 0, the rigid motion.
[[nodiscard]] Eigen::VectorXd mode_frequencies(const BallScrew& screw, double nut);
/// Static stiffness at the table with the motor held [N/m]. Not for a screw in coordinates of `in`.
[[nodiscard]] double static_stiffness(const BallScrew& screw, double nut);
/// A basis that is orthonormal in M and contains the rigid motion, as its first vector, and the
/// lowest `modes` modes with the nut at five positions from `from` to `to` [m].
[[nodiscard]] Eigen::MatrixXd modal_basis(const BallScrew& screw, double from, double to,
                                          int modes);

}  // namespace servotwin
