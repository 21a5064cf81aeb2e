#include "diagnosis/screen.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <unsupported/Eigen/FFT>

namespace servotwin {

namespace {

constexpr double kPiece_s = 0.25;
constexpr int kBlocks = 5;
constexpr double kSettle_s = 0.25;  // of every segment; its starting state is not in the problem
constexpr double kRidge = 1e-10;
constexpr double kFundamental = 0.9;  // share of what the double period explains
constexpr int kTones = 10;            // highest lines of the spectrum that are looked at
constexpr int kMoments = 6;           // largest peaks in time
constexpr int kPlacebos = 64;         // moments at which nothing is supposed to have happened

/// z of the chance that F(k, n) is that large (Wilson and Hilferty 1931, Paulson 1942).
double z_of_f(double f, double k, double n) {
  const double a = 2.0 / (9.0 * k), b = 2.0 / (9.0 * n), root = std::cbrt(f);
  return ((1.0 - b) * root - (1.0 - a)) / std::sqrt(b * root * root + a);
}
double tail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Eigen::MatrixXd solved(const Eigen::MatrixXd& gram, const Eigen::MatrixXd& right) {
  Eigen::MatrixXd ridged = gram;
  ridged.diagonal() += kRidge * gram.diagonal().cwiseMax(1e-300);
  return ridged.ldlt().solve(right);
}

}  // namespace

/// A' A, A' r and r' r of every piece, A = [J C].
struct Screen::Sums {
  std::vector<Eigen::MatrixXd> gram;
  std::vector<Eigen::VectorXd> right;
  std::vector<double> square;
};

Screen::Screen(const Projection& data, const Point& at) : data_(data), at_(at) {
  const Structure& structure = data.structure();
  std::size_t shape = 0;
  for (const std::size_t kind : structure.effects) {
    if (identity_of(kind).acts == Acts::kCommandDelay) delay_ = {at.shapes[shape]};
    shape += shapes_of(kind).size();
  }
  const Projection::Solution solution = data.solve(at);
  left_ = solution.residual;
  const Eigen::MatrixXd all = data.full_jacobian(at, solution.linear);
  // Without the free responses: they are over when a piece begins.
  const Eigen::Index linear = structure.order + structure.coefficient_count(),
                     rest = structure.order + structure.shape_count();
  tangent_.resize(all.rows(), linear + rest);
  tangent_ << all.leftCols(linear), all.rightCols(rest);

  Eigen::Index row = 0;
  double low = 1e300, high = -1e300;
  Eigen::VectorXd counts = Eigen::VectorXd::Zero(data.rows());
  begin_s_ = data.segments().front().start_s;
  end_s_ = begin_s_;
  for (const Signals& s : data.segments()) {
    const auto piece = static_cast<Eigen::Index>(std::lround(kPiece_s / s.h));
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
    pieces_[i].block = static_cast<int>(i * kBlocks / pieces_.size());
  left_.array() *= counts.array();
  tangent_.array().colwise() *= counts.array();
  Eigen::Index kept = 0;
  for (Eigen::Index c = 0; c < tangent_.cols(); ++c) {
    const double size = tangent_.col(c).norm();
    if (size > 0.0) tangent_.col(kept++) = tangent_.col(c) / size;
  }
  tangent_.conservativeResize(Eigen::NoChange, kept);
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(tangent_);
  basis_ = qr.householderQ() * Eigen::MatrixXd::Identity(tangent_.rows(), qr.rank());
  left_ -= basis_ * (basis_.transpose() * left_);
}

Eigen::MatrixXd Screen::columns(std::size_t kind, const std::vector<double>& shapes) const {
  return effect_columns(data_.segments(), data_.structure().order, at_.denominator,
                        delay_.empty() ? 0.0 : delay_.front(), kind, shapes);
}

/// The square that the columns explain beyond the tangent space.
double Screen::explained(const Eigen::MatrixXd& given) const {
  Eigen::MatrixXd c = given;
  c.noalias() -= basis_ * (basis_.transpose() * given);
  const Eigen::MatrixXd gram = c.transpose() * c;
  const Eigen::VectorXd right = c.transpose() * left_;
  // A column that the tangent space holds already explains nothing but rounding.
  Eigen::MatrixXd safe = gram;
  for (Eigen::Index i = 0; i < c.cols(); ++i)
    safe(i, i) += 1e-7 * given.col(i).squaredNorm() + 1e-300;
  return right.dot(safe.ldlt().solve(right));
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
  // Every block predicted by the others, with the candidate and without.
  double with = 0.0, without = 0.0;
  for (int b = 0; b < kBlocks; ++b) {
    Eigen::MatrixXd g = gram;
    Eigen::VectorXd x = right;
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      if (pieces_[i].block != b) continue;
      g -= sums.gram[i];
      x -= sums.right[i];
    }
    const Eigen::VectorXd both = solved(g, x), base = solved(g.topLeftCorner(k, k), x.head(k));
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      if (pieces_[i].block != b) continue;
      with += sums.square[i] - 2.0 * both.dot(sums.right[i]) + both.dot(sums.gram[i] * both);
      without += sums.square[i] - 2.0 * base.dot(sums.right[i].head(k)) +
                 base.dot(sums.gram[i].topLeftCorner(k, k) * base);
    }
  }
  out.gain = without > 0.0 ? 1.0 - with / without : 0.0;

