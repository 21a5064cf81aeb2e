#include "identification/loop/gap_scan.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "identification/least_squares/parallel.h"
#include "identification/loop/effect_columns.h"
#include "identification/loop/structure_choice.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/noise_floor.h"
#include "identification/recording/signals.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// The load may hit between two samples: the motion is interpolated to steps of at most this.
constexpr double kStep_s = 1e-3;
constexpr double kNextWidth = 1.25;    // over the one before
constexpr double kWidestShare = 0.25;  // of the travel
// The narrowest gap over the noise of the encoder: in a narrower one the load seems to move with
// the noise, which is in what is left as well.
constexpr double kNarrowestOverNoise = 20.0, kNarrowestGap = 2e-7;
// Deceleration of the load over the highest one of the motion: a load that brakes harder than the
// motor never leaves its side.
constexpr std::array kDecelerations{0.01, 0.016, 0.025, 0.04, 0.063, 0.1, 0.16, 0.25, 0.4};
constexpr double kHighestQuantile = 0.999;  // of the acceleration: steps of the command lie above
// Chosen; with less, a fixed width is as good a start.
constexpr double kMinExplained = 0.1;
// A share above 1 is none of a mass, but a width that is somewhat wrong may have it.
constexpr double kMinLoadShare = 0.02, kMaxLoadShare = 1.3;
constexpr double kMinIndependence = 1e-6;  // of the two columns, 1: at right angles
constexpr double kSettle_s = 0.25;         // start of every segment, not used: transient

/// The cubic through the samples, `parts` times as fine.
Eigen::ArrayXd finer(const Eigen::ArrayXd& samples, double h, Eigen::Index parts) {
  const Spline s = Spline::through(samples, h);
  Eigen::ArrayXd out((samples.size() - 1) * parts + 1);
  for (Eigen::Index k = 0; k < out.size(); ++k) {
    const Eigen::Index at = k / parts;
    const double t = h * static_cast<double>(k % parts) / static_cast<double>(parts);
    out(k) = s.value(at) + t * (s.first(at) + t * (s.second(at) / 2.0 + t * s.third(at) / 6.0));
  }
  return out;
}

Signals finer_signals(const Segment& s, Eigen::Index parts) {
  Segment out;
  out.start_s = s.start_s;
  out.sample_time_s = s.sample_time_s / static_cast<double>(parts);
  out.length_scale = s.length_scale;
  out.command = finer(s.command, s.sample_time_s, parts);
  out.actual = finer(s.actual, s.sample_time_s, parts);
  Signals signals = signals_of(out);
  // The mean over several samples would blur the moment of an impact.
  set_motion(signals, out.actual);
  return signals;
}

/// What the load's mass and friction behind the gap explain of the residual, in squares; 0 unless
/// the mass is a share of the moved one, which `share` becomes.
double explained(const Eigen::VectorXd& mass, const Eigen::VectorXd& friction,
                 const Eigen::VectorXd& left, double& share) {
  const double by_mass = mass.squaredNorm(), by_friction = friction.squaredNorm(),
               both = mass.dot(friction), of_mass = mass.dot(left),
               of_friction = friction.dot(left);
  if (!(by_mass > 0.0)) return 0.0;
  share = of_mass / by_mass;
  double level = 0.0;
  if (const double det = by_mass * by_friction - both * both;
      det > kMinIndependence * by_mass * by_friction) {
    level = (by_mass * of_friction - both * of_mass) / det;
    // Friction that drives the load is none.
    if (level > 0.0) share = (by_friction * of_mass - both * of_friction) / det;
    level = std::max(level, 0.0);
  }
  if (!(share > kMinLoadShare && share < kMaxLoadShare)) return 0.0;
  return share * of_mass + level * of_friction;
}

}  // namespace

