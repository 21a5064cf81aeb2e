// Diagnoses: what a simulation gets wrong, and why.
#include <pybind11/stl.h>

#include <algorithm>
#include <optional>
#include <set>

#include "diagnosis/evidence/encoder_difference.h"
#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/in_short.h"
#include "diagnosis/report/report.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/search/comparison.h"
#include "diagnosis/search/diagnose.h"
#include "diagnosis/torque/torque.h"
#include "python/bind.h"

namespace servotwin::python {
namespace {

namespace py = pybind11;

/// As the tool makes it: of the position loop, of the torque, or of both.
struct Diagnosed {
  std::optional<Diagnosis> loop;
  std::optional<TorqueDiagnosis> torque;
  std::string reason;  ///< why the position loop was not diagnosed
  SegmentedAxis axis;
};

std::optional<TorqueDiagnosis> torque_of(const Axis& axis, const DiagnoseOptions& options) {
  if (!has_torque(axis.segmented)) return std::nullopt;
  try {
    return diagnose_torque(axis.segmented, options);
  } catch (const std::runtime_error&) {
    return std::nullopt;  // too little motion with torque
  }
}

Diagnosed diagnosed(const Axis& axis, const std::optional<ModelRecord>& earlier,
                    const DiagnoseOptions& options) {
  Diagnosed out;
  out.axis = axis.segmented;
  if (!axis.commanded) {
    out.reason = "the recording has position and torque, but no command";
    // diagnose_torque() expects the position in place of a missing command.
    for (Segment& s : out.axis.segments) s.command = s.actual;
    out.torque = diagnose_torque(out.axis, options, false);
    return out;
  }
  try {
    const bool coupled = earlier && coupling_of(earlier->model) != nullptr;
    if (coupled) {
      out.axis = axis.for_model(*earlier);
    } else if (!options.leaves_out("cross_coupling")) {
      out.axis = axis.beside_acting();
    }
    out.loop = earlier ? compare(out.axis, *earlier, options) : diagnose(out.axis, options);
  } catch (const UnusableRecording&) {
    throw;
  } catch (const std::runtime_error& error) {
    if (!has_torque(axis.segmented) || earlier) throw;
    out.reason = error.what();
    out.torque = diagnose_torque(axis.segmented, options);
    return out;
  }
  out.torque = torque_of(axis, options);
  if (out.torque) heed(*out.torque, *out.loop);
  out.loop->baseline.source = out.loop->extended.source = file_name(axis);
  return out;
}

nlohmann::json json_of(const Diagnosed& diagnosed) {
  nlohmann::json out = diagnosed.loop ? to_json(*diagnosed.loop, "")
                                      : torque_alone(*diagnosed.torque, diagnosed.reason);
  if (diagnosed.loop && diagnosed.torque) add_torque(out, *diagnosed.torque);
  out["in_short"] = diagnosed.loop ? in_short(*diagnosed.loop, diagnosed.torque)
                                   : in_short(*diagnosed.torque, diagnosed.reason);
  if (const auto encoders = encoder_difference(diagnosed.axis))
    out["encoder_difference"] = to_json(*encoders);
  return out;
}

/// The named causes that the position loop shows, or those that the torque alone does.
py::object causes_of(const Diagnosed& diagnosed, bool by_loop) {
  nlohmann::json out = nlohmann::json::array();
  const nlohmann::json all = json_of(diagnosed);
  for (const nlohmann::json& one : all.at("causes")) {
    const bool in_loop =
        diagnosed.loop && std::any_of(diagnosed.loop->causes.begin(), diagnosed.loop->causes.end(),
                                      [&](const Cause& cause) {
                                        return cause.id == one.at("id").get<std::string>();
                                      });
    if (in_loop == by_loop) out.push_back(one);
  }
  return object_of(out);
}

void require_causes(const std::vector<std::string>& given) {
  std::set<std::string> known{"dropped_samples"};
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (!identity_of(kind).cause.empty()) known.emplace(identity_of(kind).cause);
  }
  for (const std::string& one : given) {
    if (known.count(one) > 0) continue;
    std::string names;
    for (const std::string& name : known) names += (names.empty() ? "" : ", ") + name;
    throw std::invalid_argument("leave_out: '" + one + "' is no cause; the causes are " + names);
  }
}

const Diagnosis& loop_of(const Diagnosed& diagnosed) {
  if (!diagnosed.loop)
    throw std::runtime_error("there is no model of the position loop: " + diagnosed.reason);
  return *diagnosed.loop;
}

std::string page_of(const Diagnosed& d) {
  if (!d.loop) return torque_page(*d.torque, d.axis.source, d.reason);
  return report_html(*d.loop, d.axis.segments, d.axis.source, d.torque, encoder_difference(d.axis));
}

}  // namespace

