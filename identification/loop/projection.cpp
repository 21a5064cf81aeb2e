#include "identification/loop/projection.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "identification/least_squares/gram_solver.h"
#include "identification/least_squares/unit_columns.h"
#include "identification/loop/force_filter.h"

namespace servotwin {

int Structure::shape_count() const {
  std::size_t count = 0;
  for (std::size_t kind : effects) count += shapes_of(kind).size();
  return static_cast<int>(count);
}

int Structure::coefficient_count() const {
  int count = 0;
  for (std::size_t kind : effects) {
    for (const Parameter& p : coefficients_of(kind))
      count += told_from_loop(p, order) || every_coefficient ? 1 : 0;
  }
  return count;
}

/// Column-major storage of one evaluation.
struct Projection::Columns {
  int order = 0;
  Eigen::MatrixXd regressors;  // rows x (order + coefficients + 2 modes + free responses)
  Eigen::VectorXd target;      // e minus the part that the delay alone explains
  Eigen::MatrixXd command2;    // s^m / P^2 of the command velocity (m = 0..2n-2)
  // Every column of a force by a1..an and by omega, zeta, gamma, delta of every mode; of a free
  // response of the loop by a1..an, of a mode by its omega and zeta.
  std::vector<Eigen::MatrixXd> by_force, by_free;
  std::vector<Mode> modes;
  // s^m / M^2 of the command velocity (m = 0..3), per mode.
  std::vector<Eigen::MatrixXd> mode2;
  Eigen::VectorXd delayed_velocity,
      top_derivative;  // v_d and d/dt of the highest state, for the delay
  // Filtered derivative of a force by a shape: (slot, shape, column).
  struct ShapeColumn {
    int slot = 0, shape = 0;
    Eigen::VectorXd column;
  };
  std::vector<ShapeColumn> by_shape;
};

Projection::Projection(std::vector<Signals> segments, Structure structure, bool free_response)
    : segments_(std::move(segments)),
      structure_(std::move(structure)),
      free_response_(free_response) {
  for (const Signals& s : segments_) rows_ += s.size();
  std::size_t shape = 0;
  for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
    const std::size_t kind = structure_.effects[i];
    shape_offset_.push_back(shape);
    if (identity_of(kind).acts == Acts::kCommandDelay) delay_shape_ = static_cast<int>(shape);
    shape += shapes_of(kind).size();
    std::size_t k = 0;
    for (const Parameter& p : coefficients_of(kind)) {
      if (told_from_loop(p, structure_.order) || structure_.every_coefficient)
        slots_.push_back({i, k, p.lower == 0.0});
      ++k;
    }
  }
  for (const std::size_t kind : structure_.effects) {
    acts_along_motion_ = acts_along_motion_ || acts_along_motion(identity_of(kind).acts);
    acts_on_reading_ = acts_on_reading_ || identity_of(kind).acts == Acts::kReading;
  }
  if (delay_shape_ >= 0 || !acts_along_motion_) return;
  for (const Signals& s : segments_) motions_.emplace_back(s, s.command, acts_on_reading_);
}

namespace {

/// Whether such an effect is driven by the position of the loop, which the reading is not.
bool along_loop(const Signals& s, Acts acts) {
  return acts == Acts::kReading && s.loop_position.size() > 0;
}

}  // namespace

