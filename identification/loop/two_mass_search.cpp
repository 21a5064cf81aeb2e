#include "identification/loop/two_mass_search.h"

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>

#include "identification/least_squares/bounded.h"
#include "identification/least_squares/gram_solver.h"
#include "identification/least_squares/parallel.h"
#include "identification/least_squares/unit_columns.h"
#include "identification/recording/signals.h"
#include "twin/linear_algebra.h"
#include "twin/twin.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

namespace {

constexpr double kStep_s = 2e-3;  // of the data: the filters are exact at any step
// Of the grid: how much faster than the rigid fit, which has taken over a part of the vibration,
// the loop may be; frequencies; shares of the load.
struct FasterLoop {
  double gain, position;
};
constexpr std::array kFasterLoops{FasterLoop{1.0, 1.0}, FasterLoop{1.7, 1.7}, FasterLoop{3.0, 3.0},
                                  FasterLoop{6.0, 2.5}, FasterLoop{12.0, 3.0}};
constexpr std::array kSprings_hz{6.0, 10.0, 16.0, 25.0, 40.0, 63.0, 100.0, 160.0};
constexpr std::array kLoadShares{0.25, 0.5, 0.75};
constexpr std::ptrdiff_t kRefinedOfLoop = 2;  // the best starts of each of these loops
constexpr int kRefineRounds = 40;
constexpr double kRefineTolerance = 1e-5;  // of the cost
constexpr double kMaxFrequency = 0.3;      // of a spring, of the rate of the thinned data
constexpr double kFrictionShare = 0.9;     // on the load: within its bounds
constexpr double kMaxLogOfGain = 3.0;      // how far a gain may go, from that of the rigid fit
// A phase of sliding: faster than this share of the largest speed, for at least so long and for so
// many rows: its starting state takes five of them.
constexpr double kSlidingShare = 0.03, kShortestPhase_s = 0.03;
constexpr Eigen::Index kFewestRows = 20;
// Norm of a column without what the starting states can do, over its whole norm, below which only
// rounding is left: of a constant force behind an integrator.
constexpr double kMaxNormRatioOfRounding = 1e-9;
// Its friction may fall with speed, within these [m/s] times the stretch of the axis.
constexpr std::array kFallingWithin{2e-3, 6e-3, 2e-2};
constexpr double kUnsolved = 1e300;

// The coordinates of the drive: logarithms of a1, of the position gain, of frequency and damping of
// the spring, of the ratio of the masses, and of the integrator's reset rate (held without an
// integrator). Where the motor's encoder closes the loop, gain and reset are a2 / a1 and a3 / a2.
enum Place : std::size_t { kGain, kPosition, kFrequency, kDamping, kMasses, kResets, kPlaces };
using DriveCoordinates = std::array<double, kPlaces>;
static_assert(kPlaces <= kDriveLanes);

template <class S>
struct DriveOf {
  LoopOf<S> loop;
  TwoMassParametersOf<S> parameters;
};

template <class S>
DriveOf<S> drive_at(const S* x, int order, Encoders encoders) {
  using std::exp;
  DriveOf<S> out;
  const S gain = exp(x[kGain]), position = exp(x[kPosition]);
  out.loop.order = order;
  out.loop.denominator = {gain, gain * position, S(0.0)};
  if (order == 3) {
    const S reset = exp(x[kResets]);
    out.loop.denominator[2] = gain * position * reset;
    if (encoders == Encoders::kLoad) {
      out.loop.denominator[1] = gain * (position + reset);
      out.parameters.reset = reset;
    }
  }
  out.parameters.encoders = encoders;
  out.parameters.omega = 2.0 * std::numbers::pi * exp(x[kFrequency]);
  out.parameters.zeta = exp(x[kDamping]);
  out.parameters.load_share = 1.0 / (1.0 + exp(-x[kMasses]));
  return out;
}

/// A phase in which the axis slides in one direction, thinned.
struct Phase {
  double h = 0.0;
  Spline command;
  Eigen::VectorXd target;            ///< the error without that of the reading
  Eigen::ArrayXd on_motor, on_load;  ///< forces that are known [m/s^2]
  Eigen::ArrayXd resisting;          ///< known relative to the last gain: friction beside the law
  Eigen::MatrixXd friction;          ///< unit forces, one column each

