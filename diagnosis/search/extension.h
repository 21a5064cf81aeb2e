// Adds an effect of the catalogue to a model structure, and removes a cause from it. Any thread.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "identification/loop/projection.h"

namespace servotwin {

/// Which signals the segments contain in addition to command and encoder, and whether errors of the
/// encoder reading are observable.
struct Channels {
  bool neighbour = true;         ///< the command of another axis
  bool neighbour_motion = true;  ///< and its encoder
  bool in_cut = true;            ///< when the tool was cutting
  bool reading = true;  ///< errors of the reading: the encoder is not that of the position loop
  bool rests = true;    ///< the axis rests; reversals of a smooth motion do not count
  bool rotary = false;  ///< a load may swing with the axis
  explicit Channels(const std::vector<Segment>& segments, bool encoder_in_loop = false);
};

/// The cause that an effect is evidence of; empty: the effect is no cause.
[[nodiscard]] std::string cause_of(std::size_t kind);

/// The effects that could be added to this structure: without those of causes that are known
/// already or left out, and without those that are not observable with these channels.
[[nodiscard]] std::vector<std::size_t> candidates_of(const Structure& structure,
                                                     const std::vector<std::string>& known,
                                                     const std::vector<std::string>& leave_out,
                                                     const Channels& channels);

/// The structure with this effect, which replaces the one that the catalogue says it replaces.
[[nodiscard]] Structure extended_by(const Structure& base, std::size_t kind);

/// The structure without a cause that this effect models. An effect that it replaced returns if
/// every machine has it. The structure itself where it does not contain the effect.
[[nodiscard]] Structure without(const Structure& base, const std::string& cause, std::size_t kind);

/// The number of parameters that an effect adds to a fit, less those of the effect that it
/// replaces.
[[nodiscard]] int parameters_of(std::size_t kind);

/// Laws of friction that contain both presliding and falling friction; the most flexible one last.
inline constexpr std::array<std::size_t, 3> kLaws{kind_of<LuGre>(), kind_of<PreslidingStribeck>(),
                                                  kind_of<Gms>()};

}  // namespace servotwin
