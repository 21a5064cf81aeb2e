// Samples and recordings: the input of the program, in SI units.
//
// Sign convention everywhere: tracking error e = x_command - x_actual. A force that resists motion
// in the positive direction is positive. Linear axes: m, N. Rotary axes: rad, N m. Plain data; any
// thread.
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

/// One axis in one servo cycle. An absent channel is NaN.
struct AxisSample {
  double command = kAbsent;  ///< interpolator setpoint [m | rad]
  double actual = kAbsent;   ///< position encoder [m | rad]
  double torque = kAbsent;   ///< measured torque, force or current, in its recorded unit
};

/// One servo cycle of one machine: all axes, and the known commands of later cycles. Fixed size and
/// trivially copyable: it is passed between threads by value.
struct MachineFrame {
  std::uint64_t sequence = 0;  ///< cycle counter; a jump means lost cycles
  std::int64_t time_ns = 0;    ///< time stamp of the cycle [ns]
  int axis_count = 0;          ///< 0..kMaxAxes
  int ahead_count = 0;         ///< 0..kMaxLookAhead, the same for all axes
  std::array<AxisSample, kMaxAxes> axes{};
  std::array<std::array<double, kMaxLookAhead>, kMaxAxes> ahead{};  ///< [axis][cycles ahead - 1]
};

/// One axis of a recording as read: one value per row, NaN where the file has none.
struct AxisRecord {
  std::string name;
  bool rotary = false;
  std::vector<double> command;  ///< [m | rad]
  std::vector<double> actual;   ///< [m | rad]
  std::vector<double> torque;   ///< empty, or one per row
  std::string torque_unit;      ///< "N", "Nm", "A", "V", "%" or empty
  /// Encoder of the motor, where `actual` is that of the load: empty, or one per row [m | rad].
  std::vector<double> actual_motor = {};
};

/// A recording as read, before gaps, repeats and jitter are handled.
struct Recording {
  std::string source;              ///< name of the file, or the recorder
  std::vector<double> time;        ///< [s], one per row
  std::vector<AxisRecord> axes;    ///< in the order of the file
  std::vector<std::string> notes;  ///< what the reader repaired, dropped or ignored, for output
};

/// An uninterrupted segment of one axis with constant sampling time. All arrays have one length.
struct Segment {
  double start_s = 0.0;         ///< time of the first sample in the recording
  double sample_time_s = 0.0;   ///< > 0
  Eigen::ArrayXd command;       ///< [m | rad]
  Eigen::ArrayXd actual;        ///< [m | rad]
  Eigen::ArrayXd torque;        ///< empty, or one per sample
  Eigen::ArrayXd actual_motor;  ///< as of AxisRecord: empty, or one per sample; it may have gaps
  Eigen::ArrayXd neighbour;     ///< command of another axis: empty, or one per sample
  bool in_plane = false;        ///< this axis and the neighbour are linear: they form a path
  Eigen::ArrayXd in_cut;        ///< 1 while the tool cuts: empty, or one per sample
  /// Number of lead-in samples at the start: they drive the state of friction, which is unknown
  /// before them, and are not counted in any fit or error figure.
  Eigen::Index lead = 0;
  /// Of lengths and velocities of a rotary axis over those of machines in m (twin/effect.h).
  double length_scale = 1.0;
  /// Motion of the neighbour, measured or predicted: empty, or one per sample, without gaps.
  Eigen::ArrayXd neighbour_motion = {};

  [[nodiscard]] Eigen::Index size() const { return command.size(); }
  [[nodiscard]] double end_s() const {
    return start_s + sample_time_s * static_cast<double>(size() > 0 ? size() - 1 : 0);
  }
};

}  // namespace servotwin
