#include "identification/torque/torque_limit.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/noise_floor.h"
#include "identification/recording/order_statistics.h"
#include "identification/recording/segments.h"
#include "identification/torque/control_law.h"

namespace servotwin {

namespace {

constexpr double kMinBand = 0.003;  // of the level: a drive controls its current that well
// Within a wider band, or in coarser steps, the torque is flat at every peak.
constexpr double kMaxBand = 0.05, kMaxStep = 0.01;
constexpr double kBandOverNoise = 3.0;   // standard deviations
constexpr double kBeside = 4.0;          // bands below the level, where a moment ends
constexpr double kMinFlat = 0.67;        // between a parabola, 0.5, and a level without noise, 1
constexpr Eigen::Index kMinSamples = 4;  // of a piece
constexpr double kPiece_s = 0.01;
constexpr double kVelocitySpan_s = 2e-3;  // to each side
// In one piece of every moment. An axis that follows lacks a per cent at most while its torque is
// flat; one at its limit lacks most at the end, when the command needs no more and it catches up.
constexpr double kMinLacking = 0.1, kMinLackingOverNoise = 3.0;
constexpr std::size_t kMinPieces = 4;
// Of the recording's highest acceleration: at constant speed friction makes a flat torque too, and
// every ripple of the velocity is more than the command has.
constexpr double kMinAcceleration = 0.3, kMinShareAccelerating = 0.5;  // of the pieces of a moment
constexpr double kMinShareLacking = 0.5;                               // of the pieces, by moments
// By the law: flat at least as a parabola. A law knows the torque to a per cent at best.
constexpr double kMinFlatAsked = 0.5, kMinBeyond = 0.01, kMinBeyondOverError = 4.0;
constexpr double kMinShareAsking = 0.5;       // of the moments
constexpr Eigen::Index kMinSamplesAsked = 3;  // of a moment
constexpr std::size_t kMinMomentsAsking = 2;
// The law is fitted away from the moments; its error counts where the torque is a high one.
constexpr double kLawBefore_s = 3e-3, kLawAfter_s = 0.02, kHighTorque = 0.7;
constexpr int kMinHighSamples = 20;
constexpr double kSettle_s = 0.3;  // after which the loop has forgotten that it was open
// A recorded torque may be behind the motion by as much (diagnosis/torque/torque_lag.h).
constexpr double kBefore_s = 0.02;
constexpr double kMinShareLeft = 0.5;  // of the samples in motion

/// Standard deviation of the noise, from second differences: few of them contain a corner.
double noise_of(const std::vector<Segment>& segments) {
  std::vector<double> second;
  for (const Segment& s : segments) {
    for (Eigen::Index k = 1; k + 1 < s.torque.size(); ++k) {
      const double value = s.torque(k + 1) - 2.0 * s.torque(k) + s.torque(k - 1);
      if (std::isfinite(value)) second.push_back(std::abs(value));
    }
  }
  constexpr double kMedianOfNormal = 0.6745;
  return median(second) / (kMedianOfNormal * std::sqrt(6.0));
}

/// The resolution of the torque.
double step_of(const std::vector<Segment>& segments, double top) {
  constexpr double kShareOfRounding = 1e-9;  // of the top
  double step = top;
  for (const Segment& s : segments) {
    for (Eigen::Index k = 1; k < s.torque.size(); ++k) {
      const double change = std::abs(s.torque(k) - s.torque(k - 1));
      if (change > kShareOfRounding * top) step = std::min(step, change);
    }
  }
  return step;
}

/// The highest commanded acceleration, over pieces.
double peak_acceleration(const std::vector<Segment>& segments) {
  std::vector<double> all;
  for (const Segment& s : segments) {
    const auto span = std::max<Eigen::Index>(1, std::lround(0.5 * kPiece_s / s.sample_time_s));
    const double span_s = s.sample_time_s * static_cast<double>(span);
    for (Eigen::Index k = span; k + span < s.size(); ++k)
      all.push_back(std::abs(s.command(k + span) - 2.0 * s.command(k) + s.command(k - span)) /
                    (span_s * span_s));
  }
  return quantile(std::move(all), kPeakQuantile);
}

/// Samples at which the command moves, behind the lead-in.
Eigen::Index moving_samples(const Segment& s) {
  Eigen::Index count = 0;
  for (Eigen::Index k = std::max<Eigen::Index>(1, s.lead); k < s.size(); ++k)
    count += s.command(k) != s.command(k - 1) ? 1 : 0;
  return count;
}

/// The highest torque that is not a single sample.
double top_of(const std::vector<Segment>& segments) {
  double top = 0.0;
  for (const Segment& s : segments) {
    for (Eigen::Index k = 1; k + 1 < s.torque.size(); ++k) {
      const double a = std::abs(s.torque(k - 1)), b = std::abs(s.torque(k)),
                   c = std::abs(s.torque(k + 1));
      if (std::isfinite(a + b + c))
        top = std::max(top, std::max(std::min(a, b), std::min(std::max(a, b), c)));
    }
  }
  return top;
}

double velocity_at(const Eigen::ArrayXd& x, Eigen::Index k, Eigen::Index span, double step_s) {
  const Eigen::Index from = std::max<Eigen::Index>(0, k - span),
                     to = std::min<Eigen::Index>(x.size() - 1, k + span);
  return to > from ? (x(to) - x(from)) / (step_s * static_cast<double>(to - from)) : 0.0;
}

TorqueLimit::Piece piece_of(const Segment& s, Eigen::Index from, Eigen::Index to, double level,
                            double noise, std::size_t moment) {
  const auto span = std::max<Eigen::Index>(1, std::lround(kVelocitySpan_s / s.sample_time_s));
  const auto change = [&](const Eigen::ArrayXd& x) {
    return velocity_at(x, to, span, s.sample_time_s) - velocity_at(x, from, span, s.sample_time_s);
  };
  const double commanded = change(s.command), measured = change(s.actual),
               lacking = std::abs(commanded - measured),
               larger = std::max(std::abs(commanded), std::abs(measured));
  TorqueLimit::Piece out;
  out.moment = moment;
  out.time_s = s.start_s + 0.5 * s.sample_time_s * static_cast<double>(from + to);
  out.lacking = larger > 0.0 ? lacking / larger : 0.0;
  // Four readings, each over twice the span.
  if (larger > 0.0) out.noise = noise / (s.sample_time_s * static_cast<double>(span)) / larger;
  const double length_s = s.sample_time_s * static_cast<double>(to - from);
  out.lacking_mps2 = lacking / length_s;
  out.acceleration = larger / length_s;
  out.beside_level = s.torque.segment(from, to - from + 1).abs().mean() - level;
  return out;
}

/// Appends the moment of samples `from` to `to`, and its pieces.
void add_moment(const Segment& s, Eigen::Index from, Eigen::Index to, double noise,
                TorqueLimit& out) {
  const auto time = [&](Eigen::Index k) {
    return s.start_s + s.sample_time_s * static_cast<double>(k);
  };
  out.moments.push_back({time(from), time(to)});
  const auto length = std::max<Eigen::Index>(kMinSamples, std::lround(kPiece_s / s.sample_time_s));
  const Eigen::Index samples = to - from + 1;
  if (samples < kMinSamples) return;
  const Eigen::Index count = std::max<Eigen::Index>(1, samples / length);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Index begin = from + i * samples / count,
                       end = from + (i + 1) * samples / count - 1;
    out.pieces.push_back(piece_of(s, begin, end, out.level, noise, out.moments.size() - 1));
  }
}

/// The limit if the torque is flat within this band.
TorqueLimit limit_at(const std::vector<Segment>& segments, double top, double band, double noise) {
  TorqueLimit out;
  std::vector<double> highest;
  for (const Segment& s : segments) {
    for (const double torque : s.torque) {
      const double size = std::abs(torque);
      if (size >= top - 2.0 * band && size <= top + band) highest.push_back(size);
    }
  }
  out.level = median(highest);
  double at = 0.0, near = 0.0;
  for (const Segment& s : segments) {
    if (s.actual.size() != s.command.size() || s.torque.size() != s.command.size()) continue;
    Eigen::Index first = -1, last = -1;
    for (Eigen::Index k = 0; k <= s.size(); ++k) {
      const double size = k < s.size() ? std::abs(s.torque(k)) : -1e300;  // ends the last moment
      const bool inside = size >= out.level - band, beside = size >= out.level - kBeside * band;
      if (beside) near += 1.0;
      if (inside) {
        at += 1.0;
        last = k;
        if (first < 0) first = k;
      }
      if (beside || first < 0) continue;
      add_moment(s, first, last, noise, out);
      first = -1;
    }
  }
  out.flat = near > 0.0 ? at / near : 0.0;
  return out;
}

/// Compares the torque with what the control asks by the law of the samples away from the moments.
void ask(const std::vector<Segment>& segments, TorqueLimit& out) {
  if (out.flat < kMinFlatAsked) return;
  std::vector<std::vector<char>> away;
  for (const Segment& s : segments) {
    std::vector<char>& free = away.emplace_back(static_cast<std::size_t>(s.size()), char{1});
    for (const TorqueLimit::Moment& moment : out.moments) {
      const auto place = [&](double time_s) {
        return std::clamp<Eigen::Index>(std::lround((time_s - s.start_s) / s.sample_time_s), 0,
                                        s.size());
      };
      std::fill(free.begin() + place(moment.begin_s - kLawBefore_s),
                free.begin() + place(moment.end_s + kLawAfter_s), char{0});
    }
  }
  const auto is_away = [&](std::size_t i, Eigen::Index k) {
    return away[i][static_cast<std::size_t>(k)] != 0;
  };
  const std::vector<Eigen::ArrayXd> asked = asked_torque(segments, is_away);
  if (asked.empty()) return;
  double all = 0.0, high = 0.0;
  int all_count = 0, high_count = 0;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& s = segments[i];
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      const double square = std::pow(asked[i](k) - s.torque(k), 2);
      if (!is_away(i, k) || !std::isfinite(square)) continue;
      all += square, ++all_count;
      if (std::abs(s.torque(k)) > kHighTorque * out.level) high += square, ++high_count;
    }
    for (TorqueLimit::Moment& moment : out.moments) {
      if (moment.begin_s < s.start_s || moment.end_s > s.end_s()) continue;
      const Eigen::Index from = std::lround((moment.begin_s - s.start_s) / s.sample_time_s),
                         to = std::lround((moment.end_s - s.start_s) / s.sample_time_s);
      if (to - from + 1 < kMinSamplesAsked) continue;
      const Eigen::Index half = (from + to) / 2, count = to - half + 1;
      const double sign = s.torque(from) > 0.0 ? 1.0 : -1.0;
      moment.beyond =
          sign * (asked[i].segment(half, count) - s.torque.segment(half, count)).mean() / out.level;
    }
  }
  if (all_count == 0) return;
  out.law_error =
      (high_count < kMinHighSamples ? std::sqrt(all / all_count) : std::sqrt(high / high_count)) /
      out.level;
}

