#include "cli/common/live_record.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace servotwin::cli {

void RunningError::add(double value) {
  if (!std::isfinite(value)) return;
  ++count_;
  sum_ += value * value;
  max_ = std::max(max_, std::abs(value));
}

ErrorFigures RunningError::figures() const {
  if (count_ == 0) return {};
  return {std::sqrt(sum_ / static_cast<double>(count_)), max_};
}

void LiveRecord::on_frame(const MachineFrame& frame, std::int64_t written_ns) {
  Sent& slot = frames_[frame.sequence % frames_.size()];
  slot.sequence = frame.sequence;
  slot.written_ns = written_ns;
  slot.axis_count = frame.axis_count;
  for (std::size_t i = 0; i < static_cast<std::size_t>(frame.axis_count); ++i)
    slot.command[i] = frame.axes[i].command;
}

const LiveRecord::Sent* LiveRecord::sent(std::uint64_t sequence) const {
  const Sent& slot = frames_[sequence % frames_.size()];
  return slot.axis_count > 0 && slot.sequence == sequence ? &slot : nullptr;
}

void LiveRecord::on_prediction(const MachinePrediction& prediction, std::int64_t written_ns) {
  if (predictions_ > 0 && prediction.sequence > last_sequence_ + 1)
    missed_ += prediction.sequence - last_sequence_ - 1;
  last_sequence_ = prediction.sequence;
  ++predictions_;
  silent_s_ = 0.0;
  if (predictions_ == 1) first_written_ns_ = written_ns;
  last_written_ns_ = written_ns;
  const Sent* frame = sent(prediction.sequence);
  if (frame != nullptr && latencies_ns_.size() < kMaxCycles)
    latencies_ns_.push_back(written_ns - frame->written_ns);

  contour_lately_.predicted.add(prediction.contour_error);
  contour_lately_.measured.add(prediction.measured_contour_error);
  const auto count = static_cast<std::size_t>(prediction.axis_count);
  while (axes_.size() < count) {
    axes_.emplace_back().name = "axis " + std::to_string(axes_.size());
    cycles_.emplace_back();
    kept_.push_back(0);
  }
  for (std::size_t i = 0; i < count; ++i) {
    const AxisPrediction& one = prediction.axes[i];
    LiveAxis& axis = axes_[i];
    axis.state = one.state;
    if (one.model_version != axis.version) {
      axis.version = one.model_version;
      axis.since_promotion = {};
      contour_ = {};
      axis.settling = 0;
      cycles_[i].clear();
      kept_[i] = 0;
      set_model(axis);
    }
    if (one.state == AxisState::kSettling) ++axis.settling;
    if (one.state == AxisState::kNoModel) axis.lately.tracking.add(one.measured_error);
    if (one.state != AxisState::kPredicting || !std::isfinite(one.residual)) continue;
    for (PredictionErrors* errors : {&axis.since_promotion, &axis.lately}) {
      errors->residual.add(one.residual);
      errors->tracking.add(one.measured_error);
      errors->predicted.add(one.predicted_error);
    }
    if (frame != nullptr && i < static_cast<std::size_t>(frame->axis_count))
      keep(i, prediction, frame->command[i]);
  }
  // A contour error is predicted where all axes of a path are; a twin that has just started is not
  // the axis yet.
  const bool settling =
      std::any_of(prediction.axes.begin(), prediction.axes.begin() + prediction.axis_count,
                  [](const AxisPrediction& one) { return one.state == AxisState::kSettling; });
  if (!settling && std::isfinite(prediction.contour_error) &&
      std::isfinite(prediction.measured_contour_error)) {
    contour_.predicted.add(prediction.contour_error);
    contour_.measured.add(prediction.measured_contour_error);
  }
}

void LiveRecord::keep(std::size_t axis, const MachinePrediction& prediction, double command) {
  if (kept_[axis] >= kMaxCycles) return;
  std::vector<Cycles>& runs = cycles_[axis];
  if (runs.empty() || prediction.sequence != runs.back().last_sequence + 1) {
    runs.emplace_back();
    runs.back().first_sequence = prediction.sequence;
    runs.back().first_ns = prediction.time_ns;
  }
  Cycles& run = runs.back();
  run.last_sequence = prediction.sequence;
  run.last_ns = prediction.time_ns;
  run.command.push_back(command);
  run.residual.push_back(prediction.axes[axis].residual);
  ++kept_[axis];
}

void LiveRecord::on_model(const ModelAnnouncement& announcement) {
  const auto axis = std::find_if(axes_.begin(), axes_.end(), [&](const LiveAxis& one) {
    return one.name == announcement.axis;
  });
  if (axis == axes_.end()) {
    unplaced_.push_back(announcement);
    return;
  }
  axis->promotions.push_back(announcement);
  set_model(*axis);
}