std::vector<Motion> motion_along(const Signals& s, const Spline& command, Acts acts) {
  const bool simulated = along_loop(s, acts);
  const Eigen::ArrayXd& x = simulated ? s.loop_position : s.position;
  std::vector<Motion> out(static_cast<std::size_t>(s.size()));
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    Motion& m = out[static_cast<std::size_t>(k)];
    m.step_s = s.h;
    m.position = x(k);
    m.velocity = simulated && k > 0 && k + 1 < s.size() ? (x(k + 1) - x(k - 1)) / (2.0 * s.h)
                                                        : s.velocity(k);
    m.displacement = k > 0 ? x(k) - x(k - 1) : 0.0;
    if (s.acceleration.size() > 0) m.acceleration = s.acceleration(k);
    m.command_velocity = command.first(k);
    m.command_acceleration = command.second(k);
    m.tracking_error = command.value(k) - x(k);
    m.time_s = s.start_s + s.h * static_cast<double>(k);
    if (s.in_cut.size() > 0) m.in_cut = s.in_cut(k);
    if (s.demand.size() > 0) {
      m.demand = s.demand(k);
      m.demand_rate = s.demand_rate(k);
      m.demand_damping = s.demand_damping(k);
    }
    if (s.friction.size() > 0) m.friction = s.friction(k);
    if (s.neighbour_acceleration.size() > 0) m.neighbour_acceleration = s.neighbour_acceleration(k);
    if (s.neighbour_motion_acceleration.size() > 0)
      m.neighbour_motion_acceleration = s.neighbour_motion_acceleration(k);
  }
  return out;
}

MotionsSeen::MotionsSeen(const Signals& signals, const Spline& command, bool by_loop)
    : by_reading_(motion_along(signals, command, Acts::kForce)) {
  if (by_loop && along_loop(signals, Acts::kReading))
    by_loop_ = motion_along(signals, command, Acts::kReading);
}

Eigen::Index Projection::model_columns() const {
  return structure_.order + static_cast<Eigen::Index>(slots_.size()) + 2 * structure_.modes;
}

Eigen::VectorXd& Projection::column_of(Columns& columns, int slot, int shape, bool first) const {
  if (first) columns.by_shape.push_back({slot, shape, Eigen::VectorXd::Zero(rows_)});
  return std::find_if(columns.by_shape.begin(), columns.by_shape.end(),
                      [&](const auto& e) { return e.slot == slot && e.shape == shape; })
      ->column;
}

/// The free responses of one block of the loop; `mode`: whose it is, or none.
template <int N, class Bank>
void Projection::fill_free(const Bank& bank, Columns& columns, const Signals& s, Eigen::Index row0,
                           Eigen::Index first, bool derivatives, const Mode* mode) const {
  using State = Eigen::Matrix<double, Bank::kStates, 1>;
  for (int i = 0; i < N; ++i) {
    const Eigen::Index at = first + i;
    auto column = columns.regressors.col(model_columns() + at);
    State w = State::Zero();
    w(i) = 1.0;
    if (derivatives) columns.by_free[static_cast<std::size_t>(at)].setZero(rows_, N);
    if (s.lead > 0) continue;  // the free response has decayed within the lead-in
    // In units of time in which the poles are about 1, all states have similar size and decay
    // alike.
    const double rate = std::pow(bank.a[N - 1], 1.0 / N);
    const auto size_of = [&] {
      double size = 0.0;
      for (int m = 0; m < N; ++m) size = std::max(size, std::abs(w(m)) * std::pow(rate, i - m));
      return size;
    };
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      column(row0 + k) = w(0);
      if (derivatives) {
        Eigen::MatrixXd& by = columns.by_free[static_cast<std::size_t>(at)];
        if (mode != nullptr) {
          by(row0 + k, 0) = -2.0 * mode->zeta * w(N + 1) - 2.0 * mode->omega * w(N);
          by(row0 + k, 1) = -2.0 * mode->omega * w(N + 1);
        } else {
          for (int m = 0; m < N; ++m) by(row0 + k, m) = -w(2 * N - 1 - m);
        }
      }
      w = (bank.phi * w).eval();
      if (k % 64 == 63 && size_of() < 1e-9) break;
    }
  }
}

