#include "cli/relay.h"

#include "cli/interrupt.h"

namespace servotwin::cli {

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
