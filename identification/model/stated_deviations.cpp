#include "identification/model/stated_deviations.h"

namespace servotwin {

StatedDeviations stated_deviations(const ModelRecord& record) {
  StatedDeviations out{record.pole_deviation, record.numerator_deviation, 0.0,
                       record.loop_covariance, record.holdout.rms / record.training.rms};
  for (std::size_t i = 0; i < record.model.effects.size(); ++i) {
    if (record.model.effects[i].kind == kind_of<TimeDelay>() && i < record.effect_deviations.size())
      out.delay_s = record.effect_deviations[i].shape[0];
  }
  return out;
}

}  // namespace servotwin
