#include "daemon/web/health.h"

#include <exception>

#include "diagnosis/text.h"

namespace servotwin::daemon {

void Health::on_turns(std::optional<std::uint64_t> turns, std::int64_t now_ns) {
  if (turns && turns == turns_) return;
  turns_ = turns;
  turned_ns_ = now_ns;
}

std::vector<std::string> Health::problems(std::int64_t now_ns) {
  std::vector<std::string> out;
  if (turns_ && now_ns - turned_ns_ > kMaxLoopSilence_ns) {
    out.push_back(text("the real-time loop has made no progress for %.1f s",
                       1e-9 * static_cast<double>(now_ns - turned_ns_)));
  }
  if (!tried_ns_ || now_ns - *tried_ns_ >= kStoreCheck_ns) {
    tried_ns_ = now_ns;
    store_problem_.clear();
    try {
      Store::require_writable(store_.directory());
      store_.try_writing();
    } catch (const std::exception& error) {
      store_problem_ = error.what();
    }
  }
  if (!store_problem_.empty()) out.push_back(store_problem_);
  if (!recording_problem_.empty()) out.push_back(recording_problem_);
  return out;
}

}  // namespace servotwin::daemon
