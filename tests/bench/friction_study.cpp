// Two comparisons of the thesis remade on drives of the virtual machine, printed: friction models
// on a linear drive (4.5, table 4.4), and what the steps of the joint identification gain on x and
// y of a five-axis machine (5.3, table 5.5).
//
//   friction_study
//
// Every model is fitted to one record and judged by its free simulation of another one with other
// motion. What the thesis does not print, or its scan does not show, is chosen and said so here.
// The true friction is GMS of 16 elements on a virgin curve that is in no model's family and passes
// the midpoint of the printed shape factor: a power law for the linear drive, a conic arc for the
// feed drives. GMS by hand is given the true Stribeck curve, as the thesis gives it the measured
// one; one row shows what it is without. The thesis's reduced GMS has the Stribeck curve as well.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "identification/loop/identify.h"
#include "identification/loop/joint.h"
#include "identification/loop/output_error.h"
#include "identification/loop/pole_search.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"
#include "twin/twin.h"

namespace {

using namespace servotwin;
using virtual_machine::Limits;
using virtual_machine::Trajectory;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr int kElements = 16;

/// Records as an encoder of some step reads them, and the same before any encoder.
struct Data {
  std::vector<Segment> read, exact;
};

Segment recorded(const virtual_machine::Axis& axis, const Trajectory& motion) {
  const virtual_machine::AxisRecord record = virtual_machine::record(axis, motion);
  Segment segment;
  segment.sample_time_s = record.sample_time;
  segment.command = record.command;
  segment.actual = record.actual;
  return segment;
}

Data read_with(double encoder_step, const std::vector<Segment>& exact) {
  Data data{exact, exact};
  for (Segment& segment : data.read)
    segment.actual = (segment.actual / encoder_step).round() * encoder_step;
  return data;
}

/// `count` moves to alternate sides, each longer than the one before (thesis 5.3), and back to the
/// middle.
void growing(Trajectory& motion, double amplitude, int count, const Limits& limits) {
  for (int k = 1; k <= count; ++k)
    motion.move_to((k % 2 == 1 ? 1.0 : -1.0) * amplitude * k / count, limits);
  motion.move_to(0.0, limits);
  motion.dwell(0.3);
}

/// Steepness of the true virgin curve that passes the midpoint of the thesis's shape factor.
double steepness_of(double shape_factor) {
  return std::log(0.5 * (1.0 - shape_factor)) / std::log(0.5 * (1.0 + shape_factor));
}

/// What a model leaves on a record, in free simulation [m].
struct Judged {
  ErrorFigures read;   ///< against the encoder
  ErrorFigures exact;  ///< against the position no encoder has rounded
};

Judged judged(const Model& model, const Data& data) {
  Judged out{judge(model, data.read), {}};
  // The starting state is the encoder's in both.
  double sum = 0.0, most = 0.0, count = 0.0;
  for (std::size_t i = 0; i < data.read.size(); ++i) {
    const Eigen::ArrayXd left =
        data.exact[i].command - data.exact[i].actual - simulate(model, data.read[i]);
    const Eigen::Index used = starting_state_samples(model, data.read[i]);
    const Eigen::ArrayXd counted = left.tail(left.size() - used);
    sum += counted.square().sum();
    most = std::max(most, counted.abs().maxCoeff());
    count += static_cast<double>(counted.size());
  }
  out.exact = {std::sqrt(sum / count), most};
  return out;
}

Projection projection(const std::vector<Segment>& segments, const Structure& structure) {
  std::vector<Signals> signals;
  for (const Segment& s : segments) signals.push_back(signals_of(s));
  return {std::move(signals), structure};
}

std::optional<Model> searched(const std::vector<Segment>& segments, const Structure& structure,
                              const PoleSearchOptions& options) {
  const Projection data = projection(segments, structure);
  const auto fit = pole_search(data, options);
  if (!fit) return std::nullopt;
  return data.model_of(fit->point, fit->solution.linear);
}

void print_poles(const Model& model) {
  const PoleLabels labels = labels_of(model.loop);
  const PoleSet& poles = labels.set[0];
  std::printf("  %6.2f Hz, %6.2f Hz / %.3f", poles.real / kTwoPi, poles.omega / kTwoPi, poles.zeta);
}

// --- table 4.4 -----------------------------------------------------------------------------------

// Printed: P-PI without feed-forward, crossover 30 Hz; static friction 56 N, Coulomb 27 N, Stribeck
// velocity 5.75 mm/s; viscous 122 kg/s; reduced GMS: breakaway 53 um, shape factor 0.38. Not
// legible: the mass (a 2 is left of it; 22 kg makes the friction's errors as large as the printed
// ones) and the phase margin (60 degrees). Not printed: the rate C at which sliding elements near
// their level and the exponent of the Stribeck curve, here 500 N/s and 2; the motion; the encoder's
// step. The thesis records at 6 kHz, this study every sixth sample.
constexpr double kMass = 22.0;                          // [kg]
constexpr double kStatic = 56.0, kCoulomb = 27.0;       // [N]
constexpr double kStribeckVelocity = 5.75e-3;           // [m/s]
constexpr double kAttraction = 500.0;                   // [N/s]
constexpr double kHandFirst = 1e-6, kHandLast = 44e-6;  // [m], the thesis's by hand: 44 um

virtual_machine::Axis linear_drive(double sliding) {
  virtual_machine::Axis axis;
  axis.body.mass = kMass;
  axis.body.viscous = 122.0;
  virtual_machine::Gms friction =
      virtual_machine::gms_with_curve(kStatic, 53e-6, steepness_of(0.38), kElements);
  friction.level.coulomb = sliding;
  friction.level.stribeck_velocity = kStribeckVelocity;
  friction.level.exponent = 2.0;
  friction.attraction = kAttraction;
  axis.body.friction = friction;
  // Position gain and integrator take 15 degrees of phase each at the crossover; the mass makes 90,
  // and 60 are left.
  const double crossover = kTwoPi * 30.0, lag = std::tan(kTwoPi * 15.0 / 360.0);
  axis.drive.rate_hz = 12000.0;
  axis.drive.integration_steps = 8;
  axis.drive.position_gain = crossover * lag;
  axis.drive.velocity_gain = kMass * crossover / (1.0 + lag * lag);
  axis.drive.integral_gain = axis.drive.velocity_gain * crossover * lag;
  axis.recorder.sample_time = 1e-3;
  return axis;
}

/// Slow reversals of 20 um to 2 mm, then moves of up to 20 mm.
Trajectory fitted_motion() {
  Trajectory motion;
  motion.dwell(0.2);
  for (const double amplitude : {20e-6, 50e-6, 100e-6, 200e-6})
    virtual_machine::reverse(motion, amplitude, 6,
                             {.velocity = 4e-3, .acceleration = 0.1, .jerk = 10.0});
  growing(motion, 2e-3, 14, {.velocity = 8e-3, .acceleration = 0.2, .jerk = 20.0});
  growing(motion, 20e-3, 12, {.velocity = 0.1, .acceleration = 1.0, .jerk = 40.0});
  return motion;
}

/// Other amplitudes, other velocities, the faster part first.
Trajectory unseen_motion() {
  Trajectory motion;
  motion.dwell(0.2);
  growing(motion, 14e-3, 9, {.velocity = 0.15, .acceleration = 1.5, .jerk = 60.0});
  growing(motion, 1.2e-3, 17, {.velocity = 5e-3, .acceleration = 0.15, .jerk = 15.0});
  for (const double amplitude : {150e-6, 80e-6, 30e-6})
    virtual_machine::reverse(motion, amplitude, 8,
                             {.velocity = 3e-3, .acceleration = 0.1, .jerk = 10.0});
  motion.dwell(0.3);
  return motion;
}

std::optional<Model> polished(const std::vector<Segment>& segments, const Model& start,
                              const OutputErrorOptions& options) {
  const Structure structure{.order = 3, .effects = {start.effects[0].kind}};
  const auto fit = output_error(segments, structure, start, options);
  if (!fit) return std::nullopt;
  return fit->model;
}

/// Steps 1 to 4 with this friction.
std::optional<Model> joint(const std::vector<Segment>& segments, std::size_t friction,
                           double encoder_step) {
  const auto fit = joint_fit(segments, {.order = 3, .effects = {friction}}, {}, encoder_step,
                             /*polish=*/false);
  if (!fit) return std::nullopt;
  return polished(segments, fit->projected, {encoder_step, 20, 1e-4, 2});
}

/// The elements' displacements and their Stribeck curve held, loop and levels projected, from the
/// loop that Coulomb friction finds.
std::optional<Model> gms_by_hand(const std::vector<Segment>& segments, double sliding) {
  const auto rough = searched(segments, {.order = 3, .effects = {kind_of<CoulombFriction>()}}, {});
  if (!rough) return std::nullopt;
  PoleSearchOptions options;
  options.search_shapes = false;
  options.from = {
      {rough->loop.denominator,
       {kHandFirst, kHandLast, kStatic / sliding, kStribeckVelocity, kAttraction / sliding}}};
  return searched(segments, {.order = 3, .effects = {kind_of<Gms>()}}, options);
}

void print_models(const Data& fitted, const Data& unseen, double encoder_step, double sliding) {
  struct Rival {
    const char* name;
    double thesis;  ///< [um]; 0: not in its table
    std::optional<Model> model;
  };
  const auto by_hand = gms_by_hand(fitted.read, sliding);
  const std::vector<Rival> rivals{
      {"Coulomb", 10.92, joint(fitted.read, kind_of<CoulombFriction>(), encoder_step)},
      {"LuGre", 9.39, joint(fitted.read, kind_of<LuGre>(), encoder_step)},
      {"GMS, segments by hand", 8.97, by_hand},
      {"the same, then searched", 0.0,
       by_hand ? polished(fitted.read, *by_hand, {encoder_step, 8, 1e-3, 1}) : std::nullopt},
      {"by hand, constant level", 0.0, gms_by_hand(fitted.read, kStatic)},
      {"reduced GMS", 0.0, joint(fitted.read, kind_of<Presliding>(), encoder_step)},
      {"the same, with Stribeck", 7.14,
       joint(fitted.read, kind_of<PreslidingStribeck>(), encoder_step)}};
  double coulomb = 0.0;
  for (const Rival& rival : rivals) {
    if (!rival.model || !why_invalid(*rival.model).empty()) {
      std::printf("  %-24s no valid fit\n", rival.name);
      continue;
    }
    const Judged left = judged(*rival.model, unseen);
    if (coulomb == 0.0) coulomb = left.read.rms;
    std::printf("  %-24s %8.3f %8.2f  %6.3f", rival.name, 1e6 * left.read.rms, 1e6 * left.read.max,
                left.read.rms / coulomb);
    if (rival.thesis > 0.0) {
      std::printf("  %6.3f", rival.thesis / 10.92);
    } else {
      std::printf("  %6s", "");
    }
    std::printf("  %8.3f  %8.3f", 1e6 * left.exact.rms, 1e6 * judge(*rival.model, fitted.read).rms);
    print_poles(*rival.model);
    std::printf("\n");
  }
}

void print_comparison(const char* title, double sliding) {
  const virtual_machine::Axis axis = linear_drive(sliding);
  const auto loop = virtual_machine::continuous_loop(axis);
  Model truth;
  truth.loop.denominator = {loop.a1, loop.a2, loop.a3};
  std::printf("%s; true loop", title);
  print_poles(truth);
  std::printf("\n");
  const Segment fitted_record = recorded(axis, fitted_motion());
  const Segment unseen_record = recorded(axis, unseen_motion());
  for (const double step : {1e-6, 1e-7}) {
    const Data fitted = read_with(step, {fitted_record}), unseen = read_with(step, {unseen_record});
    std::printf(" encoder step %g um, noise floor %.3f um; %.1f s fitted, %.1f s unseen\n",
                1e6 * step, 1e6 * step / std::sqrt(12.0), fitted.read[0].end_s(),
                unseen.read[0].end_s());
    std::printf("  %-24s %8s %8s  %6s  %6s  %8s  %8s  %s\n", "", "RMS um", "MAX um", "ratio",
                "thesis", "to exact", "fitted", "loop");
    print_models(fitted, unseen, step, sliding);
  }
}

// --- table 5.5 -----------------------------------------------------------------------------------

// Printed (tables 5.4 and 5.5, 3.7.2): the poles and the friction of step 3, taken as the truth
// here; no feed-forward; 0.6 ms; moves of growing length to alternate sides, of which 3.6 prints
// the limits for the same machine. The encoder's step is hardly legible, 1 or 0.1 um. With the
// printed poles a P-PI drive needs a viscous friction; the position gain is the one with which it
// is least. The mass is without effect.
struct FeedDrive {
  const char* name;
  PoleSet hz;
  double level, breakaway, shape;  ///< [m/s^2], [m]
  double thesis_rms, thesis_max;   ///< gains of step 3 against step 1 [%]
};
constexpr FeedDrive kFeedDrives[] = {
    {"X", {14.94, 29.58, 0.38}, 0.32916, 57.8e-6, 0.88, 12.32, 28.48},
    {"Y", {27.06, 40.07, 0.24}, 0.45473, 5.9e-6, 0.43, 44.20, 53.70}};

/// GMS whose virgin curve are the chords of a conic arc that leaves the origin upwards, ends level
/// and passes the midpoint of the shape factor; its power law would yield at once for a factor of
/// 0.88.
virtual_machine::Gms gms_on_conic(double level, double breakaway, double shape_factor) {
  const double weight = shape_factor / (1.0 - shape_factor);
  const auto at = [&](int j) {
    const double t = static_cast<double>(j) / kElements;
    const double side = 2.0 * weight * t * (1.0 - t), end = t * t;
    const double sum = (1.0 - t) * (1.0 - t) + side + end;
    return std::pair{end / sum, (side + end) / sum};
  };
  const auto slope = [&](int j) {
    if (j > kElements) return 0.0;
    const auto [x0, f0] = at(j - 1);
    const auto [x1, f1] = at(j);
    return (f1 - f0) / (x1 - x0);
  };
  virtual_machine::Gms gms;
  gms.level = {.coulomb = level, .breakaway = level};
  for (int j = 1; j <= kElements; ++j) {
    const double bend = slope(j) - slope(j + 1);
    gms.stiffness.push_back(bend * level / breakaway);
    gms.share.push_back(bend * at(j).first);
  }
  return gms;
}

virtual_machine::Axis feed_drive(const FeedDrive& drive, double sliding_share) {
  const double mass = 600.0;  // [kg]
  const auto [a1, a2, a3] =
      denominator_of({kTwoPi * drive.hz.real, kTwoPi * drive.hz.omega, drive.hz.zeta}, 3);
  virtual_machine::Axis axis;
  axis.name = drive.name;
  // a1 = B/m + Kv/m, a2 = Ki/m + Kp Kv/m, a3 = Kp Ki/m; Kp = 2 a3 / a2 makes Kv largest.
  axis.drive.position_gain = 2.0 * a3 / a2;
  axis.drive.velocity_gain = mass * a2 * a2 / (4.0 * a3);
  axis.drive.integral_gain = mass * 0.5 * a2;
  axis.body.mass = mass;
  axis.body.viscous = mass * a1 - axis.drive.velocity_gain;
  virtual_machine::Gms friction = gms_on_conic(mass * drive.level, drive.breakaway, drive.shape);
  friction.level.coulomb *= sliding_share;
  friction.level.stribeck_velocity = kStribeckVelocity;
  friction.attraction = 10.0 * mass * drive.level;  // within 0.1 s
  axis.body.friction = friction;
  axis.drive.rate_hz = 20000.0;
  axis.drive.integration_steps = 4;
  axis.recorder.sample_time = 0.6e-3;
  return axis;
}

Trajectory grown(double amplitude, int count, const Limits& limits) {
  Trajectory motion;
  motion.dwell(0.2);
  growing(motion, amplitude, count, limits);
  return motion;
}

void print_step(const char* name, const Model& model, const Data& unseen, double floor,
                const ErrorFigures* first) {
  const Judged left = judged(model, unseen);
  std::printf("  %-28s %8.3f %8.2f", name, 1e6 * left.read.rms, 1e6 * left.read.max);
  if (first != nullptr) {
    std::printf("  %5.1f %%  %5.1f %%", 100.0 * (1.0 - left.read.rms / first->rms),
                100.0 * (1.0 - left.read.max / first->max));
  } else {
    std::printf("  %7s  %7s", "", "");
  }
  std::printf("  %6.2f  %8.4f", left.read.rms / floor, 1e6 * left.exact.rms);
  print_poles(model);
  const Effect& friction = model.effects[0];
  std::printf(", %.1f mm/s^2", 1e3 * friction.coefficient[0]);
  if (friction.kind == kind_of<Presliding>())
    std::printf(", %.2f um, %.3f", 1e6 * friction.shape[0], friction.shape[1]);
  std::printf("\n");
}

/// Records of one feed drive: motion to fit (fast, slow) and other motion to judge by.
struct Records {
  FeedDrive drive;
  virtual_machine::Axis axis;
  double sliding_share = 1.0;
  std::vector<Segment> fitted, unseen;
};

Records records_of(const FeedDrive& drive, double sliding_share) {
  constexpr Limits kFast{.velocity = 0.096, .acceleration = 0.451, .jerk = 38.2};
  constexpr Limits kSlow{.velocity = 0.010, .acceleration = 0.2, .jerk = 20.0};
  constexpr Limits kOtherFast{.velocity = 0.060, .acceleration = 0.3, .jerk = 30.0};
  constexpr Limits kOtherSlow{.velocity = 0.005, .acceleration = 0.1, .jerk = 10.0};
  const virtual_machine::Axis axis = feed_drive(drive, sliding_share);
  return {
      drive,
      axis,
      sliding_share,
      {recorded(axis, grown(11e-3, 18, kFast)), recorded(axis, grown(1e-3, 24, kSlow))},
      {recorded(axis, grown(8e-3, 13, kOtherFast)), recorded(axis, grown(0.6e-3, 19, kOtherSlow))}};
}

void print_gain(const Records& records, double step) {
  const FeedDrive& drive = records.drive;
  const Data fitted = read_with(step, records.fitted), unseen = read_with(step, records.unseen);
  const double floor = step / std::sqrt(12.0);
  std::printf(
      " %s, encoder step %g um, noise floor %.3f um; truth %.2f Hz, %.2f Hz / %.3f, %.1f mm/s^2, "
      "level falling to %.0f %%, %.1f um, midpoint of %.2f; viscous %.1f 1/s, Kp %.1f 1/s\n",
      drive.name, 1e6 * step, 1e6 * floor, drive.hz.real, drive.hz.omega, drive.hz.zeta,
      1e3 * drive.level, 100.0 * records.sliding_share, 1e6 * drive.breakaway, drive.shape,
      records.axis.body.viscous / records.axis.body.mass, records.axis.drive.position_gain);
  std::printf("  %-28s %8s %8s  %7s  %7s  %6s  %8s  %s\n", "", "RMS um", "MAX um", "gain RMS",
              "MAX", "floors", "to exact", "loop and friction");
  const Structure coulomb{.order = 3, .effects = {kind_of<CoulombFriction>()}};
  const auto first = searched({fitted.read[0]}, coulomb, {});
  const auto all = searched(fitted.read, coulomb, {});
  const auto fit =
      joint_fit(fitted.read, {.order = 3, .effects = {kind_of<Presliding>()}}, {}, step,
                /*polish=*/true);
  if (!first || !all || !fit) {
    std::printf("  no valid fit\n");
    return;
  }
  const ErrorFigures before = judge(*first, unseen.read);
  print_step("step 1, fast motion", *first, unseen, floor, nullptr);
  print_step("step 1, fast and slow", *all, unseen, floor, &before);
  print_step("step 3, joint", fit->projected, unseen, floor, &before);
  print_step("step 4, polished", fit->model, unseen, floor, &before);
  std::printf("  %-28s %8s %8s  %5.1f %%  %5.1f %%\n", "thesis, step 3", "", "", drive.thesis_rms,
              drive.thesis_max);
}

}  // namespace

int main() {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  std::printf(
      "Friction models on a linear drive (thesis table 4.4: 10.92 : 9.39 : 8.97 : 7.14 um)\n");
  print_comparison("level falling from 56 N to 27 N, as printed", kCoulomb);
  print_comparison("constant level, 56 N", kStatic);
  std::printf("\nWhat the steps of the joint identification gain (thesis table 5.5)\n");
  for (const FeedDrive& drive : kFeedDrives) {
    const Records records = records_of(drive, 1.0);
    for (const double step : {1e-6, 1e-7}) print_gain(records, step);
  }
  for (const FeedDrive& drive : kFeedDrives) print_gain(records_of(drive, 0.75), 1e-6);
  return 0;
}
