#include "diagnosis/search/hypothesis.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/statistics/pieces.h"
#include "twin/two_mass_axis.h"

namespace servotwin {

double Hypothesis::rms() const { return rms_of(pieces); }

bool Hypothesis::has(std::size_t kind) const {
  return std::find(structure.effects.begin(), structure.effects.end(), kind) !=
         structure.effects.end();
}

bool has_two_masses(const Structure& structure) {
  return std::any_of(structure.effects.begin(), structure.effects.end(), acts_on_axis);
}

bool has_filter(const Structure& structure) {
  return std::find(structure.effects.begin(), structure.effects.end(), kind_of<ControlFilter>()) !=
         structure.effects.end();
}

bool is_intermittent(std::size_t kind) {
  const auto shapes = shapes_of(kind);
  const Scan scan = shapes.empty() ? Scan::kNone : shapes.front().scan;
  return scan == Scan::kMoments || scan == Scan::kDemand;
}

double shape_of(const Model& model, std::size_t kind, std::string_view name) {
  const Effect* effect = model.find(kind);
  std::size_t p = 0;
  for (const Parameter& parameter : shapes_of(kind)) {
    if (effect != nullptr && parameter.name == name) return effect->shape[p];
    ++p;
  }
  return kAbsent;
}

Model begun_from(const Model& model, const Structure& structure) {
  Model out = model;
  out.effects.clear();
  const auto law = std::find_if(model.effects.begin(), model.effects.end(),
                                [](const Effect& e) { return is_friction_law(e.kind); });
  const std::vector<double> shapes = point_of(model, structure).shapes;
  std::size_t at = 0;
  for (const std::size_t kind : structure.effects) {
    const std::size_t count = shapes_of(kind).size();
    if (const Effect* known = model.find(kind)) {
      out.effects.push_back(*known);
    } else {
      Effect other;
      other.kind = kind;
      std::copy_n(shapes.begin() + static_cast<std::ptrdiff_t>(at), count, other.shape.begin());
      if (is_friction_law(kind) && law != model.effects.end()) {
        const std::size_t levels = std::max<std::size_t>(1, free_elements_of(kind));
        for (std::size_t k = 0; k < levels; ++k)
          other.coefficient[k] = level_of(*law) / static_cast<double>(levels);
      }
      out.effects.push_back(other);
    }
    at += count;
  }
  return out;
}

Point point_of(const Model& model, const Structure& structure) {
  Point point{model.loop.denominator, {}};
  for (const std::size_t kind : structure.effects) {
    for (const Parameter& parameter : shapes_of(kind)) {
      double value = shape_of(model, kind, parameter.name);
      // A new effect starts with the value of this parameter in an effect that it may replace.
      for (const Effect& other : model.effects) {
        const double known = shape_of(model, other.kind, parameter.name);
        if (!std::isfinite(value) && std::isfinite(known) && parameter.scan == Scan::kNone)
          value = std::clamp(known, parameter.lower, parameter.upper);
      }
      point.shapes.push_back(std::isfinite(value) ? value : parameter.start);
    }
  }
  return point;
}

}  // namespace servotwin
