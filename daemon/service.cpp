#include "daemon/service.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <ostream>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "daemon/config/listen_address.h"
#include "daemon/config/reload.h"
#include "daemon/correct/arming.h"
#include "daemon/correct/learning_worker.h"
#include "daemon/diagnose/diagnosis_worker.h"
#include "daemon/identify/identification_worker.h"
#include "daemon/input/machine_input.h"
#include "daemon/loop/live_offsets.h"
#include "daemon/loop/real_time_loop.h"
#include "daemon/loop/scheduling.h"
#include "daemon/publish/publisher.h"
#include "daemon/record/motion_memory.h"
#include "daemon/record/recorder.h"
#include "daemon/record/residual_watch.h"
#include "daemon/service_manager.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "daemon/web/http_server.h"
#include "daemon/web/web_service.h"
#include "drivers/dds.h"
#include "drivers/text.h"

namespace servotwin::daemon {
namespace {

// Capacities in cycles. At 1 kHz a publisher that is blocked loses predictions after a quarter of a
// second; the recorder, which may have to wait for a disk, loses rows after eight seconds.
constexpr std::size_t kPredictionRing = 256;
constexpr std::size_t kRowRing = 8192;
// Older offsets are of no use to a drive.
constexpr std::size_t kOffsetRing = 64;
// Time by which the motion memory is longer than a fit and a comparison need, for a busy processor.
constexpr double kMemoryReserve_s = 30.0;
// Memory as a multiple of the motion that a diagnosis uses, because an axis also stands still.
constexpr double kMemoryOverRecordTime = 4.0;
// Minimum of the default ceiling for all recordings.
constexpr double kMinCeiling_mb = 1024.0;
// Period at which the reports of source and publisher are collected.
constexpr std::chrono::milliseconds kNewsPeriod{500};
// Minimum time between two reports of malformed frames.
constexpr std::int64_t kReportPeriod_ns = 60'000'000'000;

double remembered_s(const Config& config) {
  const IdentifyConfig& identify = config.identify;
  const double to_identify_s =
      identify.memory_s + identify.window_s + identify.judge_s + kMemoryReserve_s;
  const bool diagnoses = config.diagnose.every_s > 0.0 || config.diagnose.false_alarm_days > 0.0;
  return std::max(to_identify_s,
                  diagnoses ? kMemoryOverRecordTime * config.diagnose.record_s : 0.0);
}

RecordingRoom room_of(const Config& config) {
  return {config.store.recordings_mb, config.store.recordings_max_mb.value_or(std::max(
                                          kMinCeiling_mb, 4.0 * config.store.recordings_mb))};
}

DdsPlace place_of(const Config& config, const DdsConfig& dds) {
  // Frames pass through threads of Cyclone DDS, which must have the priority of the loop.
  const bool urgent = config.source == SourceKind::kDds && config.priority > 0 &&
                      real_time_refused(config.priority).empty();
  return {config.machine, dds.domain, dds.partition, dds.strength, urgent ? config.priority : 0};
}

/// Why the receive threads of DDS are not real-time threads; empty if they are, or are not needed.
std::string slow_receipt(const Config& config, const DdsPlace& place) {
  if (config.source != SourceKind::kDds || config.priority == 0) return {};
  if (dds_configured_outside()) {
    return "CYCLONEDDS_URI sets the priority of the DDS receive threads; [real_time] priority does "
           "not apply to them";
  }
  return place.receive_priority == 0 ? "the DDS receive threads run at normal priority as well"
                                     : "";
}

/// The part of the status that comes from the counters of the loop.
MachineStatus counted(const LoopCounters& counters) {
  MachineStatus status;
  status.frames = counters.frames;
  status.state = status.frames == 0 ? DaemonState::kWaiting : DaemonState::kRunning;
  status.lost = counters.lost;
  status.malformed = counters.malformed;
  status.time_jumps = counters.time_jumps;
  status.not_finite = counters.not_finite;
  status.overruns = counters.overruns;
  status.repeated = counters.repeated;
  status.wake_p50_s = counters.wake.quantile_s(0.5);
  status.wake_p99_s = counters.wake.quantile_s(0.99);
  status.work_p50_s = counters.work.quantile_s(0.5);
  status.work_p99_s = counters.work.quantile_s(0.99);
  status.work_max_s = counters.work.max_s();
  return status;
}

/// The counters of faulty frames that are not 0: ", 3 lost, 1 repeated and ignored".
std::string fault_counts(const MachineStatus& status) {
  std::string out;
  for (const auto& [count, what] : {std::pair{status.lost, "lost"},
                                    {status.repeated, "repeated and ignored"},
                                    {status.malformed, "malformed and ignored"},
                                    {status.rows_dropped, "not recorded"}}) {
    if (count > 0) out += ", " + std::to_string(count) + " " + what;
  }
  return out;
}

/// The page; null if it is not configured, or if it cannot be served and is not required.
std::unique_ptr<WebService> page_of(const Config& config, Store& store, EventLog& events) {
  if (config.http.listen.empty() || config.http.listen == "none") return nullptr;
  try {
    auto web = std::make_unique<WebService>(config.http, config.machine, store);
    events.note("http", "", "page at " + web->url());
    return web;
  } catch (const std::runtime_error& error) {
    if (config.http.needed) throw;
    events.note("http", "", std::string("the web page is not served: ") + error.what());
    return nullptr;
  }
}

/// Handles requests to reload the configuration for as long as it lives.
class WhileServing {
 public:
  using Handler = std::function<void(const std::function<Config()>& load)>;
  WhileServing(Reloads* reloads, Handler handler) : reloads_(reloads) {
    if (reloads_ != nullptr) reloads_->serve_with(std::move(handler));
  }
  WhileServing(const WhileServing&) = delete;
  WhileServing& operator=(const WhileServing&) = delete;
  ~WhileServing() {
    if (reloads_ != nullptr) reloads_->serve_with(nullptr);
  }

