// A ball screw stepped in its modes: exact for torque and friction that hold over a cycle, with the
// nut where the grid has it nearest (docs/theory.md 16.3).
//
// The unknowns are those of modal_basis. At every place of the grid the damped system of velocities
// and deformations is taken apart into its eigenvectors, each a complex number that turns and fades
// on its own; the travel of the rigid motion is the sum of what they add to it. Where the nut goes
// to another place the deformation stays and is expressed in that place's eigenvectors. A step
// therefore grows with the number of modes, not with its square.
//
// Errors: std::runtime_error from the constructor if eigenvectors nearly coincide (a mode that is
// critically damped), so that nothing can be told apart with them. One thread; step() allocates
// nothing.
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

  /// At rest, undeformed, with the nut here.
  void reset(double nut);
  [[nodiscard]] const MechanicsState& state() const { return now_; }
  void step(double torque, double friction, double nut) noexcept;

 private:
  /// One eigenvector: amplitude w <- turn w + gain (torque, friction).
  struct Mode {
    double turn_re = 0.0, turn_im = 0.0;
    std::array<double, 2> gain_re{}, gain_im{};
    /// What it adds to the travel in this cycle, to the deformation at motor and table, and to
    /// their velocities; the last is nothing, for an even number.
    std::array<double, 6> out_re{}, out_im{};
  };
  struct Place {
    std::vector<Mode> modes;
    std::array<double, 2> travel{};           // of torque and friction, in the same cycle
    Eigen::MatrixXd to_state, to_amplitudes;  // of velocities and deformations
  };
  [[nodiscard]] Place place_at(double nut, double step_s) const;
  void move_to(int place) noexcept;
  void read() noexcept;

  BallScrew screw_;
  NutGrid grid_;
  double per_metre_ = 0.0;  // places
  double rigid_motor_ = 0.0, rigid_table_ = 0.0;
  std::vector<Place> places_;
  int here_ = 0;
  double travel_ = 0.0, next_travel_ = 0.0;  // of the rigid motion
  Eigen::VectorXd amplitudes_, state_;       // real and imaginary parts in turn
  MechanicsState now_;
};

}  // namespace servotwin
