// What Cyclone DDS reports, to standard error: at most kMaxLines a minute, because it writes a line
// for every packet that the network refuses.
//
// Lines beyond that are counted, and the next line that is written says how many. Any thread;
// errors: none.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>

namespace servotwin {

class LineLimit {
 public:
  static constexpr int kMaxLines = 10;
  static constexpr std::int64_t kPeriod_ns = 60'000'000'000;

  /// What is to be written for this line at `now_ns` (steady clock): nothing, the line, or the line
  /// after a line about those that were left out. Every line ends with a line feed.
  [[nodiscard]] std::string pass(std::string_view line, std::int64_t now_ns);

 private:
  std::mutex mutex_;
  std::int64_t began_ns_ = 0;  // of the period
  int lines_ = 0;              // in it
  bool begun_ = false;
  std::uint64_t left_out_ = 0;
};

/// From now on Cyclone DDS reports through a LineLimit of this process. Later calls do nothing.
void limit_dds_log();

}  // namespace servotwin
