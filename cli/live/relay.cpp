#include "cli/live/relay.h"

#include <stdexcept>

#include "cli/common/interrupt.h"
#include "drivers/common/text.h"

namespace servotwin::cli {

PassedNames::PassedNames(std::string where, std::initializer_list<const char*> reserved)
    : where_(std::move(where)) {
  for (const char* name : reserved) whose_[name] = "";
}

void PassedNames::add(const std::string& name, const std::string& axis) {
  const auto [known, is_new] = whose_.try_emplace(name, axis);
  if (is_new) return;
  throw std::runtime_error("axis " + in_quotes(axis) + ": its name " + where_ + " would be " +
                           name + ", which " +
                           (known->second.empty() ? "has another meaning"
                                                  : "axis " + in_quotes(known->second) + " has") +
                           "; rename it on the machine, with letters, digits, . and - only");
}

bool Relay::run(double seconds, const std::function<void()>& turn,
                const std::function<void(bool)>& pass_on) {
  constexpr double kPeriod_s = 1.0;  // of the daemon's status
  const Interrupt interrupt;
  double passed_s = 0.0, there_s = -kGone_s;
  while (!interrupt.came()) {
    if (seconds > 0.0 && now_s() >= seconds) return false;
    subscriber_.receive(record_);
    turn();
    if (now_s() - passed_s < kPeriod_s) continue;
    passed_s = now_s();
    if (subscriber_.daemon_there()) there_s = passed_s;
    pass_on(passed_s - there_s < kGone_s);
    record_.clear_lately();
  }
  return true;
}

}  // namespace servotwin::cli
