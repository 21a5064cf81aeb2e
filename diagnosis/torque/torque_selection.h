// Selects the causes that are added to the rigid body, one by one, as long as each improves the
// prediction enough (docs/theory.md 10.1). Units as in torque.h. Any thread.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "diagnosis/torque/torque.h"
#include "diagnosis/torque/torque_body.h"
#include "diagnosis/torque/torque_rows.h"

namespace servotwin {

/// A cause with the terms that model it.
struct TorquePart {
  std::string id;
  std::vector<TorqueTerm> terms;
  std::vector<TorqueEvidence> evidence;
  double confidence = 0.0;
  std::vector<std::string> ambiguous_with;
  /// Causes that would explain nearly as much, and the share of bootstrap resamples in which this
  /// one explains more.
  std::vector<std::pair<std::string, double>> rivals;
};

struct TorqueSelected {
  std::vector<TorquePart> parts;
  Plateau plateau;
  std::vector<std::string> steps;  ///< of the search, as text
};

/// The causes found. `rests`: the axis rests long enough for dwell stiction; `rotary`: it is a
/// rotary axis.
[[nodiscard]] TorqueSelected select_torque_causes(const TorqueRows& rows, const TorqueBody& body,
                                                  const DiagnoseOptions& options, bool rests,
                                                  bool rotary);

/// The regressors of the body and of all parts except one (`but` = kNoEffect: of all), over all
/// rows.
[[nodiscard]] Eigen::MatrixXd columns_of(const TorqueRows& rows, const TorqueBody& body,
                                         const std::vector<TorquePart>& parts,
                                         std::size_t but = kNoEffect);

/// Half the range of a position-dependent friction level over the travel.
[[nodiscard]] double unevenness(const TorqueRows& rows, const TorqueTerm& term,
                                const Eigen::VectorXd& coefficients);

}  // namespace servotwin
