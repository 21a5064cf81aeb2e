// What two encoders on one axis show by their difference: play, a spring, a pitch error between
// motor and load.
//
//   load - motor = c - S/2 s + G s b - k a - T v + p x - J a'
//
//   s  direction of motion                 S  step at a reversal: play, and what friction winds up
//   b  1 while the axis brakes hard        G  step where the load changes sides: play alone
//   a  acceleration of the load            k  mass over stiffness, 1 / omega^2 of the load
//   v  velocity                            T  the load is read later than the motor, or drag
//   x  position of the load                p  pitch error or scale
//                                          J  damping of the spring, without a name of its own
//
// While the motor drives, the load is on one side of a gap whatever friction is; while it brakes,
// the load goes over to the other side if its inertia exceeds its friction, which tells play from a
// spring that friction winds up. Used are the samples in which the side is certain: after a rest or
// a reversal the motor has travelled further than the encoders ever differ, and it is past a change
// of sides. All channels pass the same filter, so that it does not bias the fit. Intervals of 0.25
// s in which far more is left than usual (impacts, stick-slip) are not fitted. The 95 % intervals
// are those of the jackknife over moves, or over intervals of 0.25 s where these are wider.
//
// Units: m | rad, s; times 1e6 in text. Errors: none; what the motion does not determine is NaN.
// Any thread. Allocates some columns of the recording, and nothing without a second encoder.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "identification/recording/segments.h"

namespace servotwin {

/// Following errors, RMS and MAX. The motor's zero is put where both agree in the mean: it is not
/// that of the load.
struct EncoderErrors {
  double motor_rms = 0.0, motor_max = 0.0, load_rms = 0.0, load_max = 0.0;
};
/// Nothing without a second encoder.
[[nodiscard]] std::optional<EncoderErrors> encoder_errors(const std::vector<Segment>& segments);
/// "812 um RMS, 2771 MAX at the motor; 815 um RMS, 2790 MAX at the load".
[[nodiscard]] std::string errors_text(const EncoderErrors& errors, bool rotary);

struct EncoderDifference {
  struct Term {
    double value = kAbsent, low = kAbsent, high = kAbsent;  ///< with 95 % interval; NaN: not known
    bool shown = false;  ///< not 0, and more than the encoders resolve
  };
  bool rotary = false;
  EncoderErrors errors;
  double rms = 0.0;         ///< of the difference about its mean
  double resolution = 0.0;  ///< largest encoder step, or three standard deviations of noise
  int moves = 0;            ///< that were used; with few of them no term is known
  double used_rms = kAbsent,
         left_rms = kAbsent;  ///< in these moves: of the difference, of the rest
  Term reversal, other_side, compliance, delay, scale;  ///< S, G, k, T, p
  double braking = 0.0;                                 ///< hardest [m/s^2 | rad/s^2]

  [[nodiscard]] bool spring() const;  ///< it is shown
  /// Friction over mass that winds the spring up by what is not play [m/s^2 | rad/s^2].
  [[nodiscard]] double friction() const;
  /// Where the axis brakes hard, a load with this friction crosses a gap.
  [[nodiscard]] bool changes_sides() const;
  /// The play that is shown: with a spring the step of the other side, else that at a reversal.
  [[nodiscard]] Term play() const;
  /// The step at a reversal may be play, or friction that winds up the spring.
  [[nodiscard]] bool undecided() const;
};

/// Nothing without a second encoder.
[[nodiscard]] std::optional<EncoderDifference> encoder_difference(const SegmentedAxis& axis);

/// One paragraph: "Between the encoders: play of 12.1 um (11.8 to 12.4); ..".
[[nodiscard]] std::string plain_text(const EncoderDifference& difference);
/// Whether the encoders show this cause ("backlash", "compliance"); empty where they cannot tell.
[[nodiscard]] std::string encoders_beside(const EncoderDifference& difference,
                                          const std::string& cause);
/// `encoder_difference` of the diagnosis file.
[[nodiscard]] nlohmann::json to_json(const EncoderDifference& difference);

}  // namespace servotwin