 private:
  Reloads* reloads_;
};

/// Reads the configuration again and changes the keys of `running` that change at once; reports the
/// result as an event. False, without any change, if the new configuration is refused.
bool read_again(const std::function<Config()>& load, Config& running, EventLog& events) {
  try {
    const Config newer = load();
    const ConfigChanges changes = changes_between(running, newer);
    running = reloaded(running, newer);
    events.note("reloaded", "", changes.text());
    return true;
  } catch (const std::exception& error) {
    // Each line of the message is an event.
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) events.error("config_refused", "", line);
    events.error("config_refused", "",
                 "the new configuration is refused; the previous one stays in force");
    return false;
  }
}

/// Whether the command of a frame contains the offset. By default: yes for the position demand of a
/// drive (CAN), no for the path of an interpolator.
bool offset_in_command(const Config& config) {
  return config.ilc.in_command.value_or(config.source == SourceKind::kCan ||
                                        config.source == SourceKind::kUdp);
}

/// The axes in the store, with their version in force: "X (model 3), Y".
std::string known_axes(const Store& store) {
  std::vector<std::string> out = store.axes();
  const std::vector<StoredModel> models = store.in_force();
  for (std::string& axis : out) {
    for (const StoredModel& model : models) {
      if (model.record.axis != axis) continue;
      axis += " (model " + std::to_string(model.record.version) + ")";
      break;
    }
  }
  return listed(out);
}

std::filesystem::path store_of(const Config& config) {
  return config.store.directory.empty() ? default_store() : config.store.directory;
}

}  // namespace

std::vector<std::string> obstacles(const Config& config) {
  std::vector<std::string> found;
  try {
    Store::require_writable(store_of(config));
    Store::try_making(store_of(config));
  } catch (const std::exception& error) {
    found.emplace_back(error.what());
  }
  for (const int cpu : missing_processors(config.cpus)) {
    found.push_back("real_time.cpus: there is no processor " + std::to_string(cpu) +
                    " on this host");
  }
  for (std::string& obstacle : input_obstacles(config)) found.push_back(std::move(obstacle));
  try {
    if (const auto address = parse_listen_address(config.http.listen))
      HttpServer::try_listening(*address);
  } catch (const CannotListen& error) {
    if (error.error != EADDRINUSE) found.emplace_back(error.what());
  }
  return found;
}

std::vector<std::string> taken(const Config& config) {
  std::vector<std::string> found;
  if (Store::in_use(store_of(config)))
    found.push_back("store " + store_of(config).string() + " is in use by a running servotwind");
  try {
    if (const auto address = parse_listen_address(config.http.listen))
      HttpServer::try_listening(*address);
  } catch (const CannotListen& error) {
    if (error.error == EADDRINUSE) found.push_back(config.http.listen + " is in use");
  }
  return found;
}

