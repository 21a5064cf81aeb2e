#include "diagnosis/report/in_short.h"

#include <algorithm>

#include "diagnosis/report/cause_words.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/statistics/text.h"
#include "twin/shown_units.h"

namespace servotwin {
namespace {

/// The causes that only the torque names. A limit of the motor is a sentence of its own.
std::vector<Shown> further_by(const std::optional<TorqueDiagnosis>& torque,
                              const Diagnosis& diagnosis) {
  std::vector<Shown> out;
  if (!torque) return out;
  for (const TorqueCause& cause : torque->causes) {
    const bool told = std::any_of(diagnosis.causes.begin(), diagnosis.causes.end(),
                                  [&](const Cause& other) { return other.id == cause.id; }) ||
                      (cause.id == "torque_saturation" && !diagnosis.at_limit.empty());
    if (!told) out.push_back(as_shown(cause));
  }
  return out;
}

}  // namespace

std::vector<std::string> in_short(const Diagnosis& diagnosis,
                                  const std::optional<TorqueDiagnosis>& torque) {
  std::vector<std::string> out{plain_verdict(diagnosis, further_by(torque, diagnosis))};
  const CommandLag& lag = diagnosis.lag;
  const bool rotary = diagnosis.baseline.rotary;
  const std::string& axis = diagnosis.baseline.axis;
  const double delay_s = diagnosis.extended.model.command_delay_s();
  constexpr double kMainShare = 0.5;  ///< of the squared error, and of the lag: the majority
  if (lag.share > kMainShare && delay_s > kMainShare * lag.time_s) {
    out.push_back(
        tracking_text(lag, axis, rotary) +
        text("; most of it is the delay of %.3g ms between command and encoder.", 1e3 * delay_s));
  } else if (std::string words = lag_text(lag, axis, rotary); !words.empty()) {
    // What most of the error is comes before what makes a small part of it.
    const bool first = lag.is_all() && !diagnosis.against_earlier;
    out.insert(first ? out.begin() : out.end(), std::move(words));
  }
  return out;
}

}  // namespace servotwin
