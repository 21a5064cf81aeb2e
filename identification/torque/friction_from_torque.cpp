#include "identification/torque/friction_from_torque.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "identification/recording/segments.h"

namespace servotwin {

namespace {

constexpr int kFolds = 4;
constexpr double kMaxSpeedDifference = 0.02;     // relative difference of speeds within one fold
constexpr double kNegligibleTorqueShare = 2e-4;  // error over torque below which models are equal
constexpr std::size_t kFewestRamps = 8;          // per direction, without stick-slip

ForceData pairs_of(const std::vector<Ramp>& ramps) {
  Eigen::ArrayXd velocity(static_cast<Eigen::Index>(ramps.size())), torque(velocity.size());
  for (std::size_t i = 0; i < ramps.size(); ++i) {
    velocity(static_cast<Eigen::Index>(i)) = ramps[i].velocity;
    torque(static_cast<Eigen::Index>(i)) = ramps[i].torque;
  }
  return ForceData::of_velocities(velocity, torque);
}

bool by_direction(std::size_t kind) {
  return kind == kind_of<Stribeck>() || kind == kind_of<ModifiedStribeck>() ||
         kind == kind_of<FrictionMap>();
}

/// The simplest model (the first) whose held-out error is within `slack` of the least, or
/// negligible compared with the torque.
void choose(std::vector<FrictionTrial>& trials, double slack) {
  if (trials.empty()) throw std::runtime_error("no friction model could be fitted to the torque");
  double least = std::numeric_limits<double>::infinity();
  for (const FrictionTrial& trial : trials) least = std::min(least, trial.held_out.rms);
  for (FrictionTrial& trial : trials) {
    if (trial.held_out.rms > (1.0 + slack) * least &&
        trial.held_out.relative > kNegligibleTorqueShare)
      continue;
    trial.chosen = true;
    return;
  }
  throw std::runtime_error("no friction model predicts the torque that was held out");
}

/// The part of the segments before or after a share of all their samples.
std::vector<Segment> share_of(const std::vector<Segment>& segments, double share, bool before) {
  Eigen::Index rows = 0;
  for (const Segment& s : segments) rows += s.size();
  auto left = static_cast<Eigen::Index>(share * static_cast<double>(rows));
  std::vector<Segment> out;
  for (const Segment& s : segments) {
    const Eigen::Index cut = std::clamp<Eigen::Index>(left, 0, s.size());
    left -= cut;
    const Eigen::Index begin = before ? 0 : cut, count = before ? cut : s.size() - cut;
    if (count == 0) continue;
    out.push_back(part_of(s, begin, count));
  }
  return out;
}

}  // namespace

std::vector<FrictionTrial> compare_on_ramps(const std::vector<Ramp>& ramps) {
  std::vector<Ramp> by_speed = ramps;
  std::sort(by_speed.begin(), by_speed.end(), [](const Ramp& l, const Ramp& r) {
    return std::abs(l.velocity) < std::abs(r.velocity);
  });
  std::vector<Ramp> steady;
  for (const Ramp& ramp : by_speed) {
    if (!ramp.stick_slip) steady.push_back(ramp);
  }
  for (const double sign : {1.0, -1.0}) {
    const auto count = static_cast<std::size_t>(std::count_if(
        steady.begin(), steady.end(), [sign](const Ramp& r) { return r.velocity * sign > 0.0; }));
    if (count < kFewestRamps) {
      throw std::runtime_error(
          std::to_string(count) + " steady ramps in the " + (sign > 0 ? "positive" : "negative") +
          " direction, needs at least " + std::to_string(kFewestRamps) +
          ": record the motion of 'servotwin motion-law', or use --method motion");
    }
  }
  // Folds by speed: what runs at one speed, in whichever direction, is held out together. The
  // slowest and the fastest are never held out: a model would have to extrapolate to them.
  const auto folds_of = [](const std::vector<Ramp>& sorted) {
    std::vector<int> folds;
    int group = -1;
    double speed = 0.0;
    for (const Ramp& ramp : sorted) {
      const double here = std::abs(ramp.velocity);
      if (group < 0 || here > (1.0 + kMaxSpeedDifference) * speed) {
        ++group;
        speed = here;
      }
      folds.push_back(group);
    }
    for (int& fold : folds) fold = fold == 0 || fold == group ? -1 : fold % kFolds;
    return folds;
  };

  std::vector<FrictionTrial> trials;
  const std::vector<std::vector<std::size_t>> candidates{
      {kind_of<CoulombFriction>(), kind_of<AsymmetricFriction>()},
      {kind_of<Stribeck>()},
      {kind_of<ModifiedStribeck>()},
      {kind_of<FrictionMap>()}};
  for (const std::vector<std::size_t>& effects : candidates) {
    const bool through_rest =
        effects.front() == kind_of<ModifiedStribeck>() || effects.front() == kind_of<FrictionMap>();
    const std::vector<Ramp>& shown = through_rest ? by_speed : steady;
    FrictionTrial trial;
    trial.structure = {false, effects};
    const auto fit = fit_force(pairs_of(shown), trial.structure);
    if (!fit) continue;
    trial.fit = *fit;
    const std::vector<int> folds = folds_of(shown);
    Eigen::VectorXd left(static_cast<Eigen::Index>(steady.size()));
    Eigen::VectorXd torque(left.size());
    Eigen::Index at = 0;
    for (int fold = 0; fold < kFolds; ++fold) {
      std::vector<Ramp> seen, unseen;
      for (std::size_t i = 0; i < shown.size(); ++i) {
        if (folds[i] != fold) {
          seen.push_back(shown[i]);
        } else if (!shown[i].stick_slip) {
          unseen.push_back(shown[i]);
        }
      }
      const auto part = fit_force(pairs_of(seen), trial.structure);
      if (unseen.empty()) continue;
      if (!part) {
        at = 0;  // a model that cannot be fitted to a fold is excluded
        break;
      }
      const ForceData held = pairs_of(unseen);
      left.segment(at, held.rows()) = held.force() - force_of(part->model, held);
      torque.segment(at, held.rows()) = held.force();
      at += held.rows();
    }
    if (at == 0) continue;
    left.conservativeResize(at);
    torque.conservativeResize(at);
    trial.held_out = {std::sqrt(left.squaredNorm() / static_cast<double>(at)),
                      left.cwiseAbs().maxCoeff(), left.norm() / torque.norm()};
    trials.push_back(std::move(trial));
  }
  // The standard error of an RMS of so many pairs (the one-standard-error rule of Breiman et al.
  // 1984).
  choose(trials, 1.0 / std::sqrt(2.0 * static_cast<double>(steady.size())));
  return trials;
}

std::vector<FrictionTrial> compare_on_motion(const std::vector<Segment>& segments,
                                             const std::vector<std::size_t>& frictions,
                                             double training_share, double bandwidth_hz) {
  const ForceData first =
      ForceData::of_motion(share_of(segments, training_share, true), bandwidth_hz);
  const ForceData second =
      ForceData::of_motion(share_of(segments, training_share, false), bandwidth_hz);
  std::vector<FrictionTrial> trials;
  for (const std::size_t kind : frictions) {
    std::vector<std::vector<std::size_t>> sets{{kind, kind_of<ConstantForce>()},
                                               {kind, kind_of<AsymmetricFriction>()}};
    if (by_direction(kind)) sets = {{kind}};
    for (std::vector<std::size_t>& effects : sets) {
      FrictionTrial trial;
      trial.structure = {true, std::move(effects)};
      const auto fit = fit_force(first, trial.structure);
      if (!fit) continue;
      trial.fit = *fit;
      trial.held_out = judge(fit->model, second);
      trials.push_back(std::move(trial));
    }
  }
  choose(trials, 0.0);
  return trials;
}

double steady_force(const ForceModel& model, double velocity) {
  Motion m;
  m.step_s = 1e3;
  m.velocity = velocity;
  m.displacement = velocity * m.step_s;
  m.command_velocity = velocity;
  m.friction = velocity > 0.0 ? 1.0 : -1.0;
  double sum = 0.0;
  for (const Effect& effect : model.effects) {
    EffectMemory<double> memory;
    start_memory<double>(effect.kind, effect.shape.data(), memory);
    std::array<double, kMaxCoefficients> force{};
    // One long step brings friction to its steady state.
    for (int i = 0; i < 2; ++i)
      unit_forces<double>(effect.kind, effect.shape.data(), memory, m, force.data());
    for (std::size_t c = 0; c < coefficients_of(effect.kind).size(); ++c)
      sum += effect.coefficient[c] * force[c];
  }
  return sum;
}

}  // namespace servotwin