  [[nodiscard]] Eigen::Index size() const { return target.size(); }
};

Spline part_of(const Spline& all, Eigen::Index first, Eigen::Index count) {
  Spline out;
  out.value = all.value.segment(first, count);
  out.first = all.first.segment(first, count);
  out.second = all.second.segment(first, count);
  out.third = all.third.segment(first, count);
  return out;
}

/// False where `rigid` has an effect that these equations do not have.
bool add_phases(const Segment& segment, const Model& rigid, double slowest,
                std::vector<Phase>& out) {
  Signals full = signals_of(segment);
  add_drive(rigid, full);
  const auto every = std::max(1, static_cast<int>(std::floor(kStep_s / full.h + 1e-9)));
  const Signals s = decimated(full, every);
  const double delay = rigid.command_delay_s();
  const Spline command = delay > 0.0 ? Spline::through(s.command.delayed(delay), s.h) : s.command;
  Eigen::ArrayXd target = s.error - (s.command.value - command.value);
  Eigen::ArrayXd on_motor = Eigen::ArrayXd::Zero(s.size()), on_load = on_motor,
                 resisting = on_motor;
  for (const Effect& effect : rigid.effects) {
    const Acts acts = identity_of(effect.kind).acts;
    if (acts == Acts::kCommandDelay || is_friction_law(effect.kind)) continue;
    if (!acts_along_motion(acts) || limits_motor(effect.kind) || adds_poles(effect.kind))
      return false;
    const auto units =
        unit_columns(effect.kind, effect.shape.data(), motion_along(s, command, acts), false);
    Eigen::ArrayXd force = Eigen::ArrayXd::Zero(s.size());
    for (Eigen::Index c = 0; c < units.force.cols(); ++c)
      force += effect.coefficient[static_cast<std::size_t>(c)] * units.force.col(c);
    if (acts == Acts::kReading) {
      target += force;
    } else if (is_friction(effect.kind)) {
      resisting += force;
    } else {
      (acts_on(effect.kind) == ActsOn::kMotor ? on_motor : on_load) += force;
    }
  }
  const auto shortest =
      std::max(kFewestRows, static_cast<Eigen::Index>(std::ceil(kShortestPhase_s / s.h)));
  for (Eigen::Index from = s.lead, k = from; k <= s.size(); ++k) {
    const bool slides = k < s.size() && std::abs(s.velocity(k)) > slowest &&
                        (k == from || (s.velocity(k) > 0.0) == (s.velocity(from) > 0.0));
    if (slides) continue;
    if (const Eigen::Index count = k - from; count >= shortest) {
      Phase one;
      one.h = s.h;
      one.command = part_of(command, from, count);
      one.target = target.segment(from, count).matrix();
      one.on_motor = on_motor.segment(from, count);
      one.on_load = on_load.segment(from, count);
      one.resisting = resisting.segment(from, count);
      const double direction = s.velocity(from) > 0.0 ? 1.0 : -1.0;
      one.friction.resize(count, 1 + std::ssize(kFallingWithin));
      one.friction.col(0).setConstant(direction);
      for (Eigen::Index c = 1; c < one.friction.cols(); ++c) {
        const double within = s.length_scale * kFallingWithin[static_cast<std::size_t>(c - 1)];
        one.friction.col(c) =
            direction * (-s.velocity.segment(from, count).abs() / within).exp().matrix();
      }
      out.push_back(std::move(one));
    }
    from = k + 1;
  }
  return true;
}

class TwoMassProjection {
  template <class State>
  [[nodiscard]] auto reading(const State& state) const {
    auto out = state[0];
    if (encoders_ != Encoders::kMotor) out += state[2];
    return out;
  }

