#include "cli/recording/correction.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/common/model_text.h"
#include "cli/common/output.h"
#include "drivers/common/text.h"
#include "identification/model/json_number.h"
#include "ilc/path_ends.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

json size_json(const ErrorSize& size, bool rotary) {
  const std::string unit = rotary ? "_rad" : "_m";
  return {{"rms" + unit, size.rms}, {"max" + unit, size.max}};
}

json axis_json(const Correction& correction, std::size_t i) {
  const CorrectedAxis& axis = correction.axes[i];
  const LearnedAxis& learned = correction.learned.axes[i];
  const bool rotary = axis.learning.rotary;
  const std::string unit = rotary ? "_rad" : "_m";
  const double h = axis.learning.path.sample_time_s;
  const Eigen::ArrayXd& u = learned.correction;
  const double steepest = (u.tail(u.size() - 1) - u.head(u.size() - 1)).abs().maxCoeff() / h;
  const auto best = correction.learned.best;
  return {
      {"axis", axis.learning.name},
      {"kind", rotary ? "rotary" : "linear"},
      {"model_version", axis.commanded.record.version},
      {"bandwidth_hz", axis.learning.law.bandwidth_hz},
      {"feedforward_bandwidth_hz", axis.learning.basis_bandwidth_hz},
      {"contraction", axis.contraction.most()},
      {"contraction_at_hz", axis.contraction.most_at_hz()},
      {"models_within_uncertainty", axis.models},
      {"limit_peak" + unit, number_or_null(axis.learning.limits.peak)},
      {"limit_rate" + unit + "_per_s", number_or_null(axis.learning.limits.rate)},
      {"peak" + unit, u.abs().maxCoeff()},
      {"rate" + unit + "_per_s", steepest},
      {"before", size_json(correction.learned.trials.front().axis[i], rotary)},
      {"after", size_json(correction.learned.trials[best].axis[i], rotary)},
      {"expected_rms" + unit, number_or_null(expected_rms(correction, i))},
      {"limited_by", limited_by(correction, i)},
      {"offset" + unit, std::vector<double>(u.begin(), u.end())},
  };
}

/// The share of the remaining squared error that lies so near the ends of the path that the
/// correction is 0 there.
double ends_share(const CorrectedAxis& axis, const Eigen::ArrayXd& left) {
  const auto n = std::min<Eigen::Index>(left.size() / 2,
                                        std::lround(kEndRest_s / axis.learning.path.sample_time_s));
  const double all = left.square().sum();
  return all > 0.0 ? (left.head(n).square().sum() + left.tail(n).square().sum()) / all : 0.0;
}

/// Whether the error of a trial next to the kept one is the same within 5 %.
bool stands_still(const Learned& learned, std::size_t axis) {
  const std::size_t last = learned.trials.size() - 1;
  const std::size_t beside = learned.best < last ? last : last - 1;
  if (beside == 0) return false;
  const double ratio =
      learned.trials[beside].axis[axis].rms / learned.trials[learned.best].axis[axis].rms;
  return ratio > 0.95 && ratio < 1.05;
}

}  // namespace

double expected_rms(const Correction& correction, std::size_t axis) {
  const CorrectedAxis& one = correction.axes[axis];
  if (one.beyond_model || correction.learned.best == 0) return kAbsent;
  const double missed = one.commanded.record.holdout.rms;
  return std::hypot(size_of(correction.learned.axes[axis].error_after).rms, missed);
}

double expected_contour_rms(const Correction& correction) {
  const Learned& learned = correction.learned;
  if (!learned.before || learned.best == 0) return kAbsent;
  double squares = 0.0, axes = 0.0;
  for (const CorrectedAxis& axis : correction.axes) {
    if (axis.learning.rotary) continue;
    const double missed = axis.beyond_model ? kAbsent : axis.commanded.record.holdout.rms;
    squares += missed * missed;
    axes += 1.0;
  }
  return std::hypot(learned.trials[learned.best].contour.rms,
                    std::sqrt(squares * (axes - 1.0) / axes));
}

