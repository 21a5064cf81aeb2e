// A cause plotted over the variable that it depends on: measured, simulated without it and
// simulated with it.
//
// Forces are reconstructed from the tracking error through the model of the loop,
//
//   P(s) e = s d  (order 3),   P(s) e = d  (order 2)
//   d_X = F + L^-1 (e_X - e_with),   X: measured, without,   d_with = F
//
// where F is the force of the effect itself along the simulated motion (the sum of all friction
// where the cause is one of friction), and L^-1 acts on a zero-phase low-pass filtered error. The
// integral forgets with a time constant of one second, so that it does not drift. Effects on the
// encoder reading are plotted as lengths, a delay as the tracking error itself, and changes over
// time as the error over time.
//
// Points are means over bins. Their bars are 95 % confidence intervals from the scatter between
// separate visits to a bin. Absolute scales, units on the axes. Any thread.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/report/plot.h"
#include "diagnosis/search/diagnose.h"
#include "twin/sample.h"

namespace servotwin {

struct CausePicture {
  std::vector<PlotPanel> panels;  ///< empty: there is no plot for this cause
  std::string caption;            ///< what the plot shows
};

/// `segments`: the recording that was diagnosed.
[[nodiscard]] CausePicture picture_of(const Diagnosis& diagnosis, const Cause& cause,
                                      const std::vector<Segment>& segments);

}  // namespace servotwin
