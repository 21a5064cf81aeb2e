#include "daemon/web/web_service.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "daemon/between/clock.h"
#include "daemon/loop/scheduling.h"
#include "daemon/web/live_json.h"

namespace servotwin::daemon {
namespace {

constexpr int kTurn_ms = 20;  // period at which the page gets new data
constexpr std::int64_t kStatus_ns = 1'000'000'000;

ListenAddress address_of(const HttpConfig& config) {
  const auto address = parse_listen_address(config.listen);
  if (!address) throw std::runtime_error("http.listen = '" + config.listen + "': " + kListenRule);
  return *address;
}

}  // namespace

WebService::Shown::Shown(WebService& service, const MachineDescription& machine,
                         const LoopCounters& counters, const Histogram& published,
                         ResidualWatch& watch, Arming* arming,
                         std::shared_ptr<ProgramInbox> programs)
    : service_(service),
      machine_(machine),
      counters_(counters),
      published_(published),
      watch_(watch),
      arming_(arming),
      programs_(std::move(programs)),
      feed_(machine.cycle_s, machine.axes.size()) {
  const std::lock_guard lock(service_.mutex_);
  service_.shown_ = this;
  service_.live_.status.axes.clear();  // until now those of the store
}

WebService::Shown::~Shown() {
  const std::lock_guard lock(service_.mutex_);
  service_.shown_ = nullptr;
}

WebService::WebService(const HttpConfig& config, const std::string& machine, Store& store,
                       EventLog& events)
    : machine_(machine),
      tls_(!config.tls_certificate.empty()),
      started_ns_(steady_ns()),
      reading_(store.directory(), machine, StoreAccess::kRead),
      check_(store, reading_),
      health_(check_),
      api_({machine, config.token, reading_, health_, [this] { return now(); },
            [this](std::size_t axis) {
              if (shown_ == nullptr) return false;
              shown_->watch_.ask(axis, "requested over HTTP");
              return true;
            },
            [this] { return shown_ == nullptr ? nullptr : shown_->arming_; },
            [this] { return shown_ == nullptr ? nullptr : shown_->programs_; }}),
      server_(
          address_of(config), config.names,
          [this](const HttpRequest& request) {
            const std::lock_guard lock(mutex_);
            return api_.answer(request);
          },
          read_tls_pair(config.tls_certificate, config.tls_key),
          [&events](const std::string& text) { events.note_soon("token_refused", "", text); },
          [this](const HttpRequest& request) {
            const std::lock_guard lock(mutex_);
            return api_.refuse_body(request);
          }) {
  live_.status.state = DaemonState::kWaiting;
  stored_.cycle_s = kAbsent;
  const std::vector<StoredModel> models = reading_.in_force();
  for (const std::string& axis : reading_.axes()) {
    AxisStatus& known = live_.status.axes.emplace_back();
    known.name = axis;
    for (const StoredModel& model : models) {
      if (model.record.axis != axis) continue;
      known.model_version = model.record.version;
      known.holdout_rms = model.record.holdout.rms;
      known.rotary = model.record.rotary;
    }
    known.activity = "waiting for the machine";
    stored_.axes.push_back({axis, known.rotary, {}});
  }
  thread_ = std::jthread([this](const std::stop_token& stop) {
    name_thread("http");
    run(stop);
  });
  checking_ = std::jthread([this](const std::stop_token& stop) {
    name_thread("store check");
    check_.run(stop);
  });
}

WebService::~WebService() {
  thread_.request_stop();
  thread_.join();
}

void WebService::use_token(const std::string& token) {
  const std::lock_guard lock(mutex_);
  api_.use_token(token);
}

std::string WebService::url() const {
  return (tls_ ? "https://" : "http://") + server_.address().text() + "/";
}

void WebService::run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    look();
    server_.poll(kTurn_ms);
  }
}

void WebService::look() {
  const std::lock_guard lock(mutex_);
  std::optional<std::uint64_t> turns;
  if (shown_ != nullptr) {
    // relaxed: number and flag order no other data.
    if (!shown_->ended_.load(std::memory_order_relaxed))
      turns = shown_->counters_.turns.load(std::memory_order_relaxed);
    pass_on(shown_->feed_.take());
  }
  health_.on_turns(turns, steady_ns());
  health_.on_recording(live_.status.not_recording);
  if (shown_ == nullptr && steady_ns() - status_sent_ns_ >= kStatus_ns) send_status();
}

void WebService::pass_on(LiveFeed::News news) {
  batches_dropped_ = news.dropped;
  if (!news.batches.empty()) live_ns_ = steady_ns();
  for (const LiveBatch& batch : news.batches) server_.send("live", batch_json(batch));
  for (const ModelAnnouncement& model : news.models)
    server_.send("model", nlohmann::json{{"schema", "servotwin.promotion/1"},
                                         {"axis", model.axis},
                                         {"version", model.version},
                                         {"parent", model.parent},
                                         {"created", model.created},
                                         {"reason", model.reason}}
                              .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  for (const DiagnosisAnnouncement& diagnosis : news.diagnoses)
    server_.send("diagnosis", diagnosis.diagnosis_json);
  if (!news.status) return;
  live_ = std::move(*news.status);
  send_status();
}

void WebService::send_status() {
  status_sent_ns_ = steady_ns();
  if (shown_ == nullptr) live_.status.time_ns = wall_ns();
  server_.send("status", api_.status());
}

MetricsInput WebService::now() {
  MetricsInput out;
  out.machine = machine_;
  out.version = SERVOTWIN_VERSION;
  out.uptime_s = 1e-9 * static_cast<double>(steady_ns() - started_ns_);
  out.live = live_;
  if (live_ns_ > 0) out.silent_s = 1e-9 * static_cast<double>(steady_ns() - live_ns_);
  out.streams = server_.streams();
  out.slow_streams = server_.slow_streams();
  out.batches_dropped = batches_dropped_;
  if (shown_ == nullptr) {
    out.description = stored_;
    out.alarms.assign(stored_.axes.size(), AlarmState::kOff);
    return out;
  }
  out.description = shown_->machine_;
  for (std::size_t i = 0; i < out.description.axes.size(); ++i)
    out.alarms.push_back(shown_->watch_.state(i));
  out.wake = &shown_->counters_.wake;
  out.work = &shown_->counters_.work;
  out.published = &shown_->published_;
  return out;
}

}  // namespace servotwin::daemon