 public:
  /// `rigid`: the loop that the known forces belong to.
  TwoMassProjection(std::vector<Phase> phases, const Structure& structure, const Loop& rigid,
                    Encoders encoders)
      : phases_(std::move(phases)),
        order_(structure.order),
        commands_(structure.matched_feedforward ? order_ - 1 : order_),
        last_gain_(rigid.denominator[static_cast<std::size_t>(order_ - 1)]),
        encoders_(encoders) {
    for (const Phase& s : phases_) rows_ += s.size();
  }

  struct Solution {
    std::array<double, kMaxOrder> command{};  ///< c0..
    Eigen::VectorXd friction;                 ///< levels [m/s^2]; 0 where they do not show
    std::vector<Eigen::VectorXd> starting;    ///< the state at the start of every phase
    Eigen::VectorXd residual;
    double cost = kUnsolved;            ///< half the sum of squares
    std::vector<Eigen::MatrixXd> free;  ///< orthonormal: what the starting state does
    Eigen::MatrixXd shared;             ///< what the other parameters do beside that
    std::optional<GramSolver> solver;   ///< refers to `shared`
  };

  [[nodiscard]] int order() const { return order_; }
  [[nodiscard]] Encoders encoders() const { return encoders_; }
  [[nodiscard]] Eigen::Index rows() const { return rows_; }
  /// Rows less linear parameters.
  [[nodiscard]] Eigen::Index freedom() const {
    const Eigen::Index states = order_ == 3 ? TwoMassAxis::kStates : TwoMassAxis::kStates - 1;
    return rows_ - states * std::ssize(phases_) - commands_ - kLaws;
  }
  /// How much larger the last gain is than that of the rigid loop.
  [[nodiscard]] double stiffer(const Loop& loop) const {
    return loop.denominator[static_cast<std::size_t>(order_ - 1)] / last_gain_;
  }

  /// Into `out`, which the solver in it refers to. False where the loop is not stable.
  bool solve(const DriveCoordinates& x, Solution& out) const {
    const DriveOf<double> drive = drive_at(x.data(), order_, encoders_);
    out.cost = kUnsolved;
    if (!stable(drive.loop, drive.parameters)) return false;
    Eigen::MatrixXd columns;
    std::vector<Eigen::MatrixXd> free;
    fill(drive, columns, free, out.residual);
    if (!columns.allFinite()) return false;
    const Eigen::VectorXd target = out.residual;
    out.shared = columns;
    out.free.clear();
    Eigen::Index row = 0;
    for (const Eigen::MatrixXd& one : free) {
      out.free.push_back(orthonormal_basis(one));
      take_out(out.free.back(), out.shared.middleRows(row, one.rows()));
      take_out(out.free.back(), out.residual.segment(row, one.rows()));
      row += one.rows();
    }
    out.solver.emplace(out.shared);
    for (Eigen::Index c = 0; c < columns.cols(); ++c) {
      if (!(out.shared.col(c).norm() > kMaxNormRatioOfRounding * columns.col(c).norm()))
        out.solver->drop(c);
    }
    const Eigen::VectorXd linear = out.solver->take_out(out.residual);
    out.command = {};
    for (int j = 0; j < commands_; ++j) out.command[static_cast<std::size_t>(j)] = linear(j);
    out.friction = linear.tail(kLaws);
    const Eigen::VectorXd without_free = target - columns * linear;
    out.starting.clear();
    row = 0;
    for (const Eigen::MatrixXd& one : free) {
      out.starting.push_back(least_squares(one, without_free.segment(row, one.rows())));
      row += one.rows();
    }
    out.cost = 0.5 * out.residual.squaredNorm();
    return std::isfinite(out.cost);
  }