/// Whether the control asks for more than the level in most of the moments.
bool asks_for_more(const TorqueLimit& limit) {
  if (limit.flat < kMinFlatAsked) return false;
  std::size_t known = 0, asking = 0;
  for (const TorqueLimit::Moment& moment : limit.moments) {
    if (!std::isfinite(moment.beyond)) continue;
    ++known;
    if (moment.beyond > std::max(kMinBeyond, kMinBeyondOverError * limit.law_error)) ++asking;
  }
  // One moment may be a peak that the law does not reach; and those that are judged must be most.
  return known >= kMinMomentsAsking && 2 * known >= limit.moments.size() &&
         static_cast<double>(asking) >= kMinShareAsking * static_cast<double>(known);
}

}  // namespace

bool TorqueLimit::found() const {
  if (asks_for_more(*this)) return true;
  if (pieces.size() < kMinPieces || flat < kMinFlat) return false;
  const auto lacks = [](const Piece& piece) {
    return piece.lacking > std::max(kMinLacking, kMinLackingOverNoise * piece.noise);
  };
  const auto accelerates = [&](const Piece& piece) {
    return piece.acceleration >= kMinAcceleration * peak_acceleration;
  };
  std::size_t lacking = 0;
  for (auto piece = pieces.begin(); piece != pieces.end();) {
    const auto end = std::find_if(
        piece, pieces.end(), [&](const Piece& other) { return other.moment != piece->moment; });
    const auto fast = static_cast<double>(std::count_if(piece, end, accelerates));
    if (fast >= kMinShareAccelerating * static_cast<double>(end - piece) &&
        std::any_of(piece, end, [&](const Piece& p) { return accelerates(p) && lacks(p); }))
      lacking += static_cast<std::size_t>(end - piece);
    piece = end;
  }
  return static_cast<double>(lacking) >= kMinShareLacking * static_cast<double>(pieces.size());
}

