#include "tests/hidden_effects/floors.h"

#include <cmath>
#include <iomanip>

#include "drivers/recordings/recording_file.h"
#include "identification/recording/noise_floor.h"
#include "identification/recording/segments.h"
#include "tests/support/temporary_directory.h"

namespace servotwin::hidden_effects {

Case case_of_floor(Part part, int i) {
  const std::vector<std::string>& ids = effect_ids();
  const int kinds = static_cast<int>(ids.size()) + 1;
  const int index = i / kinds;
  const auto kind = static_cast<std::size_t>(i % kinds);
  return kind < ids.size() ? single_case(part, ids[kind], Class::kClear, index)
                           : clean_case(part, index);
}

bool FloorOfCase::within() const { return std::abs(found.rms / reading_rms - 1.0) <= 0.15; }

bool FloorOfCase::in_interval() const {
  return found.low <= reading_rms && reading_rms <= found.high;
}

FloorOfCase floor_of(const Case& made) {
  const test::TemporaryDirectory directory;
  const SegmentedAxis axis =
      segment_axis(read_recording(directory.file("recording.csv", made.csv)), "X");
  return {.name = made.name,
          .reading_rms = made.reading_rms,
          .noise_rms = made.noise_rms,
          .found = noise_floor(axis.segments)};
}

void print_floors(const std::vector<FloorOfCase>& floors, std::ostream& out) {
  int within = 0, held = 0;
  out << std::fixed << std::setprecision(4)
      << "case, true noise of the reading [um], floor found [um], its interval, ratio, ratio to "
         "the "
         "noise with that of the torque\n";
  for (const FloorOfCase& f : floors) {
    within += f.within();
    held += f.in_interval();
    out << std::left << std::setw(36) << f.name << std::right << std::setw(8)
        << 1e6 * f.reading_rms;
    for (const double value : {f.found.rms, f.found.low, f.found.high})
      out << std::setw(9) << 1e6 * value;
    out << std::setw(9) << f.found.rms / f.reading_rms << std::setw(9) << f.found.rms / f.noise_rms
        << '\n';
  }
  const auto share = [&](int count) {
    out << count << " of " << floors.size() << " (" << std::setprecision(1)
        << 100.0 * count / static_cast<double>(floors.size()) << " %)\n";
  };
  out << "noise floor within 15 % of the noise of the reading: ";
  share(within);
  out << "that noise within the interval: ";
  share(held);
}

}  // namespace servotwin::hidden_effects
