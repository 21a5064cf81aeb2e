// The time stamps of a recording: its sampling time, and the place of each row on that grid.
//
// Recorders write stamps with limited accuracy. They are evaluated in this order:
// - a row without a stamp, or a single stamp that is out of order, is repaired if its neighbours
//   leave room for exactly one row, else the row is dropped; more stamps out of order are an error;
// - stamps too coarse for the rate (0.6 ms written in steps of 1 ms) follow a straight line within
//   their resolution: the rows are evenly spaced at the mean step;
// - other rows that repeat a stamp are dropped;
// - small jitter is attributed to the recorder, and the rows are evenly spaced; large jitter is
//   attributed to the sampling, and the rows are resampled.
// Times in seconds. Errors: std::runtime_error. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace servotwin {

enum class Spacing {
  kEven,    ///< rows are samples of an even grid
  kUneven,  ///< rows were sampled at uneven times: to be resampled
};

struct StampLimits {
  double jitter_share = 0.1;     ///< of the step: a row that is further from its place is misplaced
  double misplaced_rows = 0.01;  ///< share of the rows that may be misplaced on an even grid
};

struct Stamps {
  Spacing spacing = Spacing::kEven;
  double step_s = 0.0;  ///< sampling time
  double resolution_s =
      0.0;  ///< of the stamps where they are coarser than the jitter allowed; else 0
  std::vector<std::size_t> row;       ///< rows kept, in the recording's numbering from 0
  std::vector<double> time;           ///< their stamps, increasing (coarse stamps: not decreasing)
  std::vector<std::int64_t> advance;  ///< steps since the kept row before, >= 1; 0 for the first
  std::size_t repeated = 0;           ///< rows dropped: repeated stamp
  std::size_t repaired = 0;           ///< stamps replaced by interpolation between the neighbours
  std::size_t unplaced = 0;           ///< rows dropped: no usable stamp
  double jitter_rms = 0.0;            ///< of the step, as a share of it, gaps left out
  double jitter_max = 0.0;
};

/// `same_values(a, b)`: whether two rows have the same values in all channels.
/// `source` begins every message. Throws if time stands still or runs backwards.
[[nodiscard]] Stamps read_stamps(const std::string& source, const std::vector<double>& time,
                                 const std::function<bool(std::size_t, std::size_t)>& same_values,
                                 const StampLimits& limits = {});

}  // namespace servotwin
