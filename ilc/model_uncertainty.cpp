#include "ilc/model_uncertainty.h"

#include <cmath>

#include "ilc/words.h"

namespace servotwin {
namespace {

using words::number;

constexpr double kUnstatedPoleUncertainty = 0.05;  // relative, of every pole and coefficient

}  // namespace

ModelUncertainty uncertainty_of(const StatedDeviations& stated, const Transfer& transfer,
                                double sample_time_s, double share) {
  ModelUncertainty out;
  const PoleSet& poles = stated.poles;
  if (share > 0.0 || !(poles.omega > 0.0 || poles.zeta > 0.0)) {
    const double taken = share > 0.0 ? share : kUnstatedPoleUncertainty;
    out.of_transfer = relative_uncertainty(transfer, taken);
    out.of_transfer.deviations = 1.0;
    out.words = number(100.0 * taken) + " % of every pole and coefficient" +
                (share > 0.0 ? "" : " (the model states no deviations)");
  } else {
    out.words = "two standard deviations of the model";
    LoopCovariance& covariance = out.of_transfer.covariance;
    if (stated.covariance) {
      covariance = *stated.covariance;
    } else {
      covariance = one_by_one(poles, stated.numerator, stated.delay_s);
      out.words += ", taken as independent because its file has no covariance (identify it again)";
    }
    // The stated deviations cover the scatter of the training data; a larger residual on held-out
    // data scales them.
    const double more = stated.holdout_over_training;
    if (more > 1.0 && std::isfinite(more)) {
      covariance *= more * more;
      out.words += ", " + number(std::round(100.0 * more) / 100.0) +
                   " times as large because its residual was that much larger on held-out data";
    }
  }
  out.of_transfer.timing_s = sample_time_s;
  out.words += out.words.find(',') == std::string::npos
                   ? " and a timing error of one sampling time"
                   : ", and a timing error of one sampling time";
  return out;
}

}  // namespace servotwin
