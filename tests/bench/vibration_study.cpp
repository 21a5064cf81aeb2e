// What modes of vibration in the twin are worth, printed: an axis of two masses on a spring, whose
// table vibrates at 44 Hz with a damping of 3 %, two such axes that push each other, an axis that
// carries up to six masses on springs, and one whose spring becomes stiffer with the position, on
// machines of other code.
//
//   vibration_study [--write FOLDER | --coupled | --many | --moving | --two-masses]
//
// With a folder recordings of the first three parts and of the two masses are written there
// instead, for vibration_peer.py and other programs.
// --coupled, --many, --moving: only the second part, only the third, only the fourth.
// --two-masses: the axis of the first part as two masses, its encoder at motor or load, its
// friction on one of them or on both.
//
// Models are identified from the first part of one recording and judged by their free simulation of
// the rest. The true poles are those of the machine's equations (tests/support/closed_loop.h,
// many_masses.h).
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include "identification/loop/identify.h"
#include "tests/hidden_effects/motion.h"
#include "tests/hidden_effects/rig.h"
#include "tests/support/coupled_machine.h"
#include "tests/support/many_masses.h"
#include "tests/support/two_masses.h"
#include "twin/neighbour.h"
#include "twin/two_mass_axis.h"

namespace {

using namespace servotwin;
using hidden_effects::Friction;
using hidden_effects::Rig;

constexpr double kTwoPi = 2.0 * std::numbers::pi;

Rig axis(Friction::Family family, double integral_time) {
  return test::two_masses(family, 150.0, integral_time);
}

SegmentedAxis recorded(const Rig& rig, double stroke = 0.15, double duration = 20.0) {
  hidden_effects::Motion motion;
  motion.stroke = stroke;
  motion.duration = duration;
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
    std::printf("   %.3f +- %.3f Hz", mode.omega / kTwoPi, sd.omega / kTwoPi);
    if (hz > 0.0) std::printf(" (%+.2f %%)", 100.0 * (mode.omega / kTwoPi / hz - 1.0));
    std::printf(", damping %.4f +- %.4f", mode.zeta, sd.zeta);
    if (hz > 0.0) std::printf(" (%+.1f %%)", 100.0 * (mode.zeta / zeta - 1.0));
    if (mode.moves())
      std::printf(", slope %.4f +- %.4f, curve %.4f +- %.4f, of the damping %.4f +- %.4f",
                  mode.slope, sd.slope, mode.curve, sd.curve, mode.zeta_slope, sd.zeta_slope);
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

/// Both axes of the machine that vibrate and push each other, without their dry friction or with
/// it.
void write_coupled(const std::string& path, bool friction) {
  test::CoupledMachine machine = test::coupled_machine(62.0);
  for (hidden_effects::Rig& axis : machine.axes) {
    if (!friction) axis.friction.level = 0.0;
  }
  const auto axes = test::recorded(machine, test::production_of_both());
  std::ofstream out(path);
  out << "time[s],X.command[m],X.actual[m],Y.command[m],Y.actual[m]\n";
  out.precision(12);
  const Segment &x = axes[0].segments.front(), &y = axes[1].segments.front();
  for (Eigen::Index k = 0; k < x.size(); ++k)
    out << x.sample_time_s * static_cast<double>(k) << ',' << x.command(k) << ',' << x.actual(k)
        << ',' << y.command(k) << ',' << y.actual(k) << '\n';
  for (const std::complex<double> mode : test::modes_of(machine))
    std::printf("%s mode %.3f Hz %.4f\n", path.substr(path.rfind('/') + 1).c_str(),
                std::abs(mode) / kTwoPi, -mode.real() / std::abs(mode));
}

/// Both axes of a machine, of whose Y the spring has this frequency [Hz]; 0: one body.
void coupled(double spring_frequency_hz) {
  const test::CoupledMachine machine = test::coupled_machine(spring_frequency_hz);
  const auto axes = test::recorded(machine, test::production_of_both());
  // What the other axis does, its friction too.
  auto told = axes;
  for (std::size_t i = 0; i < 2; ++i)
    told[i].segments[0].neighbour_motion = axes[1 - i].segments[0].actual;
  const auto truths = test::modes_of(machine);
  std::array<Identified, 2> by_motion;
  for (std::size_t i = 0; i < 2; ++i) {
    const std::complex<double> truth = truths[i];
    std::printf("Y %s; %s:", spring_frequency_hz > 0.0 ? "vibrates, too" : "is stiff",
                axes[i].axis.c_str());
    if (std::abs(truth) > 0.0)
      std::printf(" mode %.3f Hz, damping %.4f\n", std::abs(truth) / kTwoPi,
                  -truth.real() / std::abs(truth));
    else
      std::printf(" no mode\n");
    const auto identified = [&](const char* what, const SegmentedAxis& axis, int modes,
                                bool coupling) {
      IdentifyOptions options;
      options.method = Method::kJoint;
      options.modes = modes;
      options.coupling = coupling;
      options.beyond_loop = modes > 0;  // a filter of the control would stand for the mode
      Identified found = identify(axis, options);
      say((what + std::string(identity_of(found.record.model.effects.front().kind).id)).c_str(),
          found, truth);
      std::fflush(stdout);
      return found;
    };
    identified("rigid, ", axes[i], 0, false);
    identified("with modes, ", axes[i], 2, false);
    identified("with modes, coupled, ", axes[i], 2, true);
    by_motion[i] = identified("coupled by its motion, ", told[i], 2, true);
  }
  // Its motion as its own model predicts it, from the commands of both alone.
  for (std::size_t i = 0; i < 2; ++i) {
    const ModelRecord &own = by_motion[i].record, &other = by_motion[1 - i].record;
    if (!coupled_by_motion(own.model)) continue;
    SegmentedAxis axis = axes[i];
    predict_neighbour(axis.segments[0], own.model, other.model, pushed_by(other, axes[i].axis));
    const ErrorFigures left = judge(
        own.model, with_lead_in(cut(axis.segments, own.training_to_s, own.to_s), axis.segments));
    std::printf("Y %s; %s from commands alone: held out %8.3f um RMS %8.2f MAX\n",
                spring_frequency_hz > 0.0 ? "vibrates, too" : "is stiff", axis.axis.c_str(),
                1e6 * left.rms, 1e6 * left.max);
  }
}

void both_coupled() {
  coupled(0.0);
  coupled(62.0);
}

/// The axis whose spring becomes stiffer with the position, over 0.4 m by this share to either side
/// of its middle.
void moving(double share, Friction::Family family) {
  Rig rig = axis(family, 0.0);
  rig.body.spring_by_position = share / 0.2;
  const SegmentedAxis data = recorded(rig, 0.4, 40.0);
  std::printf("spring frequency +- %g %% over 0.4 m\n", 100.0 * share);
  for (const int modes : {0, 2}) {
    IdentifyOptions options;
    options.modes = modes;
    options.method = Method::kJoint;
    const Identified found = identify(data, options);
    for (const StructureTrial& trial : found.trials)
      std::printf("    %d modes%s %.3f um\n", trial.modes, trial.moving ? ", moving" : "",
                  1e6 * trial.validation_rms);
    say(modes == 0 ? "rigid" : "with modes", found, test::mode_of(test::about(rig, 0.0)));
    const Loop& loop = found.record.model.loop;
    for (const double x : {-0.15, 0.0, 0.15}) {
      const std::complex<double> truth = test::mode_of(test::about(rig, x));
      std::printf("    at %+.2f m: %.3f Hz, damping %.4f", x, std::abs(truth) / kTwoPi,
                  -truth.real() / std::abs(truth));
      for (const Mode& mode : at_position(loop, x).modes)
        std::printf("; found %.3f Hz (%+.2f %%), %.4f", mode.omega / kTwoPi,
                    100.0 * (mode.omega / std::abs(truth) - 1.0), mode.zeta);
      std::printf("\n");
    }
    std::fflush(stdout);
  }
}

/// An axis that carries a mass on a spring at each of these frequencies [Hz], without friction.
void many(const std::vector<double>& hz) {
  const test::ManyMasses machine = test::carrying(hz);
  SegmentedAxis data;
  data.axis = "X";
  data.segments = {test::production_of(machine)};
  data.sample_time_s = data.segments.front().sample_time_s;
  IdentifyOptions options;
  options.order = 2;
  options.modes = static_cast<int>(kMaxModes);
  const Identified found = identify(data, options);
  std::vector<Mode> modes = found.record.model.loop.modes;
  std::sort(modes.begin(), modes.end(),
            [](const Mode& l, const Mode& r) { return l.omega < r.omega; });
  std::printf("%zu masses: held out %.4f um RMS, rigid ", hz.size(),
              1e6 * found.record.holdout.rms);
  options.modes = 0;
  std::printf("%.3f; %zu modes taken\n", 1e6 * identify(data, options).record.holdout.rms,
              modes.size());
  for (const std::complex<double>& truth : machine.modes()) {
    const double omega = std::abs(truth), zeta = -truth.real() / omega;
    std::printf("  %8.3f Hz, damping %.4f", omega / kTwoPi, zeta);
    const auto nearest =
        std::min_element(modes.begin(), modes.end(), [&](const auto& l, const auto& r) {
          return std::abs(l.omega - omega) < std::abs(r.omega - omega);
        });
    if (nearest == modes.end() || std::abs(nearest->omega / omega - 1.0) > 0.05)
      std::printf("   not found\n");
    else
      std::printf("   %+.2f %%, damping %+.1f %%\n", 100.0 * (nearest->omega / omega - 1.0),
                  100.0 * (nearest->zeta / zeta - 1.0));
  }
  std::fflush(stdout);
}

void all_many() {
  for (const std::vector<double>& hz : {std::vector{31.0, 62.0},
                                        {40.0, 46.0},
                                        {24.0, 47.0, 90.0},
                                        {24.0, 38.0, 60.0, 95.0},
                                        {24.0, 38.0, 60.0, 95.0, 130.0},
                                        {22.0, 34.0, 50.0, 74.0, 105.0, 140.0}})
    many(hz);
}

/// The axis of two masses, with this share of its friction on the load.
struct TwoMassCase {
  hidden_effects::Encoder encoder;
  Friction::Family family;
  double on_load = 0.0;

  [[nodiscard]] bool at_motor() const { return encoder == hidden_effects::Encoder::kMotor; }
  [[nodiscard]] const char* law() const {
    return family == Friction::Family::kMaxwell ? "GMS" : "LuGre";
  }
  [[nodiscard]] Rig rig() const {
    Rig out = axis(family, 0.0);
    out.drive.position_from = out.reading.recorded = encoder;
    out.friction.motor_share = 1.0 - on_load;
    return out;
  }
};

std::vector<TwoMassCase> two_mass_cases() {
  std::vector<TwoMassCase> out;
  for (const auto encoder : {hidden_effects::Encoder::kMotor, hidden_effects::Encoder::kLoad}) {
    for (const auto family : {Friction::Family::kMaxwell, Friction::Family::kLuGre}) {
      for (const double on_load : {0.0, 0.5, 1.0}) out.push_back({encoder, family, on_load});
    }
  }
  return out;
}

/// Against what it is made of.
void as_two_masses(const TwoMassCase& one) {
  const Rig rig = one.rig();
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.masses = Masses::kTwo;
  std::printf("encoder at the %s, %s, %g %% of the friction on the load: ",
              one.at_motor() ? "motor" : "load", one.law(), 100.0 * one.on_load);
  ModelRecord found;
  try {
    found = identify(recorded(rig), options).record;
  } catch (const std::runtime_error& refusal) {
    std::printf("%s\n", refusal.what());
    return;
  }
  const Effect& axis = *two_mass_of(found.model);
  const TwoMassParameters is = two_mass_parameters(axis);
  const double noise = std::hypot(rig.reading.noise, rig.reading.step / std::sqrt(12.0));
  std::printf(
      "held out %.3f um, %.2f times the noise; %.3f Hz (%+.2f %%), damping %.4f (%+.0f %%), "
      "load %.3f (%.3f), friction on it %.3f; %s, %s\n",
      1e6 * found.holdout.rms, found.holdout.rms / noise, is.omega / kTwoPi,
      100.0 * (is.omega / kTwoPi / rig.body.spring_frequency_hz - 1.0), is.zeta,
      100.0 * (is.zeta / rig.body.damping_ratio - 1.0), is.load_share, 1.0 - rig.body.motor_share,
      is.friction_share, std::string(identity_of(axis.kind).id).c_str(),
      std::string(identity_of(found.model.effects.front().kind).id).c_str());
  std::fflush(stdout);
}

void all_moving() {
  moving(0.0, Friction::Family::kCoulomb);
  moving(0.05, Friction::Family::kCoulomb);
  moving(0.15, Friction::Family::kCoulomb);
  moving(0.15, Friction::Family::kMaxwell);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string part = argc == 2 ? argv[1] : "";
  if (part == "--coupled") {
    both_coupled();
    return 0;
  }
  if (part == "--many") {
    all_many();
    return 0;
  }
  if (part == "--moving") {
    all_moving();
    return 0;
  }
  if (part == "--two-masses") {
    for (const TwoMassCase& one : two_mass_cases()) as_two_masses(one);
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
        options.beyond_loop = modes > 0;  // a filter of the control would stand for the mode
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
  if (!folder.empty()) {
    write_coupled(folder + "/coupled_linear.csv", false);
    write_coupled(folder + "/coupled.csv", true);
    write(folder + "/five_masses.csv",
          test::production_of(test::carrying({24.0, 38.0, 60.0, 95.0, 130.0})));
    for (const TwoMassCase& one : two_mass_cases())
      write(folder + "/" + (one.at_motor() ? "motor_" : "load_") + one.law() + "_" +
                std::to_string(std::lround(100.0 * one.on_load)) + ".csv",
            recorded(one.rig()).segments.front());
    return 0;
  }
  both_coupled();
  all_many();
  all_moving();
}
