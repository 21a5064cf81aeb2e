#include "diagnosis/evidence/encoder_difference.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>
#include <vector>

#include "diagnosis/statistics/pieces.h"
#include "diagnosis/statistics/text.h"
#include "diagnosis/statistics/thresholds.h"
#include "identification/model/json_number.h"
#include "identification/recording/noise_floor.h"
#include "identification/recording/order_statistics.h"
#include "identification/recording/signals.h"
#include "twin/shown_units.h"

namespace servotwin {
namespace {

constexpr int kMinMoves = 6;  // fewer give no interval that is worth its name
// A load crosses a gap of 0.1 mm at 0.05 m/s^2 within 63 ms, and its impact rings some cycles more.
constexpr double kSettled_s = 0.1;
// The same where it brakes hard, at 0.5 m/s^2 and more beyond friction.
constexpr double kSettledBraking_s = 0.03;
// Of the hardest braking: a load that ever goes over to the other side does so there.
constexpr double kHardShare = 0.7;
constexpr double kMinSpeedShare = 1e-3, kMinAccelerationShare = 0.02;  // of the largest: it is zero
constexpr double kMinDeviations = 5.0;                                 // the same of noise
constexpr double kMinOwnShare = 1e-3;  // of a column's square that the columns before do not give

// Columns in the order in which they are preferred where the motion does not distinguish them.
enum Column { kOne, kReversal, kCompliance, kScale, kDelay, kOtherSide, kDamping, kColumns };
using Row = Eigen::Matrix<double, kColumns + 1, 1>;
using Gram = Eigen::Matrix<double, kColumns + 1, kColumns + 1>;
using Coefficients = Eigen::Matrix<double, kColumns, 1>;

bool has_motor(const Segment& s) {
  return s.actual_motor.size() > 0 && s.actual.size() == s.actual_motor.size();
}

/// The mean of 2 m + 1 samples, fewer at the ends, as of measured_velocity.
Eigen::ArrayXd centred_mean(const Eigen::ArrayXd& x, Eigen::Index m) {
  Eigen::ArrayXd sum(x.size() + 1), out(x.size());
  sum(0) = 0.0;
  for (Eigen::Index k = 0; k < x.size(); ++k) sum(k + 1) = sum(k) + x(k);
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    const Eigen::Index w = std::min({m, k, x.size() - 1 - k});
    out(k) = (sum(k + w + 1) - sum(k - w)) / static_cast<double>(2 * w + 1);
  }
  return out;
}

/// An unbroken part, filtered.
struct Filtered {
  double h = 0.0;
  Eigen::Index half = 0;  ///< of one of the two means
  Eigen::ArrayXd difference, motor, load, velocity, acceleration, jerk;
};

std::vector<Filtered> filtered(const std::vector<Segment>& segments) {
  std::vector<Filtered> out;
  for (const Segment& s : segments) {
    if (!has_motor(s)) continue;
    const double h = s.sample_time_s;
    const Eigen::Index m = std::min(5, static_cast<int>(0.5 * kVelocityMean_s / h));
    for (Eigen::Index begin = 0, end = 0; begin < s.size(); begin = end + 1) {
      end = begin;
      while (end < s.size() && std::isfinite(s.actual_motor(end))) ++end;
      const Eigen::Index n = end - begin;
      if (n < 8 * m + 8) continue;
      Filtered one{h,  m,  {}, s.actual_motor.segment(begin, n), s.actual.segment(begin, n),
                   {}, {}, {}};
      one.difference = centred_mean(centred_mean(one.load - one.motor, m), m);
      const Eigen::ArrayXd velocity = measured_velocity(one.load, h, static_cast<int>(m));
      one.acceleration = measured_velocity(velocity, h, static_cast<int>(m));
      one.velocity = centred_mean(velocity, m);
      one.jerk = measured_velocity(one.acceleration, h, 0);
      // The means are shorter at the ends, where noise would look like the hardest braking.
      const Eigen::Index edge = 2 * m + 2;
      for (auto* values :
           {&one.difference, &one.motor, &one.load, &one.velocity, &one.acceleration, &one.jerk})
        *values = values->segment(edge, n - 2 * edge).eval();
      out.push_back(std::move(one));
    }
  }
  return out;
}

/// Noise and step of one encoder.
NoiseFloor resolution_of(const std::vector<Filtered>& parts, Eigen::ArrayXd Filtered::*encoder) {
  std::vector<Segment> segments(parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i) {
    segments[i].sample_time_s = parts[i].h;
    // No error, since noise from lap to lap is not wanted.
    segments[i].command = segments[i].actual = parts[i].*encoder;
  }
  return noise_floor(segments);
}

struct Extent {
  double velocity = 0.0, acceleration = 0.0, jerk = 0.0, braking = 0.0;  ///< largest ones
  double min_velocity = 0.0, min_acceleration = 0.0;                     ///< else it is zero
  double travel = 0.0;  ///< of the motor until it must have taken the load along
  double position = 0.0, span = 0.0, offset = 0.0;  ///< mean, and largest deviation from it
};

Extent extent_of(const std::vector<Filtered>& parts, double noise) {
  Extent out;
  double low = HUGE_VAL, high = -HUGE_VAL, from = HUGE_VAL, to = -HUGE_VAL;
  for (const Filtered& p : parts) {
    low = std::min(low, p.difference.minCoeff()), high = std::max(high, p.difference.maxCoeff());
    from = std::min(from, p.load.minCoeff()), to = std::max(to, p.load.maxCoeff());
    out.velocity = std::max(out.velocity, p.velocity.abs().maxCoeff());
    out.acceleration = std::max(out.acceleration, p.acceleration.abs().maxCoeff());
    out.jerk = std::max(out.jerk, p.jerk.abs().maxCoeff());
  }
  const double window = parts.front().h * static_cast<double>(2 * parts.front().half + 1);
  out.min_velocity = std::max(kMinSpeedShare * out.velocity, kMinDeviations * noise / window);
  out.min_acceleration = std::max(kMinAccelerationShare * out.acceleration,
                                  kMinDeviations * std::sqrt(3.0) * noise / (window * window));
  for (const Filtered& p : parts) {
    const Eigen::ArrayXd braking = -p.acceleration * p.velocity.sign();
    out.braking = std::max(out.braking,
                           (p.velocity.abs() > out.min_velocity).select(braking, 0.0).maxCoeff());
  }
  out.travel = high - low;
  out.offset = 0.5 * (high + low);
  out.position = 0.5 * (from + to), out.span = 0.5 * (to - from);
  return out;
}

/// The sums of an interval of a move.
struct Cluster {
  int move = 0;
  Gram sums = Gram::Zero();
};

/// Where the load is.
enum class Side : char { kUnknown, kDriven, kBraking };

std::vector<Side> sides_of(const Filtered& p, const Extent& extent, std::vector<int>& move,
                           int& moves) {
  std::vector<Side> out(static_cast<std::size_t>(p.load.size()), Side::kUnknown);
  move.assign(out.size(), 0);
  double direction = 0.0, travel = 0.0, since_braking_s = 0.0, braking_s = 0.0;
  for (Eigen::Index k = 1; k < p.load.size(); ++k) {
    const double v = p.velocity(k);
    const double now = std::abs(v) > extent.min_velocity ? std::copysign(1.0, v) : 0.0;
    if (now != direction) {
      direction = now, travel = 0.0, since_braking_s = HUGE_VAL, braking_s = 0.0;
      if (now != 0.0) ++moves;
    }
    const auto at = static_cast<std::size_t>(k);
    move[at] = moves;
    if (now == 0.0) continue;
    travel += std::abs(p.motor(k) - p.motor(k - 1));
    const double speeding = now * p.acceleration(k);
    if (speeding < -extent.min_acceleration) {
      since_braking_s = 0.0, braking_s += p.h;
      if (braking_s >= kSettledBraking_s && -speeding >= kHardShare * extent.braking)
        out[at] = Side::kBraking;
    } else {
      since_braking_s += p.h, braking_s = 0.0;
      if (travel >= extent.travel && since_braking_s >= kSettled_s) out[at] = Side::kDriven;
    }
  }
  return out;
}

std::vector<Cluster> clusters_of(const std::vector<Filtered>& parts, const Extent& extent) {
  std::vector<Cluster> out;
  std::vector<int> move;
  int moves = 0;
  for (const Filtered& p : parts) {
    const std::vector<Side> sides = sides_of(p, extent, move, moves);
    const auto piece = std::max<Eigen::Index>(1, std::lround(kPiece_s / p.h));
    const Eigen::Index reach = 2 * p.half + 1;  // of the filter
    Eigen::Index last = -1;
    for (Eigen::Index k = reach; k + reach < p.load.size(); ++k) {
      const auto at = static_cast<std::size_t>(k), by = static_cast<std::size_t>(reach);
      const Side side = sides[at];
      if (side == Side::kUnknown || sides[at - by] != side || sides[at + by] != side) continue;
      if (out.empty() || out.back().move != move[at] || k / piece != last)
        out.push_back({move[at], Gram::Zero()});
      last = k / piece;
      const double s = std::copysign(1.0, p.velocity(k));
      Row row;
      row(kOne) = 1.0;
      row(kReversal) = -0.5 * s;
      row(kCompliance) = -p.acceleration(k) / extent.acceleration;
      row(kScale) = (p.load(k) - extent.position) / extent.span;
      row(kDelay) = -p.velocity(k) / extent.velocity;
      row(kDamping) = -p.jerk(k) / extent.jerk;
      row(kOtherSide) = side == Side::kBraking ? s : 0.0;
      row(kColumns) = p.difference(k) - extent.offset;
      out.back().sums.noalias() += row * row.transpose();
    }
  }
  return out;
}

Gram total_of(const std::vector<Cluster>& clusters) {
  Gram out = Gram::Zero();
  for (const Cluster& cluster : clusters) out += cluster.sums;
  return out;
}

/// The columns that the motion distinguishes from those before them.
std::vector<int> distinct(const Gram& sums) {
  std::vector<int> out;
  for (int k = 0; k < kColumns; ++k) {
    if (!(sums(k, k) > 0.0)) continue;
    const Eigen::VectorXd with = sums(out, k);
    const Eigen::MatrixXd gram = sums(out, out);
    const double own = sums(k, k) - (out.empty() ? 0.0 : with.dot(gram.ldlt().solve(with)));
    if (own > kMinOwnShare * sums(k, k)) out.push_back(k);
  }
  return out;
}

Coefficients solved(const Gram& sums, const std::vector<int>& columns) {
  const Eigen::MatrixXd gram = sums(columns, columns);
  const Eigen::VectorXd found = gram.ldlt().solve(Eigen::VectorXd(sums.col(kColumns)(columns)));
  Coefficients out = Coefficients::Constant(kAbsent);
  out(columns) = found;
  return out;
}

/// Mean square that a fit leaves.
double mean_square_left(const Coefficients& found, const std::vector<int>& columns,
                        const Gram& sums) {
  Row with = Row::Zero();
  with(columns) = found(columns);
  with(kColumns) = -1.0;
  return std::max(0.0, with.dot(sums * with)) / sums(kOne, kOne);
}

/// The clusters without those in which something else happened: a cut, an impact, a load that
/// sticks and slips.
std::vector<Cluster> without_outliers(const std::vector<Cluster>& all) {
  constexpr int kPasses = 3;
  constexpr double kMaxOverMedian = 9.0;  // three times its RMS
  std::vector<Cluster> kept = all;
  for (int pass = 0; pass < kPasses; ++pass) {
    const Gram sums = total_of(kept);
    const std::vector<int> columns = distinct(sums);
    const Coefficients found = solved(sums, columns);
    std::vector<double> left;
    for (const Cluster& one : all) left.push_back(mean_square_left(found, columns, one.sums));
    const double most = kMaxOverMedian * median(left);
    kept.clear();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (left[i] <= most) kept.push_back(all[i]);
    }
  }
  return kept;
}

