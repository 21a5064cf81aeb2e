// What the publisher publishes, for whoever looks at the page: cycles in batches, the status with
// the figures of the last second, models and diagnoses.
//
// Two threads: the publisher adds, the web thread takes. The publisher collects on its own side,
// hands over what is complete, and does not wait for that: where the web thread is just taking, it
// hands over with the next batch. If nobody takes, the oldest batches are dropped and counted.
#pragma once

#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "daemon/publish/live_batch.h"
#include "drivers/messages.h"

namespace servotwin::daemon {

/// RMS and MAX of what came since the last status; NaN where nothing did.
struct LiveFigures {
  double rms = kAbsent, max = kAbsent;
};

struct LiveAxisFigures {
  LiveFigures measured, predicted, residual;
};

/// The status as it is published, and what was seen since the one before.
struct LiveStatus {
  MachineStatus status;
  std::vector<LiveAxisFigures> axes;
  LiveFigures contour;
};

class LiveFeed {
 public:
  /// Batches that wait for the web thread at most: three seconds.
  static constexpr std::size_t kMostWaiting = 64;

  struct News {
    std::deque<LiveBatch> batches;
    std::optional<LiveStatus> status;
    std::vector<ModelAnnouncement> models;
    std::vector<DiagnosisAnnouncement> diagnoses;
    std::uint64_t dropped = 0;  ///< batches that were not taken in time, since the start
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

  LiveBatcher batcher_;         // the publisher's
  std::vector<AxisSums> sums_;  // likewise
  Sum contour_;                 // likewise
  News collected_;              // likewise
  std::mutex mutex_;
  News news_;
};

}  // namespace servotwin::daemon