  /// Kaufman's Jacobian of the residual by the coordinates; its gradient is exact.
  [[nodiscard]] Eigen::MatrixXd jacobian(const DriveCoordinates& x, const Solution& at) const {
    std::array<DriveDual, kPlaces> unknowns;
    for (std::size_t i = 0; i < kPlaces; ++i) {
      unknowns[i] = x[i];
      unknowns[i].by[i] = 1.0;
    }
    DriveOf<DriveDual> drive = drive_at(unknowns.data(), order_, encoders_);
    for (std::size_t j = 0; j < kMaxOrder; ++j) drive.loop.numerator[j] = at.command[j];
    Eigen::MatrixXd out(rows_, static_cast<Eigen::Index>(kPlaces));
    TwoMassAxisOf<DriveDual> axis;
    double step = 0.0;
    Eigen::Index row = 0;
    for (std::size_t p = 0; p < phases_.size(); ++p) {
      const Phase& s = phases_[p];
      if (s.h != step) step = s.h, axis.discretise(drive.loop, drive.parameters, step);
      TwoMassAxisOf<DriveDual>::State state{};
      for (int i = 0; i < axis.states(); ++i)
        state[static_cast<std::size_t>(i)] = at.starting[p](i);
      const Eigen::VectorXd friction = s.friction * at.friction;
      const DriveDual stiffer =
          drive.loop.denominator[static_cast<std::size_t>(order_ - 1)] / last_gain_;
      const auto forces = [&](Eigen::Index k) {
        return TwoMassAxisOf<DriveDual>::Forces{
            s.on_motor(k), stiffer * s.resisting(k) + (s.on_load(k) + friction(k))};
      };
      for (Eigen::Index k = 0; k < s.size(); ++k) {
        const DriveDual error = reading(state);
        for (Eigen::Index i = 0; i < out.cols(); ++i) out(row + k, i) = -error.by(i);
        if (k + 1 == s.size()) break;
        CommandPieceOf<DriveDual> piece;
        piece.velocity = s.command.first(k);
        piece.acceleration = s.command.second(k);
        piece.jerk = s.command.third(k);
        state = axis.with(axis.free(state, piece, forces(k)), forces(k + 1));
      }
      take_out(at.free[p], out.middleRows(row, s.size()));
      row += s.size();
    }
    for (Eigen::Index c = 0; c < out.cols(); ++c) {
      Eigen::VectorXd column = out.col(c);
      at.solver->take_out(column);
      out.col(c) = column;
    }
    return out;
  }

 private:
  template <class Rows>
  static void take_out(const Eigen::MatrixXd& basis, Rows&& rows) {
    rows -= (basis * (basis.transpose() * rows)).eval();
  }

