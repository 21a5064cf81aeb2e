#include "diagnosis/search/screen.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "diagnosis/evidence/cuts.h"
#include "diagnosis/statistics/blocked_regression.h"
#include "diagnosis/statistics/chance.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/order_statistics.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr std::size_t kTones = 10;  // highest spectral lines that are tried
constexpr double kToneStep = 0.02;  // final resolution of a tone, in distances of spectral lines
constexpr int kToneSearch = 24;  // range of the search about a line, in quarters of that distance
constexpr std::size_t kMoments = 8;  // largest peaks in time that are tried
// Peaks that impulses explain over peaks that remain: impulses must stand out by this ratio.
constexpr double kMinPeakRatio = 2.5;

}  // namespace

/// A' A, A' r and r' r of every interval, A = [J C].
struct Screen::Sums {
  std::vector<Eigen::MatrixXd> gram;
  std::vector<Eigen::VectorXd> right;
  std::vector<double> square;
};

Screen::Screen(const Projection& data, const Point& at, double encoder_step)
    : segments_(data.segments()), encoder_step_(encoder_step) {
  const Projection::Solution solution = data.solve(at);
  model_ = data.model_of(at, solution.linear);
  left_ = solution.residual;
  take_tangent(data, at, solution.linear);
  prepare();
}

Screen::Screen(const Projection& data, const Point& at, const Model& model, Eigen::VectorXd left,
               double encoder_step)
    : segments_(data.segments()),
      model_(model),
      left_(std::move(left)),
      encoder_step_(encoder_step) {
  take_tangent(data, at, data.solve(at).linear);
  prepare();
}

Eigen::VectorXd left_by_simulation(const Projection& coarse, const std::vector<Segment>& segments,
                                   const Model& model) {
  Eigen::VectorXd left = Eigen::VectorXd::Zero(coarse.rows());
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& s = segments[i];
    const Eigen::ArrayXd all = s.command - s.actual - simulate(model, s);
    const Eigen::Index n = coarse.segments()[i].size();
    const auto every = std::lround(coarse.segments()[i].h / s.sample_time_s);
    for (Eigen::Index k = 0; k < n && k * every < all.size(); ++k) left(row + k) = all(k * every);
    row += n;
  }
  return left;
}

void Screen::take_tangent(const Projection& data, const Point& at, const Eigen::VectorXd& linear) {
  const Structure& structure = data.structure();
  const Eigen::MatrixXd all = data.full_jacobian(at, linear);
  // Without the columns of the free responses, which have decayed before the first interval.
  const Eigen::Index first = structure.order + structure.coefficient_count(),
                     rest = structure.order + structure.shape_count();
  tangent_.resize(all.rows(), first + rest);
  tangent_ << all.leftCols(first), all.rightCols(rest);
}

Screen::Screen(const std::vector<Signals>& segments, const Model& model, Eigen::VectorXd left,
               Eigen::MatrixXd tangent)
    : segments_(segments), model_(model), left_(std::move(left)), tangent_(std::move(tangent)) {
  prepare();
}

void Screen::prepare() {
  beside_.emplace(segments_, model_.loop, model_.command_delay_s());
  Eigen::Index row = 0;
  double low = 1e300, high = -1e300;
  Eigen::VectorXd counts = Eigen::VectorXd::Zero(left_.size());
  begin_s_ = segments_.front().start_s;
  end_s_ = begin_s_;
  for (const Signals& s : segments_) {
    const auto piece = std::max<Eigen::Index>(1, std::lround(kPiece_s / s.h));
    const auto settle = std::max(s.lead, static_cast<Eigen::Index>(std::lround(kSettle_s / s.h)));
    for (Eigen::Index k = settle; k + piece <= s.size(); k += piece) {
      pieces_.push_back({row + k, piece, 0});
      counts.segment(row + k, piece).setOnes();
    }
    low = std::min(low, s.position.minCoeff());
    high = std::max(high, s.position.maxCoeff());
    end_s_ = s.start_s + s.h * static_cast<double>(s.size());
    row += s.size();
  }
  travel_ = high - low;
  for (std::size_t i = 0; i < pieces_.size(); ++i)
    pieces_[i].block = static_cast<int>(i * kRegressionBlocks / pieces_.size());
  left_.array() *= counts.array();
  tangent_.array().colwise() *= counts.array();
  Eigen::Index kept = 0;
  for (Eigen::Index c = 0; c < tangent_.cols(); ++c) {
    const double size = tangent_.col(c).norm();
    if (size > 0.0) tangent_.col(kept++) = tangent_.col(c) / size;
  }
  tangent_.conservativeResize(Eigen::NoChange, kept);
  basis_.resize(tangent_.rows(), 0);
  if (kept == 0) return;
  basis_ = orthonormal_basis(tangent_);
  left_ -= basis_ * (basis_.transpose() * left_);
}

