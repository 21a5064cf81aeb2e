// An answer that waits for the disk or computes for long: made in a thread of its own, so that the
// thread of the HTTP server goes on, and one at a time, so that they do not pile up.
//
// One thread uses it. The destructor waits for the answer that is being made. Errors: the work must
// not throw.
#pragma once

#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <thread>
#include <utility>

#include "daemon/loop/scheduling.h"
#include "daemon/web/http_message.h"

namespace servotwin::daemon {

class SlowAnswer {
 public:
  /// Whether one is being made.
  [[nodiscard]] bool busy() const {
    return answer_.valid() &&
           answer_.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
  }
  /// Begins to make one; only if it is not busy.
  [[nodiscard]] HttpResponse begin(std::function<HttpResponse()> work) {
    std::packaged_task<std::shared_ptr<const HttpResponse>()> task(
        [work = std::move(work)] { return std::make_shared<const HttpResponse>(work()); });
    answer_ = task.get_future().share();
    working_ = std::jthread([task = std::move(task)]() mutable {
      name_thread("slow answer");
      task();
    });
    HttpResponse out;
    out.later = answer_;
    return out;
  }

 private:
  LaterResponse answer_;
  std::jthread working_;
};

}  // namespace servotwin::daemon
