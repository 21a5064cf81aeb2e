#include "identification/response/response_modes.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <numbers>
#include <stdexcept>

namespace servotwin {

namespace {

constexpr int kMaxModeOrder = 12;
constexpr std::size_t kPointsPerPole = 6;
constexpr std::size_t kFewestPoints = 12;
constexpr double kMinPower = 0.01;  // share of the input's power at the fitted frequencies
constexpr double kMinFrequency_lines =
    2.0;  // in lines: below them the removed mean distorts the spectrum
constexpr double kMaxFrequencyOverSamplingRate = 0.4;  // of the sampling rate

bool usable(const ResponsePoints& points) {
  return points.response.allFinite() && (points.deviation.array() > 0.0).all() &&
         points.deviation.allFinite();
}

FittedResponse fitted(std::span<const ResponseRecord> records, double sample_time_s,
                      const ModeOptions& options) {
  FittedResponse out;
  out.response = frequency_response(records, sample_time_s, options.spectra);
  const FrequencyResponse& whole = out.response;
  out.fitted = whole.significant(0, (kMinFrequency_lines - 0.5) / whole.window_s,
                                 kMaxFrequencyOverSamplingRate / sample_time_s);
  if (out.fitted.size() < kFewestPoints) {
    out.declined = "only " + std::to_string(out.fitted.size()) +
                   " frequencies have significant coherence, a fit needs " +
                   std::to_string(kFewestPoints);
    return out;
  }
  if (const double power = whole.channels[0].power(out.fitted).sum(); power < kMinPower) {
    char words[160];
    std::snprintf(
        words, sizeof words,
        "only %.2g %% of the input's power is at frequencies with significant coherence: the "
        "output is not a linear response to the input",
        100.0 * power);
    out.declined = words;
    return out;
  }
  const RationalOptions rational{options.delay_s, 2.0 * std::numbers::pi / whole.window_s};
  const ResponsePoints all = whole.points(0, out.fitted);
  if (options.order > 0) {
    out.fit = fit_rational(all, options.order, rational);
    if (!out.fit)
      out.declined = std::to_string(out.fitted.size()) + " frequencies are too few for order " +
                     std::to_string(options.order);
    return out;
  }
  std::array<ResponsePoints, 2> halves;
  SpectralOptions half = options.spectra;
  half.window_s = whole.window_s;
  try {
    for (const std::size_t i : {0u, 1u}) {
      half.windows = i == 0 ? Windows::kOdd : Windows::kEven;
      halves[i] = frequency_response(records, sample_time_s, half).points(0, out.fitted);
    }
  } catch (const std::runtime_error&) {
    out.declined = "half of the windows are too few to choose the order; give the order";
    return out;
  }
  if (!usable(halves[0]) || !usable(halves[1])) {
    out.declined =
        "the halves of the recording are excited at different frequencies; give the order";
    return out;
  }
  const int most = std::min(kMaxModeOrder, static_cast<int>(out.fitted.size() / kPointsPerPole));
  if (auto chosen = fit_rational_order(all, halves, most, rational)) {
    out.fit = std::move(chosen->fit);
    out.trials = std::move(chosen->trials);
  } else {
    out.declined = "no finite fit";
  }
  return out;
}

}  // namespace

FittedResponse fit_response(std::span<const ResponseRecord> records, double sample_time_s,
                            const ModeOptions& options) {
  FittedResponse out = fitted(records, sample_time_s, options);
  if (out.fit && std::none_of(out.fit->poles.begin(), out.fit->poles.end(),
                              [](const FittedPole& pole) { return pole.determined(); }))
    out.declined = "no pole of the fit is determined by these data";
  return out;
}

std::vector<FittedPole> poles_shown(std::span<const ResponseRecord> records, double sample_time_s,
                                    const ModeOptions& options) {
  std::vector<FittedPole> out;
  try {
    if (const FittedResponse found = fit_response(records, sample_time_s, options); found.fit)
      out = found.fit->poles;
  } catch (const std::runtime_error&) {
    return out;
  }
  std::erase_if(out, [](const FittedPole& pole) { return !pole.determined(); });
  return out;
}

}  // namespace servotwin