/// Half of the 95 % intervals by the fits without one cluster each (Tukey's jackknife).
Coefficients half_widths(const Gram& all, const std::vector<Gram>& clusters,
                         const std::vector<int>& columns) {
  const auto n = static_cast<double>(clusters.size());
  Coefficients mean = Coefficients::Zero(), square = Coefficients::Zero();
  const Coefficients whole = solved(all, columns);
  for (const Gram& one : clusters) {
    const Coefficients by = solved(all - one, columns) - whole;
    mean += by / n, square += by.cwiseAbs2();
  }
  // Student's t of n - 1 degrees of freedom (Cornish and Fisher's expansion to the second order).
  const double z = kOf95, f = n - 1.0, z3 = z * z * z;
  const double t =
      z + (z3 + z) / (4.0 * f) + (5.0 * z3 * z * z + 16.0 * z3 + 3.0 * z) / (96.0 * f * f);
  return t * ((square - n * mean.cwiseAbs2()).cwiseMax(0.0) * (f / n)).cwiseSqrt();
}

Coefficients half_widths(const Gram& all, const std::vector<Cluster>& clusters,
                         const std::vector<int>& columns) {
  std::vector<Gram> pieces, moves;
  int move = -1;
  for (const Cluster& cluster : clusters) {
    pieces.push_back(cluster.sums);
    if (cluster.move != move) moves.push_back(Gram::Zero());
    moves.back() += cluster.sums;
    move = cluster.move;
  }
  return half_widths(all, pieces, columns).cwiseMax(half_widths(all, moves, columns));
}

