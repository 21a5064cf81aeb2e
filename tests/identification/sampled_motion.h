// A motion as a recording, with the faults that recordings have, and what its segments must be.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "identification/recording/segments.h"

namespace servotwin {

inline double command_at(double t) { return 0.1 * std::sin(7.0 * t) + 0.02 * t; }
inline double actual_at(double t) { return command_at(t - 0.004); }
inline double torque_at(double t) { return 3.0 * std::cos(7.0 * t); }

/// A motion sampled at `at`, with the time stamps `stamps`.
inline Recording sampled(const std::vector<double>& at, const std::vector<double>& stamps) {
  Recording r;
  r.source = "rec.csv";
  r.time = stamps;
  AxisRecord x;
  x.name = "X";
  x.torque_unit = "Nm";
  for (const double t : at) {
    x.command.push_back(command_at(t));
    x.actual.push_back(actual_at(t));
    x.torque.push_back(torque_at(t));
  }
  r.axes.push_back(std::move(x));
  return r;
}
inline Recording sampled(const std::vector<double>& at) { return sampled(at, at); }

inline std::vector<double> grid(std::size_t rows, double step) {
  std::vector<double> times(rows);
  for (std::size_t i = 0; i < rows; ++i) times[i] = static_cast<double>(i) * step;
  return times;
}

inline void erase_rows(Recording& r, std::size_t from, std::size_t count) {
  const auto erase = [&](std::vector<double>& values) {
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(from);
    values.erase(begin, begin + static_cast<std::ptrdiff_t>(count));
  };
  erase(r.time);
  for (AxisRecord& axis : r.axes) {
    for (auto* values : {&axis.command, &axis.actual, &axis.torque}) erase(*values);
  }
}

inline void repeat_row(Recording& r, std::size_t row) {
  const auto repeat = [&](std::vector<double>& values) {
    values.insert(values.begin() + static_cast<std::ptrdiff_t>(row), values[row]);
  };
  repeat(r.time);
  for (AxisRecord& axis : r.axes) {
    for (auto* values : {&axis.command, &axis.actual, &axis.torque}) repeat(*values);
  }
}

inline std::string text_of(const SegmentReport& report) {
  std::string text;
  for (const std::string& line : report.lines()) text += line + "\n";
  return text;
}
inline void says(const SegmentReport& report, const char* part) {
  EXPECT_NE(text_of(report).find(part), std::string::npos) << "no \"" << part << "\" in:\n"
                                                           << text_of(report);
}

/// Every row is counted exactly once in the report.
inline void expect_accounts_to_balance(const SegmentReport& r) {
  EXPECT_EQ(r.used_rows + r.nan_bridged + r.nan_dropped + r.repeated + r.unplaced + r.short_rows,
            r.rows);
}

/// The segment holds the motion's own values from `first_s` on, to within `tolerance`.
inline void expect_motion(const Segment& segment, double first_s, double tolerance) {
  for (Eigen::Index k = 0; k < segment.size(); ++k) {
    const double t = first_s + static_cast<double>(k) * segment.sample_time_s;
    ASSERT_NEAR(segment.command[k], command_at(t), tolerance) << "sample " << k;
    ASSERT_NEAR(segment.actual[k], actual_at(t), tolerance) << "sample " << k;
    ASSERT_NEAR(segment.torque[k], torque_at(t), 30 * tolerance) << "sample " << k;
  }
}

}  // namespace servotwin