// Flattened: the compiler leaves the steps of the filters as calls, which costs a sixth of the
// time.
template <int N>
__attribute__((flatten)) void Projection::fill(const Point& point, bool derivatives,
                                               Columns& columns) const {
  using Bank = FilterBank<N>;
  using State = Eigen::Matrix<double, Bank::kStates, 1>;
  const auto slot_count = static_cast<Eigen::Index>(slots_.size());
  const auto modes = static_cast<Eigen::Index>(point.modes.size());
  const Eigen::Index states = N + 2 * modes, nonlinear = N + kModeShapes * modes;
  const Eigen::Index free_count =
      free_response_ ? states * static_cast<Eigen::Index>(segments_.size()) : 0;
  columns.order = N;
  columns.modes = point.modes;
  columns.regressors.setZero(rows_, model_columns() + free_count);
  columns.target.resize(rows_);
  const double delay =
      delay_shape_ >= 0 ? point.shapes[static_cast<std::size_t>(delay_shape_)] : 0.0;
  if (derivatives) {
    columns.command2.resize(rows_, 2 * N - 1);
    columns.by_force.resize(slots_.size());
    for (Eigen::MatrixXd& by : columns.by_force) by.resize(rows_, nonlinear);
    columns.by_free.resize(static_cast<std::size_t>(free_count));
    columns.mode2.resize(point.modes.size());
    for (Eigen::MatrixXd& second : columns.mode2) second.resize(rows_, 4);
    if (delay_shape_ >= 0) {
      columns.delayed_velocity.resize(rows_);
      columns.top_derivative.resize(rows_);
    }
  }

  Eigen::Index row0 = 0;
  for (std::size_t segment = 0; segment < segments_.size(); ++segment) {
    const Signals& s = segments_[segment];
    const Eigen::Index n = s.size();
    const ForceFilter<N> force_filter(point.denominator, point.modes, s.h, derivatives);
    const Bank& bank = force_filter.bank();
    const auto advance = [&bank](State& w, const auto& input) {
      if constexpr (std::is_same_v<std::decay_t<decltype(input)>, int>) {
        w = (bank.phi * w).eval();
      } else {
        w = (bank.phi * w + input).eval();
      }
    };
    // Without derivatives only the first block runs.
    const Eigen::Matrix<double, N, N> phi = bank.phi.template topLeftCorner<N, N>();
    const auto step_small = [&phi](Eigen::Matrix<double, N, 1>& w,
                                   const Eigen::Matrix<double, N, 1>& input) {
      w = (phi * w + input).eval();
    };
    std::array<double, 2 * N> g{};

    // --- the command through the loop
    Spline moved;
    const Spline* command = &s.command;
    if (delay > 0.0) {
      moved = Spline::through(s.command.delayed(delay), s.h);
      command = &moved;
      columns.target.segment(row0, n) = (s.error - (s.command.value - moved.value)).matrix();
    } else {
      columns.target.segment(row0, n) = s.error.matrix();
    }
    if (derivatives) {
      State w = State::Zero();
      for (Eigen::Index k = 0; k < n; ++k) {
        for (int j = 0; j < N; ++j) columns.regressors(row0 + k, j) = w(N - 1 - j);
        bank.derivatives(w, g.data());
        for (int m = 0; m < 2 * N - 1; ++m)
          columns.command2(row0 + k, m) = g[static_cast<std::size_t>(m)];
        if (delay_shape_ >= 0) {
          columns.delayed_velocity(row0 + k) = command->first(k);
          double top = command->first(k);
          for (int i = 0; i < N; ++i) top -= bank.a[static_cast<std::size_t>(N - 1 - i)] * w(i);
          columns.top_derivative(row0 + k) = top;
        }
        advance(w, State(bank.command.col(0) * command->first(k) +
                         bank.command.col(1) * command->second(k) +
                         bank.command.col(2) * command->third(k)));
      }
    } else {
      Eigen::Matrix<double, N, 1> w = Eigen::Matrix<double, N, 1>::Zero();
      const Eigen::Matrix<double, N, 3> input = bank.command.template topRows<N>();
      for (Eigen::Index k = 0; k < n; ++k) {
        for (int j = 0; j < N; ++j) columns.regressors(row0 + k, j) = w(N - 1 - j);
        step_small(w, input.col(0) * command->first(k) + input.col(1) * command->second(k) +
                          input.col(2) * command->third(k));
      }
    }

    if (structure_.matched_feedforward) columns.regressors.col(N - 1).segment(row0, n).setZero();

    // --- and through the modes
    for (Eigen::Index m = 0; m < modes; ++m) {
      const auto k_mode = static_cast<std::size_t>(m);
      const FilterBank<2>& mode = force_filter.modes()[k_mode];
      const auto alpha = N + slot_count + 2 * m;
      Eigen::Vector4d w = Eigen::Vector4d::Zero();
      for (Eigen::Index k = 0; k < n; ++k) {
        columns.regressors(row0 + k, alpha) = w(1);
        columns.regressors(row0 + k, alpha + 1) = w(0);
        if (derivatives) {
          mode.derivatives(w, g.data());
          for (int i = 0; i < 4; ++i)
            columns.mode2[k_mode](row0 + k, i) = g[static_cast<std::size_t>(i)];
        }
        w = (mode.phi * w + mode.command.col(0) * command->first(k) +
             mode.command.col(1) * command->second(k) + mode.command.col(2) * command->third(k))
                .eval();
      }
    }

    // --- the forces along the measured motion
    std::optional<MotionsSeen> moved_motions;
    if (delay_shape_ >= 0 && acts_along_motion_)
      moved_motions.emplace(s, *command, acts_on_reading_);
    for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
      const std::size_t kind = structure_.effects[i];
      const Acts acts = identity_of(kind).acts;
      if (!acts_along_motion(acts)) continue;
      const MotionsSeen& motions = moved_motions ? *moved_motions : motions_[segment];
      const auto [forces, by_shape] =
          unit_columns(kind, point.shapes.data() + shape_offset_[i], motions.of(acts), derivatives);
      for (std::size_t slot = 0; slot < slots_.size(); ++slot) {
        if (slots_[slot].effect != i) continue;
        const auto c = static_cast<Eigen::Index>(slots_[slot].coefficient);
        if (acts == Acts::kReading) {
          // Not through the loop: a reading above the position reduces the error by the same
          // amount.
          columns.regressors.col(N + static_cast<Eigen::Index>(slot)).segment(row0, n) =
              -forces.col(c).matrix();
          if (derivatives) columns.by_force[slot].middleRows(row0, n).setZero();
          for (std::size_t p = 0; p < by_shape.size(); ++p) {
            const int shape = static_cast<int>(shape_offset_[i] + p);
            column_of(columns, static_cast<int>(slot), shape, segment == 0).segment(row0, n) =
                -by_shape[p].col(c).matrix();
          }
          continue;
        }
        auto column = columns.regressors.col(N + static_cast<Eigen::Index>(slot)).segment(row0, n);
        if (derivatives) {
          auto by = columns.by_force[slot].middleRows(row0, n);
          force_filter.run(forces.col(c), column, &by);
        } else {
          force_filter.run(forces.col(c), column, nullptr);
        }
        // A force that the integrator balances from the start gives rounding errors only: no
        // column.
        const double natural = forces.col(c).abs().maxCoeff() / std::pow(bank.a[N - 1], 2.0 / N);
        if (column.cwiseAbs().maxCoeff() < 1e-11 * natural) column.setZero();
        for (std::size_t p = 0; p < by_shape.size(); ++p) {
          const int shape = static_cast<int>(shape_offset_[i] + p);
          force_filter.run(
              by_shape[p].col(c),
              column_of(columns, static_cast<int>(slot), shape, segment == 0).segment(row0, n),
              nullptr);
        }
      }
    }

    // --- free responses of the unknown starting state
    if (free_response_) {
      const Eigen::Index first = states * static_cast<Eigen::Index>(segment);
      fill_free<N>(bank, columns, s, row0, first, derivatives, nullptr);
      for (Eigen::Index m = 0; m < modes; ++m) {
        const auto k_mode = static_cast<std::size_t>(m);
        fill_free<2>(force_filter.modes()[k_mode], columns, s, row0, first + N + 2 * m, derivatives,
                     &point.modes[k_mode]);
      }
    }
    row0 += n;
  }
}

