// How a structure grows by an effect of the catalogue and shrinks by a cause.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "identification/loop/projection.h"

namespace servotwin {

/// What the segments tell beside command and encoder, and whether the encoder shows more than the
/// loop makes right.
struct Channels {
  bool neighbour = true, in_cut = true, reading = true;
  bool rests = true;  ///< a turn of a smooth motion is no rest
  explicit Channels(const std::vector<Segment>& segments, bool encoder_in_loop = false);
};

/// The cause that an effect is evidence of; empty: of none.
[[nodiscard]] std::string cause_of(std::size_t kind);

/// The effects that could be added to this structure: not those of causes that are known already or
/// left out, nor what the channels cannot show.
[[nodiscard]] std::vector<std::size_t> candidates_of(const Structure& structure,
                                                     const std::vector<std::string>& known,
                                                     const std::vector<std::string>& leave_out,
                                                     const Channels& channels);

[[nodiscard]] Structure extended_by(const Structure& base, std::size_t kind);

/// What is left when a cause that this effect models is taken out again: what the effect replaced
/// returns where every machine has it. The structure itself where that effect is not in it.
[[nodiscard]] Structure without(const Structure& base, const std::string& cause, std::size_t kind);

/// What an effect adds to a fit, beyond what it replaces.
[[nodiscard]] int parameters_of(std::size_t kind);

/// Laws of friction that say in one what presliding and falling friction say as two, the one that
/// can be any last.
inline constexpr std::array<std::size_t, 3> kLaws{kind_of<LuGre>(), kind_of<PreslidingStribeck>(),
                                                  kind_of<Gms>()};

}  // namespace servotwin
