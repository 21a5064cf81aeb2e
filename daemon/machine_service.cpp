#include "daemon/machine_service.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <thread>
#include <utility>

#include "daemon/between/clock.h"
#include "daemon/between/report_period.h"
#include "daemon/loop/scheduling.h"
#include "drivers/common/text.h"

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
// Of the longest fade-out; a busy host gets a second one.
constexpr double kFadeOuts = 2.0;
constexpr std::chrono::milliseconds kFadeOutCheck{5};
// Period at which the reports of source and publisher are collected.
constexpr std::chrono::milliseconds kNewsPeriod{500};

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

/// Why the receive threads of DDS are not real-time threads; empty if they are, or are not needed.
std::string slow_receipt(const Config& config, const DdsPlace& place) {
  if (!config.uses(SourceKind::kDds) || config.priority == 0) return {};
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

/// Whether the command of a frame contains the offset. By default: yes for the position demand of a
/// drive (CAN), no for the path of an interpolator.
bool offset_in_command(const Config& config) {
  return config.ilc.in_command.value_or(config.source == SourceKind::kCan ||
                                        config.source == SourceKind::kUdp);
}

}  // namespace

MachineService::MachineService(const ServiceBase& base, MachineInput& input, const Config& current)
    : base_(base),
      source_(*input.source),
      machine_(input.machine),
      models_(machine_.axes.size()),
      predictions_(kPredictionRing),
      rows_(kRowRing),
      offsets_(kOffsetRing),
      hand_over_(base.config.source == SourceKind::kDds),
      memory_(machine_, remembered_s(current)),
      watch_(machine_, current.diagnose, base.events),
      loop_(std::make_unique<RealTimeLoop>(machine_.cycle_s, models_, predictions_, rows_,
                                           predicted_, paths_of(base.config, machine_))),
      contract_(offset_contract(base.config, machine_.cycle_s, input.map ? &*input.map : nullptr)),
      rules_(learning_rules(base.config, machine_)),
      live_offsets_(std::make_unique<LiveOffsets>(
          offset_rules(rules_, offset_in_command(base.config), contract_.drive_timeout_s),
          hand_over_)),
      arming_(
          base.config.ilc.live, hand_over_.armed, base.events,
          [this] { return source_.state(steady_ns()).offsets_held_back; },
          [this] { return standby_reason(); }),
      inbox_(std::make_shared<ProgramInbox>(base.config.ilc.programs, machine_, base.events)),
      recorder_(machine_, base.config.machine, base.store.directory(), room_of(current), rows_,
                memory_, watch_, base.events),
      shown_(base.web == nullptr
                 ? nullptr
                 : std::make_unique<WebService::Shown>(*base.web, machine_, loop_->counters(),
                                                       published_, watch_, &arming_, inbox_)),
      identification_(machine_, current.identify, memory_, base.store, base.events, models_,
                      [this](const StoredModel& model) { publisher_.announce(model); }),
      diagnosis_(machine_, current.diagnose, current.identify, memory_, watch_, base.store,
                 base.events, [this](const StoredDiagnosis& made) { publisher_.announce(made); }),
      programs_(base.node_in),
      corrections_(base.node),
      learner_(rules_, base.store, base.events, hand_over_,
               [this](const CorrectionChunk& chunk) { corrections_.write(chunk); }),
      publisher_(
          base.node, machine_.cycle_s, predictions_, offsets_, hand_over_, predicted_, published_,
          [this] { return status(); }, shown_ == nullptr ? nullptr : &shown_->feed()) {
  loop_->give_back(*live_offsets_, offsets_);
  source_.wait_while([this] { return rows_.waiting() > rows_.capacity() / 2; });
  recorder_.spare([this] { return base_.store.cited(); });
  identification_.cite_with(
      [this](double from_s, double until_s) { return recorder_.files_with(from_s, until_s); });
  identification_.restore();
  diagnosis_.restore();
  diagnosis_.propose_with(
      [this](std::size_t axis, const ModelRecord& record, const std::string& because, double from_s,
             double until_s) { identification_.propose(axis, record, because, from_s, until_s); });
  try {
    proposals_.emplace(base_.node_in);
  } catch (const std::runtime_error& error) {
    base_.events.note(
        "network", "",
        std::string("servotwin put-in-force cannot reach this daemon: ") + error.what());
  }
  identification_.give_up_with(base_.stop);
  diagnosis_.give_up_with(base_.stop);
  learner_.give_up_with(base_.stop);
  learner_.show_in(inbox_->list());
  learner_.hear_with(
      [this](double after_s) {
        return memory_.copy(after_s, std::numeric_limits<double>::infinity(), "the machine");
      },
      [this](const std::string& program) { return inbox_->accept(program); });
  for (const std::string& remark : contract_.remarks) base_.events.note("offsets", "", remark);
  if (const std::string why = contract_.refusal(); !why.empty() && arming_.live()) {
    arming_.forbid(why);
  } else if (!why.empty()) {
    base_.events.note("offsets", "", "with ilc.live = true " + why);
  }
}

