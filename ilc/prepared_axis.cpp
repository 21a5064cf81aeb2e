#include "ilc/prepared_axis.h"

#include <algorithm>
#include <stdexcept>

#include "ilc/feedforward.h"
#include "ilc/model_uncertainty.h"
#include "ilc/words.h"

namespace servotwin {

using words::number;

PreparedAxis prepared_axis(const std::string& name, bool rotary, const Model& model,
                           const StatedDeviations& stated, const Segment& path,
                           const CorrectionWish& wish) {
  PreparedAxis out;
  LearnAxis& axis = out.learning;
  axis.name = name;
  axis.rotary = rotary;
  axis.model = model;
  axis.path = path;
  axis.limits = wish.limits;
  axis.law.law = wish.law;
  axis.law.model = transfer_of(axis.model);
  axis.law.derivative_s = axis.law.model.lag_s();
  const double h = path.sample_time_s;
  const ModelUncertainty uncertainty =
      uncertainty_of(stated, axis.law.model, h, wish.uncertainty_share);
  out.uncertainty = uncertainty.words;
  const std::vector<Transfer> models = models_within(axis.law.model, uncertainty.of_transfer);
  out.models = models.size();
  // A bandwidth that is asked for limits the whole correction, the feed-forward included.
  const double most_hz =
      wish.bandwidth_hz > 0.0 ? std::min(wish.bandwidth_hz, wish.most_hz) : wish.most_hz;
  LearningLaw inverse = axis.law;
  inverse.law = Law::kInverse;
  if (axis.law.law != Law::kNormOptimal)
    axis.basis_bandwidth_hz = std::min(harmless_bandwidth(inverse, models, h), most_hz);
  if (wish.feedforward_only) {
    axis.law.bandwidth_hz = axis.basis_bandwidth_hz;
    out.contraction = left_by_feedforward(axis.law, models, h);
    return out;
  }
  axis.law.bandwidth_hz =
      wish.bandwidth_hz > 0.0 ? most_hz : std::min(robust_bandwidth(axis.law, models, h), most_hz);
  if (axis.law.bandwidth_hz < kMinBandwidth_hz) {
    throw std::runtime_error("axis " + name + ": no bandwidth from " + number(kMinBandwidth_hz) +
                             " Hz on keeps |Q (1 - L T)| below " + number(kContraction) +
                             " for every model within " + out.uncertainty +
                             (wish.law == Law::kInverse
                                  ? "; identify a model from motion that excites the axis more"
                                  : "; learn by the inverse of the model, or identify a model "
                                    "from motion that excites the axis more"));
  }
  if (const std::string why = why_refused(axis.law, models, h); !why.empty())
    throw std::runtime_error("axis " + name + ": " + why);
  out.contraction = contraction(axis.law, models, h);
  return out;
}

}  // namespace servotwin
