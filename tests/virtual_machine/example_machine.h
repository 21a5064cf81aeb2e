// The machine and the program behind examples/axis_production.csv: two ball-screw axes with unlike
// loops and unlike friction, running the same part twice. examples/README.md states every number
// for people; a test holds the shipped file against this source.
#pragma once

#include <ostream>

#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"

namespace servotwin::virtual_machine {

/// X: P-PI control without feed-forward, GMS friction of constant level.
[[nodiscard]] Axis example_x_axis();
/// Y: slower P-PI control with half of the velocity fed forward, LuGre friction.
[[nodiscard]] Axis example_y_axis();

/// Circles, a pocket, a diamond, drilling moves, slow reversals, dwells and rapids; the second part
/// runs slower and mirrored.
[[nodiscard]] PlanePath example_program();

/// Writes the shipped recording.
void write_example(std::ostream& out);

}  // namespace servotwin::virtual_machine