void serve(const Config& config, const std::stop_token& stop, const std::function<void()>& ready,
           std::ostream& out, const Surroundings& surroundings) {
  Store store(store_of(config), config.machine);
  EventLog events(store, out, surroundings.journal, config.machine);
  // This write detects a faulty disk now, not with the first model.
  store.add(event_now("started", "", "started"));
  if (!store.lost().empty()) events.error("store", "", store.lost());
  if (const std::string known = known_axes(store); !known.empty())
    events.note("store", "", "axes in the store: " + known);
  const DdsNode node(place_of(config, config.dds));
  std::optional<DdsNode> apart;  // used if the frames have a DDS domain or partition of their own
  if (config.source == SourceKind::kDds && config.dds_in)
    apart.emplace(place_of(config, *config.dds_in));
  const DdsNode& node_in = apart ? *apart : node;
  const std::unique_ptr<WebService> web = page_of(config, store, events);
  // Lives as long as the daemon: the sender of a description waits for a matching reader.
  DdsReader<MachineDescription> descriptions(node_in);
  ready();
  const ServiceManager nobody;
  Watchdog watchdog(
      surroundings.manager != nullptr ? *surroundings.manager : nobody, config.priority,
      [&](double silent_s) {
        events.print(event_now("stalled", "",
                               "the real-time loop has made no progress for " + number(silent_s) +
                                   " s; the service manager will restart the daemon"));
      });

  // The configuration that a reload may change. The loop and its rings do not use it.
  Config running = config;
  std::optional<MachineInput> opened;
  {
    const WhileServing reloading(surroundings.reloads, [&](const std::function<Config()>& load) {
      read_again(load, running, events);
    });
    opened = open_input(config, node, node_in, descriptions, stop, events);
  }
  if (!opened) {
    events.note("stopped", "", "stopped before a machine was found");
    return;
  }
  MachineInput& input = *opened;
  if (config.cycle_s) input.machine.cycle_s = *config.cycle_s;
  const MachineDescription& machine = input.machine;

  // Data between the threads.
  std::vector<LatestValue<TwinInForce>> models(machine.axes.size());
  Ring<MachinePrediction> predictions(kPredictionRing);
  Ring<CycleRow> rows(kRowRing);
  Ring<MachineOffset> offsets(kOffsetRing);
  OffsetHandOver hand_over;
  WakeUp predicted;
  Histogram published;
  MotionMemory memory(machine, remembered_s(running));
  ResidualWatch watch(machine, running.diagnose, events);

  // The workers.
  const auto loop = std::make_unique<RealTimeLoop>(machine.cycle_s, models, predictions, rows,
                                                   predicted, paths_of(config, machine));
  const LearningRules rules = learning_rules(config, machine);
  const auto live_offsets =
      std::make_unique<LiveOffsets>(offset_rules(rules, offset_in_command(config)), hand_over);
  loop->give_back(*live_offsets, offsets);
  input.source->wait_while([&] { return rows.waiting() > rows.capacity() / 2; });
  Arming arming(config.ilc.live, hand_over.armed, events);
  Recorder recorder(machine, config.machine, store.directory(), room_of(running), rows, memory,
                    watch, events);
  Publisher* to_network = nullptr;
  const auto shown = web == nullptr
                         ? nullptr
                         : std::make_unique<WebService::Shown>(*web, machine, loop->counters(),
                                                               published, watch, &arming);
  IdentificationWorker identification(
      machine, running.identify, memory, store, events, models,
      [&](const StoredModel& model) { to_network->announce(model); });
  DiagnosisWorker diagnosis(machine, running.diagnose, running.identify, memory, watch, store,
                            events,
                            [&](const StoredDiagnosis& made) { to_network->announce(made); });
  DdsReader<ProgramChunk> programs(node_in);
  DdsWriter<CorrectionChunk> corrections(node);
  LearningWorker learner(rules, store, events, hand_over,
                         [&](const CorrectionChunk& chunk) { corrections.write(chunk); });
  std::vector<AxisStatus> axes;
  std::string last_error;
  const auto status = [&] {
    MachineStatus now = counted(loop->counters());
    SourceState source = input.source->state(steady_ns());
    if (source.silent) now.state = DaemonState::kWaiting;
    if (stop.stop_requested()) now.state = DaemonState::kStopping;
    now.malformed += source.malformed;
    now.buses = std::move(source.buses);
    now.publish_p50_s = published.quantile_s(0.5);
    now.publish_p99_s = published.quantile_s(0.99);
    now.publish_p999_s = published.quantile_s(0.999);
    now.publish_max_s = published.count() > 0 ? published.max_s() : kAbsent;
    now.rows_dropped = rows.drops() + recorder.rows_not_recorded();
    now.not_recording = recorder.problem();
    identification.update(axes);
    events.update_last_error(last_error);
    now.axes = axes;
    for (std::size_t i = 0; i < now.axes.size(); ++i) now.axes[i].rotary = machine.axes[i].rotary;
    now.last_error = last_error;
    return now;
  };
  Publisher publisher(node, machine.cycle_s, predictions, offsets, predicted, published, status,
                      shown == nullptr ? nullptr : &shown->feed());
  to_network = &publisher;
  recorder.spare([&] { return store.cited(); });
  identification.cite_with(
      [&](double from_s, double until_s) { return recorder.files_with(from_s, until_s); });
  identification.restore();
  diagnosis.restore();
  diagnosis.give_up_with(stop);
  learner.give_up_with(stop);

  if (const std::string why = slow_receipt(config, node_in.place()); !why.empty())
    events.note("real_time", "", why);
  if (const std::string why = lock_memory(); !why.empty()) events.note("real_time", "", why);
  std::atomic<bool> stop_loop{false};
  std::mutex mutex;
  std::condition_variable_any ended_changed;
  bool ended = false;

  std::jthread publishing([&](const std::stop_token& its_stop) {
    name_thread("publisher");
    // Predictions must be sent in time. If this is not permitted, the loop reports it for both.
    (void)become_real_time(std::max(config.priority - 1, 0));
    publisher.run(its_stop);
  });
  std::jthread recording([&](const std::stop_token& its_stop) {
    name_thread("recorder");
    recorder.run(its_stop);
  });
  std::jthread identifying([&](const std::stop_token& its_stop) {
    name_thread("identification");
    if (const std::string why = become_idle(); !why.empty()) events.note("real_time", "", why);
    identification.run(its_stop);
  });
  std::jthread diagnosing([&](const std::stop_token& its_stop) {
    name_thread("diagnosis");
    if (const std::string why = become_idle(); !why.empty()) events.note("real_time", "", why);
    diagnosis.run(its_stop);
  });
  std::jthread learning([&](const std::stop_token& its_stop) {
    name_thread("learning");
    if (const std::string why = become_idle(); !why.empty()) events.note("real_time", "", why);
    learner.run(its_stop, programs);
  });
  std::jthread reporting([&](const std::stop_token& its_stop) {
    name_thread("events");
    std::uint64_t reported_malformed = 0;
    std::int64_t reported_malformed_ns = 0;
    std::mutex its_mutex;
    std::condition_variable_any never;
    std::unique_lock its_lock(its_mutex);
    while (!its_stop.stop_requested()) {
      never.wait_for(its_lock, its_stop, kNewsPeriod, [] { return false; });
      for (const SourceNews& news : input.source->news(steady_ns())) {
        if (news.good) {
          events.note("source", "", news.text);
        } else {
          events.error("source", "", news.text);
        }
      }
      if (const std::string why = input.source->state(steady_ns()).offsets_held_back; !why.empty())
        arming.forbid(why);
      for (const std::string& line : publisher.news()) events.note("network", "", line);
      const std::uint64_t malformed = loop->counters().malformed;
      if (malformed > reported_malformed &&
          (reported_malformed == 0 || steady_ns() - reported_malformed_ns >= kReportPeriod_ns)) {
        events.error("source", "",
                     std::to_string(malformed - reported_malformed) +
                         " frames ignored: they do not have the " +
                         std::to_string(machine.axes.size()) +
                         " axes of the machine; restart the daemon if the machine has changed");
        reported_malformed = malformed;
        reported_malformed_ns = steady_ns();
      }
    }
  });
  std::jthread real_time([&] {
    name_thread("real-time loop");
    // In this order, because events wait for the store, which a real-time thread must not do.
    if (const std::string why = keep_to(config.cpus); !why.empty())
      events.note("real_time", "", why);
    if (const std::string why = become_real_time(config.priority); !why.empty())
      events.note("real_time", "", why);
    prefault_stack();
    watchdog.watch(&loop->counters().turns);
    loop->run(*input.source, stop_loop);
    watchdog.watch(nullptr);
    const std::lock_guard lock(mutex);
    ended = true;
    ended_changed.notify_all();
  });

  const WhileServing reloading(surroundings.reloads, [&](const std::function<Config()>& load) {
    if (!read_again(load, running, events)) return;
    identification.reconfigure(running.identify);
    diagnosis.reconfigure(running.diagnose, running.identify);
    recorder.keep(room_of(running));
    memory.remember(remembered_s(running));
  });

  {
    std::unique_lock lock(mutex);
    ended_changed.wait(lock, stop, [&] { return ended; });
  }

  // Stops in the direction of the data, so that nothing is left in a ring.
  stop_loop = true;
  real_time.join();
  if (shown != nullptr) shown->loop_has_ended();
  reporting.request_stop();
  reporting.join();
  recording.request_stop();
  recording.join();
  identifying.request_stop();
  diagnosing.request_stop();
  learning.request_stop();
  // The workers finish what they have begun; at idle priority that could take for ever on a busy
  // host.
  restore_normal_priority(identifying.native_handle());
  restore_normal_priority(diagnosing.native_handle());
  restore_normal_priority(learning.native_handle());
  identifying.join();
  diagnosing.join();
  learning.join();
  if (!stop.stop_requested()) {
    identification.finish();
    diagnosis.finish(stop);
  }
  publishing.request_stop();
  publishing.join();
  for (const std::string& line : publisher.news()) events.note("network", "", line);
  const MachineStatus total = status();
  events.note("stopped", "",
              "stopped after " + std::to_string(total.frames) + " frames" + fault_counts(total));
}

}  // namespace servotwin::daemon
