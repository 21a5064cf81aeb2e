#include "identification/torque/force_fit.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <nlopt.hpp>

#include "identification/least_squares/bounded.h"
#include "identification/least_squares/chart.h"
#include "identification/least_squares/covariance.h"
#include "identification/least_squares/gram_solver.h"
#include "identification/least_squares/unit_columns.h"

namespace servotwin {

namespace {

// Samples that the global search may evaluate in total.
constexpr double kSearchSamples = 1e7;
constexpr int kFewestEvaluations = 200, kMaxEvaluations = 10'000;
constexpr unsigned long kSeed = 1;
constexpr double kMinUnitForce = 1e-9;  // largest unit force below which a column counts as 0
// Relative decrease of the cost at which a refinement ends.
constexpr double kCoarseForceTolerance = 1e-3, kFineForceTolerance = 1e-8;

/// The linear problem at given shapes.
/// Motion::friction of a law whose elements, where it has several, weigh the same.
Eigen::ArrayXd friction_along(std::size_t kind, const Eigen::ArrayXXd& unit_force) {
  Effect law{kind, {}, {}};
  law.coefficient.fill(1.0);
  Eigen::ArrayXd out(unit_force.rows());
  std::array<double, kMaxCoefficients> force{};
  for (Eigen::Index k = 0; k < out.size(); ++k) {
    for (Eigen::Index c = 0; c < unit_force.cols(); ++c)
      force[static_cast<std::size_t>(c)] = unit_force(k, c);
    out(k) = friction_of(law, force.data());
  }
  return out;
}

class ForceProjection {
 public:
  ForceProjection(const ForceData& data, const ForceStructure& structure,
                  const Eigen::VectorXd& target, double least_speed = 0.0)
      : data_(data),
        structure_(structure),
        target_(target),
        used_((data.least_speed().array() >= least_speed).cast<double>()),
        axes_(shape_axes(structure.effects, data.length_scale())) {
    if (structure.mass) non_negative_.push_back(true);
    for (const std::size_t kind : structure.effects) {
      for (const Parameter& p : coefficients_of(kind))
        non_negative_.push_back(p.lower == 0.0 || p.resists);
    }
  }

  struct Columns {
    Eigen::MatrixXd regressors;  // mass, then every coefficient
    struct ByShape {
      Eigen::Index column = 0, shape = 0;
      Eigen::VectorXd derivative;
    };
    std::vector<ByShape> by_shape;
  };
  [[nodiscard]] Columns columns(const std::vector<double>& shapes, bool derivatives) const {
    Columns out;
    out.regressors.setZero(data_.rows(), static_cast<Eigen::Index>(non_negative_.size()));
    if (structure_.mass) out.regressors.col(0) = data_.acceleration();
    Eigen::Index row = 0;
    for (const ForceData::Stretch& stretch : data_.stretches()) {
      Eigen::Index column = structure_.mass ? 1 : 0, shape = 0, rows = 0;
      std::size_t entry = 0;
      std::vector<Motion> motion = stretch.motion;
      for (const std::size_t kind : structure_.effects) {
        const UnitColumns units = unit_columns(kind, shapes.data() + shape, motion, derivatives);
        if (is_friction_law(kind)) {  // it precedes the effects that change it
          const Eigen::ArrayXd friction = friction_along(kind, units.force);
          for (std::size_t k = 0; k < motion.size(); ++k)
            motion[k].friction = friction(static_cast<Eigen::Index>(k));
        }
        const auto samples = Eigen::seqN(0, stretch.force.size(), stretch.substeps);
        for (Eigen::Index c = 0; c < units.force.cols(); ++c) {
          const Eigen::VectorXd values = data_.compared(units.force.col(c)(samples));
          rows = values.size();
          out.regressors.col(column + c).segment(row, rows) = values;
          for (std::size_t p = 0; p < units.by_shape.size(); ++p) {
            if (row == 0) {
              out.by_shape.push_back({column + c, shape + static_cast<Eigen::Index>(p),
                                      Eigen::VectorXd::Zero(data_.rows())});
            }
            out.by_shape[entry++].derivative.segment(row, rows) =
                data_.compared(units.by_shape[p].col(c)(samples));
          }
        }
        column += units.force.cols();
        shape += static_cast<Eigen::Index>(shapes_of(kind).size());
      }
      if (structure_.effects.empty()) rows = data_.compared(stretch.force).size();
      row += rows;
    }
    out.regressors.array().colwise() *= used_.array();
    // A force that does not occur in these rows, even if it is 1e-200, is set to 0.
    for (Eigen::Index c = 0; c < out.regressors.cols(); ++c) {
      if (out.regressors.col(c).cwiseAbs().maxCoeff() < kMinUnitForce)
        out.regressors.col(c).setZero();
    }
    for (auto& entry : out.by_shape) entry.derivative.array() *= used_.array();
    return out;
  }