namespace {

/// "explained: cogging, presliding (2026-01-31T12:00:00.000Z)", or why it cannot be read.
std::string line_of(const DiagnosisAnnouncement& announcement) {
  try {
    const auto file = nlohmann::json::parse(announcement.diagnosis_json);
    std::string causes;
    for (const auto& cause : file.at("causes"))
      causes += (causes.empty() ? ": " : ", ") + cause.at("id").get<std::string>();
    return file.at("verdict").get<std::string>() + causes + " (" + file.value("created", "") + ")";
  } catch (const nlohmann::json::exception& error) {
    return std::string("cannot be read: ") + error.what();
  }
}

}  // namespace

void LiveRecord::on_diagnosis(const DiagnosisAnnouncement& announcement) {
  const auto axis = std::find_if(axes_.begin(), axes_.end(), [&](const LiveAxis& one) {
    return one.name == announcement.axis;
  });
  if (axis == axes_.end()) {
    unplaced_diagnoses_.push_back(announcement);
  } else {
    axis->diagnosis = line_of(announcement);
  }
}

void LiveRecord::set_model(LiveAxis& axis) {
  axis.model.reset();
  axis.model_problem.clear();
  for (const ModelAnnouncement& announcement : axis.promotions) {
    if (announcement.version != axis.shown_version()) continue;
    // A message from the network may be invalid; the figures are shown even without the model.
    try {
      axis.model = model_from_json(nlohmann::json::parse(announcement.model_json));
    } catch (const std::exception& error) {
      axis.model_problem = error.what();
    }
  }
}

void LiveRecord::on_status(const MachineStatus& status) {
  status_ = status;
  while (axes_.size() < status.axes.size()) {
    axes_.emplace_back();
    cycles_.emplace_back();
    kept_.push_back(0);
  }
  for (std::size_t i = 0; i < status.axes.size(); ++i) {
    axes_[i].name = status.axes[i].name;
    axes_[i].activity = status.axes[i].activity;
    if (axes_[i].in_force != status.axes[i].model_version) {
      axes_[i].in_force = status.axes[i].model_version;
      if (axes_[i].version == 0) set_model(axes_[i]);
    }
    if (status.axes[i].refused > axes_[i].refused) {
      axes_[i].refusals.push_back(status.axes[i].last_refusal);
    }
    axes_[i].refused = status.axes[i].refused;
  }
  std::vector<ModelAnnouncement> waiting;
  waiting.swap(unplaced_);
  for (const ModelAnnouncement& announcement : waiting) on_model(announcement);
  std::vector<DiagnosisAnnouncement> diagnoses;
  diagnoses.swap(unplaced_diagnoses_);
  for (const DiagnosisAnnouncement& announcement : diagnoses) on_diagnosis(announcement);
}

void LiveRecord::clear_lately() {
  for (LiveAxis& axis : axes_) axis.lately = {};
  contour_lately_ = {};
  cleared_ = predictions_;
}

double LiveRecord::latency_s(double quantile) const {
  if (latencies_ns_.empty()) return kAbsent;
  std::vector<std::int64_t> sorted = latencies_ns_;
  const auto at = sorted.begin() +
                  static_cast<std::ptrdiff_t>(quantile * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), at, sorted.end());
  return static_cast<double>(*at) * 1e-9;
}

double LiveRecord::rate_hz() const {
  if (predictions_ < 2 || last_written_ns_ <= first_written_ns_) return kAbsent;
  return static_cast<double>(predictions_ - 1) * 1e9 /
         static_cast<double>(last_written_ns_ - first_written_ns_);
}

RegimeShares LiveRecord::regimes(std::size_t axis) const {
  std::vector<ResidualStretch> stretches;
  for (const Cycles& run : cycles_[axis]) {
    if (run.last_sequence == run.first_sequence || run.last_ns <= run.first_ns) continue;
    ResidualStretch stretch;
    const auto n = static_cast<Eigen::Index>(run.command.size());
    stretch.command = Eigen::Map<const Eigen::ArrayXd>(run.command.data(), n);
    stretch.residual = Eigen::Map<const Eigen::ArrayXd>(run.residual.data(), n);
    stretch.h = static_cast<double>(run.last_ns - run.first_ns) * 1e-9 /
                static_cast<double>(run.last_sequence - run.first_sequence);
    stretches.push_back(std::move(stretch));
  }
  return by_regime(stretches);
}

}  // namespace servotwin::cli
