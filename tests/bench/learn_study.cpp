// Learned on the identified twin, applied to a machine that shares no code with it: what a
// correction is worth (docs/measurements.md 15).
//
//   learn_study [--quick]          --quick: without diagnosis
//
// Two ball-screw axes of tests/hidden_effects/rig.h: presliding with friction that falls with speed
// and is unlike in the two directions (X), LuGre friction (Y), on both cogging and a table on a
// spring at 90 and 75 Hz, none of which the first model knows. They are identified from a recording
// of production (encoder of 0.1 um, noise of 0.03 um) with Coulomb friction alone, jointly with
// their friction, and after diagnosis. The paths are others than those of the recording. Errors are
// those of the machine's true motor position. The command between two cycles is a cubic of the
// bench's own.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "diagnosis/search/diagnose.h"
#include "identification/loop/identify.h"
#include "identification/model/stated_deviations.h"
#include "ilc/feedforward.h"
#include "ilc/prepared_axis.h"
#include "tests/hidden_effects/rig.h"
#include "tests/virtual_machine/example_machine.h"

namespace {

using namespace servotwin;
using Eigen::ArrayXd;
using hidden_effects::Rig;
using virtual_machine::PlanePath;
using virtual_machine::Setpoint;

constexpr double kCycle_s = 1e-3, kPi = std::numbers::pi;
constexpr double kNoise = 3e-8, kEncoderStep = 1e-7;
/// What an encoder with both cannot tell apart [m RMS].
const double kNoiseFloor = std::hypot(kNoise, kEncoderStep / std::sqrt(12.0));

/// What both machines say alike of an axis of the example.
Rig rig_of(const virtual_machine::Axis& axis) {
  Rig rig;
  rig.friction.viscous = axis.body.viscous;
  rig.body.mass = axis.body.mass;
  rig.body.motor_share = 0.55;
  rig.body.damping_ratio = 0.05;
  rig.body.constant_force = axis.body.constant_force;
  rig.body.cogging = 12.0;
  rig.drive.position_gain = axis.drive.position_gain;
  rig.drive.velocity_gain = axis.drive.velocity_gain;
  rig.drive.integral_time = axis.drive.velocity_gain / axis.drive.integral_gain;
  rig.drive.velocity_feedforward = axis.drive.velocity_feedforward;
  rig.drive.force_limit = axis.drive.force_limit;
  rig.reading.noise = kNoise;
  rig.reading.step = kEncoderStep;
  rig.reading.noise_seed = axis.name == "X" ? 1 : 2;
  return rig;
}

Rig x_axis() {
  Rig rig = rig_of(virtual_machine::example_x_axis());
  rig.friction.family = hidden_effects::Friction::Family::kMaxwell;
  rig.friction.level = 110.0;
  rig.friction.presliding_distance = 20e-6;
  rig.friction.curve = 4.0;
  rig.friction.stribeck_rise = 0.15;
  rig.friction.stribeck_velocity = 6e-3;
  rig.friction.direction_ratio = 1.1;
  rig.body.spring_frequency_hz = 90.0;
  rig.body.cogging_period = 8e-3;
  return rig;
}

Rig y_axis() {
  Rig rig = rig_of(virtual_machine::example_y_axis());
  rig.friction.family = hidden_effects::Friction::Family::kLuGre;
  rig.friction.level = 150.0;
  rig.friction.presliding_distance = 12e-6;
  rig.friction.bristle_damping = 2e-4;
  rig.friction.stribeck_rise = 0.15;
  rig.friction.stribeck_velocity = 6e-3;
  rig.body.spring_frequency_hz = 75.0;
  rig.body.cogging_period = 10e-3;
  return rig;
}

const std::array<Rig, 2>& rigs() {
  static const std::array out{x_axis(), y_axis()};
  return out;
}

/// What the drive makes of the commands of the cycles: a cubic with the slopes of the chords over
/// two cycles.
std::function<Setpoint(double)> interpolated(const ArrayXd& samples) {
  return [samples](double time) {
    const Eigen::Index last = samples.size() - 1;
    const double place = std::clamp(time / kCycle_s, 0.0, static_cast<double>(last));
    const auto k = std::min(static_cast<Eigen::Index>(place), last - 1);
    const auto at = [&](Eigen::Index i) { return samples(std::clamp<Eigen::Index>(i, 0, last)); };
    const double t = place - static_cast<double>(k);
    const double m0 = 0.5 * (at(k + 1) - at(k - 1)), m1 = 0.5 * (at(k + 2) - at(k));
    const double d = at(k + 1) - at(k);
    const double c2 = 3.0 * d - 2.0 * m0 - m1, c3 = m0 + m1 - 2.0 * d;
    Setpoint out;
    out.position = at(k) + t * (m0 + t * (c2 + t * c3));
    out.velocity = (m0 + t * (2.0 * c2 + 3.0 * t * c3)) / kCycle_s;
    out.acceleration = (2.0 * c2 + 6.0 * t * c3) / (kCycle_s * kCycle_s);
    return out;
  };
}

ArrayXd as_array(const std::vector<double>& values) {
  return Eigen::Map<const ArrayXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// The true motor positions of both axes.
std::vector<ArrayXd> machine(const std::vector<ArrayXd>& commands) {
  std::vector<ArrayXd> out;
  for (std::size_t i = 0; i < rigs().size(); ++i) {
    const double duration = kCycle_s * static_cast<double>(commands[i].size() - 1);
    out.push_back(
        as_array(hidden_effects::simulate(rigs()[i], interpolated(commands[i]), duration).motor));
  }
  return out;
}

// --- the paths -----------------------------------------------------------------------------------

using Path = std::vector<ArrayXd>;

Path sampled(const std::function<double(double)>& x, const std::function<double(double)>& y,
             double duration) {
  const auto n = static_cast<Eigen::Index>(duration / kCycle_s) + 1;
  Path out{ArrayXd(n), ArrayXd(n)};
  for (Eigen::Index k = 0; k < n; ++k) {
    out[0](k) = x(kCycle_s * static_cast<double>(k));
    out[1](k) = y(kCycle_s * static_cast<double>(k));
  }
  return out;
}

Path sampled(const PlanePath& path) {
  return sampled([&](double t) { return path.x().at(t).position; },
                 [&](double t) { return path.y().at(t).position; }, path.x().duration());
}

Path circle() {
  PlanePath path(0.0, 0.0);
  path.dwell(0.4);
  path.arc(0.010, 0.0, 4.0 * kPi, {0.1, 1.5, 40.0});
  path.dwell(0.4);
  return sampled(path);
}

Path diamond() {
  PlanePath path(0.0, 0.0);
  const double half = 0.020 / std::numbers::sqrt2;
  const virtual_machine::Limits limits{0.096, 1.5, 40.0};
  path.dwell(0.4);
  path.line_by(half, half, limits);
  path.line_by(-half, half, limits);
  path.line_by(-half, -half, limits);
  path.line_by(half, -half, limits);
  path.dwell(0.4);
  return sampled(path);
}

/// A closed curve of three sines per axis, faded in and out: nine reversals of X, eleven of Y.
Path spline() {
  const double duration = 4.8;
  const auto fade = [&](double t) {
    const double edge = std::clamp(std::min(t - 0.4, duration - 0.4 - t) / 0.8, 0.0, 1.0);
    return edge * edge * edge * (10.0 - edge * (15.0 - 6.0 * edge));
  };
  return sampled(
      [&](double t) {
        return fade(t) * (0.012 * std::sin(4.1 * t) + 0.006 * std::sin(7.7 * t + 1.0));
      },
      [&](double t) {
        return fade(t) * (0.010 * std::sin(5.3 * t + 0.5) + 0.004 * std::sin(9.1 * t));
      },
      duration);
}

struct Named {
  const char* name;
  Path path;
};

// --- the models ----------------------------------------------------------------------------------

Recording production() {
  const PlanePath path = virtual_machine::example_program();
  const std::array commands{path.x(), path.y()};
  Recording out;
  out.source = "production";
  for (std::size_t i = 0; i < commands.size(); ++i) {
    const hidden_effects::Trace trace = hidden_effects::simulate(rigs()[i], commands[i]);
    AxisRecord axis;
    axis.name = i == 0 ? "X" : "Y";
    axis.command = trace.command;
    axis.actual = trace.actual;
    out.axes.push_back(std::move(axis));
    if (i > 0) continue;
    for (std::size_t k = 0; k < trace.command.size(); ++k)
      out.time.push_back(kCycle_s * static_cast<double>(k));
  }
  return out;
}

struct Twins {
  std::string name;
  std::vector<ModelRecord> axes;
};

/// As the program makes it ready.
LearnAxis learner(const ModelRecord& record, const ArrayXd& command, bool basis) {
  Segment path;
  path.sample_time_s = kCycle_s;
  path.command = command;
  LearnAxis axis =
      prepared_axis(record.axis, record.rotary, record.model, stated_deviations(record), path, {})
          .learning;
  if (!basis) axis.basis_bandwidth_hz = 0.0;
  return axis;
}

// --- what comes of it ----------------------------------------------------------------------------

struct OnMachine {
  std::vector<ArrayXd> error;
  ProgramError contour;
  std::vector<bool> moves;  ///< whether the path does, by cycle
};

OnMachine run(const Path& path, const std::vector<ArrayXd>& corrections) {
  Path commands = path;
  for (std::size_t i = 0; i < corrections.size(); ++i) commands[i] += corrections[i];
  const std::vector<ArrayXd> positions = machine(commands);
  std::vector<bool> moves{false};
  for (Eigen::Index k = 1; k < path[0].size(); ++k)
    moves.push_back(path[0](k) != path[0](k - 1) || path[1](k) != path[1](k - 1));
  return {{path[0] - positions[0], path[1] - positions[1]}, program_error(path, positions), moves};
}

/// RMS of both axes together.
double tracking_rms(const OnMachine& run) {
  return std::hypot(size_of(run.error[0]).rms, size_of(run.error[1]).rms) / std::numbers::sqrt2;
}

std::vector<ArrayXd> corrections_of(const std::vector<LearnAxis>& axes,
                                    const LearnOptions& options = {}) {
  std::vector<ArrayXd> out;
  for (const LearnedAxis& axis : learn(axes, on_twins(axes), options).axes)
    out.push_back(axis.correction);
  return out;
}

/// By how much the contour error is larger than without correction where that is the most [m].
double worse_by(const OnMachine& before, const OnMachine& after) {
  return (after.contour.distance.abs() - before.contour.distance.abs()).maxCoeff();
}

/// The longest time at a stretch of motion that it is larger by more than what the encoder can tell
/// [s].
double worse_for(const OnMachine& before, const OnMachine& after) {
  int longest = 0, now = 0;
  for (Eigen::Index k = 0; k < before.contour.distance.size(); ++k) {
    const double more = std::abs(after.contour.distance(k)) - std::abs(before.contour.distance(k));
    now = before.moves[static_cast<std::size_t>(k)] && more > kNoiseFloor ? now + 1 : 0;
    longest = std::max(longest, now);
  }
  return kCycle_s * longest;
}

void print_row(const char* name, const OnMachine& before, const OnMachine& after) {
  const ErrorSize was = size_of(before.contour.distance), is = size_of(after.contour.distance);
  std::printf("  %-30s %8.2f %8.2f %7.0fx   %8.2f %8.2f %7.0fx   %7.2f %7.2f   %6.2f %5.0f\n", name,
              1e6 * tracking_rms(before), 1e6 * tracking_rms(after),
              tracking_rms(before) / tracking_rms(after), 1e6 * was.rms, 1e6 * is.rms,
              was.rms / is.rms, 1e6 * was.max, 1e6 * is.max, 1e6 * worse_by(before, after),
              1e3 * worse_for(before, after));
  std::fflush(stdout);
}

void head(const char* title) {
  std::printf(
      "\n%s\n  %-30s %26s   %26s   %15s   worse, at most\n  %-30s %8s %8s %8s   %8s %8s %8s   "
      "%7s %7s   by[um] [ms]\n",
      title, "", "tracking error, RMS [um]", "contour error, RMS [um]", "MAX [um]", "", "before",
      "after", "", "before", "after", "", "before", "after");
}

Model off_by(Model model, double share) {
  PoleSet poles = labels_of(model.loop).set[0];
  poles.omega *= 1.0 + share;
  poles.real *= 1.0 - share;
  model.loop.denominator = denominator_of(poles, model.loop.order);
  // What the loop lags by is off as well: the numerators stay.
  for (Effect& effect : model.effects) {
    for (double& coefficient : effect.coefficient) coefficient *= 1.0 - share;
  }
  return model;
}

}  // namespace

int main(int argc, char** argv) {
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  const Recording recording = production();
  std::vector<Twins> twins{{"Coulomb model", {}}, {"model with its friction", {}}};
  if (!quick) twins.push_back({"after diagnosis", {}});
  std::printf("The machine, identified from %.1f s of production:\n", recording.time.back());
  for (const char* name : {"X", "Y"}) {
    const SegmentedAxis axis = segment_axis(recording, name);
    IdentifyOptions joint;
    joint.method = Method::kJoint;
    twins[0].axes.push_back(identify(axis).record);
    twins[1].axes.push_back(identify(axis, joint).record);
    if (!quick) {
      DiagnoseOptions options;
      options.identify.method = Method::kJoint;
      const Diagnosis diagnosis = diagnose(axis, options);
      twins[2].axes.push_back(diagnosis.extended);
    }
    for (const Twins& one : twins) {
      const ModelRecord& record = one.axes.back();
      std::string effects;
      for (const Effect& effect : record.model.effects)
        effects += (effects.empty() ? "" : ", ") + std::string(identity_of(effect.kind).id);
      const LearnAxis learning = learner(record, circle()[name[0] == 'X' ? 0 : 1], true);
      std::printf("  %s, %-24s %7.3f um RMS missed on its hold-out, bandwidth %3.0f Hz (%s)\n",
                  name, one.name.c_str(), 1e6 * record.holdout.rms, learning.law.bandwidth_hz,
                  effects.c_str());
      std::fflush(stdout);
    }
  }

  const std::array paths{Named{"circle, R 10 mm, 100 mm/s", circle()},
                         Named{"diamond, 20 mm, 96 mm/s", diamond()},
                         Named{"spline with reversals", spline()}};
  head("Learned on the twin, ten trials, applied to the machine once");
  for (const auto& [name, path] : paths) {
    std::printf("  %s\n", name);
    const OnMachine before = run(path, {});
    for (const Twins& one : twins) {
      const std::vector<LearnAxis> axes{learner(one.axes[0], path[0], true),
                                        learner(one.axes[1], path[1], true)};
      print_row(("  " + one.name).c_str(), before, run(path, corrections_of(axes)));
    }
  }

  head("Ways to correct, with the last model");
  for (const auto& [name, of_both] : paths) {
    const auto& path = of_both;  // a lambda cannot take a part of a pair by reference everywhere
    std::printf("  %s\n", name);
    const OnMachine before = run(path, {});
    const Twins& best = twins.back();
    LearnOptions contour, rival;
    contour.aim = Aim::kContour;
    rival.feedforward_only = true;
    const auto corrected = [&](const char* way, bool basis, const LearnOptions& options,
                               double peak = HUGE_VAL) {
      std::vector<LearnAxis> axes{learner(best.axes[0], path[0], basis),
                                  learner(best.axes[1], path[1], basis)};
      for (LearnAxis& axis : axes) axis.limits.peak = peak;
      print_row(way, before, run(path, corrections_of(axes, options)));
    };
    corrected("  one fixed Q, from nothing", false, {});
    corrected("  from what the model says", true, {});
    corrected("  no trial: feed-forward", true, rival);
    corrected("  by axis, at most 150 um", true, {}, 150e-6);
    corrected("  cross-coupled, at most 150 um", true, contour, 150e-6);
  }

  head("Gain and model error: circle; poles and friction of the model moved by");
  const OnMachine before = run(paths[0].path, {});
  for (const double share : {0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3}) {
    std::vector<LearnAxis> axes;
    for (std::size_t i = 0; i < 2; ++i) {
      ModelRecord record = twins.back().axes[i];
      record.model = off_by(record.model, share);
      axes.push_back(learner(record, paths[0].path[i], true));
    }
    char name[32];
    std::snprintf(name, sizeof name, "  %.0f %%", 100.0 * share);
    print_row(name, before, run(paths[0].path, corrections_of(axes)));
  }
  std::printf("\n  noise of the encoder and its step, RMS: %.3f um\n", 1e6 * kNoiseFloor);
  return 0;
}
