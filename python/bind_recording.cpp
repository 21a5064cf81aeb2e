// Recordings: from files, arrays and tables of columns.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "diagnosis/search/acting_axis.h"
#include "diagnosis/torque/torque.h"
#include "drivers/recordings/column_map.h"
#include "drivers/recordings/recording_file.h"
#include "identification/recording/positions.h"
#include "python/bind.h"

namespace servotwin::python {
namespace {

namespace py = pybind11;
using Values = py::array_t<double, py::array::c_style | py::array::forcecast>;

std::vector<double> vector_of(const Values& values, const std::string& name) {
  if (values.ndim() != 1)
    throw std::invalid_argument(name + " has " + std::to_string(values.ndim()) +
                                " dimensions; give one value per row");
  return {values.data(), values.data() + values.size()};
}

std::string listed_axes(const Recording& recording) {
  std::string out;
  for (const AxisRecord& one : recording.axes) out += (out.empty() ? "" : ", ") + one.name;
  return out;
}

const AxisRecord* find(const Recording& recording, const std::string& name) {
  const auto one = std::find_if(recording.axes.begin(), recording.axes.end(),
                                [&](const AxisRecord& axis) { return axis.name == name; });
  return one == recording.axes.end() ? nullptr : &*one;
}

}  // namespace

Axis axis_of(const Recording& recording, const std::optional<std::string>& given) {
  if (!given && recording.axes.size() != 1)
    throw std::runtime_error(recording.source + ": has the axes " + listed_axes(recording) +
                             "; choose one, as in recording[\"" + recording.axes.front().name +
                             "\"]");
  const std::string name = given.value_or(recording.axes.front().name);
  if (find(recording, name) == nullptr)
    throw py::key_error(recording.source + " has no axis '" + name + "'; it has " +
                        listed_axes(recording));
  Axis out;
  Recording moved = recording;
  out.commanded = !without_command(moved, name);
  out.segmented = segment_axis(moved, name);
  out.notes = recording.notes;
  if (!out.commanded) {
    for (Segment& s : out.segmented.segments) s.command.setConstant(kAbsent);
    out.notes.push_back(name + ".command has no values: only its torque can be diagnosed");
  }
  for (const std::string& line : out.segmented.report.lines()) out.notes.push_back(line);
  out.recording = std::make_shared<const Recording>(std::move(moved));
  return out;
}

SegmentedAxis Axis::for_model(const ModelRecord& record) const {
  if (coupling_of(record.model) == nullptr || record.neighbour.empty() ||
      record.neighbour == segmented.neighbour)
    return segmented;
  return segment_axis(*recording, segmented.axis, {}, record.neighbour);
}

SegmentedAxis Axis::beside_acting() const {
  const std::string acting = acting_axis(*recording, segmented.axis).name;
  return acting.empty() ? segmented : segment_axis(*recording, segmented.axis, {}, acting);
}

namespace {

Recording mended(Recording recording, bool as_recorded) {
  if (!as_recorded) {
    mend_positions(recording);
    return recording;
  }
  Recording copy = recording;
  for (const std::string& line : mend_positions(copy))
    recording.notes.push_back("as recorded, so without this: " + line);
  return recording;
}

Recording read(const std::filesystem::path& file, const std::string& columns,
               std::optional<double> rate_hz, const std::optional<std::filesystem::path>& can_map,
               const std::optional<std::string>& format, double from_s, double to_s,
               bool as_recorded) {
  ReadOptions options;
  options.columns = columns;
  options.rate_hz = rate_hz;
  options.can_map = can_map.value_or(std::filesystem::path());
  if (format) options.format = format_named(*format);
  options.from_s = from_s;
  options.to_s = to_s;
  return mended(read_recording(file, options), as_recorded);
}

/// From columns named as in a file: "X.command[mm]", "time[s]".
Recording recording_of(const std::vector<std::pair<std::string, Values>>& given,
                       const std::string& columns, std::optional<double> rate_hz, bool as_recorded,
                       const std::string& source) {
  std::vector<std::string> names;
  std::vector<std::vector<double>> values;
  for (const auto& [name, column] : given) {
    names.push_back(name);
    values.push_back(vector_of(column, name));
    if (values.back().size() != values.front().size())
      throw std::invalid_argument("the columns differ in length: " + names.front() + " has " +
                                  std::to_string(values.front().size()) + " rows, " + name + " " +
                                  std::to_string(values.back().size()));
  }
  if (names.empty() || values.front().empty())
    throw std::invalid_argument(source + ": no columns, or no rows");
  ReadOptions options;
  options.columns = columns;
  options.rate_hz = rate_hz;
  check(options);
  Layout layout = lay_out(source, names, options);
  Recording out;
  out.source = source;
  out.axes = std::move(layout.axes);
  out.notes = std::move(layout.notes);
  const std::size_t rows = values.front().size();
  for (std::size_t row = 0; row < rows; ++row)
    out.time.push_back(layout.time ? layout.time_unit.to_si(values[*layout.time][row])
                                   : static_cast<double>(row) / *rate_hz);
  for (const Layout::Column& column : layout.columns) {
    std::vector<double>& to = values_of(out.axes[column.axis], column.channel);
    to.reserve(rows);
    for (const double value : values[column.index])
      to.push_back(std::isfinite(value) ? column.unit.to_si(value) : kAbsent);
  }
  fill_absent(out);
  return mended(std::move(out), as_recorded);
}

/// One array over all segments.
template <class Of>
py::object joined(const Axis& axis, const Of& of) {
  Eigen::Index size = 0;
  for (const Segment& s : axis.segmented.segments) size += s.size();
  Eigen::ArrayXd out = Eigen::ArrayXd::Constant(size, kAbsent);
  Eigen::Index at = 0;
  for (const Segment& s : axis.segmented.segments) {
    const Eigen::ArrayXd values = of(s);
    if (values.size() == s.size()) out.segment(at, s.size()) = values;
    at += s.size();
  }
  return array_of(out);
}

/// A channel of a segment; NaN where it is not recorded.
py::object channel_of(const Segment& s, const Eigen::ArrayXd& values) {
  return array_of(values.size() == s.size() ? values : Eigen::ArrayXd::Constant(s.size(), kAbsent));
}

Eigen::ArrayXd times_of(const Segment& s) {
  Eigen::ArrayXd out(s.size());
  for (Eigen::Index i = 0; i < s.size(); ++i)
    out(i) = s.start_s + s.sample_time_s * static_cast<double>(i);
  return out;
}

}  // namespace

void bind_recording(py::module_& module) {
  py::class_<Segment>(module, "Segment", "An uninterrupted part with one sampling time.")
      .def_readonly("start_s", &Segment::start_s)
      .def_readonly("sample_time_s", &Segment::sample_time_s)
      .def_property_readonly("time", [](const Segment& s) { return array_of(times_of(s)); })
      .def_property_readonly("command", [](const Segment& s) { return channel_of(s, s.command); })
      .def_property_readonly("actual", [](const Segment& s) { return channel_of(s, s.actual); })
      .def_property_readonly("actual_motor",
                             [](const Segment& s) { return channel_of(s, s.actual_motor); })
      .def_property_readonly("torque", [](const Segment& s) { return channel_of(s, s.torque); })
      .def("__len__", [](const Segment& s) { return s.size(); });

  py::class_<Axis>(module, "Axis", "One axis of a recording, repaired and cut into segments.")
      .def_property_readonly("name", [](const Axis& a) { return a.segmented.axis; })
      .def_property_readonly("source", [](const Axis& a) { return a.segmented.source; })
      .def_property_readonly("rotary", [](const Axis& a) { return a.segmented.rotary; })
      .def_property_readonly("unit", [](const Axis& a) { return a.segmented.rotary ? "rad" : "m"; })
      .def_property_readonly("torque_unit", [](const Axis& a) { return a.segmented.torque_unit; })
      .def_property_readonly("sample_time_s",
                             [](const Axis& a) { return a.segmented.sample_time_s; })
      .def_property_readonly("notes", [](const Axis& a) { return a.notes; })
      .def_property_readonly(
          "segments",
          [](const Axis& a) -> const std::vector<Segment>& { return a.segmented.segments; },
          py::return_value_policy::reference_internal)
      .def_property_readonly("time", [](const Axis& a) { return joined(a, times_of); })
      .def_property_readonly(
          "command",
          [](const Axis& a) { return joined(a, [](const auto& s) { return s.command; }); })
      .def_property_readonly(
          "actual", [](const Axis& a) { return joined(a, [](const auto& s) { return s.actual; }); })
      .def_property_readonly(
          "actual_motor",
          [](const Axis& a) { return joined(a, [](const auto& s) { return s.actual_motor; }); })
      .def_property_readonly(
          "torque", [](const Axis& a) { return joined(a, [](const auto& s) { return s.torque; }); })
      .def("__repr__", [](const Axis& a) {
        return "<servotwin.Axis " + a.segmented.axis + " of " + a.segmented.source + ", " +
               std::to_string(a.segmented.report.used_rows) + " rows>";
      });

  py::class_<Recording>(module, "Recording", "A recording with all of its axes.")
      .def_readonly("source", &Recording::source)
      .def_readonly("notes", &Recording::notes)
      .def_property_readonly("axes",
                             [](const Recording& r) {
                               std::vector<std::string> names;
                               for (const AxisRecord& one : r.axes) names.push_back(one.name);
                               return names;
                             })
      .def("axis", &axis_of, py::arg("name") = py::none(),
           "An axis by its name; the only one without.")
      .def("__getitem__",
           [](const Recording& r, const std::string& name) { return axis_of(r, name); })
      .def("__contains__",
           [](const Recording& r, const std::string& name) { return find(r, name) != nullptr; })
      .def("__iter__",
           [](const Recording& r) {
             py::list names;
             for (const AxisRecord& one : r.axes) names.append(one.name);
             return py::iter(names);
           })
      .def("__len__", [](const Recording& r) { return r.axes.size(); })
      .def("__repr__", [](const Recording& r) {
        return "<servotwin.Recording " + r.source + ": " + listed_axes(r) + ", " +
               std::to_string(r.time.size()) + " rows>";
      });

  module.def(
      "read", &read, py::arg("file"), py::kw_only(), py::arg("columns") = "",
      py::arg("rate_hz") = py::none(), py::arg("can_map") = py::none(),
      py::arg("format") = py::none(), py::arg("from_s") = 0.0,
      py::arg("to_s") = std::numeric_limits<double>::infinity(), py::arg("as_recorded") = false,
      py::call_guard<py::gil_scoped_release>(),
      "A recording from a file, of any kind that `servotwin formats` lists. The options are "
      "those of the tool: --columns, --rate, --can-map, --format, --from, --to, --as-recorded.");
  module.def("recording", &recording_of, py::arg("table"), py::kw_only(), py::arg("columns") = "",
             py::arg("rate_hz") = py::none(), py::arg("as_recorded") = false,
             py::arg("source") = "table");
}

}  // namespace servotwin::python