  struct Solution {
    Eigen::VectorXd linear, residual;
    double cost = 0.0;
  };
  /// Coefficients that may not be negative are held at 0 where they would be.
  [[nodiscard]] Solution solve(GramSolver& solver, const Eigen::MatrixXd& regressors) const {
    Solution out;
    while (true) {
      out.residual = (used_.array() * target_.array()).matrix();
      out.linear = solver.take_out(out.residual);
      Eigen::Index worst = -1;
      double most = 0.0;
      for (Eigen::Index i = 0; i < out.linear.size(); ++i) {
        const double force = -out.linear(i) * regressors.col(i).norm();
        if (!non_negative_[static_cast<std::size_t>(i)] || force <= most) continue;
        worst = i;
        most = force;
      }
      if (worst < 0) break;
      solver.drop(worst);
    }
    out.cost = 0.5 * out.residual.squaredNorm();
    return out;
  }
  [[nodiscard]] Solution solve(const std::vector<double>& shapes) const {
    const Columns c = columns(shapes, false);
    GramSolver solver(c.regressors);
    return solve(solver, c.regressors);
  }

  /// d (columns * linear) / d shapes.
  [[nodiscard]] Eigen::MatrixXd by_shapes(const Columns& c, const Eigen::VectorXd& linear) const {
    Eigen::MatrixXd out =
        Eigen::MatrixXd::Zero(data_.rows(), static_cast<Eigen::Index>(axes_.size()));
    for (const auto& entry : c.by_shape)
      out.col(entry.shape) += linear(entry.column) * entry.derivative;
    return out;
  }

  [[nodiscard]] std::vector<double> shapes_at(const double* coordinates) const {
    std::vector<double> shapes;
    for (std::size_t i = 0; i < axes_.size(); ++i) shapes.push_back(axes_[i].value(coordinates[i]));
    return shapes;
  }
  [[nodiscard]] const std::vector<ShapeAxis>& axes() const { return axes_; }
  [[nodiscard]] Eigen::Index rows() const { return data_.rows(); }
  [[nodiscard]] const Eigen::VectorXd& used() const { return used_; }

 private:
  const ForceData& data_;
  const ForceStructure& structure_;
  const Eigen::VectorXd& target_;
  Eigen::VectorXd used_;  // 1, or 0 for rows that are left out
  std::vector<ShapeAxis> axes_;
  std::vector<bool> non_negative_;
};

/// The projected residual over the coordinates of the shapes, with Kaufman's Jacobian.
class ShapeCost : public ceres::CostFunction {
 public:
  ShapeCost(const ForceProjection& projection, double unit, int& evaluations)
      : projection_(projection), unit_(unit), evaluations_(evaluations) {
    set_num_residuals(static_cast<int>(projection.rows()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(projection.axes().size()));
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    ++evaluations_;
    const std::vector<double> shapes = projection_.shapes_at(parameters[0]);
    const bool derivatives = jacobians != nullptr && jacobians[0] != nullptr;
    const auto columns = projection_.columns(shapes, derivatives);
    GramSolver solver(columns.regressors);
    const auto at = projection_.solve(solver, columns.regressors);
    if (!std::isfinite(at.cost)) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, at.residual.size()) = at.residual / unit_;
    if (!derivatives) return true;
    const Eigen::MatrixXd by_shapes = projection_.by_shapes(columns, at.linear);
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<RowMajor> jacobian(jacobians[0], by_shapes.rows(), by_shapes.cols());
    for (Eigen::Index p = 0; p < by_shapes.cols(); ++p) {
      Eigen::VectorXd column = by_shapes.col(p);
      solver.take_out(column);
      const double stretched = projection_.axes()[static_cast<std::size_t>(p)].logarithmic
                                   ? shapes[static_cast<std::size_t>(p)]
                                   : 1.0;
      jacobian.col(p) = -column * stretched / unit_;
    }
    return true;
  }

