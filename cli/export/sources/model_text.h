/* Reads resources/model.txt of a unit: the numbers of its model.
 *
 * Lines of words: a name, and its numbers. Numbers are a whole number in hexadecimal times a power
 * of two, 0x1999999999999ap-56 for 0.1: exact, and the same in every locale. The names are listed
 * in docs/files.md. Any thread. */
#ifndef SERVOTWIN_MODEL_TEXT_H
#define SERVOTWIN_MODEL_TEXT_H

#include "axis.h"

enum { kUnitText = 128, kMessage = 512 };

/* A parameter of an effect: its name in the model file, and its bounds. */
typedef struct {
  char name[64];
  double lower, upper;
} Bounds;

typedef struct {
  char guid[kUnitText];
  AxisModel model;
  Bounds shape[kMaxEffects][kMaxShapes], coefficient[kMaxEffects][kMaxCoefficients];
} UnitModel;

/* Returns 1 if the text could be read; else 0, with the reason in `why` (kMessage characters). */
int servotwin_read_model(const char* file, UnitModel* unit, char* why);

#endif
