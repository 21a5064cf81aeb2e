/* See axis.h. */
#include "axis.h"

#include <math.h>
#include <string.h>

#include "axis_forces.h"
#include "two_masses.h"

double servotwin_delay_s(const AxisModel* model) {
  int count = 0;
  const EffectKind* kinds = servotwin_effects(&count);
  double delay = 0.0;
  for (int i = 0; i < model->effects; ++i) {
    if (kinds[model->effect[i].kind].acts == kDelaysCommand) delay += model->effect[i].shape[0];
  }
  return delay;
}

/* The motion at the end of a part, without the share of the force at that time. */
typedef struct {
  const AxisModel* model;
  const AxisStep* step;
  AxisState* state;
  Motion m;
  int rests; /* at the start: nothing moves, and an axis without integrator yields to the force */
  double command, give;
  double end_velocity;
  double position_free, velocity_free, demand_free, demand_given;
} End;

/* The difference between a force and the force at the motion that it causes. */
static double miss_at(void* of, double trial) {
  End* end = of;
  const AxisModel* model = end->model;
  const AxisStep* step = end->step;
  Motion* m = &end->m;
  if (end->rests) {
    m->tracking_error = end->give * trial;
    m->position = end->command - end->give * trial;
    m->demand = trial;
  } else {
    m->position = end->position_free - step->error_force_end * trial;
    m->velocity = end->velocity_free - step->rate_force_end * trial;
    m->displacement = m->position - end->state->position;
    m->tracking_error = end->command - m->position;
    m->demand = end->demand_free + end->demand_given * trial;
    m->acceleration = m->demand - trial;
    m->demand_rate =
        model->integral * m->tracking_error - model->integral_velocity * end->end_velocity;
    m->demand_damping = model->damping * (end->end_velocity - m->velocity);
  }
  return trial - servotwin_disturbance(model, end->state, m, kMotor);
}

/* The step of a part; in `own` if it is for this part only. It is not kept, so that restoring a
 * state needs nothing else. */
static const AxisStep* step_at(const AxisModel* model, double over, double at_end, AxisStep* own) {
  if (model->modes == 0) return &model->step;
  *own = model->step;
  servotwin_place_modes(model, over, at_end, own);
  return own;
}

void servotwin_start(const AxisModel* model, AxisState* state, double command, double time_s) {
  double give = 0.0; /* displacement of an axis without integrator by a unit force */
  AxisStep own;
  const AxisStep* step = step_at(model, command, command, &own);
  memset(state, 0, sizeof *state);
  state->time_s = time_s;
  state->slope = 1.0;
  servotwin_start_memories(model, state);
  for (int i = 0; i < kHistory; ++i) state->history[i] = command;
  if (model->masses.states > 0) {
    servotwin_start_two_masses(model, state, command);
    return;
  }
  End end;
  memset(&end, 0, sizeof end);
  end.model = model;
  end.step = step;
  end.state = state;
  end.rests = 1;
  end.command = command;
  if (model->order == 2) {
    for (int i = 0; i < model->states; ++i) give += step->row[i].error * step->row[i].rest;
  }
  end.give = give;
  end.m.step_s = model->cycle_s / model->parts;
  end.m.time_s = time_s;
  state->force = servotwin_balanced(0.0, &state->slope, miss_at, &end);
  servotwin_remember(model, state, kMotor);
  state->demand = state->force;
  double error = 0.0;
  for (int i = 0; i < model->states; ++i) {
    state->linear[i] = step->row[i].rest * state->force;
    error += step->row[i].error * state->linear[i];
  }
  state->position = command - (model->order == 2 ? error : 0.0);
  end.m.position = state->position;
  state->reading = servotwin_reading(model, state, &end.m);
}

