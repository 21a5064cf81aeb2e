/* See model_text.h. */
#include "model_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { kLine = 1024 };

/* The next word of a line, or NULL; `rest` is moved behind it. */
static char* next_word(char** rest) {
  char* word = *rest + strspn(*rest, " \t\r\n");
  if (*word == '\0') return NULL;
  *rest = word + strcspn(word, " \t\r\n");
  if (**rest != '\0') *(*rest)++ = '\0';
  return word;
}

static int next_number(char** rest, double* value) {
  const char* word = next_word(rest);
  char* end = NULL;
  if (word == NULL) return 0;
  *value = strtod(word, &end);
  return *end == '\0' && *value - *value == 0.0;
}

static int next_count(char** rest, int* value, int least, int most) {
  double number = 0.0;
  if (!next_number(rest, &number) || number < least || number > most) return 0;
  *value = (int)number;
  return *value == number;
}

static int next_text(char** rest, char* text, size_t size) {
  const char* word = next_word(rest);
  if (word == NULL || strlen(word) >= size) return 0;
  memcpy(text, word, strlen(word) + 1);
  return 1;
}

static int next_numbers(char** rest, double* value, int count) {
  for (int i = 0; i < count; ++i) {
    if (!next_number(rest, &value[i])) return 0;
  }
  return 1;
}

static int next_row(char** rest, AxisRow* row, int states) {
  return next_count(rest, &row->first, 0, states - 1) &&
         next_count(rest, &row->width, 1, kMaxOrder) && row->first + row->width <= states &&
         next_numbers(rest, row->phi, kMaxOrder) && next_numbers(rest, row->command, 3) &&
         next_number(rest, &row->force_begin) && next_number(rest, &row->force_end) &&
         next_number(rest, &row->rest) && next_number(rest, &row->error) &&
         next_number(rest, &row->rate) && next_number(rest, &row->second);
}

/* The loop without its moving modes, whose lines follow. */
static int next_moving(char** rest, AxisModel* m) {
  return next_count(rest, &m->modes, 1, kMaxModes) && 2 * m->order + 2 * m->modes == m->states &&
         next_numbers(rest, m->denominator, kMaxOrder) &&
         next_numbers(rest, m->numerator, kMaxOrder) && next_numbers(rest, m->travel, 2);
}

static int next_mode(char** rest, AxisMode* mode) {
  return next_number(rest, &mode->omega) && next_number(rest, &mode->zeta) &&
         next_number(rest, &mode->alpha) && next_number(rest, &mode->beta) &&
         next_number(rest, &mode->gamma) && next_number(rest, &mode->delta) &&
         next_number(rest, &mode->slope) && next_number(rest, &mode->curve) &&
         next_number(rest, &mode->zeta_slope);
}

/* Motor and load as two masses, whose states follow. */
static int next_masses(char** rest, AxisModel* m) {
  AxisMasses* two = &m->masses;
  two->states = m->order + 2;
  return next_count(rest, &two->encoders, 0, 2) && next_number(rest, &two->omega) &&
         next_number(rest, &two->zeta) && next_number(rest, &two->load_share) &&
         next_number(rest, &two->friction_share) && next_number(rest, &two->width) &&
         next_number(rest, &two->a1) && next_number(rest, &two->a2) &&
         next_number(rest, &two->by_loop) && next_number(rest, &two->by_motor) &&
         next_number(rest, &two->command_velocity) && next_number(rest, &two->command_acceleration);
}

static int next_mass_state(char** rest, AxisMasses* two, int at) {
  return next_numbers(rest, two->phi[at], kMassStates) && next_numbers(rest, two->command[at], 3) &&
         next_number(rest, &two->motor_begin[at]) && next_number(rest, &two->motor_end[at]) &&
         next_number(rest, &two->load_begin[at]) && next_number(rest, &two->load_end[at]);
}

/* The state of the reader: the names follow in a fixed order. */
typedef struct {
  int place;                 /* index in kNames */
  int shape, coefficient;    /* of the last effect, read so far */
  int states, modes, masses; /* read so far */
  int ended;
} Reader;

static const char* const kNames[] = {"servotwin_unit", "guid",   "cycle_s",  "parts", "order",
                                     "integral",       "direct", "by_force", "states"};
enum { kNameCount = sizeof kNames / sizeof kNames[0] };

static const EffectKind* last_kind(const AxisModel* m) {
  int count = 0;
  return m->effects > 0 ? &servotwin_effects(&count)[m->effect[m->effects - 1].kind] : NULL;
}

static int effect_is_whole(const Reader* reader, const AxisModel* m) {
  const EffectKind* kind = last_kind(m);
  return kind == NULL ||
         (reader->shape == kind->shapes && reader->coefficient == kind->coefficients);
}