/// The shortest period of position that is searched.
double Screen::shortest_period() const {
  constexpr double kMaxTurns = 200.0;     // over the travel: more would need a finer grid
  constexpr double kMinEncoderSteps = 8;  // below, the steps themselves make a pattern of position
  return std::max(travel_ / kMaxTurns, kMinEncoderSteps * encoder_step_);
}

Eigen::MatrixXd Screen::columns(std::size_t kind, const std::vector<double>& shapes) const {
  return beside_->of(kind, shapes);
}

/// The squared error that the columns explain beyond the tangent space.
double Screen::explained(const Eigen::MatrixXd& given) const {
  // The Gram matrix of what the tangent space leaves of the columns, as a difference: its rounding
  // error is far below what is added. The residual has no part in that space.
  const Eigen::MatrixXd inside = basis_.transpose() * given;
  Eigen::MatrixXd safe = given.transpose() * given;
  const Eigen::VectorXd size = safe.diagonal();
  safe.noalias() -= inside.transpose() * inside;
  const Eigen::VectorXd right = given.transpose() * left_;
  // A column inside the tangent space explains only rounding errors.
  safe.diagonal().array() += 1e-7 * size.array() + 1e-300;
  return right.dot(solve_symmetric(safe, right));
}

void Screen::judge(const Eigen::MatrixXd& given, Screened& out) const {
  Eigen::MatrixXd c = given;
  for (Eigen::Index i = 0; i < c.cols(); ++i) {
    const double size = c.col(i).norm();
    if (size > 0.0) c.col(i) /= size;
  }
  const Eigen::Index k = tangent_.cols(), n = k + c.cols();
  Sums sums;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (const Piece& piece : pieces_) {
    Eigen::MatrixXd a(piece.count, n);
    a << tangent_.middleRows(piece.first, piece.count), c.middleRows(piece.first, piece.count);
    const auto r = left_.segment(piece.first, piece.count);
    sums.gram.emplace_back(a.transpose() * a);
    sums.right.emplace_back(a.transpose() * r);
    sums.square.push_back(r.squaredNorm());
    gram += sums.gram.back();
    right += sums.right.back();
  }
  // Predict every block by the others, with the candidate and without.
  double with = 0.0, without = 0.0;
  for (int b = 0; b < kRegressionBlocks; ++b) {
    Eigen::MatrixXd g = gram;
    Eigen::VectorXd x = right;
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      if (pieces_[i].block != b) continue;
      g -= sums.gram[i];
      x -= sums.right[i];
    }
    // Coefficients that the other blocks do not determine stay near 0.
    g += kPriorWeight * gram;
    const Eigen::VectorXd both = ridge_solved(g, x),
                          base = ridge_solved(g.topLeftCorner(k, k), x.head(k));
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      if (pieces_[i].block != b) continue;
      with += sums.square[i] - 2.0 * both.dot(sums.right[i]) + both.dot(sums.gram[i] * both);
      without += sums.square[i] - 2.0 * base.dot(sums.right[i].head(k)) +
                 base.dot(sums.gram[i].topLeftCorner(k, k) * base);
    }
  }
  out.gain = without > 0.0 ? 1.0 - with / without : 0.0;

  const Eigen::VectorXd theta = ridge_solved(gram, right);
  Eigen::MatrixXd scores = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    const Eigen::VectorXd s = sums.right[i] - sums.gram[i] * theta;
    scores += s * s.transpose();
  }
  const Eigen::MatrixXd inverse = ridge_solved(gram, Eigen::MatrixXd::Identity(n, n));
  const auto m = static_cast<double>(pieces_.size()), q = static_cast<double>(c.cols());
  const Eigen::MatrixXd cov = (inverse * scores * inverse).bottomRightCorner(c.cols(), c.cols()) *
                              (m / std::max(1.0, m - static_cast<double>(n)));
  const Eigen::VectorXd own = theta.tail(c.cols());
  const double wald = own.dot(solve_symmetric(cov, own));
  const double degrees = std::max(1.0, m - static_cast<double>(n));
  out.statistic = std::isfinite(wald) && wald > 0.0 ? z_of_f_ratio(wald / q, q, degrees) : 0.0;
  out.p = chance_beyond(out.statistic);
}