  /// What every linear parameter does, and the error less what none of them changes.
  void fill(const DriveOf<double>& drive, Eigen::MatrixXd& columns,
            std::vector<Eigen::MatrixXd>& free, Eigen::VectorXd& target) const {
    constexpr int kStates = TwoMassAxis::kStates;
    const int states = order_ == 3 ? kStates : kStates - 1;
    const Eigen::Index shared = commands_ + kLaws;
    const double stiffer = this->stiffer(drive.loop);
    columns.resize(rows_, shared);
    target.resize(rows_);
    TwoMassAxis axis;
    std::array<TwoMassAxis::Step, kMaxOrder> by_command{};
    double step = 0.0;
    Eigen::Index row = 0;
    for (const Phase& s : phases_) {
      if (s.h != step) {
        step = s.h;
        axis.discretise(drive.loop, drive.parameters, step);
        for (int j = 0; j < commands_; ++j) {
          Loop loop = drive.loop;
          loop.numerator[static_cast<std::size_t>(j)] = 1.0;
          TwoMassAxis other;
          other.discretise(loop, drive.parameters, step);
          by_command[static_cast<std::size_t>(j)] = other.step();
        }
      }
      const TwoMassAxis::Step& fixed = axis.step();
      using State = Eigen::Matrix<double, kStates, 1>;
      Eigen::Matrix<double, kStates, kStates> phi = decltype(phi)::Zero();
      Eigen::Matrix<double, kStates, 3> command = decltype(command)::Zero();
      std::array<Eigen::Matrix<double, kStates, 3>, kMaxOrder> commands;
      commands.fill(command);
      State motor_begin = State::Zero(), motor_end = motor_begin, load_begin = motor_begin,
            load_end = motor_begin;
      for (int r = 0; r < states; ++r) {
        const auto at = static_cast<std::size_t>(r);
        for (int c = 0; c < states; ++c) phi(r, c) = fixed.phi[at][static_cast<std::size_t>(c)];
        for (int c = 0; c < 3; ++c) {
          command(r, c) = fixed.command[at][static_cast<std::size_t>(c)];
          for (std::size_t j = 0; j < kMaxOrder; ++j)
            commands[j](r, c) =
                by_command[j].command[at][static_cast<std::size_t>(c)] - command(r, c);
        }
        motor_begin(r) = fixed.motor_begin[at], motor_end(r) = fixed.motor_end[at];
        load_begin(r) = fixed.load_begin[at], load_end(r) = fixed.load_end[at];
      }
      // The fixed part, the columns of the command, that of the friction, and the free states.
      Eigen::Matrix<double, kStates, kMaxOrder + 1 + kLaws> z = decltype(z)::Zero(), input = z;
      Eigen::Matrix<double, kStates, kStates> swings = decltype(swings)::Identity();
      Eigen::MatrixXd of_start(s.size(), states);
      const Eigen::ArrayXd on_load = s.on_load + stiffer * s.resisting;
      for (Eigen::Index k = 0; k < s.size(); ++k) {
        target(row + k) = s.target(k) - reading(z.col(0));
        for (Eigen::Index c = 0; c < shared; ++c) columns(row + k, c) = reading(z.col(1 + c));
        for (int i = 0; i < states; ++i) of_start(k, i) = reading(swings.col(i));
        if (k + 1 == s.size()) break;
        const Eigen::Vector3d moves(s.command.first(k), s.command.second(k), s.command.third(k));
        input.col(0) = command * moves + motor_begin * s.on_motor(k) +
                       motor_end * s.on_motor(k + 1) + load_begin * on_load(k) +
                       load_end * on_load(k + 1);
        for (int j = 0; j < commands_; ++j)
          input.col(1 + j) = commands[static_cast<std::size_t>(j)] * moves;
        for (Eigen::Index c = 0; c < kLaws; ++c)
          input.col(1 + commands_ + c) =
              load_begin * s.friction(k, c) + load_end * s.friction(k + 1, c);
        z = (phi * z + input).eval();
        swings = (phi * swings).eval();
      }
      free.push_back(std::move(of_start));
      row += s.size();
    }
  }

  static constexpr int kLaws = 1 + static_cast<int>(kFallingWithin.size());

  std::vector<Phase> phases_;
  int order_, commands_;  // commands_: of c0.. those that are free
  double last_gain_;
  Encoders encoders_;
  Eigen::Index rows_ = 0;
};

/// Levenberg-Marquardt asks for r'r, J'r and J'J only, which the triangle of [J r] has as well.
class TwoMassCost final : public ceres::CostFunction {
 public:
  TwoMassCost(const TwoMassProjection& data, double unit) : data_(data), unit_(unit) {
    mutable_parameter_block_sizes()->push_back(kPlaces);
    set_num_residuals(kPlaces + 1);
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    constexpr auto kCount = static_cast<Eigen::Index>(kPlaces);
    DriveCoordinates x{};
    std::copy_n(parameters[0], kCount, x.begin());
    TwoMassProjection::Solution at;
    if (!data_.solve(x, at)) return false;
    Eigen::Map<Eigen::VectorXd> out(residuals, kCount + 1);
    out.setZero();
    out(kCount) = unit_ * std::sqrt(2.0 * at.cost);
    if (jacobians == nullptr || jacobians[0] == nullptr) return true;
    Eigen::MatrixXd both(data_.rows(), kCount + 1);
    both.leftCols(kCount) = data_.jacobian(x, at);
    both.col(kCount) = at.residual;
    const Eigen::MatrixXd triangle = triangle_of(unit_ * both);
    if (!triangle.allFinite()) return false;
    out = triangle.col(kCount);
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<RowMajor>(jacobians[0], kCount + 1, kCount) = triangle.leftCols(kCount);
    return true;
  }

