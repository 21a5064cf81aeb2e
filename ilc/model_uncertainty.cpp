#include "ilc/model_uncertainty.h"

#include <cmath>

#include "ilc/words.h"

namespace servotwin {
namespace {

using words::number;

// Relative, of every pole and coefficient, and of every parameter of two masses.
constexpr double kUnstatedPoleUncertainty = 0.05;

/// Sets the deviations of two masses that are not stated; returns whether there were any.
bool complete(TransferUncertainty& uncertainty, const TwoMassParameters& two) {
  TwoMassDeviations& deviations = uncertainty.two_masses;
  bool any = false;
  const auto set = [&](double& deviation, double value) {
    if (deviation > 0.0 || value == 0.0) return;
    deviation = kUnstatedPoleUncertainty * value / uncertainty.deviations;
    any = true;
  };
  set(deviations.omega, two.omega);
  set(deviations.zeta, two.zeta);
  set(deviations.load_share, two.load_share);
  set(deviations.reset, two.reset);
  return any;
}

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
    TwoMassDeviations& two = out.of_transfer.two_masses;
    two = stated.two_masses;
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
      for (double* deviation : {&two.omega, &two.zeta, &two.load_share, &two.reset})
        *deviation *= more;
      out.words += ", " + number(std::round(100.0 * more) / 100.0) +
                   " times as large because its residual was that much larger on held-out data";
    }
    if (transfer.two_masses && complete(out.of_transfer, *transfer.two_masses))
      out.words += ", " + number(100.0 * kUnstatedPoleUncertainty) +
                   " % of each parameter of its two masses for which it states none";
  }
  out.of_transfer.timing_s = sample_time_s;
  out.words += out.words.find(',') == std::string::npos
                   ? " and a timing error of one sampling time"
                   : ", and a timing error of one sampling time";
  return out;
}

}  // namespace servotwin
