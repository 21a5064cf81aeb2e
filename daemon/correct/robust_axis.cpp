#include "daemon/correct/robust_axis.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "daemon/correct/model_uncertainty.h"
#include "drivers/text.h"
#include "ilc/feedforward.h"
#include "twin/two_mass_axis.h"

namespace servotwin::daemon {

RobustAxis robust_axis(const ModelRecord& record, const Segment& path,
                       const CorrectionLimits& limits, double most_hz) {
  RobustAxis out;
  LearnAxis& axis = out.learning;
  axis.name = record.axis;
  axis.rotary = record.rotary;
  axis.model = record.model;
  axis.path = path;
  axis.limits = limits;
  if (const Effect* two_mass = two_mass_of(axis.model))
    throw std::runtime_error(
        "axis " + axis.name + ": its model has two masses (" +
        std::string(identity_of(two_mass->kind).id) +
        "), for which corrections are not learned in the background; use servotwin learn, which "
        "shows in simulation what a correction gains");
  axis.law.model = transfer_of(axis.model);
  const double h = path.sample_time_s;
  const ModelUncertainty uncertainty = uncertainty_of(record, axis.law.model);
  out.uncertainty = uncertainty.words;
  const std::vector<Transfer> models = models_within(axis.law.model, uncertainty.of_transfer);
  axis.law.bandwidth_hz = std::min(robust_bandwidth(axis.law, models, h), most_hz);
  const std::string why = axis.law.bandwidth_hz < kMinBandwidth_hz
                              ? "no bandwidth keeps |Q (1 - L T)| below " + number(kContraction) +
                                    " for every model within " + out.uncertainty +
                                    "; identify a model from motion that excites the axis more"
                              : why_refused(axis.law, models, h);
  if (!why.empty()) throw std::runtime_error("axis " + axis.name + ": " + why);
  axis.basis_bandwidth_hz = std::min(harmless_bandwidth(axis.law, models, h), most_hz);
  return out;
}

}  // namespace servotwin::daemon
