#include "diagnosis/search/extension.h"

#include <algorithm>

#include "identification/recording/excitation.h"

namespace servotwin {

Channels::Channels(const std::vector<Segment>& segments, bool encoder_in_loop)
    : reading(!encoder_in_loop) {
  // Share of the time. Reversals of a smooth motion alone reach more than half of it.
  constexpr double kMinRestShare = 0.02;
  for (const Segment& s : segments) {
    neighbour = neighbour && s.neighbour.size() == s.size();
    neighbour_motion = neighbour_motion && s.neighbour_motion.size() == s.size();
    in_cut = in_cut && s.in_cut.size() == s.size();
  }
  rests = excitation_of(segments).rest_share >= kMinRestShare;
}

std::string cause_of(std::size_t kind) { return std::string(identity_of(kind).cause); }

std::vector<std::size_t> candidates_of(const Structure& structure,
                                       const std::vector<std::string>& known,
                                       const std::vector<std::string>& leave_out,
                                       const Channels& channels) {
  const auto has = [&](std::size_t kind) {
    const auto& e = structure.effects;
    return std::find(e.begin(), e.end(), kind) != e.end();
  };
  const bool coupled = std::any_of(structure.effects.begin(), structure.effects.end(), couples);
  std::vector<std::size_t> out;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    const Identity& identity = identity_of(kind);
    if (identity.cause.empty() || !identity.form_of.empty() ||
        identity.acts == Acts::kCommandDelay || identity.acts == Acts::kAxis || has(kind) ||
        std::find(known.begin(), known.end(), identity.cause) != known.end())
      continue;
    if (std::find(leave_out.begin(), leave_out.end(), identity.cause) != leave_out.end()) continue;
    // With an integrator in the loop a constant force is not observable; asymmetric friction
    // includes it.
    if (kind == kind_of<ConstantForce>() &&
        (structure.order == 3 || has(kind_of<AsymmetricFriction>())))
      continue;
    if (couples(kind) && (coupled || !channels.neighbour ||
                          channels.neighbour_motion != (kind == kind_of<CrossCouplingByMotion>())))
      continue;
    if (kind == kind_of<CuttingForce>() && !channels.in_cut) continue;
    if (kind == kind_of<DwellStiction>() && !channels.rests) continue;
    if (kind == kind_of<SwingingLoad>() && !channels.rotary) continue;
    if (identity.acts == Acts::kReading && !channels.reading) continue;
    out.push_back(kind);
  }
  return out;
}

Structure extended_by(const Structure& base, std::size_t kind) {
  Structure out = base;
  const std::size_t replaced = kind_of(identity_of(kind).replaces);
  const auto at = std::find(out.effects.begin(), out.effects.end(), replaced);
  if (at != out.effects.end()) {
    *at = kind;
  } else {
    out.effects.push_back(kind);
  }
  return out;
}

Structure without(const Structure& base, const std::string& cause, std::size_t kind) {
  Structure out = base;
  const auto at = std::find(out.effects.begin(), out.effects.end(), kind);
  if (at == out.effects.end()) return out;
  if (std::find(kLaws.begin(), kLaws.end(), kind) != kLaws.end()) {
    *at = cause == "stribeck" ? kind_of<Presliding>() : kind_of<CoulombFriction>();
    if (cause != "stribeck") out.effects.push_back(kind_of<FallingFriction>());
    return out;
  }
  const std::size_t replaced = kind_of(identity_of(kind).replaces);
  if (replaced < kEffectKinds && identity_of(replaced).cause.empty()) {
    *at = replaced;
  } else {
    out.effects.erase(at);
  }
  return out;
}

int parameters_of(std::size_t kind) {
  const auto count = [](std::size_t k) {
    Structure one{3, {k}};
    return one.shape_count() + one.coefficient_count();
  };
  const std::size_t replaced = kind_of(identity_of(kind).replaces);
  return count(kind) - (replaced < kEffectKinds ? count(replaced) : 0);
}

}  // namespace servotwin
