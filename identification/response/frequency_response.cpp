#include "identification/response/frequency_response.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>
#include <unsupported/Eigen/FFT>

#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::VectorXcd;

constexpr Index kMinWindowSamples = 16;  // samples of a window
constexpr double kShareOfData = 1.0 / 8.0;
constexpr double kMinDeviation = 1e-3;      // of |G|
constexpr Index kFewestLines = 3;           // side by side: one alone may be chance
constexpr double kLeakingLineShare = 1e-3;  // power over the strongest line from which a line leaks
constexpr double kMainLobe = 3.0;           // lines
constexpr double kMinPowerOverLeakage = 10.0;  // least power of an excited input over the leakage
// Reciprocal condition below which inputs are linearly dependent.
constexpr double kMinReciprocalCondition = 1e-10;
// Half overlapping Hann windows of noise correlate by 1/6, neighbouring frequencies of one by 2/3
// and 1/6; their squares count.
constexpr double kOverlap = 1.0 / 36.0;
constexpr double kNeighbours = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0);

/// Inputs, output and instruments of a record, in this order.
std::vector<Eigen::ArrayXd> signals_of(const ResponseRecord& record, bool differenced) {
  std::vector<Eigen::ArrayXd> out = record.inputs;
  out.push_back(record.output);
  out.insert(out.end(), record.instruments.begin(), record.instruments.end());
  for (Eigen::ArrayXd& x : out) {
    if (differenced && x.size() > 0) x = (x.tail(x.size() - 1) - x.head(x.size() - 1)).eval();
  }
  return out;
}

/// The longest length up to `samples` with no factor beyond 5 and an even half.
Index quick_length(Index samples) {
  const auto quick = [](Index n) {
    for (const Index factor : {2, 3, 5}) {
      while (n % factor == 0) n /= factor;
    }
    return n == 1;
  };
  while (samples > 4 && (samples % 4 != 0 || !quick(samples))) --samples;
  return samples;
}

Index window_of(std::span<const ResponseRecord> records, double h, const SpectralOptions& options) {
  Index all = 0, longest = 0;
  for (const ResponseRecord& record : records) {
    all += record.output.size();
    longest = std::max(longest, record.output.size());
  }
  if (options.differenced) --longest;
  const double wanted = options.window_s > 0.0
                            ? options.window_s / h
                            : std::min(kWindow_s / h, kShareOfData * static_cast<double>(all));
  const auto rounded = static_cast<Index>(std::min(wanted + 1e-9, 1e9));
  return options.window_s > 0.0 ? rounded - rounded % 2 : quick_length(std::min(longest, rounded));
}

/// Spectra of all signals with each other, one matrix per frequency: row a, column b is S_ab.
struct Spectra {
  std::vector<MatrixXcd> s;
  int windows = 0;
  double averages = 0.0;

  void close_run(int run) {
    if (run > 0) averages += run / (1.0 + 2.0 * kOverlap * (run - 1.0) / run);
    windows += run;
  }
};

Spectra spectra_of(std::span<const ResponseRecord> records, Index length,
                   const SpectralOptions& options) {
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  const Eigen::ArrayXd window =
      0.5 -
      0.5 * Eigen::ArrayXd::LinSpaced(length, 0.0,
                                      2.0 * std::numbers::pi * static_cast<double>(length - 1) /
                                          static_cast<double>(length))
                .cos();
  const auto windows_in = [&](const ResponseRecord& record) {
    const Index samples = record.output.size() - (options.differenced ? 1 : 0);
    return samples < length ? Index{0} : (samples - length) / (length / 2) + 1;
  };
  Index count = 0;
  for (const ResponseRecord& record : records) count += windows_in(record);

  Spectra out;
  Index number = 0;
  for (const ResponseRecord& record : records) {
    const std::vector<Eigen::ArrayXd> signals = signals_of(record, options.differenced);
    const auto m = static_cast<Index>(signals.size());
    std::vector<VectorXcd> lines(signals.size());
    int run = 0;
    for (Index w = 0; w < windows_in(record); ++w, ++number) {
      const bool odd = 4 * number / count % 2 == 0;
      if (options.windows != Windows::kAll && odd != (options.windows == Windows::kOdd)) {
        out.close_run(run);
        run = 0;
        continue;
      }
      ++run;
      for (std::size_t a = 0; a < signals.size(); ++a) {
        const auto part = signals[a].segment(w * (length / 2), length);
        const Eigen::VectorXd windowed = window * (part - part.mean());
        fft.fwd(lines[a], windowed);
      }
      if (out.s.empty())
        out.s.assign(static_cast<std::size_t>(length / 2 - 1), MatrixXcd::Zero(m, m));
      VectorXcd z(m);
      for (std::size_t k = 0; k < out.s.size(); ++k) {
        for (Index a = 0; a < m; ++a)
          z(a) = lines[static_cast<std::size_t>(a)](static_cast<Index>(k) + 1);
        out.s[k].noalias() += z.conjugate() * z.transpose();
      }
    }
    out.close_run(run);
  }
  return out;
}

