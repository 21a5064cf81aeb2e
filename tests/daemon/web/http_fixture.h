// The web service of a machine "mill" with a store of its own, on a free port of this host.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <sstream>
#include <string>
#include <thread>

#include "daemon/web/web_service.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {

inline constexpr const char* kToken = "a token of the test";

class HttpTest : public testing::Test {
 protected:
  HttpTest() : store_(directory_.path(), "mill"), events_(store_, said_) {
    config_.listen = "127.0.0.1:0";
    config_.token = kToken;
    config_.names = {"cell3.example"};
    start();
  }
  void start() {
    web_ = std::make_unique<WebService>(config_, "mill", store_, events_);
    const std::string url = web_->url();
    port_ = static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
  }
  /// From now on there is a machine with an axis X.
  void show() {
    watch_ = std::make_unique<ResidualWatch>(machine_, DiagnoseConfig{}, events_);
    shown_ = std::make_unique<WebService::Shown>(*web_, machine_, counters_, published_, *watch_,
                                                 &arming_, inbox_);
  }
  void promote(const std::string& reason) {
    ModelRecord record = record_of(drive());
    store_.promote(record, {"2026-01-31T12:00:00.000Z", "X", "model_promoted", reason, ""});
  }
  [[nodiscard]] HttpAnswer get(const std::string& target) const {
    return ask(port_, "GET", target);
  }
  /// Publishes this status until `said()` contains the text: what finds the web thread busy goes
  /// along with the next status, as with those that the daemon publishes every second.
  template <class Said>
  bool tells(const std::string& text, const Said& said, const MachineStatus& status = {}) {
    constexpr int kTurns = 1500;
    for (int turn = 0; turn < kTurns; ++turn) {
      shown_->feed().add(status);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      if (said().find(text) != std::string::npos) return true;
    }
    return false;
  }

  TemporaryDirectory directory_;
  HttpConfig config_;
  Store store_;
  std::ostringstream said_;
  EventLog events_;
  MachineDescription machine_ = one_axis();
  LoopCounters counters_;
  Histogram published_;
  std::atomic<bool> armed_{false};
  Arming arming_{true, armed_, events_};
  std::shared_ptr<ProgramInbox> inbox_;
  std::unique_ptr<ResidualWatch> watch_;
  std::unique_ptr<WebService> web_;
  std::unique_ptr<WebService::Shown> shown_;
  std::uint16_t port_ = 0;
};

}  // namespace servotwin::daemon
