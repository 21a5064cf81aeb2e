// Samples and recordings: what enters the program, in SI units.
//
// Sign convention, everywhere: tracking error e = x_command - x_actual. A force effect that resists
// motion in the positive direction is positive. Linear axes: m, N. Rotary axes: rad, N m.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace servotwin {

inline constexpr int kMaxAxes = 32;
inline constexpr int kMaxLookAhead = 32;
inline constexpr double kAbsent = std::numeric_limits<double>::quiet_NaN();

/// One axis in one servo cycle. A channel that is not there is NaN.
struct AxisSample {
  double command = kAbsent;  ///< interpolator set-point [m | rad]
  double actual = kAbsent;   ///< position encoder [m | rad]
  double torque = kAbsent;   ///< measured torque, force or current, in its recorded unit
};

/// One servo cycle of one machine: all axes, and the commands that are already known of later
/// cycles. Fixed size and trivially copyable: it crosses threads by value.
struct MachineFrame {
  std::uint64_t sequence = 0;  ///< counts cycles; a jump is a loss
  std::int64_t time_ns = 0;    ///< stamp of the cycle
  int axis_count = 0;          ///< 0..kMaxAxes
  int ahead_count = 0;         ///< 0..kMaxLookAhead, the same for all axes
  std::array<AxisSample, kMaxAxes> axes{};
  std::array<std::array<double, kMaxLookAhead>, kMaxAxes> ahead{};  ///< [axis][cycles ahead - 1]
};

/// One axis of a recording as it was read: one value per row, NaN where the file had none.
struct AxisRecord {
  std::string name;
  bool rotary = false;
  std::vector<double> command;  ///< [m | rad]
  std::vector<double> actual;   ///< [m | rad]
  std::vector<double> torque;   ///< empty, or one per row
  std::string torque_unit;      ///< "N", "Nm", "A", "V", "%" or empty
};

/// A recording as it was read, before gaps, repeats and jitter are dealt with.
struct Recording {
  std::string source;              ///< the file's name, or who recorded it
  std::vector<double> time;        ///< [s], one per row
  std::vector<AxisRecord> axes;    ///< in the file's order
  std::vector<std::string> notes;  ///< what the reader repaired, dropped or ignored, for people
};

/// An unbroken stretch of one axis with a constant sampling time. Arrays are of one length.
struct Segment {
  double start_s = 0.0;        ///< time of the first sample in the recording
  double sample_time_s = 0.0;  ///< > 0
  Eigen::ArrayXd command;      ///< [m | rad]
  Eigen::ArrayXd actual;       ///< [m | rad]
  Eigen::ArrayXd torque;       ///< empty, or one per sample
  Eigen::ArrayXd neighbour;    ///< command of another axis: empty, or one per sample
  bool in_plane = false;       ///< this axis and the neighbour are linear: they draw a path
  Eigen::ArrayXd in_cut;       ///< 1 while the tool cuts: empty, or one per sample
  /// Samples at the start that lead in: what friction remembers from before is not known until they
  /// are over, so that no fit and no figure counts them.
  Eigen::Index lead = 0;

  [[nodiscard]] Eigen::Index size() const { return command.size(); }
  [[nodiscard]] double end_s() const {
    return start_s + sample_time_s * static_cast<double>(size() > 0 ? size() - 1 : 0);
  }
};

}  // namespace servotwin