  const Eigen::VectorXd theta = solved(gram, right);
  Eigen::MatrixXd scores = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    const Eigen::VectorXd s = sums.right[i] - sums.gram[i] * theta;
    scores += s * s.transpose();
  }
  const Eigen::MatrixXd inverse = solved(gram, Eigen::MatrixXd::Identity(n, n));
  const auto m = static_cast<double>(pieces_.size()), q = static_cast<double>(c.cols());
  const Eigen::MatrixXd cov = (inverse * scores * inverse).bottomRightCorner(c.cols(), c.cols()) *
                              (m / std::max(1.0, m - static_cast<double>(n)));
  const Eigen::VectorXd own = theta.tail(c.cols());
  const double wald = own.dot(cov.ldlt().solve(own));
  const double degrees = std::max(1.0, m - static_cast<double>(n));
  out.statistic = std::isfinite(wald) && wald > 0.0 ? z_of_f(wald / q, q, degrees) : 0.0;
  out.p = tail(out.statistic);
}

/// What happened once cannot be predicted from other blocks: its size is held against what the same
/// push finds at moments chosen at random.
void Screen::judge_moment(std::size_t kind, Screened& out) const {
  const auto force_at = [&](double time) {
    std::vector<double> shapes = out.shapes;
    shapes[0] = time;
    Eigen::VectorXd c = columns(kind, shapes).col(0);
    c -= basis_ * (basis_.transpose() * c);
    const double square = c.squaredNorm();
    return square > 0.0 ? c.dot(left_) / square : 0.0;
  };
  std::vector<double> sizes;
  for (int i = 0; i < kPlacebos; ++i)
    sizes.push_back(std::abs(force_at(begin_s_ + (end_s_ - begin_s_) * (i + 0.5) / kPlacebos)));
  const double sd = 1.4826 * median(sizes);
  out.statistic = sd > 0.0 ? std::abs(force_at(out.shapes[0])) / sd : 0.0;
  out.p = tail(out.statistic);
  out.gain = explained(columns(kind, out.shapes)) / left_.squaredNorm();
}

std::vector<double> Screen::tones() const {
  const Signals& s =
      *std::max_element(data_.segments().begin(), data_.segments().end(),
                        [](const auto& l, const auto& r) { return l.size() < r.size(); });
  Eigen::Index first = 0;
  for (const Signals& other : data_.segments()) {
    if (&other == &s) break;
    first += other.size();
  }
  // Windowed, and with zeros behind it: neighbours half a line apart.
  Eigen::Index length = 1;
  while (length < 2 * s.size()) length *= 2;
  std::vector<double> x(static_cast<std::size_t>(length), 0.0);
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    const double window = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * static_cast<double>(k) /
                                               static_cast<double>(s.size()));
    x[static_cast<std::size_t>(k)] = window * left_(first + k);
  }
  Eigen::FFT<double> fft;
  std::vector<std::complex<double>> spectrum;
  fft.fwd(spectrum, x);
  const auto half = static_cast<std::size_t>(length / 2);
  std::vector<double> power(half);
  for (std::size_t i = 0; i < half; ++i) power[i] = std::norm(spectrum[i]);
  // A line stands out from its own neighbourhood, not from the whole spectrum.
  std::vector<std::pair<double, double>> lines;
  const double step_hz = 1.0 / (s.h * static_cast<double>(length));
  for (std::size_t i = 2; i + 2 < half; ++i) {
    if (power[i] < power[i - 1] || power[i] < power[i + 1]) continue;
    const std::size_t reach = std::max<std::size_t>(20, i / 5);
    const std::size_t from = i > reach ? i - reach : 1, to = std::min(half, i + reach);
    double sum = 0.0;
    for (std::size_t j = from; j < to; j += 2) sum += power[j];
    const double around = sum / static_cast<double>((to - from + 1) / 2);
    lines.emplace_back(-power[i] / around, step_hz * static_cast<double>(i));
  }
  std::sort(lines.begin(), lines.end());
  std::vector<double> out;
  for (std::size_t i = 0; i < std::min<std::size_t>(kTones, lines.size()); ++i)
    out.push_back(lines[i].second);
  return out;
}