void Projection::leave_out_leads(Columns& columns, bool derivatives) const {
  Eigen::Index row = 0;
  for (const Signals& s : segments_) {
    const Eigen::Index first = row, count = std::min(s.lead, s.size());
    const auto clear = [&](auto& rows) { rows.middleRows(first, count).setZero(); };
    row += s.size();
    if (count <= 0) continue;
    clear(columns.regressors);
    clear(columns.target);
    if (!derivatives) continue;
    clear(columns.command2);
    for (Eigen::MatrixXd& by : columns.by_force) clear(by);
    for (Eigen::MatrixXd& by : columns.by_free) clear(by);
    for (Eigen::MatrixXd& second : columns.mode2) clear(second);
    for (auto& entry : columns.by_shape) clear(entry.column);
    if (delay_shape_ < 0) continue;
    clear(columns.delayed_velocity);
    clear(columns.top_derivative);
  }
}

const Projection::Columns& Projection::columns_at(const Point& point, bool derivatives) const {
  // Kept between evaluations: allocating these megabytes each time costs page faults.
  static thread_local Columns columns;
  columns.by_shape.clear();
  if (structure_.order == 2) {
    fill<2>(point, derivatives, columns);
  } else {
    fill<3>(point, derivatives, columns);
  }
  leave_out_leads(columns, derivatives);
  return columns;
}