/// Upper bound of the leakage of stronger lines into each line of a power spectrum by the Hann
/// window: at d lines from it a sine has 1 / (pi d (d^2 - 1)) of its amplitude.
Eigen::ArrayXd leakage_of(const Eigen::ArrayXd& power) {
  Eigen::ArrayXd out = Eigen::ArrayXd::Zero(power.size());
  const double strong = kLeakingLineShare * power.maxCoeff();
  for (Index j = 0; j < power.size(); ++j) {
    if (power(j) < strong) continue;
    for (Index k = 0; k < power.size(); ++k) {
      const double d = std::abs(static_cast<double>(k - j));
      if (d < kMainLobe) continue;
      const double share = 1.0 / (std::numbers::pi * d * (d * d - 1.0));
      out(k) += power(j) * share * share;
    }
  }
  return out;
}

/// x^H S^-1 x, the power that the signals of S explain of a signal whose cross spectra with them
/// are x; NaN if the signals of S are linearly dependent.
double explained(const MatrixXcd& s, const VectorXcd& x) {
  const Eigen::VectorXd scale = s.diagonal().real().cwiseSqrt().cwiseInverse();
  if (!scale.allFinite()) return std::numeric_limits<double>::quiet_NaN();
  const MatrixXcd scaled = scale.asDiagonal() * s * scale.asDiagonal();
  const VectorXcd y = scale.asDiagonal() * x;
  const Solved solved = solve_square(scaled, y);
  if (!(solved.reciprocal_condition > kMinReciprocalCondition))
    return std::numeric_limits<double>::quiet_NaN();
  return y.dot(solved.x).real();
}

/// The responses at one frequency.
void estimate(const MatrixXcd& s, Index q, bool instruments, double freedom, Index at,
              FrequencyResponse& out) {
  const Index r = instruments ? q + 1 : 0;  // where the instruments begin
  const MatrixXcd uu = s.topLeftCorner(q, q), ru = s.block(r, 0, q, q), rr = s.block(r, r, q, q);
  const VectorXcd uy = s.col(q).head(q), ry = s.col(q).segment(r, q);
  const double yy = s(q, q).real();
  for (Index i = 0; i < q; ++i)
    out.channels[static_cast<std::size_t>(i)].power(at) = s(i, i).real();
  const double together = explained(rr, ry);
  if (!std::isfinite(together) || !(yy > 0.0)) return;
  out.coherence(at) = std::clamp(together / yy, 0.0, 1.0);
  const MatrixXcd inverted = inverse(ru);
  const VectorXcd g = inverted * ry;
  const double vv = std::max(0.0, yy - 2.0 * g.dot(uy).real() + g.dot(uu * g).real());
  const MatrixXcd c = inverted * rr * inverted.adjoint();
  if (!g.allFinite() || !c.allFinite()) return;
  const double chance = 1.0 - std::pow(kChanceOfSignificance, 1.0 / freedom);
  for (Index i = 0; i < q; ++i) {
    ResponseChannel& channel = out.channels[static_cast<std::size_t>(i)];
    const double own = std::norm(g(i)), other = vv * c(i, i).real();
    double coherence = own / (own + other);
    if (instruments) {
      const double known = explained(rr, s.col(i).segment(r, q)) / s(i, i).real();
      coherence = std::min(coherence, std::clamp(known, 0.0, 1.0));
    }
    channel.response(at) = g(i);
    channel.deviation(at) = std::sqrt(other / (2.0 * freedom));
    channel.coherence(at) = coherence;
    channel.significant(at) = coherence > chance;
  }
}

}  // namespace