int moves_in(const std::vector<Cluster>& clusters) {
  int out = 0, last = -1;
  for (const Cluster& cluster : clusters) out += std::exchange(last, cluster.move) != cluster.move;
  return out;
}

double natural_hz(double compliance) {
  return 1.0 / (2.0 * std::numbers::pi * std::sqrt(compliance));
}

/// " of 12.1 um (11.8 to 12.4)".
std::string sized(const EncoderDifference::Term& term, bool rotary) {
  return text(" of %.4g %s (%.4g to %.4g)", 1e6 * term.value, micro(rotary), 1e6 * term.low,
              1e6 * term.high);
}

}  // namespace

std::optional<EncoderErrors> encoder_errors(const std::vector<Segment>& segments) {
  double count = 0.0, sum = 0.0;
  for (const Segment& s : segments) {
    if (!has_motor(s)) continue;
    const auto known = s.actual_motor.isFinite();
    count += static_cast<double>(known.count());
    sum += known.select(s.actual - s.actual_motor, 0.0).sum();
  }
  if (count == 0.0) return std::nullopt;
  EncoderErrors out;
  for (const Segment& s : segments) {
    if (!has_motor(s)) continue;
    const auto known = s.actual_motor.isFinite();
    const Eigen::ArrayXd load = known.select(s.command - s.actual, 0.0),
                         motor = known.select(s.command - s.actual_motor - sum / count, 0.0);
    out.motor_rms += motor.square().sum() / count, out.load_rms += load.square().sum() / count;
    out.motor_max = std::max(out.motor_max, motor.abs().maxCoeff());
    out.load_max = std::max(out.load_max, load.abs().maxCoeff());
  }
  out.motor_rms = std::sqrt(out.motor_rms), out.load_rms = std::sqrt(out.load_rms);
  return out;
}

