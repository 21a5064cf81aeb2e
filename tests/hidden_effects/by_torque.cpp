#include "tests/hidden_effects/by_torque.h"

#include <array>
#include <cmath>
#include <iomanip>

#include "diagnosis/torque/torque.h"
#include "drivers/recordings/recording_file.h"
#include "identification/recording/segments.h"
#include "tests/support/temporary_directory.h"

namespace servotwin::hidden_effects {

namespace {

void print_hits(const std::vector<CauseByTorque>& named, bool friction, std::ostream& out) {
  constexpr std::array kLeft{0.0, 0.3, 0.6, 0.8, 1e9};
  double square = 0.0;
  int all = 0;
  for (std::size_t i = 0; i + 1 < kLeft.size(); ++i) {
    int count = 0, right = 0;
    double confidence = 0.0;
    for (const CauseByTorque& one : named) {
      if (one.friction != friction || one.left < kLeft[i] || one.left >= kLeft[i + 1]) continue;
      ++count;
      right += one.right;
      confidence += one.confidence;
      square += std::pow(one.confidence - (one.right ? 1.0 : 0.0), 2);
    }
    all += count;
    if (count == 0) continue;
    out << "  leaves " << kLeft[i] << " of the RMS or more: " << right << " of " << count
        << " are there, mean confidence " << confidence / count << '\n';
  }
  if (all > 0) out << "  mean squared error of the confidence: " << square / all << '\n';
}

}  // namespace

std::vector<CauseByTorque> named_by_torque(const Case& made) {
  const test::TemporaryDirectory directory;
  const SegmentedAxis axis =
      segment_axis(read_recording(directory.file("recording.csv", made.csv)), "X");
  std::vector<CauseByTorque> out;
  for (const TorqueCause& cause : diagnose_torque(axis).causes) {
    // A limit is seen in the torque itself and has no gain.
    if (!std::isfinite(cause.gain.before)) continue;
    out.push_back({made.name, cause.id, cause.gain.after / cause.gain.before, cause.confidence,
                   made.hides(cause.id) || made.owns(cause.id),
                   cause.id == "presliding" || cause.id == "stribeck"});
  }
  return out;
}

void print_by_torque(const std::vector<CauseByTorque>& named, std::ostream& out) {
  out << std::fixed << std::setprecision(3);
  for (const CauseByTorque& one : named) {
    if (!one.right)
      out << "wrong: " << one.machine << " " << one.id << ", leaves " << one.left << " of the RMS, "
          << "confidence " << one.confidence << '\n';
  }
  out << "causes\n";
  print_hits(named, false, out);
  out << "laws of friction\n";
  print_hits(named, true, out);
}

}  // namespace servotwin::hidden_effects
