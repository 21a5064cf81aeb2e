// Which causes are added to the rigid body, one by one while they earn their place (docs/theory.md
// 10.1). Units as of torque.h. Any thread.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "diagnosis/torque.h"
#include "diagnosis/torque_body.h"
#include "diagnosis/torque_rows.h"

namespace servotwin {

/// A cause with the terms that model it.
struct TorquePart {
  std::string id;
  std::vector<TorqueTerm> terms;
  std::vector<TorqueEvidence> evidence;
  double confidence = 0.0;
  std::vector<std::string> ambiguous_with;
  /// Causes that would have explained nearly as much, and the share of resamples that this one
  /// beats them in.
  std::vector<std::pair<std::string, double>> rivals;
};

struct TorqueSelected {
  std::vector<TorquePart> parts;
  Plateau plateau;
  std::vector<std::string> steps;  ///< what was tried, for people
};

[[nodiscard]] TorqueSelected select_torque_causes(const TorqueRows& rows, const TorqueBody& body,
                                                  const DiagnoseOptions& options, bool rests,
                                                  bool rotary);

/// The columns of the body and of all parts but one (kNoEffect: of all), over all rows.
[[nodiscard]] Eigen::MatrixXd columns_of(const TorqueRows& rows, const TorqueBody& body,
                                         const std::vector<TorquePart>& parts,
                                         std::size_t but = kNoEffect);

/// Half of what the level of a position-dependent friction varies over the travel.
[[nodiscard]] double unevenness(const TorqueRows& rows, const TorqueTerm& term,
                                const Eigen::VectorXd& coefficients);

}  // namespace servotwin