std::vector<double> Screen::moments() const {
  std::vector<std::pair<double, double>> peaks;
  Eigen::Index row = 0;
  for (const Signals& s : data_.segments()) {
    const auto window = static_cast<Eigen::Index>(std::lround(0.1 / s.h));
    for (Eigen::Index k = 0; k + window <= s.size(); k += window) {
      Eigen::Index at = 0;
      const double peak = left_.segment(row + k, window).cwiseAbs().maxCoeff(&at);
      peaks.emplace_back(-peak, s.start_s + s.h * static_cast<double>(k + at));
    }
    row += s.size();
  }
  std::sort(peaks.begin(), peaks.end());
  std::vector<double> out;
  // The axis answers some time after it has been pushed.
  for (std::size_t i = 0; i < std::min<std::size_t>(kMoments, peaks.size()); ++i) {
    for (const double earlier : {0.0, 0.005, 0.01, 0.02, 0.03, 0.05})
      out.push_back(peaks[i].second - earlier);
  }
  return out;
}

std::vector<std::vector<double>> Screen::grid(std::size_t kind) const {
  const auto shapes = shapes_of(kind);
  std::vector<double> start;
  for (const Parameter& p : shapes) {
    double value = p.start;
    // What a friction of the base has found: where the force has its direction.
    std::size_t shape = 0;
    for (const std::size_t other : data_.structure().effects) {
      for (const Parameter& q : shapes_of(other)) {
        if (q.name == p.name && p.name == "velocity_limit") value = at_.shapes[shape];
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
      const double shortest = std::max(p.lower, travel_ / 200.0);
      for (double turns = 0.75; travel_ / turns > shortest; turns += 0.5) add(travel_ / turns);
      break;
    }
    case Scan::kFrequency:
      if (shapes.size() == 1) {
        for (const double tone : tones()) add(tone);
      } else {
        const double top = 0.4 / data_.segments().front().h;
        for (double f = 5.0; f < top; f *= 1.12) add(f);
      }
      break;
    case Scan::kTime:
      if (shapes.size() > 1 && shapes[1].unit == "s") {
        for (const double moment : moments()) add(moment);
      } else {
        for (int i = 1; i < 20; ++i) add(begin_s_ + (end_s_ - begin_s_) * i / 20.0);
      }
      break;
  }
  if (out.empty()) out.push_back(start);
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
  // The period itself and not its double, which has it as second harmonic.
  while (shapes_of(kind).size() > 0 && shapes_of(kind)[0].scan == Scan::kPeriod) {
    std::vector<double> half = out.shapes;
    half[0] *= 0.5;
    if (half[0] < shapes_of(kind)[0].lower) break;
    Eigen::MatrixXd c = columns(kind, half);
    if (explained(c) < kFundamental * best) break;
    out.shapes = half, of_best = std::move(c);
  }
  const bool once = shapes_of(kind).size() > 1 && shapes_of(kind)[0].scan == Scan::kTime &&
                    shapes_of(kind)[1].unit == "s";
  if (once) {
    judge_moment(kind, out);
  } else {
    judge(of_best, out);
  }
  out.p = std::min(1.0, out.p * static_cast<double>(points.size()));
  return out;
}

}  // namespace servotwin
