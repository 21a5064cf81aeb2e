#include "diagnosis/statistics/residual.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace servotwin {
namespace {

constexpr double kMovingSpeedShare = 0.005;  // of the peak speed, above which the axis moves
constexpr double kAcceleratingShare = 0.05;  // of the peak acceleration, above which it accelerates
// Change of speed over the span, as a share of the peak speed, that rounding of the command can
// make in a motion at constant speed.
constexpr double kRoundingSpeedShare = 0.001;

// Number of samples at a torque limit over the number one digit below it.
constexpr double kMinLimitCountRatio = 5.0;
// Least share of a limit in the largest torque in either direction.
constexpr double kMinLimitShareOfPeak = 0.5;
constexpr double kMinLimitRun_s = 0.003;

Eigen::Index samples_in(double time_s, double h) {
  return std::max<Eigen::Index>(1, static_cast<Eigen::Index>(std::lround(time_s / h)));
}

/// Half the span of the differences for velocity and acceleration, in whole samples [s].
double span_s(double h) { return static_cast<double>(samples_in(kRegimeSpan_s, h)) * h; }

}  // namespace

CommandMotion motion_of(const ResidualStretch& stretch) {
  const Eigen::Index n = stretch.command.size();
  const Eigen::Index m = samples_in(kRegimeSpan_s, stretch.h);
  const double span = span_s(stretch.h);
  CommandMotion motion;
  motion.velocity = Eigen::ArrayXd::Constant(n, std::numeric_limits<double>::quiet_NaN());
  motion.acceleration = motion.velocity;
  const auto& x = stretch.command;
  for (Eigen::Index k = m; k + m < n; ++k) {
    motion.velocity(k) = (x(k + m) - x(k - m)) / (2 * span);
    motion.acceleration(k) = (x(k + m) - 2 * x(k) + x(k - m)) / (span * span);
  }
  return motion;
}

namespace {

double peak(const Eigen::ArrayXd& values) {
  double largest = 0.0;
  for (const double value : values) {
    if (std::isfinite(value)) largest = std::max(largest, std::abs(value));
  }
  return largest;
}

/// Marks the samples near a reversal of the command.
std::vector<bool> reversals(const Eigen::ArrayXd& velocity, double moving, double h) {
  const Eigen::Index n = velocity.size();
  const Eigen::Index window = samples_in(kReversalWindow_s, h);
  std::vector<bool> reversal(static_cast<std::size_t>(n), false);
  int direction = 0;
  Eigen::Index last_moving = 0;
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(std::abs(velocity(k)) > moving)) continue;
    const int now = velocity(k) > 0 ? 1 : -1;
    if (direction != 0 && now != direction) {
      const bool without_stop = k - last_moving <= window;
      const Eigen::Index from = without_stop ? std::max<Eigen::Index>(0, last_moving - window) : k;
      const Eigen::Index to = std::min(n - 1, k + window);
      for (Eigen::Index i = from; i <= to; ++i) reversal[static_cast<std::size_t>(i)] = true;
    }
    direction = now;
    last_moving = k;
  }
  return reversal;
}

}  // namespace

Eigen::ArrayXd at_limit(const Eigen::ArrayXd& torque, double h) {
  Eigen::ArrayXd out;
  const Eigen::Index shortest = std::max<Eigen::Index>(3, samples_in(kMinLimitRun_s, h));
  for (const double sign : {1.0, -1.0}) {
    double most = -std::numeric_limits<double>::infinity(), next = most;
    for (const double value : sign* torque) {
      if (value > most) next = most, most = value;
      if (value < most && value > next) next = value;
    }
    const auto count = [&](double value) {
      return static_cast<double>((sign * torque == value).count());
    };
    // A constant torque, and one that is 0 at rest, also has many samples at its extreme.
    if (!std::isfinite(next) || !(most > kMinLimitShareOfPeak * torque.abs().maxCoeff()) ||
        !(count(most) > kMinLimitCountRatio * count(next)))
      continue;
    for (Eigen::Index k = 0, run = 0; k < torque.size(); ++k) {
      run = sign * torque(k) == most ? run + 1 : 0;
      if (run < shortest) continue;
      if (out.size() == 0) out = Eigen::ArrayXd::Zero(torque.size());
      out.segment(k - run + 1, run).setOnes();
    }
  }
  return out;
}

