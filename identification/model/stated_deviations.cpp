#include "identification/model/stated_deviations.h"

#include "twin/two_mass_axis.h"

namespace servotwin {

StatedDeviations stated_deviations(const ModelRecord& record) {
  StatedDeviations out;
  out.poles = record.pole_deviation;
  out.numerator = record.numerator_deviation;
  out.covariance = record.loop_covariance;
  out.holdout_over_training = record.holdout.rms / record.training.rms;
  for (std::size_t i = 0; i < record.model.effects.size() && i < record.effect_deviations.size();
       ++i) {
    const std::size_t kind = record.model.effects[i].kind;
    Effect deviations;
    deviations.kind = kind;
    deviations.shape = record.effect_deviations[i].shape;
    if (kind == kind_of<TimeDelay>()) out.delay_s = deviations.shape[0];
    if (!acts_on_axis(kind)) continue;
    const TwoMassParameters of = two_mass_parameters(deviations);
    out.two_masses = {of.omega, of.zeta, of.load_share, of.reset};
  }
  return out;
}

}  // namespace servotwin
