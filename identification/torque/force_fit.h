// Force fit: moved mass and friction from motor force and motion (inverse dynamic model;
// docs/theory.md 9).
//
//   F = m a + sum_i c_i f_i(motion; theta)
//
// The effects are those of the catalogue; the coefficients c_i = m d_i are in the unit of the
// force. For given shapes theta the rest is one linear least squares problem (variable projection).
// The shapes are searched over their whole physical range by controlled random search (NLopt, CRS2
// with local mutation; Kaelo and Ali 2006) and refined by Levenberg-Marquardt (Ceres).
//
// Any thread; the same data give the same result. Allocates.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "identification/model/model_file.h"
#include "identification/torque/force_data.h"
#include "twin/model.h"

namespace servotwin {

struct ForceStructure {
  bool mass = true;                  ///< false: the mass is 0 and not fitted
  std::vector<std::size_t> effects;  ///< indices in the catalogue
};

struct ForceModel {
  double mass = 0.0;            ///< unit of the force per m/s^2 (rad/s^2)
  std::vector<Effect> effects;  ///< coefficients in the unit of the force
};

struct ForceFitOptions {
  std::optional<std::vector<double>> shapes;  ///< held at these values; absent: searched
  int evaluations = 0;       ///< of the global search; 0: chosen by the amount of data
  double least_speed = 0.0;  ///< slower rows are left out: at rest, static friction may have any
                             ///< value up to breakaway [m/s | rad/s]
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

/// Fits data.force() minus `known`, a given force of every row (empty: none). Returns nothing where
/// no shapes give a finite fit.
[[nodiscard]] std::optional<ForceFit> fit_force(const ForceData& data,
                                                const ForceStructure& structure,
                                                const ForceFitOptions& options = {},
                                                const Eigen::VectorXd& known = {});

}  // namespace servotwin