void MachineService::reconfigure(const Config& current) {
  identification_.reconfigure(current.identify);
  diagnosis_.reconfigure(current.diagnose, current.identify);
  recorder_.keep(room_of(current));
  memory_.remember(remembered_s(current));
}

void MachineService::run() {
  const auto note = [this](const std::string& why) {
    if (!why.empty()) base_.events.note("real_time", "", why);
  };
  note(slow_receipt(base_.config, base_.node_in.place()));
  note(lock_memory());

  std::jthread publishing([this](const std::stop_token& stop) {
    name_thread("publisher");
    // Predictions must be sent in time. What is not permitted, the loop reports for both.
    (void)keep_to(base_.config.cpus);
    (void)become_real_time(std::max(base_.config.priority - 1, 0));
    publisher_.run(stop);
  });
  std::jthread recording([this](const std::stop_token& stop) {
    name_thread("recorder");
    recorder_.run(stop);
  });
  const auto in_idle_time = [&note](auto work) {
    return std::jthread([&note, work](const std::stop_token& stop) {
      note(become_idle());
      work(stop);
    });
  };
  std::jthread identifying = in_idle_time([this](const std::stop_token& stop) {
    name_thread("identification");
    identification_.run(stop);
  });
  std::jthread diagnosing = in_idle_time([this](const std::stop_token& stop) {
    name_thread("diagnosis");
    diagnosis_.run(stop);
  });
  std::jthread learning = in_idle_time([this](const std::stop_token& stop) {
    name_thread("learning");
    learner_.run(stop, programs_);
  });
  std::jthread reporting([this](const std::stop_token& stop) {
    name_thread("events");
    report_news(stop);
  });
  std::jthread real_time([this] { run_loop(); });

  {
    std::unique_lock lock(mutex_);
    ended_changed_.wait(lock, base_.stop, [this] { return ended_; });
  }
  fade_out();

  stop_loop_ = true;
  real_time.join();
  if (shown_ != nullptr) shown_->loop_has_ended();
  const auto end = [](std::jthread& thread) {
    thread.request_stop();
    thread.join();
  };
  end(reporting);
  end(recording);
  // The workers finish what they have begun, or give it up; at idle priority that could take for
  // ever on a busy host.
  for (std::jthread* idle : {&identifying, &diagnosing, &learning}) {
    idle->request_stop();
    restore_normal_priority(idle->native_handle());
  }
  for (std::jthread* idle : {&identifying, &diagnosing, &learning}) idle->join();
  if (!base_.stop.stop_requested()) {
    diagnosis_.finish(base_.stop);
    identification_.finish();
  }
  end(publishing);
  for (const std::string& line : publisher_.news()) base_.events.note("network", "", line);
  const MachineStatus total = status();
  base_.events.note(
      "stopped", "",
      "stopped after " + servotwin::counted(total.frames, "frame") + fault_counts(total));
}

