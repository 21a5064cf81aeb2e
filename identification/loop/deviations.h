// How uncertain the parameters of a fitted model are: standard deviations of its poles, numerator,
// effects and modes, from the covariance of the fit. Any thread; errors: none.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "identification/loop/projection.h"
#include "identification/model/model_file.h"
#include "twin/sample.h"

namespace servotwin {

/// Writes them into `record`. `all`: covariance of all parameters as that of OutputErrorFit, with
/// a1..an at `nonlinear`. `poles`: those of the model, by which they are named.
void set_deviations(ModelRecord& record, const PoleSet& poles, const Eigen::MatrixXd& all,
                    Eigen::Index nonlinear);

/// The same for the model of `record` that was fitted to `training`: by the curvature of its output
/// error there. Where that cannot be had, all deviations are unknown (NaN).
void set_deviations(ModelRecord& record, const std::vector<Segment>& training, double encoder_step);

}  // namespace servotwin