 private:
  const ForceProjection& projection_;
  double unit_;
  int& evaluations_;
};

/// The best coordinates of a search over the whole box, from the catalogue's start.
std::vector<double> box_searched(const ForceProjection& projection,
                                 const std::vector<double>& start, int evaluations, int& done) {
  struct Search {
    const ForceProjection& projection;
    int& done;
  } search{projection, done};
  nlopt::srand(kSeed);
  nlopt::opt optimizer(nlopt::GN_CRS2_LM, static_cast<unsigned>(start.size()));
  std::vector<double> lower, upper;
  for (const ShapeAxis& axis : projection.axes()) {
    lower.push_back(axis.lower);
    upper.push_back(axis.upper);
  }
  optimizer.set_lower_bounds(lower);
  optimizer.set_upper_bounds(upper);
  optimizer.set_maxeval(evaluations);
  optimizer.set_ftol_rel(1e-6);
  optimizer.set_min_objective(
      [](unsigned, const double* x, double*, void* given) {
        auto& s = *static_cast<Search*>(given);
        ++s.done;
        const double cost = s.projection.solve(s.projection.shapes_at(x)).cost;
        return std::isfinite(cost) ? cost : 1e300;
      },
      &search);
  std::vector<double> x = start;
  double cost = 0.0;
  optimizer.optimize(x, cost);
  return x;
}

std::vector<double> refined(const ForceProjection& projection, std::vector<double> x, double unit,
                            double tolerance, int& evaluations) {
  ceres::Problem problem;
  auto* cost = new ShapeCost(projection, unit, evaluations);  // Ceres deletes it
  problem.AddResidualBlock(cost, nullptr, x.data());
  for (std::size_t i = 0; i < x.size(); ++i) {
    problem.SetParameterLowerBound(x.data(), static_cast<int>(i), projection.axes()[i].lower);
    problem.SetParameterUpperBound(x.data(), static_cast<int>(i), projection.axes()[i].upper);
  }
  solve_bounded(bounded_options(ceres::DENSE_QR, 100, tolerance), problem);
  return x;
}

Eigen::VectorXd known_or_none(const Eigen::VectorXd& known, const ForceData& data) {
  if (known.size() != 0) return data.force() - known;
  return data.force();
}

ForceModel model_of(const ForceStructure& structure, const std::vector<double>& shapes,
                    const Eigen::VectorXd& linear) {
  ForceModel model;
  Eigen::Index at = 0;
  std::size_t shape = 0;
  if (structure.mass) model.mass = linear(at++);
  for (const std::size_t kind : structure.effects) {
    Effect effect;
    effect.kind = kind;
    for (std::size_t p = 0; p < shapes_of(kind).size(); ++p) effect.shape[p] = shapes[shape++];
    for (std::size_t c = 0; c < coefficients_of(kind).size(); ++c)
      effect.coefficient[c] = linear(at++);
    model.effects.push_back(effect);
  }
  return model;
}

}  // namespace

Eigen::VectorXd force_of(const ForceModel& model, const ForceData& data) {
  ForceStructure structure;
  std::vector<double> shapes, linear{model.mass};
  for (const Effect& effect : model.effects) {
    structure.effects.push_back(effect.kind);
    const auto shape_count = static_cast<std::ptrdiff_t>(shapes_of(effect.kind).size());
    const auto count = static_cast<std::ptrdiff_t>(coefficients_of(effect.kind).size());
    shapes.insert(shapes.end(), effect.shape.begin(), effect.shape.begin() + shape_count);
    linear.insert(linear.end(), effect.coefficient.begin(), effect.coefficient.begin() + count);
  }
  const Eigen::VectorXd& target = data.force();
  const ForceProjection projection(data, structure, target);
  return projection.columns(shapes, false).regressors *
         Eigen::Map<const Eigen::VectorXd>(linear.data(), static_cast<Eigen::Index>(linear.size()));
}

ForceError judge(const ForceModel& model, const ForceData& data) {
  const Eigen::VectorXd left = data.force() - force_of(model, data);
  return {std::sqrt(left.squaredNorm() / static_cast<double>(left.size())),
          left.cwiseAbs().maxCoeff(), left.norm() / data.force().norm()};
}

std::optional<ForceFit> fit_force(const ForceData& data, const ForceStructure& structure,
                                  const ForceFitOptions& options, const Eigen::VectorXd& known) {
  const Eigen::VectorXd target = known_or_none(known, data);
  const ForceProjection projection(data, structure, target, options.least_speed);
  const double rows = projection.used().sum();
  if (rows == 0.0 || !(target.squaredNorm() > 0.0)) return std::nullopt;
  ForceFit fit;
  std::vector<double> shapes;
  if (options.shapes) {
    shapes = *options.shapes;
  } else if (!projection.axes().empty()) {
    std::vector<double> start;
    for (const ShapeAxis& axis : projection.axes())
      start.push_back(axis.coordinate(axis.parameter.start));
    double samples = 0.0;
    for (const auto& stretch : data.stretches())
      samples += static_cast<double>(stretch.motion.size());
    const int evaluations =
        options.evaluations > 0
            ? options.evaluations
            : static_cast<int>(std::clamp<double>(kSearchSamples / samples, kFewestEvaluations,
                                                  kMaxEvaluations));
    const double unit = target.norm() / std::sqrt(static_cast<double>(data.rows()));
    // Both starts to the coarse tolerance, then the better one to the fine tolerance.
    double least = 1e300;
    std::vector<double> best;
    for (const auto& from :
         {start, box_searched(projection, start, evaluations, fit.evaluations)}) {
      const auto x = refined(projection, from, unit, kCoarseForceTolerance, fit.evaluations);
      const double cost = projection.solve(projection.shapes_at(x.data())).cost;
      if (!(cost < least)) continue;
      least = cost;
      best = x;
    }
    if (best.empty()) return std::nullopt;
    shapes = projection.shapes_at(
        refined(projection, best, unit, kFineForceTolerance, fit.evaluations).data());
  }

  const auto columns = projection.columns(shapes, true);
  GramSolver solver(columns.regressors);
  const auto at = projection.solve(solver, columns.regressors);
  if (!std::isfinite(at.cost)) return std::nullopt;
  fit.model = model_of(structure, shapes, at.linear);
  fit.error = {std::sqrt(2.0 * at.cost / rows), at.residual.cwiseAbs().maxCoeff(),
               at.residual.norm() / target.cwiseProduct(projection.used()).norm()};

  const bool fixed = options.shapes.has_value();
  Eigen::MatrixXd jacobian(data.rows(), columns.regressors.cols() +
                                            (fixed ? 0 : static_cast<Eigen::Index>(shapes.size())));
  jacobian.leftCols(columns.regressors.cols()) = columns.regressors;
  if (!fixed)
    jacobian.rightCols(static_cast<Eigen::Index>(shapes.size())) =
        projection.by_shapes(columns, at.linear);
  // A coefficient held at 0 has no scatter; that of a force without any row is unknown.
  for (Eigen::Index i = 0; i < columns.regressors.cols(); ++i) {
    if (at.linear(i) == 0.0) jacobian.col(i).setZero();
  }
  Eigen::VectorXd deviation =
      robust_covariance(jacobian, at.residual, data.step_s()).diagonal().cwiseMax(0.0).cwiseSqrt();
  for (Eigen::Index i = 0; i < deviation.size(); ++i) {
    if (!(jacobian.col(i).squaredNorm() > 0.0)) deviation(i) = kAbsent;
  }
  Eigen::Index linear = 0, shape = columns.regressors.cols();
  if (structure.mass) fit.mass_deviation = deviation(linear++);
  for (const std::size_t kind : structure.effects) {
    EffectDeviations of;
    for (std::size_t c = 0; c < coefficients_of(kind).size(); ++c)
      of.coefficient[c] = deviation(linear++);
    for (std::size_t p = 0; p < shapes_of(kind).size(); ++p)
      of.shape[p] = fixed ? kAbsent : deviation(shape++);
    fit.deviations.push_back(of);
  }
  return fit;
}

}  // namespace servotwin