std::string_view name_of(Regime regime) {
  switch (regime) {
    case Regime::kStandstill:
      return "standstill";
    case Regime::kConstantSpeed:
      return "constant_speed";
    case Regime::kAcceleration:
      return "acceleration";
    case Regime::kReversal:
      return "reversal";
    case Regime::kSaturation:
      return "saturation";
  }
  return "";
}

RegimeShares by_regime(std::span<const ResidualStretch> stretches) {
  std::vector<CommandMotion> motions;
  motions.reserve(stretches.size());
  double moving = 0.0, accelerating = 0.0;
  for (const ResidualStretch& stretch : stretches) {
    if (stretch.command.size() != stretch.residual.size()) {
      throw std::invalid_argument("by_regime: " + std::to_string(stretch.command.size()) +
                                  " commands but " + std::to_string(stretch.residual.size()) +
                                  " residuals");
    }
    if (!(stretch.h > 0.0)) {
      throw std::invalid_argument("by_regime: sampling time " + std::to_string(stretch.h) +
                                  " s must be positive");
    }
    motions.push_back(motion_of(stretch));
    const double top_speed = peak(motions.back().velocity);
    const double steady = kRoundingSpeedShare * top_speed / (2 * span_s(stretch.h));
    moving = std::max(moving, kMovingSpeedShare * top_speed);
    accelerating =
        std::max({accelerating, kAcceleratingShare * peak(motions.back().acceleration), steady});
  }

  RegimeShares shares;
  for (std::size_t i = 0; i < kRegimes; ++i) shares[i].regime = static_cast<Regime>(i);
  std::array<double, kRegimes> squares{};
  Eigen::Index samples = 0;
  for (std::size_t s = 0; s < stretches.size(); ++s) {
    const ResidualStretch& stretch = stretches[s];
    const CommandMotion& motion = motions[s];
    const auto reversal = reversals(motion.velocity, moving, stretch.h);
    for (Eigen::Index k = 0; k < stretch.residual.size(); ++k) {
      const double r = stretch.residual(k);
      const double v = std::abs(motion.velocity(k)), a = std::abs(motion.acceleration(k));
      if (!std::isfinite(r) || !std::isfinite(v) || !std::isfinite(a)) continue;
      const bool saturated = stretch.saturated.size() > k && stretch.saturated(k) > 0.0;
      const Regime regime = saturated                               ? Regime::kSaturation
                            : reversal[static_cast<std::size_t>(k)] ? Regime::kReversal
                            : v <= moving                           ? Regime::kStandstill
                            : a <= accelerating                     ? Regime::kConstantSpeed
                                                                    : Regime::kAcceleration;
      const auto i = static_cast<std::size_t>(regime);
      ++shares[i].samples;
      ++samples;
      squares[i] += r * r;
      shares[i].max = std::max(shares[i].max, std::abs(r));
    }
  }
  double all = 0.0;
  for (const double sum : squares) all += sum;
  for (std::size_t i = 0; i < kRegimes; ++i) {
    if (shares[i].samples == 0) continue;
    shares[i].rms = std::sqrt(squares[i] / static_cast<double>(shares[i].samples));
    shares[i].time_share = static_cast<double>(shares[i].samples) / static_cast<double>(samples);
    shares[i].share = all > 0.0 ? squares[i] / all : 0.0;
  }
  return shares;
}

RegimeShares by_regime(const Eigen::ArrayXd& command, const Eigen::ArrayXd& residual, double h) {
  const ResidualStretch stretch{command, residual, h};
  return by_regime(std::span(&stretch, 1));
}

}  // namespace servotwin
