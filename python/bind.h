// The parts of the module servotwin._core, and what they share. Positions and errors are numpy
// arrays in m, or rad on a rotary axis; everything else is in SI units. An error of the libraries
// becomes RuntimeError (what failed, and what to do) or ValueError (an argument out of range).
// Functions that calculate release the interpreter's lock.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <chrono>
#include <functional>
#include <future>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "identification/least_squares/interruption.h"
#include "identification/model/model_file.h"
#include "identification/recording/segments.h"

namespace servotwin::python {

void bind_recording(pybind11::module_& module);
void bind_model(pybind11::module_& module);
void bind_diagnosis(pybind11::module_& module);
void bind_correction(pybind11::module_& module);
void bind_listener(pybind11::module_& module);

/// One axis of a recording, repaired and cut into segments.
struct Axis {
  SegmentedAxis segmented;                     ///< without a command: NaN in its place
  std::vector<std::string> notes;              ///< what was read, repaired or dropped
  bool commanded = true;                       ///< the recording has its command
  std::shared_ptr<const Recording> recording;  ///< that it is of

  /// With the command of the axis that this model needs beside it.
  [[nodiscard]] SegmentedAxis for_model(const ModelRecord& record) const;
  /// With the command of the axis that acts on it, of several other ones.
  [[nodiscard]] SegmentedAxis beside_acting() const;
};

/// A model with where it comes from.
struct ModelOfAxis {
  ModelRecord record;
};

/// The same values as dict, list, str, float, int, bool and None.
[[nodiscard]] pybind11::object object_of(const nlohmann::json& json);
/// JSON from the same, and from numpy's scalars. Throws std::invalid_argument with the place of a
/// value that is not one of these, or not finite.
[[nodiscard]] nlohmann::json json_of(const pybind11::handle& object);
[[nodiscard]] pybind11::object array_of(const Eigen::ArrayXd& values);
/// An axis by its name; the only one without. Throws std::runtime_error, pybind11::key_error.
[[nodiscard]] Axis axis_of(const Recording& recording, const std::optional<std::string>& name);
/// The name of the recording as model files have it: without folders.
[[nodiscard]] std::string file_name(const Axis& axis);
/// "2026-11-27T08:15:00Z".
[[nodiscard]] std::string now_utc();
/// Throws std::invalid_argument where the longest delay is not 0 to 0.05 s.
void require_delay(double delay_max_s);
/// The model for data with this sampling time. Throws std::runtime_error if it cannot run at it.
[[nodiscard]] Model model_at(const ModelRecord& record, double sample_time_s);

/// The value of a name. Throws std::invalid_argument with the names that are known.
template <class Value>
Value one_of(const std::map<std::string, Value>& known, const std::string& given,
             const std::string& what) {
  if (const auto found = known.find(given); found != known.end()) return found->second;
  std::string names;
  for (const auto& [name, value] : known) names += (names.empty() ? "" : ", ") + name;
  throw std::invalid_argument(what + " '" + given + "' is not known; choose one of " + names);
}

/// Runs work without the interpreter's lock; Ctrl-C interrupts it (interruption.h).
template <class Work>
auto interruptible(const Work& work) {
  std::stop_source stop;
  auto result = std::async(std::launch::async, [&] {
    const Interruptible until(stop.get_token());
    return work();
  });
  while (true) {
    {
      const pybind11::gil_scoped_release release;
      if (result.wait_for(std::chrono::milliseconds(100)) == std::future_status::ready) break;
    }
    if (PyErr_CheckSignals() == 0) continue;
    stop.request_stop();
    {
      const pybind11::gil_scoped_release release;
      result.wait();
    }
    throw pybind11::error_already_set();
  }
  return result.get();
}

}  // namespace servotwin::python