static int read_effect_line(Reader* reader, const char* name, char** rest, UnitModel* unit) {
  AxisModel* m = &unit->model;
  const int last = m->effects - 1;
  if (strcmp(name, "effect") == 0) {
    const char* id = next_word(rest);
    if (id == NULL || m->effects == kMaxEffects || !effect_is_whole(reader, m)) return 0;
    m->effect[m->effects].kind = servotwin_find_effect(id);
    if (m->effect[m->effects].kind < 0) return 0;
    m->effects += 1;
    reader->shape = reader->coefficient = 0;
    return 1;
  }
  const int is_shape = strcmp(name, "shape") == 0;
  if (last < 0 || (!is_shape && strcmp(name, "coefficient") != 0)) return 0;
  const EffectKind* kind = last_kind(m);
  int* place = is_shape ? &reader->shape : &reader->coefficient;
  if (*place == (is_shape ? kind->shapes : kind->coefficients)) return 0;
  Bounds* bounds = is_shape ? &unit->shape[last][*place] : &unit->coefficient[last][*place];
  double* value = is_shape ? &m->effect[last].shape[*place] : &m->effect[last].coefficient[*place];
  *place += 1;
  return next_text(rest, bounds->name, sizeof bounds->name) && next_number(rest, value) &&
         next_number(rest, &bounds->lower) && next_number(rest, &bounds->upper);
}

static int read_words(Reader* reader, const char* name, char** rest, UnitModel* unit) {
  AxisModel* m = &unit->model;
  int format = 0;
  if (reader->ended) return 0;
  if (reader->place == kNameCount && reader->states < m->states) {
    if (strcmp(name, "state") != 0) return 0;
    return next_row(rest, &m->step.row[reader->states++], m->states);
  }
  if (reader->place == kNameCount && reader->modes < m->modes) {
    if (strcmp(name, "mode") != 0) return 0;
    return next_mode(rest, &m->mode[reader->modes++]);
  }
  if (reader->place == kNameCount && reader->masses < m->masses.states) {
    if (strcmp(name, "mass_state") != 0) return 0;
    return next_mass_state(rest, &m->masses, reader->masses++);
  }
  if (reader->place == kNameCount && m->modes == 0 && m->masses.states == 0 && m->effects == 0 &&
      strcmp(name, "two_masses") == 0)
    return next_masses(rest, m);
  if (reader->place == kNameCount && m->modes == 0 && m->effects == 0 &&
      strcmp(name, "moving_modes") == 0)
    return next_moving(rest, m);
  if (reader->place == kNameCount) {
    if (strcmp(name, "end") != 0) return read_effect_line(reader, name, rest, unit);
    reader->ended = effect_is_whole(reader, m);
    return reader->ended;
  }
  if (strcmp(name, kNames[reader->place]) != 0) return 0;
  switch (reader->place++) {
    case 0:
      return next_count(rest, &format, 1, 1);
    case 1:
      return next_text(rest, unit->guid, sizeof unit->guid);
    case 2:
      return next_number(rest, &m->cycle_s) && m->cycle_s > 0.0;
    case 3:
      return next_count(rest, &m->parts, 1, 1000000);
    case 4:
      return next_count(rest, &m->order, 2, kMaxOrder);
    case 5:
      return next_number(rest, &m->damping) && next_number(rest, &m->integral) &&
             next_number(rest, &m->integral_velocity);
    case 6:
      return next_number(rest, &m->step.rate_velocity) &&
             next_number(rest, &m->step.second_velocity) &&
             next_number(rest, &m->step.second_acceleration) &&
             next_number(rest, &m->step.second_force);
    case 7:
      return next_number(rest, &m->step.error_force_end) &&
             next_number(rest, &m->step.rate_force_end) &&
             next_number(rest, &m->step.second_force_end);
    default:
      return next_count(rest, &m->states, 2 * m->order, kMaxStates);
  }
}

static int read_line(Reader* reader, char* line, UnitModel* unit) {
  const char* name = next_word(&line);
  if (name == NULL || *name == '#') return 1;
  return read_words(reader, name, &line, unit) && next_word(&line) == NULL;
}

int servotwin_read_model(const char* file, UnitModel* unit, char* why) {
  char line[kLine];
  Reader reader = {0, 0, 0, 0, 0, 0, 0};
  FILE* in = fopen(file, "r");
  memset(unit, 0, sizeof *unit);
  if (in == NULL) {
    snprintf(why, kMessage, "%.400s cannot be read", file);
    return 0;
  }
  int fine = 1;
  for (int number = 1; fine && fgets(line, sizeof line, in) != NULL; ++number) {
    fine = read_line(&reader, line, unit);
    if (!fine) {
      snprintf(why, kMessage, "%.400s, line %d: not the line that this unit expects here", file,
               number);
    }
  }
  fclose(in);
  if (fine && !reader.ended) {
    snprintf(why, kMessage, "%.400s is incomplete", file);
    fine = 0;
  }
  return fine;
}