std::string errors_text(const EncoderErrors& errors, bool rotary) {
  const char* unit = micro(rotary);
  return text("%.4g %s RMS, %.4g MAX at the motor; %.4g %s RMS, %.4g MAX at the load",
              1e6 * errors.motor_rms, unit, 1e6 * errors.motor_max, 1e6 * errors.load_rms, unit,
              1e6 * errors.load_max);
}

bool EncoderDifference::spring() const { return compliance.shown && compliance.value > 0.0; }

double EncoderDifference::friction() const {
  return 0.5 * (reversal.value - (other_side.shown ? other_side.value : 0.0)) / compliance.value;
}

bool EncoderDifference::changes_sides() const {
  return std::isfinite(other_side.value) && friction() < kHardShare * braking;
}

EncoderDifference::Term EncoderDifference::play() const {
  constexpr double kMaxFriction_mps2 = 10.0;  // of a linear axis: as high as its weight
  if (!(reversal.shown && reversal.value > 0.0)) return {};
  if (!spring()) return reversal;
  if (changes_sides()) return other_side.shown ? other_side : Term();
  return !rotary && friction() > kMaxFriction_mps2 ? reversal : Term();
}

bool EncoderDifference::undecided() const {
  return reversal.shown && reversal.value > 0.0 && !play().shown && !changes_sides();
}

