#include "daemon/web/health.h"

#include "diagnosis/statistics/text.h"

namespace servotwin::daemon {

void Health::on_turns(std::optional<std::uint64_t> turns, std::int64_t now_ns) {
  if (turns && turns == turns_) return;
  turns_ = turns;
  turned_ns_ = now_ns;
}

std::vector<std::string> Health::problems(std::int64_t now_ns) const {
  std::vector<std::string> out;
  if (turns_ && now_ns - turned_ns_ > kMaxLoopSilence_ns) {
    out.push_back(text("the real-time loop has made no progress for %.1f s",
                       1e-9 * static_cast<double>(now_ns - turned_ns_)));
  }
  const StoreCheck::Seen store = store_.seen(now_ns);
  for (const std::string& problem : {store.problem, store.damage, recording_problem_}) {
    if (!problem.empty()) out.push_back(problem);
  }
  return out;
}

std::vector<std::string> Health::notes() const {
  if (store_.lost().empty()) return {};
  return {store_.lost()};
}

}  // namespace servotwin::daemon
