// A Bode plot of a measured frequency response: magnitude, phase and coherence over frequency on a
// logarithmic axis, with a 95 % confidence band. Frequencies that are not significant are left out.
// Any thread; errors: none.
#pragma once

#include <complex>
#include <string>
#include <vector>

#include "diagnosis/report/plot.h"
#include "identification/response/frequency_response.h"

namespace servotwin {

/// The frequency response of a model at these frequencies.
struct ModelledResponse {
  std::string name;  ///< in the legend; empty: not in the legend
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> response;
};

/// The panels of the plot. `inputs`: one name for each channel of `measured`. `models`: one for
/// each channel, or none; they are drawn even where the measured response is not significant. Where
/// neither a response nor a model can be drawn, the coherence is the only panel.
[[nodiscard]] std::vector<PlotPanel> bode_panels(const FrequencyResponse& measured,
                                                 const std::vector<std::string>& inputs,
                                                 const std::string& output,
                                                 const std::vector<ModelledResponse>& models = {});

}  // namespace servotwin
