// Models: identified, read, written, simulated and compared with recordings.
#include <pybind11/eigen.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>

#include "identification/loop/identified_file.h"
#include "identification/loop/identify.h"
#include "identification/loop/joint.h"
#include "identification/recording/excerpt.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/noise_floor.h"
#include "python/bind.h"
#include "twin/twin.h"

namespace servotwin::python {
namespace {

namespace py = pybind11;

IdentifyOptions options_of(const std::string& method, const std::optional<std::string>& friction,
                           const std::string& structure, int order, int modes, bool coupling,
                           double delay_max_s, std::optional<double> training_share) {
  IdentifyOptions out;
  out.method = one_of<Method>({{"joint", Method::kJoint},
                               {"pole-search", Method::kPoleSearch},
                               {"full-ls", Method::kFullLs}},
                              method, "method");
  out.masses = one_of<Masses>(
      {{"rigid", Masses::kRigid}, {"two-mass", Masses::kTwo}, {"auto", Masses::kChosen}}, structure,
      "structure");
  if (friction) {
    std::map<std::string, std::size_t> laws;
    for (const std::size_t kind : friction_kinds()) laws[std::string(identity_of(kind).id)] = kind;
    out.friction = one_of(laws, *friction, "friction");
  }
  if (out.method != Method::kJoint && (out.friction || out.masses != Masses::kRigid))
    throw std::invalid_argument("friction and structure need the method joint");
  if (out.masses != Masses::kRigid && modes > 0)
    throw std::invalid_argument("structure '" + structure +
                                "' takes no modes: a mode stands for the same vibration");
  if (out.method == Method::kFullLs && (modes > 0 || coupling))
    throw std::invalid_argument(
        "full-ls models one loop and Coulomb friction only: it takes neither modes nor coupling");
  if (modes < 0 || modes > static_cast<int>(kMaxModes))
    throw std::invalid_argument("modes " + std::to_string(modes) + " is not 0 to " +
                                std::to_string(kMaxModes));
  require_delay(delay_max_s);
  if (order != 0 && order != 2 && order != 3)
    throw std::invalid_argument("order " + std::to_string(order) +
                                " is not 2, 3, or 0 for the one that predicts best");
  out.order = order;
  out.modes = modes;
  out.coupling = coupling;
  out.delay_max_s = delay_max_s;
  out.training_share = training_share;
  return out;
}

Identified identified(const Axis& axis, const IdentifyOptions& options, bool whole) {
  SegmentedAxis used = options.coupling ? axis.beside_acting() : axis.segmented;
  if (!whole) used.segments = excerpt(used.segments);
  const auto start = std::chrono::steady_clock::now();
  Identified out = identify(used, options);
  out.record.time_taken_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  out.record.motion = motion_range(used.segments);
  out.record.created = now_utc();
  out.record.source = file_name(axis);
  return out;
}

/// A model and a recording, segment by segment.
struct Prediction {
  struct Part {
    Segment segment;
    Eigen::ArrayXd predicted;  ///< the tracking error in free simulation
    ErrorFigures figures;
  };
  std::string axis;
  bool rotary = false;
  std::vector<Part> parts;
  ErrorFigures all;
  RmsEstimate noise_floor;
};

Prediction predicted(const ModelOfAxis& model, const Axis& axis) {
  const SegmentedAxis of = axis.for_model(model.record);
  if (model.record.rotary != of.rotary)
    throw std::invalid_argument(std::string("the model is of a ") +
                                (model.record.rotary ? "rotary" : "linear") + " axis, " + of.axis +
                                " of " + of.source + " is " + (of.rotary ? "rotary" : "linear"));
  if (of.segments.front().actual.size() == 0)
    throw std::invalid_argument(of.source + ": " + of.axis +
                                ".actual has no values to compare with; simulate() needs none");
  if (!axis.commanded)
    throw std::invalid_argument(of.source + ": " + of.axis +
                                ".command has no values: nothing to predict from");
  const Model at = model_at(model.record, of.sample_time_s);
  Prediction out;
  out.axis = of.axis;
  out.rotary = of.rotary;
  out.all = judge(at, of.segments);
  if (!std::isfinite(out.all.rms))
    throw std::runtime_error(of.source + ": no segment of " + of.axis + " is longer than the " +
                             std::to_string(starting_state_s(at)) +
                             " s that the starting state is estimated from");
  for (const Segment& s : of.segments) out.parts.push_back({s, simulate(at, s), judge(at, {s})});
  out.noise_floor = noise_floor(of.segments);
  return out;
}

/// The tracking error of an axis that starts at rest on its command.
Eigen::ArrayXd simulated(const ModelOfAxis& model, const Eigen::ArrayXd& command,
                         const std::optional<Eigen::VectorXd>& neighbour, double sample_time_s) {
  if (command.size() == 0) throw std::invalid_argument("the command has no values");
  if (!command.isFinite().all())
    throw std::invalid_argument("the command has values that are not finite");
  if (!(sample_time_s > 0.0)) throw std::invalid_argument("sample_time_s must be positive");
  const bool coupled = coupling_of(model.record.model) != nullptr;
  if (coupled && !neighbour)
    throw std::invalid_argument(
        "the model contains the acceleration of " +
        (model.record.neighbour.empty() ? "another axis" : "axis " + model.record.neighbour) +
        ": give its " + (coupled_by_motion(model.record.model) ? "motion" : "command") +
        " as neighbour");
  if (neighbour && (neighbour->size() != command.size() || !neighbour->allFinite()))
    throw std::invalid_argument("neighbour must have as many values as the command, all finite");
  Segment segment;
  segment.sample_time_s = sample_time_s;
  if (coupled) segment.neighbour = neighbour->array();
  segment.command = command;
  return simulate(model_at(model.record, sample_time_s), segment);
}

/// Completely or not at all.
void save(const ModelOfAxis& model, const std::filesystem::path& file) {
  const std::filesystem::path part = file.string() + ".part";
  const auto refuse = [&] {
    const int error = errno;
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
    throw std::runtime_error(file.string() + ": cannot be written: " + std::strerror(error));
  };
  std::ofstream out(part, std::ios::binary);
  if (!out) refuse();
  out << to_json(model.record).dump(2) << '\n';
  out.close();
  if (!out || std::rename(part.c_str(), file.c_str()) != 0) refuse();
}

template <class Of>
py::object joined(const Prediction& prediction, const Of& of) {
  Eigen::Index size = 0, at = 0;
  for (const Prediction::Part& part : prediction.parts) size += part.predicted.size();
  Eigen::ArrayXd out(size);
  for (const Prediction::Part& part : prediction.parts) {
    out.segment(at, part.predicted.size()) = of(part);
    at += part.predicted.size();
  }
  return array_of(out);
}

Eigen::ArrayXd error_of(const Prediction::Part& part) {
  return part.segment.command - part.segment.actual;
}

}  // namespace

void bind_model(py::module_& module) {
  py::class_<Prediction::Part>(module, "PredictedSegment")
      .def_readonly("segment", &Prediction::Part::segment)
      .def_property_readonly("predicted_error",
                             [](const Prediction::Part& p) { return array_of(p.predicted); })
      .def_property_readonly("measured_error",
                             [](const Prediction::Part& p) { return array_of(error_of(p)); })
      .def_property_readonly("rms", [](const Prediction::Part& p) { return p.figures.rms; })
      .def_property_readonly("max", [](const Prediction::Part& p) { return p.figures.max; });

  py::class_<Prediction>(module, "Prediction", "The tracking error, predicted and measured.")
      .def_property_readonly(
          "rms", [](const Prediction& p) { return p.all.rms; },
          "Of measured minus predicted [m | rad], without the samples that the starting state is "
          "estimated from.")
      .def_readonly("axis", &Prediction::axis)
      .def_readonly("rotary", &Prediction::rotary)
      .def_property_readonly("unit", [](const Prediction& p) { return p.rotary ? "rad" : "m"; })
      .def("__repr__",
           [](const Prediction& p) {
             return "<servotwin.Prediction of axis " + p.axis + ", " +
                    std::to_string(p.parts.size()) +
                    (p.parts.size() == 1 ? " segment>" : " segments>");
           })
      .def_property_readonly("max", [](const Prediction& p) { return p.all.max; })
      .def_property_readonly("noise_floor_rms",
                             [](const Prediction& p) { return p.noise_floor.rms; })
      .def_property_readonly(
          "noise_floor_interval",
          [](const Prediction& p) { return std::pair(p.noise_floor.low, p.noise_floor.high); })
      .def_property_readonly(
          "segments",
          [](const Prediction& p) -> const std::vector<Prediction::Part>& { return p.parts; },
          py::return_value_policy::reference_internal)
      .def_property_readonly("time",
                             [](const Prediction& p) {
                               return joined(p, [](const Prediction::Part& part) {
                                 Eigen::ArrayXd out(part.segment.size());
                                 for (Eigen::Index i = 0; i < out.size(); ++i)
                                   out(i) = part.segment.start_s +
                                            part.segment.sample_time_s * static_cast<double>(i);
                                 return out;
                               });
                             })
      .def_property_readonly("predicted_error",
                             [](const Prediction& p) {
                               return joined(p, [](const auto& part) { return part.predicted; });
                             })
      .def_property_readonly("measured_error",
                             [](const Prediction& p) { return joined(p, error_of); })
      .def_property_readonly("residual", [](const Prediction& p) {
        return joined(
            p, [](const auto& part) -> Eigen::ArrayXd { return error_of(part) - part.predicted; });
      });

  py::class_<ModelOfAxis>(module, "Model", "The model of an axis, and where it comes from.")
      .def_static(
          "load", [](const std::filesystem::path& file) { return ModelOfAxis{read_model(file)}; },
          py::arg("file"), "Reads a model file (servotwin.model/1).")
      .def_static(
          "from_dict", [](const py::dict& d) { return ModelOfAxis{model_from_json(json_of(d))}; },
          py::arg("values"))
      .def("save", &save, py::arg("file"),
           "Writes the model file that the tool and the daemon read.")
      .def(
          "to_dict", [](const ModelOfAxis& m) { return object_of(to_json(m.record)); },
          "The content of the model file.")
      .def_property_readonly("axis", [](const ModelOfAxis& m) { return m.record.axis; })
      .def_property_readonly("rotary", [](const ModelOfAxis& m) { return m.record.rotary; })
      .def_property_readonly("sample_time_s",
                             [](const ModelOfAxis& m) { return m.record.model.sample_time_s; })
      .def_property_readonly("settling_time_s",
                             [](const ModelOfAxis& m) { return starting_state_s(m.record.model); })
      .def(py::pickle([](const ModelOfAxis& m) { return py::dict(object_of(to_json(m.record))); },
                      [](const py::dict& d) { return ModelOfAxis{model_from_json(json_of(d))}; }))
      .def(
          "predict",
          [](const ModelOfAxis& m, const Recording& recording) {
            const Axis axis = axis_of(recording, std::nullopt);
            const py::gil_scoped_release release;
            return predicted(m, axis);
          },
          py::arg("recording"), "The same with a recording of one axis.")
      .def("predict", &predicted, py::arg("axis"), py::call_guard<py::gil_scoped_release>(),
           "Compares the model with a recorded axis, in free simulation from the command alone; "
           "with "
           "cross_coupling_by_motion along the recorded motion of the other axis.")
      .def(
          "simulate",
          [](const ModelOfAxis& m, const Eigen::VectorXd& command, std::optional<double> h,
             const std::optional<Eigen::VectorXd>& neighbour) {
            Eigen::ArrayXd out;
            {
              const py::gil_scoped_release release;
              out = simulated(m, command.array(), neighbour,
                              h.value_or(m.record.model.sample_time_s));
            }
            return array_of(out);
          },
          py::arg("command"), py::kw_only(), py::arg("sample_time_s") = py::none(),
          py::arg("neighbour") = py::none(),
          "The tracking error, command minus position, of an axis that starts at rest; neighbour: "
          "the command of the axis whose acceleration the model contains (cross_coupling), or its "
          "motion (cross_coupling_by_motion).")
      .def("__repr__", [](const ModelOfAxis& m) {
        return "<servotwin.Model of axis " + m.record.axis + ", order " +
               std::to_string(m.record.model.loop.order) + ", " +
               std::to_string(m.record.model.effects.size()) + " effects>";
      });

  py::class_<Identified>(module, "Identification",
                         "A model, how it was chosen, and what is against it.")
      .def_property_readonly(
          "model",
          [](const Identified& i) {
            if (i.refusals.empty()) return ModelOfAxis{i.record};
            std::string why = "the model must not be used: ";
            for (std::size_t k = 0; k < i.refusals.size(); ++k)
              why += (k == 0 ? "" : "; ") + i.refusals[k];
            throw std::runtime_error(why);
          },
          "The model; RuntimeError with the reasons where it must not be used.")
      .def_readonly("refusals", &Identified::refusals)
      .def_property_readonly("excitation", [](const Identified& i) { return i.record.excitation; })
      .def_property_readonly("training_rms",
                             [](const Identified& i) { return i.record.training.rms; })
      .def_property_readonly("holdout_rms",
                             [](const Identified& i) { return i.record.holdout.rms; })
      .def_property_readonly("holdout_max",
                             [](const Identified& i) { return i.record.holdout.max; })
      .def_property_readonly("noise_floor_rms",
                             [](const Identified& i) { return i.record.noise_floor.rms; })
      .def_property_readonly("noise_floor_interval",
                             [](const Identified& i) {
                               return std::pair(i.record.noise_floor.low,
                                                i.record.noise_floor.high);
                             })
      .def(
          "to_dict", [](const Identified& i) { return object_of(to_json(i)); },
          "What `servotwin identify --json` writes.")
      .def("__repr__", [](const Identified& i) {
        return "<servotwin.Identification of axis " + i.record.axis +
               (i.refusals.empty() ? "" : ", refused") + ">";
      });

  module.def(
      "why_unusable",
      [](const Axis& axis) -> std::string {
        if (!axis.commanded) return axis.segmented.axis + ".command has no values";
        try {
          require_usable(axis.segmented);
        } catch (const std::runtime_error& error) {
          return error.what();
        }
        return {};
      },
      py::arg("axis"),
      "Why nothing can be identified from this axis; empty: nothing is known against it.");
  module.def(
      "identify",
      [](const Axis& axis, const std::string& method, const std::optional<std::string>& friction,
         const std::string& structure, int order, int modes, bool coupling, double delay_max_s,
         std::optional<double> training_share, bool whole) {
        if (!axis.commanded)
          throw std::invalid_argument(axis.segmented.source + ": " + axis.segmented.axis +
                                      ".command has no values: nothing to identify the loop from");
        const IdentifyOptions options = options_of(method, friction, structure, order, modes,
                                                   coupling, delay_max_s, training_share);
        return interruptible([&] { return identified(axis, options, whole); });
      },
      py::arg("axis"), py::kw_only(), py::arg("method") = "joint", py::arg("friction") = py::none(),
      py::arg("structure") = "rigid", py::arg("order") = 0, py::arg("modes") = 0,
      py::arg("coupling") = false, py::arg("delay_max_s") = 0.02,
      py::arg("training_share") = py::none(), py::arg("whole") = false);
}

}  // namespace servotwin::python