 private:
  const TwoMassProjection& data_;
  double unit_;
};

struct Found {
  DriveCoordinates x{};
  double cost = kUnsolved;
};

/// Bounds of the coordinates; those with one value are held.
struct Box {
  DriveCoordinates lower{}, upper{};

  void hold(std::size_t place, double value) { lower[place] = upper[place] = value; }
};

/// What machines usually have.
struct Usual {
  std::size_t place;
  double mean, deviation;  // of the coordinate
};
// A damping of 0.04 and masses of one size. While the axis slides, the residual hardly changes
// along a curve of both, and a fit that begins with a load that is far too light does not find the
// friction on it. Machines differ by more than a factor of 1.6; the fit in free simulation, which
// follows, knows nothing of this.
constexpr std::array kUsual{Usual{kDamping, -3.2, 0.5}, Usual{kMasses, 0.0, 0.5}};

/// What is added to the cost, of residuals whose RMS is this.
double unusual(const DriveCoordinates& x, double rms) {
  double out = 0.0;
  for (const Usual& of : kUsual)
    out += 0.5 * std::pow(rms * (x[of.place] - of.mean) / of.deviation, 2);
  return out;
}

/// `usual`: the unit in which the residual is compared with kUsual; 0 without that.
DriveCoordinates refined_from(const TwoMassProjection& data, const Box& box, const Found& one,
                              double usual) {
  DriveCoordinates x = one.x;
  ceres::Problem problem;
  const double unit = 1.0 / std::sqrt(2.0 * one.cost);
  problem.AddResidualBlock(new TwoMassCost(data, unit), nullptr, x.data());
  if (usual > 0.0) {
    constexpr auto kCount = static_cast<Eigen::Index>(kPlaces);
    ceres::Matrix weights = ceres::Matrix::Zero(kCount, kCount);
    ceres::Vector means = ceres::Vector::Zero(kCount);
    for (const Usual& of : kUsual) {
      const auto at = static_cast<Eigen::Index>(of.place);
      weights(at, at) = unit * usual / of.deviation;
      means(at) = of.mean;
    }
    problem.AddResidualBlock(new ceres::NormalPrior(weights, means), nullptr, x.data());
  }
  std::vector<int> held;
  for (std::size_t i = 0; i < kPlaces; ++i) {
    const int at = static_cast<int>(i);
    if (box.lower[i] == box.upper[i]) {
      held.push_back(at);
      continue;
    }
    problem.SetParameterLowerBound(x.data(), at, box.lower[i]);
    problem.SetParameterUpperBound(x.data(), at, box.upper[i]);
  }
  if (!held.empty())
    problem.SetManifold(x.data(), new ceres::SubsetManifold(static_cast<int>(kPlaces), held));
  ceres::Solver::Options options =
      bounded_options(ceres::DENSE_NORMAL_CHOLESKY, kRefineRounds, kRefineTolerance);
  options.max_num_line_search_step_size_iterations = 0;
  solve_bounded(options, problem);
  return x;
}

void refine(const TwoMassProjection& data, const Box& box, Found& one) {
  if (!(one.cost > 0.0)) return;
  const DriveCoordinates x = refined_from(data, box, one, 0.0);
  TwoMassProjection::Solution at;
  if (data.solve(x, at) && at.cost < one.cost) one = {x, at.cost};
}

/// Led to what machines usually have where the residual, of this RMS, hardly tells; from there as
/// well, since the curve is long.
Found led_to_usual(const TwoMassProjection& data, const Box& box, double rms, const Found& found) {
  Found usual = found;
  for (const Usual& of : kUsual) usual.x[of.place] = of.mean;
  Found best = found;
  double least = found.cost + unusual(found.x, rms);
  for (Found one : {found, usual}) {
    TwoMassProjection::Solution at;
    if (!data.solve(one.x, at) || !(at.cost > 0.0)) continue;
    one.cost = at.cost;
    one.x = refined_from(data, box, one, rms);
    if (!data.solve(one.x, at)) continue;
    const double cost = at.cost + unusual(one.x, rms);
    if (cost < least) least = cost, best = {one.x, at.cost};
  }
  return best;
}

std::optional<Model> model_at(const Found& found, const TwoMassProjection& data, const Model& rigid,
                              std::size_t kind) {
  TwoMassProjection::Solution at;
  if (!data.solve(found.x, at)) return std::nullopt;
  const DriveOf<double> drive = drive_at(found.x.data(), data.order(), data.encoders());
  Effect axis;
  axis.kind = kind;
  axis.shape[0] = drive.parameters.omega / (2.0 * std::numbers::pi);
  axis.shape[1] = drive.parameters.zeta;
  axis.shape[2] = drive.parameters.load_share;
  axis.shape[TwoMassLoadEncoder::kFrictionShareAt] = kFrictionShare;
  if (data.encoders() == Encoders::kLoad)
    axis.shape[TwoMassLoadEncoder::kResetAt] =
        data.order() == 3 ? drive.parameters.reset : TwoMassLoadEncoder::kReset.start;
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(kind)) {
    axis.shape[i] = std::clamp(axis.shape[i], p.lower, p.upper);
    ++i;
  }
  Model out = rigid;
  out.loop.denominator = drive.loop.denominator;
  out.loop.numerator = at.command;
  // The error by a constant force (order 2), or the area of the error after a step of force (order
  // 3), is relative to the last gain: friction keeps it, where the phases do not show its level.
  const double stiffer = data.stiffer(drive.loop);
  for (Effect& effect : out.effects) {
    if (!is_friction(effect.kind)) continue;
    const double level = is_friction_law(effect.kind) ? level_of(effect) : 0.0,
                 factor = at.friction(0) > 0.0 && level > 0.0 ? at.friction(0) / level : stiffer;
    for (double& c : effect.coefficient) c *= factor;
  }
  out.effects.push_back(axis);
  return why_invalid(out).empty() ? std::optional(out) : std::nullopt;
}

}  // namespace