std::optional<EncoderDifference> encoder_difference(const SegmentedAxis& axis) {
  const std::optional<EncoderErrors> errors = encoder_errors(axis.segments);
  if (!errors) return std::nullopt;
  EncoderDifference out;
  out.rotary = axis.rotary;
  out.errors = *errors;
  const std::vector<Filtered> parts = filtered(axis.segments);
  if (parts.empty()) return out;
  double noise = 0.0;
  for (const auto encoder : {&Filtered::motor, &Filtered::load}) {
    constexpr double kDeviations = 3.0;
    const NoiseFloor floor = resolution_of(parts, encoder);
    if (std::isfinite(floor.white.rms)) noise = std::hypot(noise, floor.white.rms);
    out.resolution = std::max({out.resolution, floor.encoder_step, kDeviations * noise});
  }
  double count = 0.0, sum = 0.0, square = 0.0;
  for (const Filtered& p : parts) count += static_cast<double>(p.load.size());
  for (const Filtered& p : parts) sum += (p.load - p.motor).sum() / count;
  for (const Filtered& p : parts) square += (p.load - p.motor - sum).square().sum() / count;
  out.rms = std::sqrt(square);

  const Extent extent = extent_of(parts, noise);
  out.braking = extent.braking;
  if (!(extent.velocity > 0.0)) return out;
  const std::vector<Cluster> all = clusters_of(parts, extent);
  if (moves_in(all) < kMinMoves) {
    out.moves = moves_in(all);
    return out;
  }
  const std::vector<Cluster> clusters = without_outliers(all);
  out.moves = moves_in(clusters);
  if (out.moves < kMinMoves) return out;
  const Gram sums = total_of(clusters);
  const std::vector<int> columns = distinct(sums);
  const Coefficients found = solved(sums, columns), half = half_widths(sums, clusters, columns);
  const Gram whole = total_of(all);  // what is not explained is of all of them
  const double rows = whole(kOne, kOne);
  out.used_rms = std::sqrt(
      std::max(0.0, whole(kColumns, kColumns) / rows - std::pow(whole(kOne, kColumns) / rows, 2)));
  out.left_rms = std::sqrt(mean_square_left(found, columns, whole));
  // Every column is at most 1: its coefficient is what the term contributes at most.
  const auto term = [&](Column k, double unit) {
    return EncoderDifference::Term{found(k) / unit, (found(k) - half(k)) / unit,
                                   (found(k) + half(k)) / unit,
                                   std::abs(found(k)) > std::max(half(k), out.resolution)};
  };
  out.reversal = term(kReversal, 1.0);
  out.other_side = term(kOtherSide, 1.0);
  out.compliance = term(kCompliance, extent.acceleration);
  out.delay = term(kDelay, extent.velocity);
  out.scale = term(kScale, extent.span);
  return out;
}

