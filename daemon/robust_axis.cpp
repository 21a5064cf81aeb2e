#include "daemon/robust_axis.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "drivers/text.h"
#include "ilc/feedforward.h"
#include "ilc/uncertainty.h"

namespace servotwin {
namespace {

constexpr double kUnstated = 0.05;  // of every pole, where a model does not state deviations

/// What a model says of its own uncertainty, or a share where it says nothing.
TransferUncertainty uncertainty_of(const ModelRecord& record, const Segment& path,
                                   const Transfer& transfer, std::string& words) {
  TransferUncertainty out;
  double known = 0.0;
  for (const double sd : {record.pole_deviation.omega, record.pole_deviation.zeta})
    known = std::max(known, std::isfinite(sd) ? sd : 0.0);
  if (known == 0.0) {
    out = relative_uncertainty(transfer, kUnstated);
    out.deviations = 1.0;
    words = number(100.0 * kUnstated) +
            " % of every pole and coefficient (the model states no deviations)";
  } else {
    out.poles = record.pole_deviation;
    out.numerator = record.numerator_deviation;
    for (std::size_t i = 0; i < record.model.effects.size(); ++i) {
      if (record.model.effects[i].kind == kind_of<TimeDelay>() &&
          i < record.effect_deviations.size())
        out.delay_s = record.effect_deviations[i].shape[0];
    }
    words = "two standard deviations of the model";
    if (record.holdout.rms > 0.0) {
      out.seen = seen_of_model(path.command, path.sample_time_s, record.holdout.rms);
      words += ", what it missed of its hold-out,";
    }
  }
  out.timing_s = record.model.sample_time_s;
  words += " and a cycle of its recording";
  return out;
}

}  // namespace

RobustAxis robust_axis(const ModelRecord& record, const Segment& path,
                       const CorrectionLimits& limits, double most_hz) {
  RobustAxis out;
  LearnAxis& axis = out.learning;
  axis.name = record.axis;
  axis.rotary = record.rotary;
  axis.model = record.model;
  axis.path = path;
  axis.limits = limits;
  axis.law.model = transfer_of(axis.model);
  const double h = path.sample_time_s;
  const std::vector<Transfer> models =
      models_within(axis.law.model, uncertainty_of(record, path, axis.law.model, out.uncertainty));
  axis.law.bandwidth_hz = std::min(robust_bandwidth(axis.law, models, h), most_hz);
  const std::string why = axis.law.bandwidth_hz < kLeastBandwidth_hz
                              ? "no bandwidth keeps |Q (1 - L T)| below " + number(kContraction) +
                                    " for every model within " + out.uncertainty +
                                    "; it takes a model from richer motion"
                              : why_refused(axis.law, models, h);
  if (!why.empty()) throw std::runtime_error("axis " + axis.name + ": " + why);
  axis.basis_bandwidth_hz = std::min(harmless_bandwidth(axis.law, models, h), most_hz);
  return out;
}

}  // namespace servotwin