/// Isolated events cannot be predicted from other blocks: instead, the peaks that the impulses
/// explain must stand out from those that remain.
void Screen::judge_moment(std::size_t kind, Screened& out) const {
  const Eigen::MatrixXd own = columns(kind, out.shapes);
  out.gain = explained(own) / left_.squaredNorm();
  const Eigen::MatrixXd c = own - basis_ * (basis_.transpose() * own);
  const Eigen::VectorXd rest = left_ - c * ridge_solved(c.transpose() * c, c.transpose() * left_);
  std::vector<double> before, after;
  for (const Piece& piece : pieces_) {
    before.push_back(left_.segment(piece.first, piece.count).cwiseAbs().maxCoeff());
    after.push_back(rest.segment(piece.first, piece.count).cwiseAbs().maxCoeff());
  }
  std::sort(before.begin(), before.end(), std::greater<>());
  std::sort(after.begin(), after.end(), std::greater<>());
  const auto pushes = static_cast<std::size_t>(own.cols());
  if (before.size() <= 2 * pushes) return;
  // Compare the explained peaks with the remaining ones, some of which may be further impulses.
  const bool stands_out = before[pushes / 2] > kMinPeakRatio * after[pushes];
  const double usual = 1.4826 * median(after);
  out.statistic = stands_out && usual > 0.0 ? before[pushes / 2] / usual : 0.0;
  out.p = stands_out ? chance_beyond(out.statistic) : 1.0;
}

std::vector<double> Screen::tones() const {
  const Signals& s =
      *std::max_element(segments_.begin(), segments_.end(),
                        [](const auto& l, const auto& r) { return l.size() < r.size(); });
  Eigen::Index first = 0;
  for (const Signals& other : segments_) {
    if (&other == &s) break;
    first += other.size();
  }
  std::vector<double> out = lines_of(left_.segment(first, s.size()), s.h, kTones);
  for (const double f : strongest_of(left_.segment(first, s.size()), s.h)) out.push_back(f);
  return out;
}

/// Starting values of the times of the impulses, found one by one: each at the peak where one more
/// impulse explains most of the remaining residual.
std::vector<double> Screen::moments(std::size_t kind, std::vector<double> shapes) const {
  constexpr double kNever = 1e6;
  const std::size_t pushes = coefficients_of(kind).size();
  std::fill_n(shapes.begin(), pushes, kNever);
  Eigen::VectorXd rest = left_;
  for (std::size_t i = 0; i < pushes; ++i) {
    std::vector<std::pair<double, double>> peaks;
    Eigen::Index row = 0;
    for (const Signals& s : segments_) {
      const auto window = std::max<Eigen::Index>(1, std::lround(0.1 / s.h));
      for (Eigen::Index k = 0; k + window <= s.size(); k += window) {
        Eigen::Index at = 0;
        const double peak = rest.segment(row + k, window).cwiseAbs().maxCoeff(&at);
        peaks.emplace_back(-peak, s.start_s + s.h * static_cast<double>(k + at));
      }
      row += s.size();
    }
    std::sort(peaks.begin(), peaks.end());
    if (peaks.size() > kMoments) peaks.resize(kMoments);
    double most = 0.0, best_time = 0.0;
    Eigen::VectorXd best_column;
    for (const auto& [negative, time] : peaks) {
      // The response of the axis peaks some time after the impulse.
      for (const double earlier : {0.0, 0.005, 0.01, 0.02, 0.03}) {
        std::vector<double> trial(shapes.size(), kNever);
        trial.back() = shapes.back();
        trial[0] = time - earlier;
        Eigen::VectorXd c = columns(kind, trial).col(0);
        c -= basis_ * (basis_.transpose() * c);
        const double square = c.squaredNorm();
        const double explains = square > 0.0 ? std::pow(c.dot(rest), 2) / square : 0.0;
        if (explains > most) most = explains, best_time = trial[0], best_column = std::move(c);
      }
    }
    if (most <= 0.0) break;
    shapes[i] = best_time;
    rest -= best_column * (best_column.dot(rest) / best_column.squaredNorm());
  }
  return shapes;
}