void bind_diagnosis(py::module_& module) {
  py::class_<Diagnosed>(module, "Diagnosis", "What the simulation of an axis gets wrong, and why.")
      .def(
          "to_dict", [](const Diagnosed& d) { return object_of(json_of(d)); },
          "What `servotwin diagnose --json` writes.")
      .def_property_readonly("verdict",
                             [](const Diagnosed& d) {
                               return d.loop ? verdict_text(*d.loop) : "torque alone: " + d.reason;
                             })
      .def_property_readonly(
          "causes", [](const Diagnosed& d) { return causes_of(d, true); },
          "The named causes, as in the diagnosis file; the one that explains most of the tracking "
          "error is the first.")
      .def_property_readonly(
          "torque_causes", [](const Diagnosed& d) { return causes_of(d, false); },
          "The causes that only the motor's torque shows. They are not in `extended`.")
      .def_property_readonly(
          "suspected",
          [](const Diagnosed& d) {
            return object_of(json_of(d).value("suspected", nlohmann::json::array()));
          },
          "Causes that are too uncertain to be named.")
      .def_property_readonly("baseline",
                             [](const Diagnosed& d) { return ModelOfAxis{loop_of(d).baseline}; })
      .def_property_readonly(
          "extended", [](const Diagnosed& d) { return ModelOfAxis{loop_of(d).extended}; },
          "The model with all causes of the position loop, the suspected ones too.")
      .def_property_readonly(
          "steps", [](const Diagnosed& d) { return loop_of(d).steps; },
          "What the search tried, added and removed.")
      .def("report", &page_of, py::call_guard<py::gil_scoped_release>(),
           "A page for people, as HTML.")
      .def("_repr_html_", &page_of)
      .def("__repr__",
           [](const Diagnosed& d) { return "<servotwin.Diagnosis of axis " + d.axis.axis + ">"; });

  module.def(
      "diagnose",
      [](const Axis& axis, const std::optional<ModelOfAxis>& earlier,
         const std::vector<std::string>& leave_out, bool encoder_in_loop,
         std::optional<double> training_share, double delay_max_s) {
        DiagnoseOptions options;
        require_causes(leave_out);
        require_delay(delay_max_s);
        options.leave_out = leave_out;
        options.encoder_in_loop = encoder_in_loop;
        options.identify.delay_max_s = delay_max_s;
        if (training_share) {
          if (!(*training_share >= 0.1 && *training_share <= 0.95))
            throw std::invalid_argument("training_share must be 0.1 to 0.95");
          options.identify.training_share = *training_share;
          options.balance = false;
        }
        std::optional<ModelRecord> record;
        if (earlier) record = earlier->record;
        return interruptible([&] { return diagnosed(axis, record, options); });
      },
      py::arg("axis"), py::kw_only(), py::arg("earlier") = py::none(),
      py::arg("leave_out") = std::vector<std::string>(), py::arg("encoder_in_loop") = false,
      py::arg("training_share") = py::none(), py::arg("delay_max_s") = 0.02);
}

}  // namespace servotwin::python
