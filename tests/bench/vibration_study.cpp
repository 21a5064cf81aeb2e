// What modes of vibration in the twin are worth, printed: an axis of two masses on a spring, whose
// table vibrates at 44 Hz with a damping of 3 %, on a machine of other code.
//
//   vibration_study [--write FOLDER | --coupled]
//
// With a folder the recordings are written there instead, for vibration_peer.py. --coupled: only
// the last part, two such axes that push each other.
//
// Models are identified from the first part of one recording and judged by their free simulation of
// the rest. The true poles are those of the machine's equations (tests/support/two_masses.h).
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "identification/identify.h"
#include "tests/hidden_effects/motion.h"
#include "tests/hidden_effects/rig.h"
#include "tests/support/coupled_machine.h"
#include "tests/support/two_masses.h"

namespace {

using namespace servotwin;
using hidden_effects::Friction;
using hidden_effects::Rig;

constexpr double kTwoPi = 2.0 * std::numbers::pi;

Rig axis(Friction::Family family, double integral_time) {
  return test::two_masses(family, 150.0, integral_time);
}

SegmentedAxis recorded(const Rig& rig) {
  hidden_effects::Motion motion;
  motion.limits = {0.25, 5.0, 200.0};
  hidden_effects::Random random(7);
  const auto trace = hidden_effects::simulate(rig, hidden_effects::motion_of(motion, random));
  const auto array = [](const std::vector<double>& v) {
    return Eigen::Map<const Eigen::ArrayXd>(v.data(), static_cast<Eigen::Index>(v.size())).eval();
  };
  SegmentedAxis out;
  out.axis = "X";
  out.sample_time_s = rig.reading.sample_time;
  Segment segment;
  segment.sample_time_s = rig.reading.sample_time;
  segment.command = array(trace.command);
  segment.actual = array(trace.actual);
  out.segments = {segment};
  return out;
}

void say(const char* name, const Identified& found, std::complex<double> truth) {
  const ModelRecord& r = found.record;
  std::printf("  %-26s held out %8.3f um RMS %8.2f MAX", name, 1e6 * r.holdout.rms,
              1e6 * r.holdout.max);
  const double hz = std::abs(truth) / kTwoPi, zeta = -truth.real() / std::abs(truth);
  for (std::size_t i = 0; i < r.model.loop.modes.size(); ++i) {
    const Mode &mode = r.model.loop.modes[i], &sd = r.mode_deviations[i];
    std::printf("   %.3f +- %.3f Hz (%+.2f %%), damping %.4f +- %.4f (%+.1f %%)",
                mode.omega / kTwoPi, sd.omega / kTwoPi, 100.0 * (mode.omega / kTwoPi / hz - 1.0),
                mode.zeta, sd.zeta, 100.0 * (mode.zeta / zeta - 1.0));
  }
  std::printf("\n");
}

void write(const std::string& path, const Segment& segment) {
  std::ofstream out(path);
  out << "time[s],X.command[m],X.actual[m]\n";
  out.precision(12);
  for (Eigen::Index k = 0; k < segment.size(); ++k)
    out << segment.sample_time_s * static_cast<double>(k) << ',' << segment.command(k) << ','
        << segment.actual(k) << '\n';
}

/// Both axes of a machine, of whose Y the spring has this frequency [Hz]; 0: one body.
void coupled(double spring_frequency_hz) {
  const test::CoupledMachine machine = test::coupled_machine(spring_frequency_hz);
  const auto axes = test::recorded(machine, test::production_of_both());
  for (std::size_t i = 0; i < 2; ++i) {
    const std::complex<double> truth = test::mode_of(machine.axes[i]);
    std::printf("Y %s, %s feels %.0f %% of the other's acceleration:",
                spring_frequency_hz > 0.0 ? "vibrates, too" : "is stiff", axes[i].axis.c_str(),
                100.0 * machine.felt[i]);
    if (std::abs(truth) > 0.0)
      std::printf(" mode %.3f Hz, damping %.4f\n", std::abs(truth) / kTwoPi,
                  -truth.real() / std::abs(truth));
    else
      std::printf(" no mode\n");
    for (const auto& [modes, coupling] : {std::pair{0, false}, {2, false}, {2, true}}) {
      IdentifyOptions options;
      options.method = Method::kJoint;
      options.modes = modes;
      options.coupling = coupling;
      const Identified found = identify(axes[i], options);
      say((std::string(modes > 0 ? "with modes, " : "rigid, ") + (coupling ? "coupled, " : "") +
           std::string(identity_of(found.record.model.effects.front().kind).id))
              .c_str(),
          found, truth);
      std::fflush(stdout);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::string(argv[1]) == "--coupled") {
    coupled(0.0);
    coupled(62.0);
    return 0;
  }
  const std::string folder = argc == 3 && std::string(argv[1]) == "--write" ? argv[2] : "";
  for (const double integral_time : {0.0, 0.02}) {
    for (const auto& [name, family] : {std::pair{"Coulomb", Friction::Family::kCoulomb},
                                       {"GMS", Friction::Family::kMaxwell},
                                       {"LuGre", Friction::Family::kLuGre}}) {
      const Rig rig = axis(family, integral_time);
      const std::complex<double> truth = test::mode_of(rig);
      const SegmentedAxis data = recorded(rig);
      if (!folder.empty()) {
        write(folder + "/" + name + (integral_time > 0.0 ? "_pi.csv" : "_p.csv"),
              data.segments.front());
        continue;
      }
      std::printf("true friction %s, %s: mode %.3f Hz, damping %.4f\n", name,
                  integral_time > 0.0 ? "PI velocity control" : "P velocity control",
                  std::abs(truth) / kTwoPi, -truth.real() / std::abs(truth));
      for (const int modes : {0, 2}) {
        IdentifyOptions options;
        options.modes = modes;
        const Identified projected = identify(data, options);
        say(modes == 0 ? "rigid, Coulomb" : "with modes, Coulomb", projected, truth);
        options.method = Method::kJoint;
        const Identified joint = identify(data, options);
        say((std::string(modes == 0 ? "rigid, " : "with modes, ") +
             std::string(identity_of(joint.record.model.effects.front().kind).id))
                .c_str(),
            joint, truth);
        std::fflush(stdout);
      }
    }
  }
  if (!folder.empty()) return 0;
  coupled(0.0);
  coupled(62.0);
}
