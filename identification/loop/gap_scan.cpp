#include "identification/loop/gap_scan.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "identification/least_squares/parallel.h"
#include "identification/loop/structure_choice.h"
#include "identification/recording/signals.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// A load hits between samples: the motion is followed in steps of at most this.
constexpr double kStep_s = 1e-3;
constexpr double kWidestGap = 1e-3, kNextWidth = 1.5;
// The narrowest gap over what is left: in one that is hardly wider the load seems to move with the
// noise of the encoder, which is in what is left as well.
constexpr double kNarrowestOverLeft = 20.0;
// Of the load, over the highest acceleration of the command: with more the load stays where it is.
constexpr std::array kDecelerations{0.01, 0.02, 0.05, 0.1, 0.2, 0.4};
constexpr double kMinExplained = 0.1, kMinLoadShare = 0.02, kMaxLoadShare = 1.3;
constexpr double kSettle_s = 0.25;

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
  out.command = finer(s.command, s.sample_time_s, parts);
  out.actual = finer(s.actual, s.sample_time_s, parts);
  Signals signals = signals_of(out);
  // The mean over several samples would blur the moment of an impact.
  set_motion(signals, out.actual);
  return signals;
}

}  // namespace

std::optional<GapFound> scan_gap(const std::vector<Segment>& segments, const Structure& structure,
                                 const Model& rigid, double encoder_step) {
  const double h = segments.front().sample_time_s;
  const auto parts = static_cast<Eigen::Index>(std::ceil(h / kStep_s - 1e-9));
  std::vector<Signals> coarse, fine;
  Eigen::Index rows = 0;
  double highest = 0.0;
  for (const Segment& s : segments) {
    coarse.push_back(signals_of(s));
    fine.push_back(finer_signals(s, parts));
    rows += s.size();
    highest = std::max(highest, coarse.back().command.second.abs().maxCoeff());
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
  const auto shapes = shapes_of(kind);
  double velocity_limit = shapes[1].start;
  for (const Effect& effect : rigid.effects) {
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      if (is_friction_law(effect.kind) && p.name == shapes[1].name)
        velocity_limit = std::clamp(effect.shape[i], shapes[1].lower, shapes[1].upper);
      ++i;
    }
  }
  std::vector<GapFound> tried;
  const double rms = std::sqrt(all / used.sum());
  for (double width = std::max(kNarrowestOverLeft * rms, 2.0 * encoder_step); width < kWidestGap;
       width *= kNextWidth) {
    for (const double share : kDecelerations) tried.push_back({width, share * highest});
  }
  in_parallel(tried.size(), [&](std::size_t i) {
    GapFound& one = tried[i];
    const Eigen::MatrixXd steps = effect_columns(fine, rigid.loop, rigid.command_delay_s(), kind,
                                                 {one.width, velocity_limit, one.deceleration});
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
    Eigen::MatrixXd gram = columns.transpose() * columns;
    gram.diagonal().array() += 1e-7 * gram.trace() + 1e-300;
    const Eigen::VectorXd right = columns.transpose() * left, found = solve_symmetric(gram, right);
    one.load_share = found(1);
    if (one.load_share > kMinLoadShare && one.load_share < kMaxLoadShare)
      one.explained = right.dot(found) / all;
  });
  if (tried.empty()) return std::nullopt;
  GapFound best = *std::max_element(
      tried.begin(), tried.end(),
      [](const GapFound& l, const GapFound& r) { return l.explained < r.explained; });
  if (best.explained < kMinExplained) return std::nullopt;
  best.load_share = std::min(best.load_share, 1.0);
  return best;
}

}  // namespace servotwin