std::optional<GapFound> scan_gap(const std::vector<Segment>& segments, const Structure& structure,
                                 const Model& rigid, double encoder_step) {
  const double h = segments.front().sample_time_s;
  const auto parts = static_cast<Eigen::Index>(std::ceil(h / kStep_s - 1e-9));
  std::vector<Signals> coarse, fine;
  Eigen::Index rows = 0;
  std::vector<double> accelerations;
  double low = 1e300, high = -1e300;
  for (const Segment& s : segments) {
    coarse.push_back(signals_of(s));
    fine.push_back(finer_signals(s, parts));
    rows += s.size();
    const Eigen::ArrayXd acceleration = coarse.back().command.second.abs();
    accelerations.insert(accelerations.end(), acceleration.begin(), acceleration.end());
    low = std::min(low, s.command.minCoeff());
    high = std::max(high, s.command.maxCoeff());
  }
  Eigen::VectorXd left(rows), used = Eigen::VectorXd::Ones(rows);
  Eigen::Index row = 0;
  for (const Segment& s : segments) {
    left.segment(row, s.size()) = (s.command - s.actual - simulate(rigid, s)).matrix();
    const auto settles =
        std::max(s.lead, static_cast<Eigen::Index>(std::lround(kSettle_s / s.sample_time_s)));
    used.segment(row, std::min(settles, s.size())).setZero();
    row += s.size();
  }
  // What other values of the rigid axis' own parameters explain is not the gap's.
  const Projection data(std::move(coarse), structure);
  const Point at = point_of(rigid);
  Eigen::MatrixXd tangent = data.full_jacobian(at, data.solve(at).linear);
  for (Eigen::Index c = 0; c < tangent.cols(); ++c) {
    const double size = tangent.col(c).norm();
    if (size > 0.0) tangent.col(c) /= size;
  }
  tangent.array().colwise() *= used.array();
  left.array() *= used.array();
  const Eigen::MatrixXd basis = orthonormal_basis(tangent);
  left -= basis * (basis.transpose() * left);
  const double all = left.squaredNorm();
  if (!(all > 0.0)) return std::nullopt;

  const std::size_t kind = kind_of<BacklashBehindEncoder>();
  std::vector<Parameter> shapes;
  for (const Parameter& p : shapes_of(kind)) shapes.push_back(stretched(p, length_scale(segments)));
  double velocity_limit = shapes[1].start;
  for (const Effect& effect : rigid.effects) {
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      if (is_friction_law(effect.kind) && p.name == shapes[1].name)
        velocity_limit = std::clamp(effect.shape[i], shapes[1].lower, shapes[1].upper);
      ++i;
    }
  }
  const auto at_quantile =
      accelerations.begin() +
      static_cast<std::ptrdiff_t>(kHighestQuantile * static_cast<double>(accelerations.size() - 1));
  std::nth_element(accelerations.begin(), at_quantile, accelerations.end());
  const double noise = noise_floor(segments).rms;
  const double narrowest =
      std::max(2.0 * encoder_step, std::isfinite(noise) ? kNarrowestOverNoise * noise : 0.0);
  std::vector<GapFound> tried;
  // The same widths whatever the noise is, so that a start does not depend on its last digits.
  for (double width = kNarrowestGap; width < std::min(shapes[0].upper, kWidestShare * (high - low));
       width *= kNextWidth) {
    if (width < narrowest) continue;
    for (const double share : kDecelerations)
      tried.push_back({width, std::clamp(share * *at_quantile, shapes[2].lower, shapes[2].upper)});
  }
  if (tried.empty()) return std::nullopt;
  const EffectColumns beside(fine, rigid.loop, rigid.command_delay_s());
  in_parallel(tried.size(), [&](std::size_t i) {
    GapFound& one = tried[i];
    const Eigen::MatrixXd steps = beside.of(kind, {one.width, velocity_limit, one.deceleration});
    Eigen::MatrixXd columns(rows, steps.cols());
    Eigen::Index from = 0, to = 0;
    for (std::size_t s = 0; s < segments.size(); ++s) {
      for (Eigen::Index k = 0; k < segments[s].size(); ++k)
        columns.row(to + k) = steps.row(from + k * parts);
      from += fine[s].size();
      to += segments[s].size();
    }
    columns.array().colwise() *= used.array();
    columns -= basis * (basis.transpose() * columns);
    one.explained = explained(columns.col(1), columns.col(0), left, one.load_share) / all;
  });
  GapFound best = *std::max_element(
      tried.begin(), tried.end(),
      [](const GapFound& l, const GapFound& r) { return l.explained < r.explained; });
  if (best.explained < kMinExplained) return std::nullopt;
  best.load_share = std::min(best.load_share, 1.0);
  return best;
}

}  // namespace servotwin
