#include "diagnosis/statistics/pieces.h"

#include <cstddef>

#include "twin/twin.h"

namespace servotwin {

namespace {

/// Calls `take(first, count)` for the samples of every interval of a segment.
template <class Take>
void each_piece(const Segment& s, Eigen::Index size, const Take& take) {
  const auto piece = std::max<Eigen::Index>(1, std::lround(kPiece_s / s.sample_time_s));
  const auto skip =
      std::max(s.lead, static_cast<Eigen::Index>(std::lround(kSettle_s / s.sample_time_s)));
  for (Eigen::Index at = skip; at + piece <= size; at += piece) take(at, piece);
}

}  // namespace

void add_pieces(const Segment& s, const Eigen::Ref<const Eigen::ArrayXd>& left,
                std::vector<double>& out) {
  each_piece(s, left.size(), [&](Eigen::Index at, Eigen::Index count) {
    out.push_back(left.segment(at, count).square().mean());
  });
}

std::vector<double> left_by(const Model& model, const std::vector<Segment>& segments) {
  std::vector<double> out;
  for (const Segment& s : segments) add_pieces(s, s.command - s.actual - simulate(model, s), out);
  return out;
}

std::vector<bool> moving(const std::vector<Segment>& segments) {
  std::vector<bool> out;
  for (const Segment& s : segments) {
    each_piece(s, s.size(), [&](Eigen::Index at, Eigen::Index count) {
      const auto commands = s.command.segment(at, count);
      out.push_back(commands.maxCoeff() > commands.minCoeff());
    });
  }
  return out;
}

double paired_z(const std::vector<double>& before, const std::vector<double>& after) {
  const auto n = static_cast<Eigen::Index>(std::min(before.size(), after.size()));
  if (n < 4) return 0.0;
  const Eigen::ArrayXd d = Eigen::Map<const Eigen::ArrayXd>(before.data(), n) -
                           Eigen::Map<const Eigen::ArrayXd>(after.data(), n);
  const double sd = std::sqrt((d - d.mean()).square().sum() / static_cast<double>(n - 1));
  return sd > 0.0 ? d.mean() / (sd / std::sqrt(static_cast<double>(n))) : 0.0;
}

double signed_rank_z(const std::vector<double>& before, const std::vector<double>& after) {
  std::vector<double> d;
  for (std::size_t i = 0; i < std::min(before.size(), after.size()); ++i) {
    if (before[i] != after[i]) d.push_back(before[i] - after[i]);
  }
  if (d.size() < 10) return 0.0;
  std::sort(d.begin(), d.end(), [](double l, double r) { return std::abs(l) < std::abs(r); });
  double sum = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double rank = static_cast<double>(i) + 1.0;
    sum += d[i] > 0.0 ? rank : -rank;
    squares += rank * rank;
  }
  return sum / std::sqrt(squares);
}

}  // namespace servotwin
