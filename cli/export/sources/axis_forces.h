/* The forces on the bodies of an axis and their balance with its motion; used by axis.c and
 * two_masses.c. */
#ifndef SERVOTWIN_AXIS_FORCES_H
#define SERVOTWIN_AXIS_FORCES_H

#include "axis.h"

/* An axis of one body has the motor's only. */
typedef enum { kMotor, kLoad } Body;

/* Puts the memory of all effects before its first sample. */
void servotwin_start_memories(const AxisModel* model, AxisState* state);
/* Whether any force acts on this body. */
int servotwin_acts_on(const AxisModel* model, Body body);
/* Sums all forces on a body at this motion; the law of friction first, because effects that change
 * friction depend on it. The new memory of the effects is stored in `trial`. */
double servotwin_disturbance(const AxisModel* model, AxisState* state, Motion* m, Body body);
/* Accepts the memory that the last call for this body stored in `trial`. */
void servotwin_remember(const AxisModel* model, AxisState* state, Body body);
/* What effects on the reading add to the position. */
double servotwin_reading(const AxisModel* model, AxisState* state, const Motion* m);

/* The force at which `miss` is 0, searched for from `first`; the method is that of
 * twin/force_balance.h. */
double servotwin_balanced(double first, double* slope, double (*miss)(void* of, double trial),
                          void* of);
/* Seeks the two forces at which both misses are within the tolerance; 0 where that does not settle
   in a few trials. `inverse` of their slopes: as it was last, and as it is now. The last pair tried
   is the answer. */
int servotwin_balanced_pair(double motor, double load, double inverse[2][2], double tolerance,
                            void (*miss)(void* of, double motor, double load, double out[2]),
                            void* of);

#endif
