// The module servotwin._core: the libraries for Python.
#include <cmath>
#include <ctime>
#include <filesystem>

#include "identification/least_squares/parallel.h"
#include "python/bind.h"
#include "twin/twin.h"

namespace servotwin::python {

namespace py = pybind11;
using nlohmann::json;

py::object object_of(const json& value) {
  switch (value.type()) {
    case json::value_t::boolean:
      return py::bool_(value.get<bool>());
    case json::value_t::number_integer:
      return py::int_(value.get<std::int64_t>());
    case json::value_t::number_unsigned:
      return py::int_(value.get<std::uint64_t>());
    case json::value_t::number_float:
      return py::float_(value.get<double>());
    case json::value_t::string:
      return py::str(value.get<std::string>());
    case json::value_t::array: {
      py::list out;
      for (const json& one : value) out.append(object_of(one));
      return out;
    }
    case json::value_t::object: {
      py::dict out;
      for (const auto& [key, one] : value.items()) out[py::str(key)] = object_of(one);
      return out;
    }
    default:
      return py::none();
  }
}

namespace {

json json_at(const py::handle& value, const std::string& place) {
  if (value.is_none()) return nullptr;
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>();
  if (py::isinstance<py::int_>(value)) return value.cast<std::int64_t>();
  if (py::isinstance<py::str>(value)) return value.cast<std::string>();
  if (py::isinstance<py::float_>(value)) {
    const auto number = value.cast<double>();
    if (std::isfinite(number)) return number;
    throw std::invalid_argument((place.empty() ? "the value" : place) + " is " +
                                std::to_string(number) + ", which is no number of a model");
  }
  if (py::isinstance<py::dict>(value)) {
    json out = json::object();
    for (const auto& [key, one] : value.cast<py::dict>()) {
      const auto name = py::str(key).cast<std::string>();
      out[name] = json_at(one, place.empty() ? name : place + "." + name);
    }
    return out;
  }
  if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
    json out = json::array();
    for (const py::handle one : value)
      out.push_back(json_at(one, place + "[" + std::to_string(out.size()) + "]"));
    return out;
  }
  if (py::hasattr(value, "item") && py::hasattr(value, "ndim") &&
      value.attr("ndim").cast<int>() == 0)
    return json_at(value.attr("item")(), place);
  throw std::invalid_argument((place.empty() ? "the value" : place) + " is of the type " +
                              py::str(py::type::of(value).attr("__name__")).cast<std::string>() +
                              "; a model has numbers, text, lists and dicts");
}

}  // namespace

json json_of(const py::handle& object) { return json_at(object, ""); }

py::object array_of(const Eigen::ArrayXd& values) {
  return py::array_t<double>(values.size(), values.data());
}

void require_delay(double delay_max_s) {
  constexpr double kLongest_s = 0.05;  // as of --delay-max
  if (!(delay_max_s >= 0.0 && delay_max_s <= kLongest_s))
    throw std::invalid_argument("delay_max_s " + std::to_string(delay_max_s) + " is not 0 to 0.05");
}

std::string file_name(const Axis& axis) {
  return std::filesystem::path(axis.segmented.source).filename().string();
}

std::string now_utc() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text.data();
}

Model model_at(const ModelRecord& record, double sample_time_s) {
  Model model = record.model;
  model.sample_time_s = sample_time_s;
  try {
    (void)Twin(model);
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error("the model of axis " + record.axis + " cannot run at a cycle of " +
                             std::to_string(1e3 * sample_time_s) + " ms: " + error.what());
  }
  return model;
}

}  // namespace servotwin::python

PYBIND11_MODULE(_core, module) {
  module.doc() = "The libraries of Servotwin; import servotwin, not this.";
  module.attr("__version__") = SERVOTWIN_VERSION;
  // As the tool: without them an identification takes nearly twice the time.
  const pybind11::object cores = pybind11::module_::import("os").attr("sched_getaffinity")(0);
  servotwin::use_threads(pybind11::len(cores));
  servotwin::keep_freed_memory();
  servotwin::python::bind_recording(module);
  servotwin::python::bind_model(module);
  servotwin::python::bind_diagnosis(module);
  servotwin::python::bind_correction(module);
  servotwin::python::bind_listener(module);
}
