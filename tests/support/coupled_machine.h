// Two axes that push each other: the table of each feels a mass times the acceleration of the
// other's table, the same one both ways, as where one carries the other on guides that are not
// square (tests/hidden_effects/rig.h).
#pragma once

#include <algorithm>
#include <array>
#include <complex>
#include <stdexcept>
#include <utility>
#include <vector>

#include "identification/recording/segments.h"
#include "tests/hidden_effects/motion.h"
#include "tests/hidden_effects/rig.h"
#include "tests/support/closed_loop.h"
#include "tests/support/two_masses.h"

namespace servotwin::test {

struct CoupledMachine {
  std::array<hidden_effects::Rig, 2> axes;
  double common_mass = 0.0;  ///< [kg]
};

/// By turns, until neither axis changes what the other does. Every turn adds one more way back and
/// forth; at the frequency of a mode it is four times smaller than the one before, not more.
inline std::array<hidden_effects::Trace, 2> simulate(
    CoupledMachine machine, const std::array<hidden_effects::Command, 2>& commands) {
  constexpr int kTurns = 16;
  std::array<hidden_effects::Trace, 2> traces;
  for (int turn = 0; turn < kTurns; ++turn) {
    for (std::size_t i = 0; i < 2; ++i) {
      const std::vector<double>& other = traces[1 - i].acceleration;
      std::vector<double>& force = machine.axes[i].external_force;
      force.resize(other.size());
      for (std::size_t k = 0; k < other.size(); ++k) force[k] = machine.common_mass * other[k];
      traces[i] = hidden_effects::simulate(machine.axes[i], commands[i]);
    }
  }
  return traces;
}

/// What a controller writes down of it: X and Y, each with the other's command beside it.
inline std::array<SegmentedAxis, 2> recorded(
    const CoupledMachine& machine, const std::array<hidden_effects::Command, 2>& commands) {
  const auto traces = simulate(machine, commands);
  const auto array = [](const std::vector<double>& v) {
    return Eigen::Map<const Eigen::ArrayXd>(v.data(), static_cast<Eigen::Index>(v.size())).eval();
  };
  if (traces[0].command.size() != traces[1].command.size())
    throw std::invalid_argument("two axes of one machine move for the same time");
  std::array<SegmentedAxis, 2> out;
  for (std::size_t i = 0; i < 2; ++i) {
    Segment segment;
    segment.sample_time_s = machine.axes[i].reading.sample_time;
    segment.command = array(traces[i].command);
    segment.actual = array(traces[i].actual);
    segment.neighbour = array(traces[1 - i].command);
    segment.in_plane = true;
    out[i].axis = i == 0 ? "X" : "Y";
    out[i].sample_time_s = segment.sample_time_s;
    out[i].segments = {std::move(segment)};
  }
  return out;
}

/// The modes of X and Y as the machine has them together [rad/s]; 0 where the axis is one body.
inline std::array<std::complex<double>, 2> modes_of(const CoupledMachine& machine) {
  const auto poles =
      closed_loop_poles({machine.axes.begin(), machine.axes.end()}, machine.common_mass);
  std::array<std::complex<double>, 2> out;
  for (std::size_t i = 0; i < 2; ++i) {
    const std::complex<double> alone = mode_of(machine.axes[i]);
    if (alone == 0.0) continue;
    out[i] = *std::min_element(poles.begin(), poles.end(), [&](const auto& l, const auto& r) {
      return std::abs(l - alone) < std::abs(r - alone);
    });
  }
  return out;
}

/// X of two masses, Y of two with a spring of this frequency [Hz], or of one body with 0; each
/// feels 4 kg times the other's acceleration.
inline CoupledMachine coupled_machine(double spring_frequency_hz) {
  constexpr auto kMaxwell = hidden_effects::Friction::Family::kMaxwell;
  CoupledMachine out{{two_masses(kMaxwell, 150.0, 0.0), two_masses(kMaxwell, 90.0, 0.0)}, 4.0};
  hidden_effects::Rig& y = out.axes[1];
  y.body.spring_frequency_hz = spring_frequency_hz;
  y.drive.position_gain = 33.0;
  y.reading.noise_seed = 2;
  return out;
}

/// Production, of each axis its own.
inline std::array<hidden_effects::Command, 2> production_of_both(double seconds = 20.0) {
  std::array<hidden_effects::Command, 2> out;
  for (std::size_t i = 0; i < 2; ++i) {
    hidden_effects::Motion motion;
    motion.duration = seconds;
    motion.limits = {0.25, 5.0, 200.0};
    hidden_effects::Random random(7 + i);
    out[i] = hidden_effects::motion_of(motion, random);
  }
  const double end = std::max(out[0].duration(), out[1].duration());
  for (hidden_effects::Command& command : out) {
    if (command.duration() < end) command.dwell(end - command.duration());
  }
  return out;
}

}  // namespace servotwin::test
