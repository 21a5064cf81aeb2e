// The time stamps of a recording: what its sampling time is and where each row belongs on that
// grid.
//
// Stamps tell of the samples only as well as the recorder wrote them. In this order:
// - a row without a stamp, or one stamp that is out of order between good ones, is repaired where
// its
//   neighbours leave exactly its place, else the row is dropped; anything more is time running
//   backwards;
// - stamps written too coarsely for the rate (0.6 ms in steps of 1 ms) are recognised by following
// a
//   straight line within their resolution: the rows are evenly spaced at the mean step;
// - other rows that repeat a stamp are dropped;
// - small jitter is the recorder's, the rows are evenly spaced; large jitter is the sampling's own.
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
  kUneven,  ///< rows were taken at their stamps, which are no grid: to be resampled
};

struct StampLimits {
  double jitter_share = 0.1;     ///< of the step: a row further off its place is out of place
  double misplaced_rows = 0.01;  ///< share of the rows that may be out of place on an even grid
};

struct Stamps {
  Spacing spacing = Spacing::kEven;
  double step_s = 0.0;  ///< sampling time
  double resolution_s =
      0.0;  ///< of the stamps where they are coarser than the jitter allowed; else 0
  std::vector<std::size_t> row;       ///< rows kept, in the recording's numbering from 0
  std::vector<double> time;           ///< their stamps, increasing (coarse stamps: not decreasing)
  std::vector<std::int64_t> advance;  ///< steps since the kept row before, >= 1; 0 for the first
  std::size_t repeated = 0;           ///< rows dropped: their stamp was there already
  std::size_t repaired = 0;           ///< stamps replaced by the place that their neighbours leave
  std::size_t unplaced = 0;           ///< rows dropped: no usable stamp
  double jitter_rms = 0.0;            ///< of the step, as a share of it, gaps left out
  double jitter_max = 0.0;
};

/// `same_values(a, b)` tells whether two rows hold the same values in all channels.
/// `source` begins every message. Throws if time stands still or runs backwards.
[[nodiscard]] Stamps read_stamps(const std::string& source, const std::vector<double>& time,
                                 const std::function<bool(std::size_t, std::size_t)>& same_values,
                                 const StampLimits& limits = {});

}  // namespace servotwin
