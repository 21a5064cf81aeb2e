#include "diagnosis/in_short.h"

#include <algorithm>

#include "diagnosis/cause_words.h"

namespace servotwin {
namespace {

/// The causes that only the torque names. A limit of the motor is a sentence of its own.
std::vector<std::string> further_by(const std::optional<TorqueDiagnosis>& torque,
                                    const Diagnosis& diagnosis) {
  std::vector<std::string> out;
  if (!torque) return out;
  for (const TorqueCause& cause : torque->causes) {
    const bool told = std::any_of(diagnosis.causes.begin(), diagnosis.causes.end(),
                                  [&](const Cause& other) { return other.id == cause.id; }) ||
                      (cause.id == "torque_saturation" && !diagnosis.at_limit.empty());
    if (!told) out.push_back(cause.id);
  }
  return out;
}

}  // namespace

std::vector<std::string> in_short(const Diagnosis& diagnosis,
                                  const std::optional<TorqueDiagnosis>& torque) {
  std::vector<std::string> out{plain_verdict(diagnosis, further_by(torque, diagnosis))};
  if (std::string lag = lag_text(diagnosis.lag, diagnosis.baseline.rotary); !lag.empty())
    out.push_back(std::move(lag));
  return out;
}

}  // namespace servotwin
