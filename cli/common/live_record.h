// What a subscriber has received about a machine: errors with the model in force, by the motion in
// which they occurred; model versions; lost messages; latency. It handles messages, not their
// transport; times are arguments. One thread.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/statistics/residual.h"
#include "drivers/common/messages.h"
#include "identification/model/model_file.h"

namespace servotwin::cli {

/// RMS and MAX of a stream of numbers; those that are not finite do not count.
class RunningError {
 public:
  void add(double value);
  [[nodiscard]] ErrorFigures figures() const;
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  std::uint64_t count_ = 0;
  double sum_ = 0.0;
  double max_ = 0.0;
};

/// Errors of one axis over the same cycles [m | rad].
struct PredictionErrors {
  RunningError residual;     ///< measured - predicted
  RunningError tracking;     ///< measured
  RunningError predicted{};  ///< predicted
};

/// Contour errors over the same cycles [m].
struct ContourErrors {
  RunningError predicted, measured;
};

struct LiveAxis {
  std::string name;
  AxisState state = AxisState::kNoModel;
  int version = 0;                            ///< of the last prediction
  int in_force = 0;                           ///< as the last status says; 0: none
  std::optional<ModelRecord> model;           ///< of shown_version(), once announced
  std::string model_problem;                  ///< why the announced model cannot be shown
  std::vector<ModelAnnouncement> promotions;  ///< in the order received
  std::string activity;                       ///< what its identification is doing now
  std::string diagnosis;                      ///< the last one, in one line
  std::uint32_t refused = 0;                  ///< candidates, since the daemon started
  std::vector<std::string> refusals;          ///< reasons of those that were received
  PredictionErrors since_promotion;           ///< of this version, after settling
  std::uint64_t settling = 0;                 ///< cycles of this version before it had settled
  PredictionErrors lately;  ///< since clear_lately; without a model only `tracking`

  /// The predicted version, or the one in the status while there is no prediction.
  [[nodiscard]] int shown_version() const { return version > 0 ? version : in_force; }
};

class LiveRecord {
 public:
  /// Cycles per axis of which command and residual are kept for regimes(); later ones are not.
  static constexpr std::size_t kMaxCycles = 1'000'000;
  /// Time without a prediction after which silent() is true [s]; longer than a period of the
  /// status.
  static constexpr double kSilence_s = 1.5;

  void on_frame(const MachineFrame& frame, std::int64_t written_ns);
  void on_prediction(const MachinePrediction& prediction, std::int64_t written_ns);
  void on_model(const ModelAnnouncement& announcement);
  void on_diagnosis(const DiagnosisAnnouncement& announcement);
  void on_status(const MachineStatus& status);
  /// How long there has been no prediction [s], and whether a daemon is there.
  void silent_for(double seconds, bool daemon_there) {
    silent_s_ = seconds;
    daemon_there_ = daemon_there;
  }
  [[nodiscard]] bool daemon_there() const { return daemon_there_; }
  void clear_lately();

  [[nodiscard]] const std::vector<LiveAxis>& axes() const { return axes_; }
  /// Contour error since clear_lately.
  [[nodiscard]] const ContourErrors& contour_lately() const { return contour_lately_; }
  /// The same since a model came into force and its twin has settled.
  [[nodiscard]] const ContourErrors& contour_since_promotion() const { return contour_; }
  [[nodiscard]] const std::optional<MachineStatus>& status() const { return status_; }
  [[nodiscard]] std::uint64_t predictions() const { return predictions_; }
  /// Whether there are no predictions now: what is known about the axes is older.
  [[nodiscard]] bool silent() const { return predictions_ == 0 || silent_s_ > kSilence_s; }
  [[nodiscard]] double silent_s() const { return silent_s_; }
  /// Predictions since clear_lately.
  [[nodiscard]] std::uint64_t latest() const { return predictions_ - cleared_; }
  /// Cycles without a prediction between the first and the last prediction received.
  [[nodiscard]] std::uint64_t missed() const { return missed_; }
  /// Quantile (0 to 1) of the time from sending a frame to sending its prediction [s]; NaN if none
  /// was received.
  [[nodiscard]] double latency_s(double quantile) const;
  /// Predictions per second of the sender's clock; NaN for fewer than two.
  [[nodiscard]] double rate_hz() const;
  /// The residual of the cycles since the version in force was promoted, by regime.
  [[nodiscard]] RegimeShares regimes(std::size_t axis) const;

 private:
  struct Cycles {  // an unbroken run of cycles
    std::uint64_t first_sequence = 0, last_sequence = 0;
    std::int64_t first_ns = 0, last_ns = 0;
    std::vector<double> command, residual;
  };
  struct Sent {  // a frame whose prediction may come
    std::uint64_t sequence = 0;
    std::int64_t written_ns = 0;
    int axis_count = 0;
    std::array<double, kMaxAxes> command{};
  };

  [[nodiscard]] const Sent* sent(std::uint64_t sequence) const;
  void keep(std::size_t axis, const MachinePrediction& prediction, double command);
  void set_model(LiveAxis& axis);

  std::vector<LiveAxis> axes_;
  std::vector<std::vector<Cycles>> cycles_;  // per axis
  std::vector<std::size_t> kept_;            // cycles in them
  std::vector<ModelAnnouncement> unplaced_;  // received before the order of the axes was known
  std::vector<DiagnosisAnnouncement> unplaced_diagnoses_;  // the same
  std::vector<Sent> frames_ = std::vector<Sent>(1024);     // by sequence
  std::vector<std::int64_t> latencies_ns_;
  std::optional<MachineStatus> status_;
  ContourErrors contour_lately_, contour_;
  std::uint64_t predictions_ = 0, missed_ = 0, last_sequence_ = 0;
  std::uint64_t cleared_ = 0;  // predictions before clear_lately
  std::int64_t first_written_ns_ = 0, last_written_ns_ = 0;
  double silent_s_ = 0.0;
  bool daemon_there_ = false;
};

}  // namespace servotwin::cli
