// The web page and the HTTP interface, in a thread of their own at normal priority. They show what
// the publisher publishes and what the store holds.
//
// The real-time loop does not depend on it: its counters are read without locks (LoopCounters), its
// cycles come through the publisher and daemon/publish/live_feed.h. The store is opened a second
// time, for reading. Errors: the constructor throws std::runtime_error if it cannot listen, and
// BadTlsPair.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "daemon/config/config.h"
#include "daemon/correct/arming.h"
#include "daemon/correct/program_inbox.h"
#include "daemon/loop/real_time_loop.h"
#include "daemon/publish/live_feed.h"
#include "daemon/record/residual_watch.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "daemon/web/api.h"
#include "daemon/web/health.h"
#include "daemon/web/http_server.h"

namespace servotwin::daemon {

class WebService {
 public:
  /// `store` and `events` must outlive the service.
  WebService(const HttpConfig& config, const std::string& machine, Store& store, EventLog& events);
  ~WebService();

  /// The data that is shown once the machine is known, for as long as this object lives. All
  /// references must outlive it.
  class Shown {
   public:
    Shown(WebService& service, const MachineDescription& machine, const LoopCounters& counters,
          const Histogram& published, ResidualWatch& watch, Arming* arming = nullptr,
          std::shared_ptr<ProgramInbox> programs = nullptr);
    Shown(const Shown&) = delete;
    Shown& operator=(const Shown&) = delete;
    ~Shown();
    /// The end of the feed that the publisher uses.
    [[nodiscard]] LiveFeed& feed() noexcept { return feed_; }
    /// From now on a loop without progress is not a problem.
    void loop_has_ended() noexcept { ended_.store(true, std::memory_order_relaxed); }

   private:
    friend WebService;
    WebService& service_;
    const MachineDescription& machine_;
    const LoopCounters& counters_;
    const Histogram& published_;
    ResidualWatch& watch_;
    Arming* arming_;                          // null: nothing can be armed
    std::shared_ptr<ProgramInbox> programs_;  // null: there are none
    LiveFeed feed_;
    std::atomic<bool> ended_{false};
  };

  /// From now on changes need this token; empty: they are not allowed. Any thread.
  void use_token(const std::string& token);

  /// From now on new connections get this certificate; false if it is the same. Only if the page
  /// was made with one. Any thread.
  bool use_tls(const TlsPair& tls) { return server_.use_tls(tls); }

  /// "http://127.0.0.1:8402/", with TLS "https://..."
  [[nodiscard]] std::string url() const;

 private:
  void run(const std::stop_token& stop);
  void look();
  void pass_on(LiveFeed::News news);
  void send_status();
  [[nodiscard]] MetricsInput now();

  std::string machine_;
  bool tls_;
  std::int64_t started_ns_;
  Store reading_;
  StoreCheck check_;
  Health health_;
  std::mutex mutex_;  // protects the members below
  Api api_;
  Shown* shown_ = nullptr;     // null: no machine is known
  MachineDescription stored_;  // axes in the store, used until the machine is known
  LiveStatus live_;
  std::uint64_t batches_dropped_ = 0;
  std::int64_t live_ns_ = 0;         // time of the last cycle; 0: none
  std::int64_t status_sent_ns_ = 0;  // time of the last status sent to the streams

  HttpServer server_;  // declared last: its last responses use the members above
  std::jthread thread_, checking_;
};

}  // namespace servotwin::daemon
