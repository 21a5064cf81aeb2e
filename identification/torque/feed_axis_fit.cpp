#include "identification/torque/feed_axis_fit.h"

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "identification/least_squares/bounded.h"
#include "twin/feed_axis/feed_axis.h"
#include "twin/feed_axis/velocity_loop.h"
#include "twin/hold.h"
#include "twin/linear_algebra.h"

namespace servotwin {
namespace {

struct SoughtPart {
  std::string name;
  double& (*of)(FeedAxisParts& parts);
};
using Residual = std::function<Eigen::VectorXd(const FeedAxisParts& parts)>;

FeedAxisParts with(FeedAxisParts parts, const std::vector<SoughtPart>& sought, const double* logs) {
  for (std::size_t i = 0; i < sought.size(); ++i) sought[i].of(parts) = std::exp(logs[i]);
  return parts;
}

/// The residual of logarithms, by central differences.
class LogCost final : public ceres::CostFunction {
 public:
  LogCost(const FeedAxisParts& parts, const std::vector<SoughtPart>& sought,
          const Residual& residual, Eigen::Index rows)
      : parts_(parts), sought_(sought), residual_(residual) {
    set_num_residuals(static_cast<int>(rows));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(sought.size()));
  }
  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override {
    constexpr double kStep = 1e-4;
    const auto n = static_cast<Eigen::Index>(sought_.size());
    Eigen::VectorXd logs = Eigen::Map<const Eigen::VectorXd>(parameters[0], n);
    const auto at = [&] { return residual_(with(parts_, sought_, logs.data())); };
    const Eigen::VectorXd here = at();
    if (!here.allFinite()) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, here.size()) = here;
    if (jacobians == nullptr || jacobians[0] == nullptr) return true;
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<Rows> jacobian(jacobians[0], here.size(), n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double value = logs(i);
      logs(i) = value + kStep;
      const Eigen::VectorXd above = at();
      logs(i) = value - kStep;
      jacobian.col(i) = (above - at()) / (2.0 * kStep);
      logs(i) = value;
    }
    return jacobian.allFinite();
  }

 private:
  const FeedAxisParts& parts_;
  const std::vector<SoughtPart>& sought_;
  const Residual& residual_;
};

/// The deviations take the residual for noise.
FeedAxisFit fit(const FeedAxisParts& parts, const std::vector<SoughtPart>& sought,
                const Residual& residual) {
  // Largest change of a part from its given value: a factor of 100.
  constexpr double kMaxLogChange = 4.6;
  FeedAxisParts start = parts;
  std::vector<double> logs;
  for (const SoughtPart& one : sought) {
    if (!(one.of(start) > 0.0))
      throw std::runtime_error(one.name + " is 0; a fitted parameter must start above 0");
    logs.push_back(std::log(one.of(start)));
  }
  const Eigen::VectorXd before = residual(parts);
  if (before.size() <= static_cast<Eigen::Index>(sought.size()) || !before.allFinite())
    throw std::runtime_error(
        "the axis with the given parts cannot be compared with the data: it is not "
        "stable, or the data are too few");
  FeedAxisFit out;
  out.rms_before = std::sqrt(before.squaredNorm() / static_cast<double>(before.size()));

  const LogCost cost(parts, sought, residual, before.size());
  ceres::Problem::Options keep;
  keep.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(keep);
  problem.AddResidualBlock(const_cast<LogCost*>(&cost), nullptr, logs.data());
  for (std::size_t i = 0; i < logs.size(); ++i) {
    problem.SetParameterLowerBound(logs.data(), static_cast<int>(i), logs[i] - kMaxLogChange);
    problem.SetParameterUpperBound(logs.data(), static_cast<int>(i), logs[i] + kMaxLogChange);
  }
  const ceres::Solver::Summary summary =
      solve_bounded(bounded_options(ceres::DENSE_QR, 60, 1e-9), problem);
  if (!summary.IsSolutionUsable()) throw std::runtime_error("no finite fit of the axis");

  out.parts = with(parts, sought, logs.data());
  Eigen::VectorXd left(before.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian(
      before.size(), static_cast<Eigen::Index>(sought.size()));
  const double* at = logs.data();
  double* rows = jacobian.data();
  cost.Evaluate(&at, left.data(), &rows);
  const double square = left.squaredNorm() / static_cast<double>(left.size() - jacobian.cols());
  out.rms = std::sqrt(left.squaredNorm() / static_cast<double>(left.size()));
  const Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  const Eigen::MatrixXd covariance = square * inverse(information);
  for (std::size_t i = 0; i < sought.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    out.values.push_back({sought[i].name, sought[i].of(start), sought[i].of(out.parts),
                          std::sqrt(covariance(k, k))});
  }
  return out;
}

const std::vector<SoughtPart>& springs() {
  static const std::vector<SoughtPart> all{
      {"coupling.stiffness",
       [](FeedAxisParts& p) -> double& { return p.coupling.spring.stiffness; }},
      {"coupling.damping", [](FeedAxisParts& p) -> double& { return p.coupling.spring.damping; }},
      {"bearing.stiffness", [](FeedAxisParts& p) -> double& { return p.bearing.stiffness; }},
      {"bearing.damping", [](FeedAxisParts& p) -> double& { return p.bearing.damping; }},
      {"nut.stiffness", [](FeedAxisParts& p) -> double& { return p.nut.spring.stiffness; }},
      {"nut.damping", [](FeedAxisParts& p) -> double& { return p.nut.spring.damping; }}};
  return all;
}

template <std::optional<LuGreParts> FeedAxisParts::*kOf>
std::vector<SoughtPart> lugre(const std::string& name) {
  return {{name + ".breakaway", [](FeedAxisParts& p) -> double& { return (p.*kOf)->breakaway; }},
          {name + ".coulomb", [](FeedAxisParts& p) -> double& { return (p.*kOf)->coulomb; }},
          {name + ".stribeck_velocity",
           [](FeedAxisParts& p) -> double& { return (p.*kOf)->stribeck_velocity; }},
          {name + ".stiffness", [](FeedAxisParts& p) -> double& { return (p.*kOf)->stiffness; }},
          {name + ".damping", [](FeedAxisParts& p) -> double& { return (p.*kOf)->damping; }},
          {name + ".viscous", [](FeedAxisParts& p) -> double& { return (p.*kOf)->viscous; }}};
}

}  // namespace