std::string bandwidth_text(const Correction& correction, const CorrectedAxis& axis) {
  const double beneath = axis.learning.basis_bandwidth_hz;
  const std::string feedforward = correction.options.feedforward_only || beneath == 0.0
                                      ? ""
                                      : text(" (feed-forward %.1f Hz)", beneath);
  return text("bandwidth %.1f Hz%s, %s at most %.2f (at %.0f Hz) for %zu models within ",
              axis.learning.law.bandwidth_hz, feedforward.c_str(),
              correction.options.feedforward_only ? "|1 - Q L T|" : "|Q (1 - L T)|",
              axis.contraction.most(), axis.contraction.most_at_hz(), axis.models) +
         axis.uncertainty;
}

std::string limited_by(const Correction& correction, std::size_t i) {
  if (correction.learned.best == 0) return "no correction is kept: no trial reduced the error";
  const CorrectedAxis& axis = correction.axes[i];
  const LearnedAxis& learned = correction.learned.axes[i];
  const bool rotary = axis.learning.rotary;
  const double left = size_of(learned.error_after).rms;
  const double missed = axis.commanded.record.holdout.rms;
  if (learned.at_limit_share > 0.005)
    return text("the limits: they bind in %.0f %% of the motion", 100.0 * learned.at_limit_share);
  if (correction.options.aim == Aim::kContour && !rotary)
    return "its aim: the axes follow the path, the lag along it is not corrected";
  if (axis.beyond_model) return "the model: it was identified on slower motion";
  if (std::isfinite(missed) && missed > left)
    return text("the model: its prediction error on held-out data is %.3g %s RMS", 1e6 * missed,
                micro(rotary));
  if (const double share = ends_share(axis, learned.error_after); share > 0.5)
    return text(
        "the ends of the path: %.0f %% of the remaining squared error lies within %.3g s of them, "
        "where the correction is 0",
        100.0 * share, kEndRest_s);
  if (learned.beyond_bandwidth_rms > 0.7 * left)
    return text("the bandwidth: %.0f %% of the remaining error lies beyond it",
                100.0 * learned.beyond_bandwidth_rms / left);
  if (correction.options.feedforward_only)
    return "the missing trials: the model is evaluated on the commanded motion, not on the "
           "corrected one";
  if (stands_still(correction.learned, i))
    return "the bandwidth: more trials change nothing, because its filter blocks the remaining "
           "error";
  return correction.learned.ending == Ending::kGrew
             ? "friction, which is not linear: more trials increased the error"
             : "the number of trials";
}

std::string shares_text(const Correction& correction) {
  std::string out;
  for (const ContourShare& share : correction.shares) {
    if (std::abs(share.share) < 0.005) continue;
    out += (out.empty() ? "" : ", ") +
           (share.what.empty() ? std::string("together")
                               : correction.axes[share.axis].learning.name + " " + share.what) +
           text(" %.0f %%", 100.0 * share.share);
  }
  return out;
}

json to_json(const Correction& correction) {
  const Learned& learned = correction.learned;
  json axes = json::array(), trials = json::array(), shares = json::array();
  for (std::size_t i = 0; i < correction.axes.size(); ++i) axes.push_back(axis_json(correction, i));
  const bool has_contour = learned.before.has_value();
  for (const Trial& trial : learned.trials) {
    json one = json::object();
    for (std::size_t i = 0; i < trial.axis.size(); ++i)
      one["axes"][correction.axes[i].learning.name] =
          size_json(trial.axis[i], correction.axes[i].learning.rotary);
    if (has_contour) one["contour"] = size_json(trial.contour, false);
    if (has_contour && learned.before->turned.size() > 0)
      one["orientation"] = size_json(trial.turned, true);
    trials.push_back(std::move(one));
  }
  for (const ContourShare& share : correction.shares) {
    shares.push_back(
        {{"axis", share.what.empty() ? json() : json(correction.axes[share.axis].learning.name)},
         {"what", share.what.empty() ? json("together") : json(share.what)},
         {"share", share.share}});
  }
  const Segment& path = correction.axes.front().learning.path;
  return {{"schema", kCorrectionSchema},
          {"source", correction.source},
          {"method", correction.method},
          {"aim", correction.options.aim == Aim::kContour ? "contour" : "tracking"},
          {"from_s", path.start_s},
          {"sample_time_s", path.sample_time_s},
          {"rows", path.size()},
          {"best_trial", learned.best},
          {"ended", learned.ending == Ending::kGrew ? "errors_grew" : "all_trials"},
          {"trials", trials},
          {"expected_contour_rms_m", number_or_null(expected_contour_rms(correction))},
          {"contour_shares", shares},
          {"axes", axes}};
}

}  // namespace servotwin::cli
