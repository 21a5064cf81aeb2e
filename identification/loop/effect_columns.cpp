#include "identification/loop/effect_columns.h"

#include "identification/least_squares/unit_columns.h"

namespace servotwin {

EffectColumns::EffectColumns(const std::vector<Signals>& segments, const Loop& loop,
                             double command_delay_s)
    : order_(loop.order) {
  for (const Signals& s : segments) {
    Spline moved;
    if (command_delay_s > 0.0) moved = Spline::through(s.command.delayed(command_delay_s), s.h);
    MotionsSeen motions(s, command_delay_s > 0.0 ? moved : s.command, true);
    if (order_ == 2) {
      parts_.push_back({std::move(motions),
                        ForceFilter<2>(loop.denominator, loop.modes, s.h, false), rows_, s.size()});
    } else {
      parts_.push_back({std::move(motions),
                        ForceFilter<3>(loop.denominator, loop.modes, s.h, false), rows_, s.size()});
    }
    rows_ += s.size();
  }
}

Eigen::MatrixXd EffectColumns::of(std::size_t kind, const std::vector<double>& shapes) const {
  const auto coefficients = coefficients_of(kind);
  const Acts acts = identity_of(kind).acts;
  Eigen::Index columns = 0;
  for (const Parameter& p : coefficients) columns += told_from_loop(p, order_) ? 1 : 0;
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows_, columns);
  for (const Part& part : parts_) {
    const auto units = unit_columns(kind, shapes.data(), part.motions.of(acts), false);
    Eigen::Index column = 0;
    for (std::size_t c = 0; c < coefficients.size(); ++c) {
      if (!told_from_loop(coefficients[c], order_)) continue;
      const auto force = units.force.col(static_cast<Eigen::Index>(c));
      auto of_part = out.col(column++).segment(part.first, part.count);
      if (acts == Acts::kReading) {
        of_part = -force.matrix();
      } else {
        std::visit([&](const auto& filter) { filter.run(force, of_part, nullptr); }, part.filter);
      }
    }
  }
  return out;
}

}  // namespace servotwin