namespace {

/// Solves with the coefficients that may not be negative held at 0 where they would be.
template <class Slots>
Projection::Solution solve_bounded(GramSolver& solver, const Eigen::VectorXd& target,
                                   const Slots& slots, int order) {
  Projection::Solution solution;
  while (true) {
    solution.residual = target;
    solution.linear = solver.take_out(solution.residual);
    Eigen::Index worst = -1;
    for (std::size_t i = 0; i < slots.size(); ++i) {
      const Eigen::Index at = order + static_cast<Eigen::Index>(i);
      if (slots[i].non_negative && solution.linear(at) < 0.0) worst = at;
    }
    if (worst < 0) break;
    solver.drop(worst);
    solution.clamped = true;
  }
  solution.cost = 0.5 * solution.residual.squaredNorm();
  return solution;
}

}  // namespace

Projection::Solution Projection::project(const Columns& columns) const {
  GramSolver solver(columns.regressors);
  return solve_bounded(solver, columns.target, slots_, columns.order);
}

Projection::Solution Projection::solve(const Point& point) const {
  return project(columns_at(point, false));
}

Eigen::MatrixXd Projection::derivatives_of_sum(const Columns& columns,
                                               const Eigen::VectorXd& linear) const {
  const int n = columns.order;
  const auto slot_count = static_cast<Eigen::Index>(slots_.size());
  const auto modes = static_cast<Eigen::Index>(columns.modes.size());
  const Eigen::Index first_mode = n + structure_.shape_count();
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(rows_, first_mode + kModeShapes * modes);
  for (int i = 1; i <= n; ++i) {
    for (int j = 0; j < n; ++j) d.col(i - 1) -= linear(j) * columns.command2.col(2 * n - 1 - i - j);
  }
  for (Eigen::Index m = 0; m < modes; ++m) {
    const Mode& mode = columns.modes[static_cast<std::size_t>(m)];
    const Eigen::MatrixXd& g = columns.mode2[static_cast<std::size_t>(m)];
    const double alpha = linear(n + slot_count + 2 * m), beta = linear(n + slot_count + 2 * m + 1);
    const Eigen::VectorXd by_damping = -alpha * g.col(2) - beta * g.col(1);
    const Eigen::Index at = first_mode + kModeShapes * m;
    d.col(at) =
        2.0 * mode.zeta * by_damping - 2.0 * mode.omega * (alpha * g.col(1) + beta * g.col(0));
    d.col(at + 1) = 2.0 * mode.omega * by_damping;
  }
  for (Eigen::Index slot = 0; slot < slot_count; ++slot) {
    const Eigen::MatrixXd& by = columns.by_force[static_cast<std::size_t>(slot)];
    d.leftCols(n) += linear(n + slot) * by.leftCols(n);
    if (modes > 0)
      d.rightCols(kModeShapes * modes) += linear(n + slot) * by.rightCols(kModeShapes * modes);
  }
  const Eigen::Index states = n + 2 * modes;
  Eigen::Index state = 0;  // of its segment
  for (std::size_t f = 0; f < columns.by_free.size(); ++f) {
    const double size = linear(model_columns() + static_cast<Eigen::Index>(f));
    if (state < n) {
      d.leftCols(n) += size * columns.by_free[f];
    } else {
      d.middleCols(first_mode + kModeShapes * ((state - n) / 2), 2) += size * columns.by_free[f];
    }
    state = state + 1 < states ? state + 1 : 0;
  }
  for (const auto& entry : columns.by_shape)
    d.col(n + entry.shape) += linear(n + entry.slot) * entry.column;
  if (delay_shape_ >= 0) {
    auto column = d.col(n + delay_shape_);
    // A later command: every state falls back by its derivative, and so does the command itself.
    column = columns.delayed_velocity - linear(0) * columns.top_derivative;
    for (int j = 1; j < n; ++j)
      column -= linear(j) * columns.regressors.col(j - 1);  // 0 where it is not free
    for (Eigen::Index m = 0; m < modes; ++m) {
      const Mode& mode = columns.modes[static_cast<std::size_t>(m)];
      const Eigen::Index alpha = n + slot_count + 2 * m;
      const auto rate = columns.regressors.col(alpha), value = columns.regressors.col(alpha + 1);
      column -= linear(alpha) * (columns.delayed_velocity - 2.0 * mode.zeta * mode.omega * rate -
                                 mode.omega * mode.omega * value) +
                linear(alpha + 1) * rate;
    }
  }
  return d;
}

