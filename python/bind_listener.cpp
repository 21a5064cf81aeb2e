// The predictions of a running daemon, over DDS.
#include <cmath>
#include <memory>

#include "drivers/dds.h"
#include "python/bind.h"

namespace servotwin::python {
namespace {

namespace py = pybind11;

/// The subscriber of one machine. One thread.
class Listener {
 public:
  Listener(const std::string& machine, std::uint32_t domain, const std::string& partition)
      : node_(place_of(machine, domain, partition)),
        statuses_(node_),
        predictions_(std::make_unique<DdsReader<MachinePrediction>>(node_)) {}

  /// The next prediction as a dict; None where none comes in time.
  py::object next(double timeout_s) {
    MachinePrediction message;
    bool got = false;
    {
      const py::gil_scoped_release release;
      learn_axes();
      got = predictions_->receive(message, timeout_s);
    }
    if (!got) return py::none();
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
      axes[py::str(at < names_.size() ? names_[at] : std::to_string(i))] = axis;
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

  /// The names of the axes, in the order of the predictions, from the daemon's status.
  void learn_axes() {
    MachineStatus status;
    while (statuses_.receive(status, names_.empty() ? 1.5 : 0.0)) {
      if (status.axes.empty()) continue;
      names_.clear();
      for (const AxisStatus& axis : status.axes) names_.push_back(axis.name);
    }
  }

  DdsNode node_;
  DdsReader<MachineStatus> statuses_;
  std::unique_ptr<DdsReader<MachinePrediction>> predictions_;
  std::vector<std::string> names_;
};

}  // namespace

void bind_listener(py::module_& module) {
  py::class_<Listener>(module, "Listener", "Receives the predictions of a running daemon.")
      .def(py::init<const std::string&, std::uint32_t, const std::string&>(),
           py::arg("machine") = "machine", py::kw_only(), py::arg("domain") = 0,
           py::arg("partition") = "")
      .def("next", &Listener::next, py::arg("timeout_s") = 1.0,
           "The prediction of the next servo cycle; None where none comes in time.");
}

}  // namespace servotwin::python
