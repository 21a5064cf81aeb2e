// A frequency response as a picture: magnitude, phase and coherence over the logarithm of
// frequency, with a 95 % band. What is not significant is left out. Any thread; errors: none.
#pragma once

#include <complex>
#include <string>
#include <vector>

#include "diagnosis/plot.h"
#include "identification/response/frequency_response.h"

namespace servotwin {

/// What a model answers at these frequencies.
struct ModelledResponse {
  std::string name;  ///< in the legend; empty: not there
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> response;
};

/// `inputs` names the channels of `measured`, `models` are beside them one by one, or none; they
/// are drawn whether the measured one says anything or not. The coherence alone where there is
/// nothing else.
[[nodiscard]] std::vector<PlotPanel> bode_panels(const FrequencyResponse& measured,
                                                 const std::vector<std::string>& inputs,
                                                 const std::string& output,
                                                 const std::vector<ModelledResponse>& models = {});

}  // namespace servotwin
