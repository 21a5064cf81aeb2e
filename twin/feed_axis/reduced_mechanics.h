// A ball screw stepped in its modes: exact for torque and friction held over a cycle, with the nut
// at the nearest point of a grid (docs/theory.md 16.3).
//
// The unknowns are those of modal_basis. At every grid point the damped system of velocities and
// deformations is decomposed into eigenvectors, each with a complex amplitude that rotates and
// decays independently; the travel of the rigid motion is the sum of their contributions. When the
// nut moves to another grid point, the deformation is kept and expressed in the eigenvectors of
// that point. The cost of a step is proportional to the number of modes, not to its square.
//
// SI units. Errors: std::runtime_error from the constructor if eigenvectors nearly coincide (a
// critically damped mode), because the decomposition is then ill-conditioned. One thread; step()
// allocates nothing.
#pragma once

#include <array>
#include <vector>

#include "twin/feed_axis/ball_screw.h"
#include "twin/feed_axis/full_mechanics.h"

namespace servotwin {

class ReducedMechanics {
 public:
  /// `screw` in the coordinates of its modal_basis.
  ReducedMechanics(const BallScrew& screw, const NutGrid& grid, double step_s);

  /// At rest and undeformed, with the nut at `nut` [m].
  void reset(double nut);
  [[nodiscard]] const MechanicsState& state() const { return now_; }
  void step(double torque, double friction, double nut) noexcept;

 private:
  /// One eigenvector: amplitude w <- turn w + gain (torque, friction).
  struct Mode {
    double turn_re = 0.0, turn_im = 0.0;
    std::array<double, 2> gain_re{}, gain_im{};
    /// Contributions to the travel in this cycle, to the deformation at motor and table, and to
    /// their velocities; the last entry is padding.
    std::array<double, 6> out_re{}, out_im{};
  };
  struct Place {
    std::vector<Mode> modes;
    std::array<double, 2> travel{};           // by torque and friction in the same cycle
    Eigen::MatrixXd to_state, to_amplitudes;  // between amplitudes and velocities, deformations
  };
  [[nodiscard]] Place place_at(double nut, double step_s) const;
  void move_to(int place) noexcept;
  void read() noexcept;

  BallScrew screw_;
  NutGrid grid_;
  double per_metre_ = 0.0;  // grid points per metre
  double rigid_motor_ = 0.0, rigid_table_ = 0.0;
  std::vector<Place> places_;
  int here_ = 0;
  double travel_ = 0.0, next_travel_ = 0.0;  // of the rigid motion
  Eigen::VectorXd amplitudes_, state_;       // real and imaginary parts alternate
  MechanicsState now_;
};

}  // namespace servotwin
