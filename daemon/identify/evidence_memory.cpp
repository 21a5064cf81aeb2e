#include "daemon/identify/evidence_memory.h"

#include <algorithm>
#include <cmath>

#include "identification/loop/identify.h"

namespace servotwin::daemon {
namespace {

constexpr double kSamplingTimeTolerance = 1e-6;

double length_s(const Segment& s) { return s.sample_time_s * static_cast<double>(s.size()); }

/// Whether `next` continues `before` on the same sampling grid.
bool follows(const Segment& next, const Segment& before) {
  const double h = before.sample_time_s;
  return std::abs(next.sample_time_s - h) < kSamplingTimeTolerance * h &&
         std::abs(next.start_s - before.end_s() - h) < 0.1 * h &&
         (next.torque.size() == 0) == (before.torque.size() == 0) &&
         (next.neighbour.size() == 0) == (before.neighbour.size() == 0) &&
         (next.neighbour_motion.size() == 0) == (before.neighbour_motion.size() == 0);
}

void append(Eigen::ArrayXd& column, const Eigen::ArrayXd& more) {
  const Eigen::Index n = column.size();
  column.conservativeResize(n + more.size());
  column.tail(more.size()) = more;
}

}  // namespace

EvidenceSeconds EvidenceMemory::take(const std::vector<Segment>& recent, double new_after_s,
                                     double moved_s) {
  EvidenceSeconds fresh;
  if (recent.empty()) return fresh;
  scale_ = wider(scale_, motion_scale(recent));
  const double from_s = recent.front().start_s - 0.5 * recent.front().sample_time_s;
  std::vector<Kept> kept;
  for (Kept& old : kept_) {
    if (old.stretch.segment.end_s() < from_s) {
      kept.push_back(std::move(old));
    } else {
      for (Segment& part : cut({old.stretch.segment}, -1e300, from_s))
        kept.push_back({{old.stretch.shows, std::move(part)}, old.moved_s});
    }
  }
  for (EvidenceStretch& stretch : sorted_by_evidence(recent, scale_)) {
    const Segment& s = stretch.segment;
    fresh.of(stretch.shows) +=
        std::clamp(s.end_s() + s.sample_time_s - new_after_s, 0.0, length_s(s));
    kept.push_back({std::move(stretch), moved_s});
  }
  kept_ = std::move(kept);
  forget(moved_s);
  return fresh;
}

void EvidenceMemory::forget(double moved_s) {
  EvidenceSeconds left;
  left.of(Evidence::kFastMotion) = bounds_.fast_s;
  left.of(Evidence::kSlowReversals) = bounds_.slow_s;
  left.of(Evidence::kStandstill) = bounds_.standstill_s;
  std::vector<Kept> newest_first;
  for (auto it = kept_.rbegin(); it != kept_.rend(); ++it) {
    if (moved_s - it->moved_s > bounds_.forgotten_after_s) continue;
    Segment& s = it->stretch.segment;
    double& room_s = left.of(it->stretch.shows);
    if (const double length = length_s(s); length > room_s) {
      std::vector<Segment> end = cut({s}, s.end_s() - room_s + 0.5 * s.sample_time_s, 1e300);
      room_s = 0.0;
      if (end.empty()) continue;
      s = std::move(end.front());
    } else {
      room_s -= length;
    }
    newest_first.push_back(std::move(*it));
  }
  kept_.assign(std::make_move_iterator(newest_first.rbegin()),
               std::make_move_iterator(newest_first.rend()));
}

std::vector<Segment> EvidenceMemory::kept(std::initializer_list<Evidence> classes) const {
  std::vector<Segment> out;
  const Kept* before = nullptr;
  for (const Kept& one : kept_) {
    if (std::find(classes.begin(), classes.end(), one.stretch.shows) == classes.end()) continue;
    const Segment& s = one.stretch.segment;
    if (before != nullptr && before->stretch.shows == one.stretch.shows && follows(s, out.back())) {
      append(out.back().command, s.command);
      append(out.back().actual, s.actual);
      append(out.back().torque, s.torque);
      append(out.back().neighbour, s.neighbour);
      append(out.back().neighbour_motion, s.neighbour_motion);
    } else {
      out.push_back(s);
    }
    before = &one;
    if (one.stretch.shows == Evidence::kSlowReversals) out.back().lead = lead_in(out.back());
  }
  return out;
}

EvidenceSeconds EvidenceMemory::seconds() const {
  EvidenceSeconds out;
  for (const Kept& one : kept_) out.of(one.stretch.shows) += length_s(one.stretch.segment);
  return out;
}

}  // namespace servotwin::daemon
