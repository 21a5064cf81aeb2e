#include "daemon/publish/publisher.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "daemon/between/clock.h"
#include "identification/model/model_file.h"

namespace servotwin::daemon {
namespace {
constexpr std::int64_t kStatusPeriod_ns = 1'000'000'000;
// How often the publisher checks whether to stop.
constexpr std::int64_t kStopCheck_ns = 100'000'000;
// Readers may notice a takeover up to a lease later than this daemon: models are repeated until
// then.
constexpr int kRepeatsAfterTakeover = 1 + static_cast<int>(kLivelinessLease_ns / kStatusPeriod_ns);
}  // namespace

Publisher::Publisher(const DdsNode& node, double cycle_s, Ring<MachinePrediction>& predictions,
                     Ring<DatedOffset>& offsets, OffsetHandOver& hand_over, const WakeUp& wake_up,
                     Histogram& published, Status status, LiveFeed* page)
    : prediction_writer_(node, cycle_s),
      offset_writer_(node),
      model_writer_(node),
      diagnosis_writer_(node),
      status_writer_(node),
      status_reader_(node),
      predictions_(predictions),
      offsets_(offsets, hand_over),
      hand_over_(hand_over),
      wake_up_(wake_up),
      published_(published),
      status_(std::move(status)),
      page_(page) {}

void Publisher::run(const std::stop_token& stop) {
  std::int64_t next_status = steady_ns();
  while (!stop.stop_requested()) {
    const std::int64_t now = steady_ns();
    if (now >= next_status) {
      send_status();
      repeat_announcements();
      next_status = now + kStatusPeriod_ns;
    }
    wake_up_.wait(
        static_cast<int>(std::min(kStopCheck_ns, next_status - now + 1'000'000) / 1'000'000));
    send_offsets();
    send_predictions();
    send_announcements();
    find_active_daemon();
  }
  send_offsets();
  send_predictions();
  send_announcements();
  send_status();
}

void Publisher::announce(const StoredModel& model) {
  const ModelRecord& record = model.record;
  ModelAnnouncement announcement{record.axis,    record.version, record.parent,
                                 record.created, model.reason,   to_json(record).dump()};
  const std::lock_guard lock(mutex_);
  waiting_.push_back(std::move(announcement));
}

void Publisher::announce(const StoredDiagnosis& diagnosis) {
  const std::lock_guard lock(mutex_);
  waiting_diagnoses_.push_back({diagnosis.axis, diagnosis.json});
}

void Publisher::send_offsets() {
  offsets_.send(steady_ns,
                [this](const MachineOffset& offset) { return offset_writer_.write(offset); });
}

void Publisher::send_predictions() {
  while (predictions_.pop(prediction_)) {
    prediction_writer_.write(prediction_);
    if (prediction_.due_ns != 0) published_.add(steady_ns() - prediction_.due_ns);
    if (page_ != nullptr) page_->add(prediction_);
  }
}

void Publisher::send_announcements() {
  std::vector<ModelAnnouncement> models;
  std::vector<DiagnosisAnnouncement> diagnoses;
  {
    // try_lock: predictions must not wait for a thread at idle priority; the next round is soon.
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (lock.owns_lock()) {
      models.swap(waiting_);
      diagnoses.swap(waiting_diagnoses_);
    }
  }
  for (const ModelAnnouncement& model : models) {
    model_writer_.write(model);
    models_[model.axis] = model;
    if (page_ != nullptr) page_->add(model);
  }
  for (const DiagnosisAnnouncement& diagnosis : diagnoses) {
    diagnosis_writer_.write(diagnosis);
    diagnoses_[diagnosis.axis] = diagnosis;
    if (page_ != nullptr) page_->add(diagnosis);
  }
}

// The daemon's own reader gets what every reader gets: the status of the active daemon.
void Publisher::find_active_daemon() {
  MachineStatus status;
  while (status_reader_.receive(status, 0.0)) {
    const bool ours = status_reader_.writer() == status_writer_.handle();
    if (ours != active_.value_or(true)) changes_.push(ours);
    if (ours && !active_.value_or(true)) repeats_left_ = kRepeatsAfterTakeover;
    active_ = ours;
    hand_over_.standby.store(!ours, std::memory_order_relaxed);  // orders no data
  }
}

std::vector<std::string> Publisher::news() {
  std::vector<std::string> lines;
  for (bool ours = false; changes_.pop(ours);) {
    lines.emplace_back(ours ? "this daemon is now active for the machine: the other one stopped or "
                              "has a lower strength"
                            : "standby: another daemon is active for this machine");
  }
  return lines;
}

void Publisher::repeat_announcements() {
  if (repeats_left_ == 0) return;
  --repeats_left_;
  for (const auto& [axis, model] : models_) model_writer_.write(model);
  for (const auto& [axis, diagnosis] : diagnoses_) diagnosis_writer_.write(diagnosis);
}

void Publisher::send_status() {
  MachineStatus status = status_();
  status.time_ns = wall_ns();
  status.predictions_dropped = predictions_.drops() + prediction_writer_.failed();
  const std::int64_t now = steady_ns();
  if (last_status_ns_ != 0 && now > last_status_ns_) {
    status.frame_rate_hz = static_cast<double>(status.frames - last_frames_) * 1e9 /
                           static_cast<double>(now - last_status_ns_);
  }
  last_status_ns_ = now;
  last_frames_ = status.frames;
  status_writer_.write(status);
  if (page_ != nullptr) page_->add(status);
}

}  // namespace servotwin::daemon