std::vector<Index> FrequencyResponse::significant(std::size_t channel, double from_hz,
                                                  double to_hz) const {
  std::vector<Index> out;
  const auto says = [&](Index i) {
    return i < frequency_hz.size() && channels[channel].significant(i) &&
           frequency_hz(i) >= from_hz && frequency_hz(i) <= to_hz;
  };
  for (Index i = 0; i < frequency_hz.size();) {
    Index end = i;
    while (says(end)) ++end;
    for (Index k = i; k < end && end - i >= kFewestLines; ++k) out.push_back(k);
    i = end + 1;
  }
  return out;
}

ResponsePoints FrequencyResponse::points(std::size_t channel,
                                         const std::vector<Index>& places) const {
  const ResponseChannel& from = channels[channel];
  ResponsePoints out;
  out.overlap = kNeighbours;
  out.omega = 2.0 * std::numbers::pi * frequency_hz(places);
  out.response = from.response(places).matrix();
  out.deviation = from.deviation(places).max(kMinDeviation * from.response(places).abs()).matrix();
  return out;
}

FrequencyResponse frequency_response(std::span<const ResponseRecord> records, double sample_time_s,
                                     const SpectralOptions& options) {
  const auto q = static_cast<Index>(records.front().inputs.size());
  const Index length = window_of(records, sample_time_s, options);
  char words[200];
  if (length < kMinWindowSamples) {
    std::snprintf(
        words, sizeof words,
        "a window of %.4g s has %td samples, it needs %td: use longer windows or a "
        "longer recording",
        options.window_s > 0.0 ? options.window_s : sample_time_s * static_cast<double>(length),
        length, kMinWindowSamples);
    throw std::runtime_error(words);
  }
  const Spectra spectra = spectra_of(records, length, options);
  const double freedom = spectra.averages - static_cast<double>(q);
  if (freedom < kFewestAverages) {
    std::snprintf(
        words, sizeof words,
        "%d window%s of %.4g s %s %.1f independent averages, too few to estimate coherence "
        "(at least %.0f): use shorter windows or a longer recording",
        spectra.windows, spectra.windows == 1 ? "" : "s",
        sample_time_s * static_cast<double>(length), spectra.windows == 1 ? "gives" : "give",
        spectra.averages, kFewestAverages + static_cast<double>(q));
    throw std::runtime_error(words);
  }
  FrequencyResponse out;
  out.sample_time_s = sample_time_s;
  out.window_s = sample_time_s * static_cast<double>(length);
  out.windows = spectra.windows;
  out.averages = spectra.averages;
  const auto n = static_cast<Index>(spectra.s.size());
  out.frequency_hz = Eigen::ArrayXd::LinSpaced(n, 1.0, static_cast<double>(n)) / out.window_s;
  out.coherence.setConstant(n, std::numeric_limits<double>::quiet_NaN());
  ResponseChannel empty{Eigen::ArrayXcd::Constant(n, std::numeric_limits<double>::quiet_NaN()),
                        out.coherence,
                        out.coherence,
                        Eigen::ArrayXd::Zero(n),
                        {}};
  empty.significant.setConstant(n, false);
  out.channels.assign(static_cast<std::size_t>(q), empty);
  for (Index i = 0; i < n; ++i)
    estimate(spectra.s[static_cast<std::size_t>(i)], q, !records.front().instruments.empty(),
             freedom, i, out);
  for (ResponseChannel& channel : out.channels) {
    channel.significant =
        channel.significant && channel.power > kMinPowerOverLeakage * leakage_of(channel.power);
    channel.power /= std::max(channel.power.sum(), 1e-300);
  }
  return out;
}

}  // namespace servotwin