Projection::Linearised Projection::linearise(const Point& point) const {
  const Columns& columns = columns_at(point, true);
  Linearised out;
  GramSolver solver(columns.regressors);
  out.at = solve_bounded(solver, columns.target, slots_, columns.order);
  out.jacobian = -derivatives_of_sum(columns, out.at.linear);
  for (Eigen::Index j = 0; j < out.jacobian.cols(); ++j) {
    Eigen::VectorXd column = out.jacobian.col(j);
    solver.take_out(column);
    out.jacobian.col(j) = column;
  }
  return out;
}

Eigen::MatrixXd Projection::regressors(const Point& point) const {
  const Columns& columns = columns_at(point, false);
  return columns.regressors.leftCols(model_columns());
}

Eigen::MatrixXd Projection::full_jacobian(const Point& point, const Eigen::VectorXd& linear) const {
  const Columns& columns = columns_at(point, true);
  const Eigen::MatrixXd by = derivatives_of_sum(columns, linear);
  Eigen::MatrixXd all(rows_, columns.regressors.cols() + by.cols());
  all << columns.regressors, by;
  return all;
}

Model Projection::model_of(const Point& point, const Eigen::VectorXd& linear) const {
  Model model;
  model.sample_time_s = segments_.empty() ? 0.0 : segments_.front().h;
  model.loop.order = structure_.order;
  model.loop.denominator = point.denominator;
  for (int j = 0; j < structure_.order; ++j)
    model.loop.numerator[static_cast<std::size_t>(j)] = linear(j);
  for (std::size_t i = 0; i < structure_.effects.size(); ++i) {
    Effect effect;
    effect.kind = structure_.effects[i];
    const auto shape_count = shapes_of(effect.kind).size();
    for (std::size_t p = 0; p < shape_count; ++p)
      effect.shape[p] = point.shapes[shape_offset_[i] + p];
    for (std::size_t slot = 0; slot < slots_.size(); ++slot) {
      if (slots_[slot].effect == i) {
        effect.coefficient[slots_[slot].coefficient] =
            linear(structure_.order + static_cast<Eigen::Index>(slot));
      }
    }
    model.effects.push_back(effect);
  }
  Eigen::Index at = structure_.order + static_cast<Eigen::Index>(slots_.size());
  for (Mode mode : point.modes) {
    mode.alpha = linear(at++);
    mode.beta = linear(at++);
    model.loop.modes.push_back(mode);
  }
  return model;
}

}  // namespace servotwin
