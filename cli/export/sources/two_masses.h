/* An axis of two masses: a translation of twin/two_mass_axis.cpp and twin/two_mass_step.cpp. */
#ifndef SERVOTWIN_TWO_MASSES_H
#define SERVOTWIN_TWO_MASSES_H

#include "axis.h"

/* Puts both masses at rest at this command; the memories are those before the first sample. */
void servotwin_start_two_masses(const AxisModel* model, AxisState* state, double command);
/* One part of a cycle; returns the tracking error at its end. */
double servotwin_advance_two_masses(const AxisModel* model, AxisState* state,
                                    const CommandPiece* piece);

#endif
