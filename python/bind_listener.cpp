// The predictions of a running daemon, over DDS.
#include <algorithm>
#include <chrono>
#include <mutex>

#include "drivers/dds/dds.h"
#include "python/bind.h"

namespace servotwin::python {
namespace {

namespace py = pybind11;

/// The subscriber of one machine. Any thread, one after the other.
class Listener {
 public:
  Listener(const std::string& machine, std::uint32_t domain, const std::string& partition)
      : node_(place_of(machine, domain, partition)), statuses_(node_), predictions_(node_) {}

  /// The next prediction as a dict; None where none comes in time.
  py::object next(double timeout_s) {
    if (!(timeout_s >= 0.0 && timeout_s <= kLongest_s))
      throw std::invalid_argument("timeout_s " + std::to_string(timeout_s) +
                                  " is not 0 to 86400 (a day)");
    using Clock = std::chrono::steady_clock;
    const auto end = Clock::now() + std::chrono::duration<double>(timeout_s);
    MachinePrediction message;
    while (true) {
      const double left_s = std::chrono::duration<double>(end - Clock::now()).count();
      if (got(message, std::clamp(left_s, 0.0, kSlice_s))) break;
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      if (!(left_s > 0.0)) return py::none();
    }
    py::dict out, axes;
    for (int i = 0; i < message.axis_count; ++i) {
      const AxisPrediction& one = message.axes[static_cast<std::size_t>(i)];
      const auto at = static_cast<std::size_t>(i);
      py::dict axis;
      axis["predicted_error"] = one.predicted_error;
      axis["measured_error"] = one.measured_error;
      axis["residual"] = one.residual;
      axis["standard_deviation"] = one.standard_deviation;
      axis["model_version"] = one.model_version;
      axes[py::str(names_[at])] = axis;
    }
    out["sequence"] = message.sequence;
    out["time_ns"] = message.time_ns;
    out["contour_error"] = message.contour_error;
    out["measured_contour_error"] = message.measured_contour_error;
    out["axes"] = axes;
    return out;
  }

 private:
  static DdsPlace place_of(const std::string& machine, std::uint32_t domain,
                           const std::string& partition) {
    DdsPlace place;
    place.machine = machine;
    place.domain = domain;
    place.partition = partition;
    return place;
  }

  /// Whether a prediction came in time whose axes are known by name.
  bool got(MachinePrediction& message, double timeout_s) {
    const py::gil_scoped_release release;
    const std::scoped_lock lock(mutex_);
    // In the order of the predictions, from the daemon's status.
    for (MachineStatus status; statuses_.receive(status, 0.0);) {
      if (status.axes.empty()) continue;
      names_.clear();
      for (const AxisStatus& axis : status.axes) names_.push_back(axis.name);
    }
    return predictions_.receive(message, timeout_s) &&
           names_.size() == static_cast<std::size_t>(message.axis_count);
  }

  static constexpr double kSlice_s = 0.1;  // between looks for an interrupt
  static constexpr double kLongest_s = 86400.0;

  std::mutex mutex_;
  DdsNode node_;
  DdsReader<MachineStatus> statuses_;
  DdsReader<MachinePrediction> predictions_;
  std::vector<std::string> names_;
};

}  // namespace

void bind_listener(py::module_& module) {
  py::class_<Listener>(module, "Listener", "Receives the predictions of a running daemon.")
      .def(py::init<const std::string&, std::uint32_t, const std::string&>(),
           py::arg("machine") = "machine", py::kw_only(), py::arg("domain") = 0,
           py::arg("partition") = "")
      .def("next", &Listener::next, py::arg("timeout_s") = 1.0,
           "The prediction of the next servo cycle, once the daemon has told the names of its axes "
           "(every second); None where none comes in time.");
}

}  // namespace servotwin::python
