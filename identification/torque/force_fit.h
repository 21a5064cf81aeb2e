// Force fit: moved mass and friction from the motor's force and the motion (the inverse dynamic
// model; docs/theory.md 9).
//
//   F = m a + sum_i c_i f_i(motion; theta)
//
// The effects are those of the catalogue; the coefficients c_i = m d_i are in the unit of the
// force. For given shapes theta the rest is one linear least squares problem (variable projection);
// the shapes are sought over their whole physical range by controlled random search (NLopt, CRS2
// with local mutation; Kaelo and Ali 2006) and refined by Levenberg-Marquardt (Ceres).
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "identification/model/model_file.h"
#include "identification/torque/force_data.h"
#include "twin/model.h"

namespace servotwin {

struct ForceStructure {
  bool mass = true;                  ///< false: the inertia is not sought and taken as 0
  std::vector<std::size_t> effects;  ///< places in the catalogue
};

struct ForceModel {
  double mass = 0.0;            ///< unit of the force per m/s^2 (rad/s^2)
  std::vector<Effect> effects;  ///< coefficients in the unit of the force
};

struct ForceFitOptions {
  std::optional<std::vector<double>> shapes;  ///< held at these; otherwise sought
  int evaluations = 0;       ///< of the global search; 0: as many as the amount of data allows
  double least_speed = 0.0;  ///< rows that are slower are left out: at rest, static friction may
                             ///< be anything up to breakaway
};

/// Measured minus modelled force over all rows, in the unit of the force.
struct ForceError {
  double rms = 0.0, max = 0.0;
  double relative = 0.0;  ///< |error| / |force|, Euclidean norms
};

struct ForceFit {
  ForceModel model;
  double mass_deviation = 0.0;
  std::vector<EffectDeviations> deviations;  ///< one per effect
  ForceError error;
  int evaluations = 0;
};

/// The modelled force of every row of the data.
[[nodiscard]] Eigen::VectorXd force_of(const ForceModel& model, const ForceData& data);
[[nodiscard]] ForceError judge(const ForceModel& model, const ForceData& data);

/// Fits data.force() less `known`, a force of every row that is held (none where it is empty).
/// Nothing where no shapes give a finite fit. Any thread; the same data give the same result.
[[nodiscard]] std::optional<ForceFit> fit_force(const ForceData& data,
                                                const ForceStructure& structure,
                                                const ForceFitOptions& options = {},
                                                const Eigen::VectorXd& known = {});

}  // namespace servotwin
