// Passes published data from the publisher to the web page: cycles in batches, the status with the
// figures of the last second, models and diagnoses.
//
// Two threads: the publisher adds, the web thread takes. The publisher collects data on its own
// side and hands over complete batches without waiting: if the web thread is just taking, it hands
// them over with the next batch. If nobody takes them, the oldest batches are dropped and counted.
#pragma once

#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "daemon/publish/live_batch.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

/// RMS and maximum since the last status; NaN without values.
struct LiveFigures {
  double rms = kAbsent, max = kAbsent;
};

struct LiveAxisFigures {
  LiveFigures measured, predicted, residual;
};

/// The published status, and the figures since the one before.
struct LiveStatus {
  MachineStatus status;
  std::vector<LiveAxisFigures> axes;
  LiveFigures contour, measured_contour;
};

class LiveFeed {
 public:
  /// Maximum number of batches that wait for the web thread: three seconds.
  static constexpr std::size_t kMaxWaitingBatches = 64;

  struct News {
    std::deque<LiveBatch> batches;
    std::optional<LiveStatus> status;
    std::vector<ModelAnnouncement> models;
    std::vector<DiagnosisAnnouncement> diagnoses;
    std::uint64_t dropped = 0;  ///< batches dropped since the start
  };

  LiveFeed(double cycle_s, std::size_t axes);

  // The publisher.
  void add(const MachinePrediction& cycle);
  void add(const MachineStatus& status);
  void add(const ModelAnnouncement& model);
  void add(const DiagnosisAnnouncement& diagnosis);

  /// The web thread: what is new since the last call.
  News take();

 private:
  class Sum {
   public:
    void add(double value);
    LiveFigures take();

   private:
    std::uint64_t count_ = 0;
    double squares_ = 0.0, max_ = 0.0;
  };
  struct AxisSums {
    Sum measured, predicted, residual;
  };

  void collect(std::optional<LiveBatch> batch);
  void hand_over();

  LiveBatcher batcher_;             // the publisher's
  std::vector<AxisSums> sums_;      // likewise
  Sum contour_, measured_contour_;  // likewise
  News collected_;                  // likewise
  std::mutex mutex_;
  News news_;
};

}  // namespace servotwin::daemon
