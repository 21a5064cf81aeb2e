#include "twin/contour_shares.h"

#include <algorithm>

#include "twin/twin.h"

namespace servotwin {

std::vector<ContourShare> contour_shares(const std::vector<Model>& models,
                                         const std::vector<Segment>& paths,
                                         const ProgramError& error) {
  double whole = 0.0;
  for (const PathPoint& away : error.away) {
    for (const double x : away) whole += x * x;
  }
  std::vector<ContourShare> out;
  if (whole == 0.0) return out;
  double rest = 1.0;
  const auto add = [&](std::size_t axis, std::string what, const Eigen::ArrayXd& part) {
    double sum = 0.0;
    for (std::size_t k = 0; k < error.away.size(); ++k)
      sum -= part(static_cast<Eigen::Index>(k)) * error.away[k][axis];
    out.push_back({axis, std::move(what), sum / whole});
    rest -= sum / whole;
  };
  for (std::size_t i = 0; i < models.size(); ++i) {
    Segment path = paths[i];
    path.actual.resize(0);
    const Eigen::ArrayXd all = simulate(models[i], path);
    Model loop = models[i];
    loop.effects.clear();
    Eigen::ArrayXd lag(path.size());
    for (Eigen::Index k = 0; k < path.size(); ++k) {
      const auto low = static_cast<Eigen::Index>(error.place(k));
      const Eigen::Index high = std::min(low + 1, path.size() - 1);
      const double part = error.place(k) - static_cast<double>(low);
      lag(k) =
          path.command(k) - path.command(low) - part * (path.command(high) - path.command(low));
    }
    add(i, "loop", simulate(loop, path) - lag);
    for (std::size_t m = 0; m < models[i].effects.size(); ++m) {
      Model without = models[i];
      without.effects.erase(without.effects.begin() + static_cast<std::ptrdiff_t>(m));
      add(i, std::string(identity_of(models[i].effects[m].kind).id), all - simulate(without, path));
    }
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const ContourShare& a, const ContourShare& b) { return a.share > b.share; });
  out.push_back({0, "", rest});
  return out;
}

}  // namespace servotwin
