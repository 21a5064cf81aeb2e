// The module servotwin._core: the libraries for Python.
#include <ctime>
#include <filesystem>

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

json json_of(const py::handle& object) {
  const py::object text = py::module_::import("json").attr("dumps")(object);
  return json::parse(text.cast<std::string>());
}

py::object array_of(const Eigen::ArrayXd& values) {
  return py::array_t<double>(values.size(), values.data());
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
  servotwin::python::bind_recording(module);
  servotwin::python::bind_model(module);
  servotwin::python::bind_diagnosis(module);
  servotwin::python::bind_listener(module);
}