double TorqueLimit::duration_s() const {
  double sum = 0.0;
  for (const Moment& moment : moments) sum += moment.end_s - moment.begin_s;
  return sum;
}

TorqueLimit torque_limit(const std::vector<Segment>& segments) {
  const double top = top_of(segments);
  if (!(top > 0.0)) return {};
  const NoiseFloor floor = noise_floor(segments);
  const double noise =
      std::max(std::isfinite(floor.rms) ? floor.rms : 0.0, floor.encoder_step / std::sqrt(12.0));
  // A limit cuts the noise of the control off, but not that of the measurement.
  const double step = step_of(segments, top), band = std::max(kMinBand * top, step);
  if (step > kMaxStep * top) return {};
  TorqueLimit out = limit_at(segments, top, band, noise);
  out.peak_acceleration = peak_acceleration(segments);
  ask(segments, out);
  const double wide = kBandOverNoise * noise_of(segments);
  if (out.found() || !(wide > band) || wide > kMaxBand * top) return out;
  TorqueLimit other = limit_at(segments, top, wide, noise);
  other.peak_acceleration = out.peak_acceleration;
  ask(segments, other);
  return other;
}

std::vector<Segment> away_from(const TorqueLimit& limit, const std::vector<Segment>& segments) {
  std::vector<Segment> out;
  Eigen::Index all = 0, left = 0;
  for (const Segment& s : segments) {
    all += moving_samples(s);
    double from_s = s.start_s;
    bool open = false;  // the loop was open before
    const auto add = [&](double to_s) {
      for (Segment& part : cut({s}, from_s, to_s)) {
        if (open)
          part.lead = std::max<Eigen::Index>(part.lead, std::lround(kSettle_s / s.sample_time_s));
        if (part.lead >= part.size()) continue;
        left += moving_samples(part);
        out.push_back(std::move(part));
      }
    };
    for (const TorqueLimit::Moment& moment : limit.moments) {
      if (moment.end_s < s.start_s || moment.begin_s > s.end_s()) continue;
      if (moment.begin_s - kBefore_s > from_s) add(moment.begin_s - kBefore_s);
      from_s = moment.end_s;
      open = true;
    }
    add(s.end_s());
  }
  if (static_cast<double>(left) < kMinShareLeft * static_cast<double>(all)) out.clear();
  return out;
}

}  // namespace servotwin