std::vector<std::vector<double>> Screen::grid(std::size_t kind) const {
  std::vector<Parameter> shapes;
  for (const Parameter& p : shapes_of(kind))
    shapes.push_back(stretched(p, length_scale(segments_)));
  std::vector<double> start;
  for (const Parameter& p : shapes) {
    double value = p.start;
    // Shape parameters shared with a friction of the model start at the values found for it.
    for (const Effect& other : model_.effects) {
      std::size_t shape = 0;
      for (const Parameter& q : shapes_of(other.kind)) {
        if (q.name == p.name && (p.name == "velocity_limit" || p.name == "breakaway_displacement"))
          value = other.shape[shape];
        ++shape;
      }
    }
    start.push_back(std::clamp(value, p.lower, p.upper));
  }
  std::vector<std::vector<double>> out;
  if (shapes.empty()) return {start};
  const Parameter& p = shapes.front();
  const auto add = [&](double value) {
    if (!(value > p.lower) || !(value < p.upper)) return;
    out.push_back(start);
    out.back().front() = value;
  };
  switch (p.scan) {
    case Scan::kNone:
      for (const double factor : {0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0}) add(factor * p.start);
      break;
    case Scan::kPeriod: {
      const double shortest = std::max(p.lower, shortest_period());
      for (double turns = 0.75; travel_ / turns > shortest; turns += 0.5) add(travel_ / turns);
      break;
    }
    case Scan::kFrequency:
      for (const double tone : tones()) add(tone);
      if (shapes.size() > 1) {
        // A mode is broader than a tone: a grid over all frequencies is tried as well.
        const double top = 0.4 / segments_.front().h;
        for (double f = 5.0; f < top; f *= 1.06) add(f);
      }
      break;
    case Scan::kTime:
      for (int i = 2; i < 19; ++i) add(begin_s_ + (end_s_ - begin_s_) * i / 20.0);
      break;
    case Scan::kMoments:
      out.push_back(moments(kind, start));
      break;
    case Scan::kDemand: {
      // Viscous friction may be a large part of the demanded torque, or none of it. The limit is
      // tried at high quantiles of the demand, since the peaks meet it first.
      const auto of_viscous = static_cast<std::size_t>(
          std::find_if(shapes.begin(), shapes.end(),
                       [](const Parameter& q) { return q.name == "viscous"; }) -
          shapes.begin());
      for (const double viscous : {shapes[of_viscous].lower, 0.3, 1.0, 2.0, 4.0}) {
        start[of_viscous] = viscous;
        Eigen::ArrayXd asked(0);
        for (const Signals& s : segments_) {
          if (s.demand.size() == 0) continue;
          asked.conservativeResize(asked.size() + s.size());
          asked.tail(s.size()) = (s.demand + viscous * s.velocity).abs();
        }
        if (asked.size() == 0) break;
        for (const double beyond : {5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.016, 0.03, 0.06, 0.12, 0.2})
          add(quantile(asked, 1.0 - beyond));
      }
      break;
    }
  }
  if (out.empty()) out.push_back(start);
  return out;
}

Screened Screen::look(const Eigen::MatrixXd& given) const {
  Screened out;
  out.kind = kEffectKinds;
  if (given.allFinite() && explained(given) > 0.0) judge(given, out);
  return out;
}

Screened Screen::look(std::size_t kind) const {
  Screened out;
  out.kind = kind;
  const std::vector<std::vector<double>> points = grid(kind);
  double best = -1.0;
  Eigen::MatrixXd of_best;
  for (const std::vector<double>& point : points) {
    Eigen::MatrixXd c = columns(kind, point);
    if (!c.allFinite()) continue;
    const double square = explained(c);
    if (square > best) best = square, out.shapes = point, of_best = std::move(c);
  }
  if (best <= 0.0) return out;
  if (!shapes_of(kind).empty() && shapes_of(kind)[0].scan == Scan::kFrequency) {
    // Refine the frequency to a small fraction of the line distance: an intermittent tone must be
    // in phase each time it is present.
    const double line = 1.0 / (end_s_ - begin_s_);
    const auto better = [&](double to) {
      if (!(to > shapes_of(kind)[0].lower) || !(to < shapes_of(kind)[0].upper)) return;
      std::vector<double> point = out.shapes;
      point[0] = to;
      Eigen::MatrixXd c = columns(kind, point);
      const double square = c.allFinite() ? explained(c) : 0.0;
      if (square > best) best = square, out.shapes = point, of_best = std::move(c);
    };
    const double middle = out.shapes[0];
    for (int i = -kToneSearch; i <= kToneSearch; ++i) better(middle + 0.25 * line * i);
    for (double step = 0.125 * line; step > kToneStep * line; step *= 0.5) {
      better(out.shapes[0] - step);
      better(out.shapes[0] + step);
    }
  }
  // Prefer half the period where it explains nearly as much: twice a period fits it as the second
  // harmonic.
  while (!shapes_of(kind).empty() && shapes_of(kind)[0].scan == Scan::kPeriod) {
    std::vector<double> half = out.shapes;
    half[0] *= 0.5;
    if (half[0] < std::max(shapes_of(kind)[0].lower, shortest_period())) break;
    Eigen::MatrixXd c = columns(kind, half);
    if (explained(c) < kMinShareOfHalfPeriod * best) break;
    out.shapes = half, of_best = std::move(c);
  }
  if (!shapes_of(kind).empty() && shapes_of(kind)[0].scan == Scan::kMoments) {
    judge_moment(kind, out);
  } else {
    judge(of_best, out);
  }
  out.p = std::min(1.0, out.p * static_cast<double>(points.size()));
  return out;
}

}  // namespace servotwin
