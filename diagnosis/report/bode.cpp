#include "diagnosis/report/bode.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "diagnosis/statistics/thresholds.h"

namespace servotwin {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr double kDecibels = 20.0 / std::numbers::ln10;  // per natural logarithm
constexpr double kGap = std::numeric_limits<double>::quiet_NaN();

double decibels(const std::complex<double>& value) { return kDecibels * std::log(std::abs(value)); }

/// The phases [degrees] unwrapped, the first one as close to `near` as possible; gaps stay gaps.
std::vector<double> unwrapped(const std::vector<std::complex<double>>& values, double near) {
  std::vector<double> out;
  for (const std::complex<double> g : values) {
    double degrees = kDegrees * std::arg(g);
    if (std::isfinite(degrees)) near = degrees += 360.0 * std::round((near - degrees) / 360.0);
    out.push_back(degrees);
  }
  return out;
}

/// The first finite value of the series at or after this x; 0 where there is none.
double value_from(double x, const PlotSeries& series) {
  for (std::size_t i = 0; i < series.x.size(); ++i) {
    if (series.x[i] >= x - 1e-9 * x && std::isfinite(series.y[i])) return series.y[i];
  }
  return 0.0;
}

std::vector<double> list(const Eigen::ArrayXd& values) { return {values.begin(), values.end()}; }

}  // namespace

std::vector<PlotPanel> bode_panels(const FrequencyResponse& measured,
                                   const std::vector<std::string>& inputs,
                                   const std::string& output,
                                   const std::vector<ModelledResponse>& models) {
  const std::string x_label = "frequency [Hz]";
  PlotPanel magnitude{inputs.front() + " to " + output, x_label, "magnitude [dB]", true, {}};
  PlotPanel phase{"phase", x_label, "phase [degrees]", true, {}};
  PlotPanel coherence{"coherence", x_label, "coherence", true, {}};
  std::vector<PlotSeries> sizes, angles;  // of the models, drawn after the measured ones
  const std::vector<double> hz = list(measured.frequency_hz);
  // With several inputs each model has the colour of its input.
  const bool several = models.size() > 1;
  for (std::size_t c = 0; c < std::max(measured.channels.size(), models.size()); ++c) {
    const std::string colour = several ? plot_colour(c) : "";
    double near = 0.0;  // measured phase at the first frequency of the model
    if (c < measured.channels.size()) {
      const ResponseChannel& channel = measured.channels[c];
      const std::string name = inputs.size() > 1 ? inputs[c] : "measured, 95 % band";
      coherence.series.push_back({"", hz, list(channel.coherence), true, colour});
      const std::vector<Eigen::Index> places = measured.significant(c, 0.0, hz.back());
      PlotSeries size{name, hz, {}, true, colour}, angle{"", hz, {}, true, colour};
      std::vector<std::complex<double>> shown(hz.size(), kGap);
      size.error.assign(hz.size(), kGap);
      angle.error.assign(hz.size(), kGap);
      for (const Eigen::Index i : places) {
        const auto k = static_cast<std::size_t>(i);
        shown[k] = channel.response(i);
        size.error[k] = kOf95 * kDecibels * channel.deviation(i) / std::abs(shown[k]);
        angle.error[k] = kOf95 * kDegrees * channel.deviation(i) / std::abs(shown[k]);
      }
      for (const std::complex<double> g : shown) size.y.push_back(decibels(g));
      angle.y = unwrapped(shown, 0.0);
      if (c < models.size() && !models[c].frequency_hz.empty())
        near = value_from(models[c].frequency_hz.front(), angle);
      if (!places.empty()) {
        magnitude.series.push_back(std::move(size));
        phase.series.push_back(std::move(angle));
      }
    }
    if (c >= models.size() || models[c].frequency_hz.empty()) continue;
    const ModelledResponse& model = models[c];
    sizes.push_back({model.name, model.frequency_hz, {}, true, colour, {}, several});
    for (const std::complex<double> g : model.response) sizes.back().y.push_back(decibels(g));
    angles.push_back(
        {"", model.frequency_hz, unwrapped(model.response, near), true, colour, {}, several});
  }
  for (PlotSeries& size : sizes) magnitude.series.push_back(std::move(size));
  for (PlotSeries& angle : angles) phase.series.push_back(std::move(angle));
  if (magnitude.series.empty()) return {coherence};
  return {magnitude, phase, coherence};
}

}  // namespace servotwin