std::string plain_text(const EncoderDifference& d) {
  const char* unit = micro(d.rotary);
  const std::string apart = text("%.3g %s RMS", 1e6 * d.rms, unit);
  if (d.moves < kMinMoves)
    return "The two encoders differ by " + apart +
           text(
               "; why is judged from %d moves on, with a rest or a reversal between them, and the "
               "recording has %d",
               kMinMoves, d.moves) +
           ".";
  std::vector<std::string> shown;
  if (const auto play = d.play(); play.shown) shown.push_back("play" + sized(play, d.rotary));
  if (d.spring()) {
    std::string line =
        text("a spring on which the load swings at %.4g Hz", natural_hz(d.compliance.value));
    if (d.compliance.low > 0.0)
      line += text(" (%.4g to %.4g)", natural_hz(d.compliance.high), natural_hz(d.compliance.low));
    shown.push_back(line);
    const double wound = d.reversal.value - (d.play().shown ? d.play().value : 0.0);
    if (d.undecided())
      shown.push_back("a step" + sized(d.reversal, d.rotary) +
                      " at reversals, by play or by friction that winds up the spring (to tell: "
                      "brake harder)");
    else if (d.reversal.shown && wound > d.resolution)
      shown.push_back(text("%.3g %s by which friction winds it up from one direction to the other",
                           1e6 * wound, unit));
  }
  if (d.delay.shown)
    shown.push_back(
        text("%.4g us (%.4g to %.4g) by which the load's encoder is read later, or drag "
             "winds it up",
             1e6 * d.delay.value, 1e6 * d.delay.low, 1e6 * d.delay.high));
  if (d.scale.shown)
    shown.push_back(text("a pitch error or scale of %.4g %s/%s (%.4g to %.4g)", 1e6 * d.scale.value,
                         unit, d.rotary ? "rad" : "m", 1e6 * d.scale.low, 1e6 * d.scale.high));
  std::string out;
  for (const std::string& one : shown) out += (out.empty() ? "" : ", ") + one;
  if (out.empty()) {
    out = d.rms <= d.resolution ? "The two encoders agree to " + apart
                                : "The two encoders differ by " + apart +
                                      ", which neither play nor a spring explains";
  } else {
    out = "Between the encoders: " + out +
          text("; %.2g %s of the %.3g %s RMS in motion are left unexplained", 1e6 * d.left_rms,
               unit, 1e6 * d.used_rms, unit);
  }
  if (d.reversal.shown && d.reversal.value < 0.0)
    out += text(
        ". At reversals the load is ahead of the motor by %.3g %s: are the two encoders "
        "exchanged?",
        -1e6 * d.reversal.value, unit);
  return out + (out.back() == '?' ? "" : ".");
}

std::string encoders_beside(const EncoderDifference& d, const std::string& cause) {
  if (d.moves < kMinMoves || (cause != "backlash" && cause != "compliance")) return {};
  if (cause == "backlash" && d.undecided()) return {};
  const bool shown = cause == "backlash" ? d.play().shown : d.spring();
  if (!shown) return "the two encoders do not show it: it is not between them";
  return "between the two encoders there is " +
         (cause == "backlash" ? "play" + sized(d.play(), d.rotary)
                              : text("a spring of %.4g Hz", natural_hz(d.compliance.value)));
}

nlohmann::json to_json(const EncoderDifference& d) {
  const auto term = [](const EncoderDifference::Term& t) {
    return nlohmann::json{{"value", number_or_null(t.value)},
                          {"ci95", {number_or_null(t.low), number_or_null(t.high)}},
                          {"shown", t.shown}};
  };
  return {
      {"motor_error_rms_m", d.errors.motor_rms},
      {"motor_error_max_m", d.errors.motor_max},
      {"load_error_rms_m", d.errors.load_rms},
      {"load_error_max_m", d.errors.load_max},
      {"rms_m", d.rms},
      {"resolution_m", d.resolution},
      {"moves", d.moves},
      {"moves_rms_m", number_or_null(d.used_rms)},
      {"moves_left_rms_m", number_or_null(d.left_rms)},
      {"play_m", term(d.play())},
      {"step_at_reversals_m", term(d.reversal)},
      {"step_while_braking_m", term(d.other_side)},
      {"compliance_s2", term(d.compliance)},
      {"spring_hz", d.spring() ? nlohmann::json(natural_hz(d.compliance.value)) : nlohmann::json()},
      {"delay_s", term(d.delay)},
      {"scale", term(d.scale)},
      {"text", plain_text(d)}};
}

}  // namespace servotwin
