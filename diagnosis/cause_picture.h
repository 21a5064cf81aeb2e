// A cause drawn over what it depends on: measured, simulated without it, simulated with it.
//
// What the tracking error says about a force is got back from it through the loop,
//
//   P(s) e = s d  (order 3),   P(s) e = d  (order 2)
//   d_X = F + L^-1 (e_X - e_with),   X: measured, without,   d_with = F
//
// where F is the force of the effect itself (of all friction together where the cause is one of
// friction) along the simulated motion, and L^-1 is taken behind a low-pass without phase. What the
// integrator has made of it longer than a second ago is left out. Effects on the reading are drawn
// as lengths, a delay as the tracking error itself, changes in time as the error over time.
//
// Points are means of bins with 95 % bars from the scatter of separate visits to a bin. Absolute
// scales, units on the axes. Any thread.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/diagnose.h"
#include "diagnosis/plot.h"
#include "twin/sample.h"

namespace servotwin {

struct CausePicture {
  std::vector<PlotPanel> panels;  ///< none: the cause has no picture
  std::string caption;            ///< what is seen
};

/// `segments`: the recording that was diagnosed.
[[nodiscard]] CausePicture picture_of(const Diagnosis& diagnosis, const Cause& cause,
                                      const std::vector<Segment>& segments);

}  // namespace servotwin