/* One part of a cycle. */
static double advance(const AxisModel* model, AxisState* state, const CommandPiece* piece) {
  if (model->masses.states > 0) return servotwin_advance_two_masses(model, state, piece);
  const double h = model->cycle_s / model->parts;
  AxisStep own;
  const AxisStep* step = step_at(model, piece->end_position - 0.5 * h * piece->end_velocity,
                                 piece->end_position, &own);
  double next[kMaxStates] = {0};
  double error = 0.0, rate = 0.0, second = 0.0;
  for (int r = 0; r < model->states; ++r) {
    const AxisRow* row = &step->row[r];
    double sum = row->command[0] * piece->velocity + row->command[1] * piece->acceleration +
                 row->command[2] * piece->jerk + row->force_begin * state->force;
    for (int k = 0; k < row->width; ++k) sum += row->phi[k] * state->linear[row->first + k];
    next[r] = sum;
    error += row->error * sum;
    rate += row->rate * sum;
    second += row->second * sum;
  }
  rate += step->rate_velocity * piece->end_velocity;

  End end;
  memset(&end, 0, sizeof end);
  end.model = model;
  end.step = step;
  end.state = state;
  end.command = piece->end_position;
  end.end_velocity = piece->end_velocity;
  end.position_free = piece->end_position - error;
  end.velocity_free = piece->end_velocity - rate;
  /* The control demands x'' and the force. */
  end.demand_free = piece->end_acceleration - second - step->second_velocity * piece->end_velocity -
                    step->second_acceleration * piece->end_acceleration;
  end.demand_given = 1.0 - step->second_force - step->second_force_end;
  end.m.step_s = h;
  end.m.command_velocity = piece->end_velocity;
  end.m.command_acceleration = piece->end_acceleration;
  end.m.neighbour_acceleration = piece->neighbour_acceleration;
  end.m.in_cut = piece->in_cut;
  state->time_s += h;
  end.m.time_s = state->time_s;
  const double force =
      servotwin_balanced(state->force + state->force_change, &state->slope, miss_at, &end);
  servotwin_remember(model, state, kMotor);
  for (int r = 0; r < model->states; ++r)
    state->linear[r] = next[r] + step->row[r].force_end * force;
  state->force_change = force - state->force;
  state->force = force;
  state->position = end.m.position;
  state->velocity = end.m.velocity;
  state->demand = end.m.demand;
  state->reading = servotwin_reading(model, state, &end.m);
  return error + step->error_force_end * force - state->reading;
}

double servotwin_step(const AxisModel* model, AxisState* state, const CommandPiece* whole) {
  const double neighbour_before = state->neighbour_acceleration;
  CommandPiece part = *whole;
  state->neighbour_acceleration = whole->neighbour_acceleration;
  for (int i = 1; i < model->parts; ++i) {
    const double to_end = model->cycle_s / model->parts * (model->parts - i);
    part.end_acceleration = whole->end_acceleration - to_end * whole->jerk;
    part.end_velocity =
        whole->end_velocity - to_end * (whole->end_acceleration - to_end * whole->jerk / 2);
    part.end_position = whole->end_position -
                        to_end * (whole->end_velocity - to_end * (whole->end_acceleration / 2 -
                                                                  to_end * whole->jerk / 6));
    part.neighbour_acceleration =
        neighbour_before + (whole->neighbour_acceleration - neighbour_before) * i / model->parts;
    (void)advance(model, state, &part);
    part.velocity = part.end_velocity;
    part.acceleration = part.end_acceleration;
  }
  part.end_position = whole->end_position;
  part.end_velocity = whole->end_velocity;
  part.end_acceleration = whole->end_acceleration;
  part.neighbour_acceleration = whole->neighbour_acceleration;
  const double error = advance(model, state, &part);
  state->newest = (state->newest + 1) % kHistory;
  state->history[state->newest] = whole->end_position;
  return error;
}

double servotwin_follow(const AxisModel* model, AxisState* state, double command,
                        double neighbour_acceleration, double in_cut) {
  const double h = model->cycle_s;
  const double shift = servotwin_delay_s(model) / h;
  const int whole = (int)shift;
  const double t = shift - whole; /* the point searched for is t cycles before the whole one */
  /* The commands known at the end of this cycle, the newest first. */
  double past[8];
  const int first_known = whole > 0 ? whole - 1 : 0;
  for (int i = 0; i < 8; ++i) {
    const int back = first_known + i;
    past[i] =
        back == 0 ? command : state->history[(state->newest + 1 + kHistory - back) % kHistory];
  }
  double x[4];
  for (int i = 0; i < 4; ++i) {
    if (t == 0.0) {
      x[i] = past[whole + i - first_known];
      continue;
    }
    const int first = whole + i >= 1 ? whole + i - 1 : 0; /* newest of the four nodes */
    const double u = t + (double)(whole + i - first);     /* position counted back from it */
    const double* p = &past[first - first_known];
    x[i] = -p[0] * (u - 1) * (u - 2) * (u - 3) / 6 + p[1] * u * (u - 2) * (u - 3) / 2 -
           p[2] * u * (u - 1) * (u - 3) / 2 + p[3] * u * (u - 1) * (u - 2) / 6;
  }
  const double d1 = x[0] - x[1];
  const double d2 = x[0] - 2 * x[1] + x[2];
  const double d3 = x[0] - 3 * x[1] + 3 * x[2] - x[3];
  CommandPiece piece;
  piece.velocity = (d1 - d2 / 2 - d3 / 6) / h;
  piece.acceleration = d2 / (h * h);
  piece.jerk = d3 / (h * h * h);
  piece.end_position = x[0];
  piece.end_velocity = piece.velocity + h * (piece.acceleration + h * piece.jerk / 2);
  piece.end_acceleration = piece.acceleration + h * piece.jerk;
  piece.neighbour_acceleration = neighbour_acceleration;
  piece.in_cut = in_cut;
  const double error = servotwin_step(model, state, &piece) + (command - x[0]);
  state->history[state->newest] = command; /* not delayed */
  return error;
}