Eigen::ArrayXd at_rate(const Segment& segment, double rate_hz) {
  const double h = segment.sample_time_s;
  const Spline spline = Spline::through(segment.command, h);
  const double duration = h * static_cast<double>(segment.size() - 1);
  Eigen::ArrayXd out(static_cast<Eigen::Index>(duration * rate_hz + 1e-6) + 1);
  for (Eigen::Index k = 0; k < out.size(); ++k) {
    const double time = static_cast<double>(k) / rate_hz;
    const auto i = std::min(static_cast<Eigen::Index>(time / h + 1e-9), segment.size() - 1);
    const double t = time - h * static_cast<double>(i);
    out(k) = spline.value(i) +
             t * (spline.first(i) + t * (spline.second(i) / 2.0 + t * spline.third(i) / 6.0));
  }
  return out;
}

FeedAxisFit fit_response(const FeedAxisParts& parts, const VelocityResponse& response) {
  constexpr double kPriorDeviation = 1.1;  // ln 3: prior deviation of a part's logarithm
  // Deviation of the response's logarithm: 0.4 dB, 3 degrees.
  constexpr double kResponseDeviation = 0.05;
  const Eigen::Index n = response.frequency_hz.size();
  const Residual residual = [&](const FeedAxisParts& tried) {
    const Eigen::ArrayXcd simulated =
        closed_velocity_loop(tried, response.nut, response.frequency_hz);
    const Eigen::ArrayXcd missed = (simulated / response.closed).log();
    FeedAxisParts from = parts, to = tried;
    Eigen::VectorXd out(2 * n + static_cast<Eigen::Index>(springs().size()));
    out.head(n) = missed.real();
    out.segment(n, n) = missed.imag();
    for (std::size_t i = 0; i < springs().size(); ++i)
      out(2 * n + static_cast<Eigen::Index>(i)) =
          kResponseDeviation / kPriorDeviation *
          std::log(springs()[i].of(to) / springs()[i].of(from));
    return out;
  };
  return fit(parts, springs(), residual);
}

FeedAxisFit fit_friction(const FeedAxisParts& parts, FrictionOf which,
                         const std::vector<Segment>& segments) {
  const bool drive = which == FrictionOf::kDrive;
  if (!(drive ? parts.friction : parts.cover))
    throw std::runtime_error("the parts have no friction as a start value");
  ReducedAxis axis = reduced_axis(parts);
  const double rate = parts.control.rate_hz;
  std::vector<Eigen::ArrayXd> commands;
  Eigen::Index rows = 0;
  for (const Segment& segment : segments) {
    if (segment.torque.size() != segment.size())
      throw std::runtime_error("a segment has no torque");
    commands.push_back(at_rate(segment, rate));
    rows += segment.size();
  }
  const Residual residual = [&](const FeedAxisParts& tried) {
    axis.take_friction(tried);
    Eigen::VectorXd out(rows);
    Eigen::Index row = 0;
    for (std::size_t s = 0; s < segments.size(); ++s) {
      const Eigen::ArrayXd torque = run(axis, commands[s]).torque;
      const double cycles = segments[s].sample_time_s * rate;
      for (Eigen::Index k = 0; k < segments[s].size(); ++k) {
        const auto cycle =
            std::min(static_cast<Eigen::Index>(std::lround(static_cast<double>(k) * cycles)),
                     torque.size() - 1);
        out(row++) = torque(cycle) - segments[s].torque(k);
      }
    }
    return out;
  };
  return fit(
      parts,
      drive ? lugre<&FeedAxisParts::friction>("friction") : lugre<&FeedAxisParts::cover>("cover"),
      residual);
}

}  // namespace servotwin
