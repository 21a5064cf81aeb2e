// The modes of an axis from its frequency response: estimate and fit, or the reason why the data do
// not allow a fit.
//
// Only significant frequencies are fitted, from two lines above 0 to 0.4 of the sampling rate.
// docs/theory.md 15. Any thread. Errors: as frequency_response.h.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "identification/response/frequency_response.h"
#include "identification/response/vector_fitting.h"

namespace servotwin {

struct ModeOptions {
  SpectralOptions spectra;
  int order = 0;         ///< of the fit; 0: chosen on held-out windows
  double delay_s = 0.0;  ///< known delay, removed before the fit [s]
};

struct FittedResponse {
  FrequencyResponse response;
  std::vector<Eigen::Index> fitted;  ///< places of the frequencies that were fitted
  std::optional<RationalFit> fit;    ///< from the first input
  std::vector<OrderTrial> trials;    ///< none where the order was given
  std::string declined;              ///< why there is no fit, or why it must not be used
};

[[nodiscard]] FittedResponse fit_response(std::span<const ResponseRecord> records,
                                          double sample_time_s, const ModeOptions& options = {});

/// The poles of the fit that are determined, from the first input to the output, by how much of the
/// response they explain: start values of a fit in the time domain. From the command's velocity to
/// the tracking error they are those of the position loop and the modes. Empty where there is no
/// fit, or too little for an estimate; throws nothing of frequency_response.h.
[[nodiscard]] std::vector<FittedPole> poles_shown(std::span<const ResponseRecord> records,
                                                  double sample_time_s,
                                                  const ModeOptions& options = {});

}  // namespace servotwin