void MachineService::fade_out() {
  arming_.end();
  // An offset that is not renewed is a fault for the drive: it fades out first. Without frames
  // nothing can be sent, and the drive ramps it to 0 by itself.
  const std::int64_t until_ns =
      steady_ns() + std::llround(1e9 * (kFadeOuts * fade_out_s(offset_rules(
                                                        rules_, false, contract_.drive_timeout_s)) +
                                        base_.config.ilc.validity_s));
  std::unique_lock lock(mutex_);
  while (!ended_ && hand_over_.active.load(std::memory_order_relaxed) && steady_ns() < until_ns)
    ended_changed_.wait_for(lock, kFadeOutCheck);
}

void MachineService::run_loop() {
  name_thread("real-time loop");
  // In this order, because events wait for the store, which a real-time thread must not do.
  if (const std::string why = keep_to(base_.config.cpus); !why.empty())
    base_.events.note("real_time", "", why);
  if (const std::string why = become_real_time(base_.config.priority); !why.empty())
    base_.events.note("real_time", "", why);
  prefault_stack();
  base_.watchdog.watch(&loop_->counters().turns);
  loop_->run(source_, stop_loop_);
  base_.watchdog.watch(nullptr);
  const std::lock_guard lock(mutex_);
  ended_ = true;
  ended_changed_.notify_all();
}

void MachineService::report_news(const std::stop_token& stop) {
  std::uint64_t reported = 0;  // malformed frames
  std::int64_t reported_ns = 0;
  ModelProposal proposal;
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  while (!stop.stop_requested()) {
    never.wait_for(lock, stop, kNewsPeriod, [] { return false; });
    for (const SourceNews& news : source_.news(steady_ns())) {
      if (news.good) {
        base_.events.note("source", "", news.text);
      } else {
        base_.events.error("source", "", news.text);
      }
    }
    (void)arming_.armed();  // disarms where there is a reason to
    while (proposals_ && proposals_->receive(proposal, 0.0)) identification_.propose(proposal);
    for (const std::string& line : publisher_.news()) {
      // Drives hear another daemon from now on, or this one again, in the middle of a run.
      if (hand_over_.by_publisher) arming_.disarm();
      base_.events.note("network", "", line);
    }
    const std::uint64_t malformed = loop_->counters().malformed;
    if (malformed > reported && (reported == 0 || steady_ns() - reported_ns >= kReportPeriod_ns)) {
      base_.events.error(
          "source", "",
          servotwin::counted(malformed - reported, "frame") + " ignored for lack of the " +
              (machine_.axes.size() == 1 ? std::string("axis")
                                         : std::to_string(machine_.axes.size()) + " axes") +
              " of the machine; restart the daemon if the machine has changed");
      reported = malformed;
      reported_ns = steady_ns();
    }
  }
}

std::string MachineService::standby_reason() const {
  // relaxed: the flag orders no data.
  if (!hand_over_.by_publisher || !hand_over_.standby.load(std::memory_order_relaxed)) return {};
  return "standby: another daemon is active for this machine, and the drives receive its offsets; "
         "arm that one";
}

MachineStatus MachineService::status() {
  MachineStatus now = counted(loop_->counters());
  SourceState source = source_.state(steady_ns());
  if (source.silent) now.state = DaemonState::kWaiting;
  if (base_.stop.stop_requested()) now.state = DaemonState::kStopping;
  now.malformed += source.malformed;
  now.buses = std::move(source.buses);
  now.clocks = source.clocks;
  now.publish_p50_s = published_.quantile_s(0.5);
  now.publish_p99_s = published_.quantile_s(0.99);
  now.publish_p999_s = published_.quantile_s(0.999);
  now.publish_max_s = published_.count() > 0 ? published_.max_s() : kAbsent;
  now.rows_dropped = rows_.drops() + recorder_.rows_not_recorded();
  now.not_recording = recorder_.problem();
  identification_.update(axes_);
  base_.events.update_last_error(last_error_);
  now.axes = axes_;
  for (std::size_t i = 0; i < now.axes.size(); ++i) {
    now.axes[i].rotary = machine_.axes[i].rotary;
    now.axes[i].alarm = watch_.state(i);
    source_.show_alarm(i, now.axes[i].alarm == AlarmState::kRaised);
  }
  now.last_error = last_error_;
  return now;
}

}  // namespace servotwin::daemon
