// Corrected paths: learned in virtual trials on the twins.
#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include <cmath>
#include <map>
#include <optional>

#include "identification/model/motion_reach.h"
#include "identification/model/stated_deviations.h"
#include "ilc/path_ends.h"
#include "ilc/prepared_axis.h"
#include "ilc/words.h"
#include "python/bind.h"

namespace servotwin::python {
namespace {

namespace py = pybind11;

/// A path, what it becomes, and the errors on the twin before and after.
struct CorrectedPath {
  double sample_time_s = 0.0;
  std::vector<PreparedAxis> axes;
  Learned learned;
  std::vector<std::string> notes;
};

struct LearnArguments {
  CorrectionWish wish;
  LearnOptions options;
};

LearnArguments arguments_of(const std::string& method, const std::string& aim, int trials,
                            std::optional<double> bandwidth_hz, std::optional<double> uncertainty,
                            std::optional<double> peak, std::optional<double> rate) {
  LearnArguments out;
  out.wish.feedforward_only = method == "feedforward";
  out.wish.law = one_of<Law>({{"inverse", Law::kInverse},
                              {"norm-optimal", Law::kNormOptimal},
                              {"p", Law::kP},
                              {"pd", Law::kPd},
                              {"feedforward", Law::kInverse}},
                             method, "method");
  out.options.aim =
      one_of<Aim>({{"tracking", Aim::kTracking}, {"contour", Aim::kContour}}, aim, "aim");
  out.options.feedforward_only = out.wish.feedforward_only;
  if (out.wish.feedforward_only && (aim != "tracking" || bandwidth_hz))
    throw std::invalid_argument(
        "the method feedforward corrects every axis by itself, at the largest bandwidth that makes "
        "no model within the uncertainty worse: it takes neither aim nor bandwidth_hz");
  constexpr int kMaxTrials = 1000;
  if (trials < 1 || trials > kMaxTrials)
    throw std::invalid_argument("trials " + std::to_string(trials) + " is not 1 to 1000");
  out.options.trials = trials;
  out.options.rigid_law_too = true;
  const auto within = [](const char* what, std::optional<double> value, double low, double high) {
    if (value && !(*value >= low && *value <= high))
      throw std::invalid_argument(std::string(what) + " " + words::number(*value) + " is not " +
                                  words::number(low) + " to " + words::number(high));
  };
  within("bandwidth_hz", bandwidth_hz, kMinBandwidth_hz, 1e5);
  within("uncertainty", uncertainty, 1e-5, 0.9);
  within("peak", peak, 1e-9, 1.0);
  within("rate", rate, 1e-9, 1e3);
  out.wish.bandwidth_hz = bandwidth_hz.value_or(0.0);
  out.wish.uncertainty_share = uncertainty.value_or(0.0);
  if (peak) out.wish.limits.peak = *peak;
  if (rate) out.wish.limits.rate = *rate;
  return out;
}

CorrectedPath corrected(const std::vector<ModelOfAxis>& models,
                        const std::vector<Eigen::VectorXd>& commands, double sample_time_s,
                        const LearnArguments& arguments) {
  CorrectedPath out;
  out.sample_time_s = sample_time_s;
  std::vector<LearnAxis> axes;
  bool moving = false;
  for (std::size_t i = 0; i < models.size(); ++i) {
    const ModelRecord& record = models[i].record;
    for (std::size_t k = 0; k < i; ++k) {
      if (models[k].record.axis == record.axis)
        throw std::invalid_argument("two models are of axis " + record.axis);
    }
    Segment path;
    path.sample_time_s = sample_time_s;
    path.command = commands[i].array();
    if (path.size() != commands.front().size())
      throw std::invalid_argument("the command of " + record.axis + " has " +
                                  std::to_string(path.size()) + " values, that of " +
                                  models.front().record.axis + " " +
                                  std::to_string(commands.front().size()));
    if (path.size() < 2 || !path.command.isFinite().all())
      throw std::invalid_argument("the command of " + record.axis +
                                  " must have two values or more, all of them finite");
    moving = moving || path_moves(path);
    if (const std::string jump = jump_in(path, record.axis, record.rotary); !jump.empty())
      throw std::runtime_error(jump);
    const MotionReach reach = motion_reach(record, {&path, 1});
    if (reach.far_beyond()) throw std::runtime_error(reach.words + "; " + kFarBeyondAdvice);
    if (reach.beyond())
      out.notes.push_back(reach.words + "; its prediction for this path is not reliable");
    out.axes.push_back(prepared_axis(record.axis, record.rotary, model_at(record, sample_time_s),
                                     stated_deviations(record), path, arguments.wish));
    axes.push_back(out.axes.back().learning);
  }
  std::vector<std::string> neighbours;
  for (const ModelOfAxis& model : models) neighbours.push_back(model.record.neighbour);
  for (const std::size_t i : find_neighbours(axes, neighbours))
    out.notes.push_back(without_neighbour(axes[i].name, neighbours[i]));
  if (!moving) throw std::runtime_error("no axis moves: there is nothing to correct");
  for (const std::string& line : short_rests(axes)) out.notes.push_back(line);
  const Plant twins = on_twins(axes);
  out.learned = learn(
      axes,
      [&](const std::vector<Eigen::ArrayXd>& tried) {
        throw_if_interrupted();
        return twins(tried);
      },
      arguments.options);
  if (out.learned.best == 0)
    out.notes.push_back(why_none_is_kept(out.learned, axes) + "; the path is unchanged");
  return out;
}

/// What `of` gives of every axis, by its name.
template <class Of>
py::dict by_axis(const CorrectedPath& path, const Of& of) {
  py::dict out;
  for (std::size_t i = 0; i < path.axes.size(); ++i)
    out[py::str(path.axes[i].learning.name)] = of(path.axes[i], path.learned.axes[i]);
  return out;
}

py::object contour_of(const std::optional<ProgramError>& error) {
  return error ? array_of(error->distance) : py::object(py::none());
}

py::list trials_of(const CorrectedPath& path) {
  py::list out;
  for (const Trial& trial : path.learned.trials) {
    py::dict rms;
    for (std::size_t i = 0; i < path.axes.size(); ++i)
      rms[py::str(path.axes[i].learning.name)] = trial.axis[i].rms;
    py::dict one;
    one["rms"] = rms;
    one["contour_rms"] =
        path.learned.before ? py::object(py::float_(trial.contour.rms)) : py::none();
    out.append(one);
  }
  return out;
}

}  // namespace

void bind_correction(py::module_& module) {
  const auto arrays = [](const auto& of) {
    return [of](const CorrectedPath& path) {
      return by_axis(path, [&](const PreparedAxis& axis, const LearnedAxis& learned) {
        return array_of(of(axis, learned));
      });
    };
  };
  py::class_<CorrectedPath>(module, "Correction",
                            "A corrected path, with the errors on the twin before and after.")
      .def_readonly("sample_time_s", &CorrectedPath::sample_time_s)
      .def_readonly("notes", &CorrectedPath::notes)
      .def_property_readonly("axes",
                             [](const CorrectedPath& path) {
                               std::vector<std::string> names;
                               for (const PreparedAxis& axis : path.axes)
                                 names.push_back(axis.learning.name);
                               return names;
                             })
      .def_property_readonly("command", arrays([](const PreparedAxis& axis, const LearnedAxis&) {
                               return axis.learning.path.command;
                             }))
      .def_property_readonly("correction", arrays([](const PreparedAxis&, const LearnedAxis& l) {
                               return l.correction;
                             }))
      .def_property_readonly("corrected",
                             arrays([](const PreparedAxis& axis, const LearnedAxis& l) {
                               return Eigen::ArrayXd(axis.learning.path.command + l.correction);
                             }),
                             "What to command instead.")
      .def_property_readonly("error_before", arrays([](const PreparedAxis&, const LearnedAxis& l) {
                               return l.error_before;
                             }))
      .def_property_readonly("error_after", arrays([](const PreparedAxis&, const LearnedAxis& l) {
                               return l.error_after;
                             }))
      .def_property_readonly(
          "contour_before", [](const CorrectedPath& p) { return contour_of(p.learned.before); },
          "The distance from the path [m]; None with fewer than two linear axes.")
      .def_property_readonly("contour_after",
                             [](const CorrectedPath& p) { return contour_of(p.learned.after); })
      .def_property_readonly("trials", &trials_of,
                             "RMS of the errors in every trial; the first is without correction.")
      .def_property_readonly("best", [](const CorrectedPath& p) { return p.learned.best; })
      .def_property_readonly("bandwidth_hz",
                             [](const CorrectedPath& path) {
                               return by_axis(path, [](const PreparedAxis& a, const LearnedAxis&) {
                                 return a.learning.law.bandwidth_hz;
                               });
                             })
      .def_property_readonly("contraction",
                             [](const CorrectedPath& path) {
                               return by_axis(path, [](const PreparedAxis& a, const LearnedAxis&) {
                                 return a.contraction.most();
                               });
                             })
      .def_property_readonly("uncertainty",
                             [](const CorrectedPath& path) {
                               return by_axis(path, [](const PreparedAxis& a, const LearnedAxis&) {
                                 return a.uncertainty;
                               });
                             })
      .def("__repr__", [](const CorrectedPath& path) {
        std::string names;
        for (const PreparedAxis& axis : path.axes)
          names += (names.empty() ? "" : ", ") + axis.learning.name;
        return "<servotwin.Correction of " + names + ", trial " +
               std::to_string(path.learned.best) + " of " +
               std::to_string(path.learned.trials.size() - 1) + " kept>";
      });

  module.def(
      "learn",
      [](const std::vector<ModelOfAxis>& models, const std::vector<Eigen::VectorXd>& commands,
         double sample_time_s, const std::string& method, const std::string& aim, int trials,
         std::optional<double> bandwidth_hz, std::optional<double> uncertainty,
         std::optional<double> peak, std::optional<double> rate) {
        if (models.empty() || models.size() != commands.size())
          throw std::invalid_argument("one model and one command for every axis are needed");
        if (!(sample_time_s > 0.0 && std::isfinite(sample_time_s)))
          throw std::invalid_argument("sample_time_s must be positive");
        const LearnArguments arguments =
            arguments_of(method, aim, trials, bandwidth_hz, uncertainty, peak, rate);
        return interruptible([&] { return corrected(models, commands, sample_time_s, arguments); });
      },
      py::arg("models"), py::arg("commands"), py::arg("sample_time_s"), py::kw_only(),
      py::arg("method") = "inverse", py::arg("aim") = "tracking", py::arg("trials") = 10,
      py::arg("bandwidth_hz") = py::none(), py::arg("uncertainty") = py::none(),
      py::arg("peak") = py::none(), py::arg("rate") = py::none());
}

}  // namespace servotwin::python