std::optional<TwoMassStart> two_mass_start(const std::vector<Segment>& segments,
                                           const Structure& structure, const Model& rigid,
                                           std::size_t kind) {
  if (!rigid.loop.modes.empty()) return std::nullopt;
  double fastest = 0.0;
  for (const Segment& s : segments)
    fastest = std::max(fastest, signals_of(s).velocity.abs().maxCoeff());
  std::vector<Phase> phases;
  double duration_s = 0.0;
  for (const Segment& s : segments) {
    if (!add_phases(s, rigid, kSlidingShare * fastest, phases)) return std::nullopt;
    duration_s += s.sample_time_s * static_cast<double>(s.size() - s.lead);
  }
  if (phases.empty()) return std::nullopt;
  double step_s = 0.0, sliding_s = 0.0;
  for (const Phase& s : phases) {
    step_s = std::max(step_s, s.h);
    sliding_s += s.h * static_cast<double>(s.size());
  }
  Effect axis;
  axis.kind = kind;
  const TwoMassProjection data(std::move(phases), structure, rigid.loop,
                               two_mass_parameters(axis).encoders);
  if (data.freedom() < kFewestRows) return std::nullopt;
  const std::array<double, kMaxOrder>& a = rigid.loop.denominator;
  const bool integral = rigid.loop.order == 3, by_load = data.encoders() == Encoders::kLoad;
  const auto shapes = shapes_of(kind);
  const double fastest_hz = kMaxFrequency / step_s;

  // Of a position gain and a reset that the load's encoder cannot tell from the loop: halves.
  DriveCoordinates at_rigid{};
  at_rigid[kGain] = std::log(a[0]);
  at_rigid[kPosition] = std::log((integral && by_load ? 0.5 : 1.0) * a[1] / a[0]);
  at_rigid[kDamping] = std::log(shapes[1].start);
  if (integral) at_rigid[kResets] = by_load ? at_rigid[kPosition] : std::log(a[2] / a[1]);
  Box box{at_rigid, at_rigid};
  for (const std::size_t i : {kGain, kPosition, kResets}) {
    box.lower[i] -= kMaxLogOfGain;
    box.upper[i] += kMaxLogOfGain;
  }
  if (!integral) box.hold(kResets, 0.0);
  box.lower[kFrequency] = std::log(shapes[0].lower);
  box.upper[kFrequency] = std::log(std::min(shapes[0].upper, fastest_hz));
  box.lower[kDamping] = std::log(shapes[1].lower);
  box.upper[kDamping] = std::log(shapes[1].upper);
  box.lower[kMasses] = std::log(shapes[2].lower / (1.0 - shapes[2].lower));
  box.upper[kMasses] = std::log(shapes[2].upper / (1.0 - shapes[2].upper));
  std::vector<Found> grid;
  for (const FasterLoop& faster : kFasterLoops) {
    for (const double frequency_hz : kSprings_hz) {
      if (frequency_hz > fastest_hz) continue;
      for (const double share : kLoadShares) {
        Found one{at_rigid};
        one.x[kGain] += std::log(faster.gain);
        one.x[kPosition] += std::log(faster.position);
        if (integral) one.x[kResets] += std::log(faster.position);
        one.x[kFrequency] = std::log(frequency_hz);
        one.x[kMasses] = std::log(share / (1.0 - share));
        grid.push_back(one);
      }
    }
  }
  in_parallel(grid.size(), [&](std::size_t i) {
    TwoMassProjection::Solution at;
    if (data.solve(grid[i].x, at)) grid[i].cost = at.cost;
  });
  const auto best_first = [](const Found& l, const Found& r) { return l.cost < r.cost; };
  std::vector<Found> refined;
  const auto of_loop = std::ssize(grid) / std::ssize(kFasterLoops);
  for (auto from = grid.begin(); from != grid.end(); from += of_loop) {
    std::sort(from, from + of_loop, best_first);
    std::copy_if(from, from + std::min(kRefinedOfLoop, of_loop), std::back_inserter(refined),
                 [](const Found& one) { return one.cost < kUnsolved; });
  }
  in_parallel(refined.size(), [&](std::size_t i) { refine(data, box, refined[i]); });
  const auto best = std::min_element(refined.begin(), refined.end(), best_first);
  if (best == refined.end()) return std::nullopt;
  const auto rms_of = [&](const Found& one) {
    return std::sqrt(2.0 * one.cost / static_cast<double>(data.freedom()));
  };
  const Found led = led_to_usual(data, box, rms_of(*best), *best);
  auto model = model_at(led, data, rigid, kind);
  if (!model) return std::nullopt;
  const double in_phases = std::sqrt(2.0 * best->cost / static_cast<double>(data.rows()));
  return TwoMassStart{std::move(*model), rms_of(led),
                      in_phases * std::sqrt(sliding_s / duration_s)};
}

}  // namespace servotwin
