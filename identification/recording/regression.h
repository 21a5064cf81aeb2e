// Least squares on a constant and a few columns, from sums that are taken in one pass: a recording
// has up to 10^7 rows, of which no matrix is made.
//
// The sums are of deviations from the running mean (Welford), so that a large offset of a column
// costs no digits. A column that the earlier ones nearly determine is left out: the first columns
// are those whose slopes are wanted. Any thread. Allocates nothing.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

namespace servotwin {

template <int kColumns>
class Regression {
 public:
  using Row = Eigen::Matrix<double, kColumns + 1, 1>;  ///< the columns, then what they are to give

  void add(const Row& row) {
    ++count_;
    const Row deviation = row - mean_;
    mean_ += deviation / static_cast<double>(count_);
    sums_.noalias() += deviation * (row - mean_).transpose();
  }

  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  /// Standard deviation of a column.
  [[nodiscard]] double deviation(int column) const {
    return std::sqrt(sums_(column, column) / static_cast<double>(std::max<std::size_t>(count_, 1)));
  }

  struct Fit {
    Eigen::Matrix<double, kColumns, 1> slopes;  ///< 0 of a column that was left out
    double rms = 0.0;                           ///< of what the columns leave
  };

  /// By sweeping one column after the other out of the sums (Goodnight 1979).
  [[nodiscard]] Fit fit() const {
    constexpr double kMinShare = 1e-9;  // of a column that the earlier ones do not determine
    const Row scale = sums_.diagonal().cwiseMax(1e-300).cwiseSqrt();
    Sums swept = scale.cwiseInverse().asDiagonal() * sums_ * scale.cwiseInverse().asDiagonal();
    Fit out;
    out.slopes.setZero();
    std::array<bool, kColumns> in{};
    for (int k = 0; k < kColumns; ++k) {
      if (!(swept(k, k) > kMinShare)) continue;
      sweep(swept, k);
      in[static_cast<std::size_t>(k)] = true;
    }
    out.rms = std::sqrt(std::max(0.0, swept(kColumns, kColumns))) * deviation(kColumns);
    for (int k = 0; k < kColumns; ++k) {
      if (!in[static_cast<std::size_t>(k)]) continue;
      out.slopes(k) = swept(k, kColumns) * scale(kColumns) / scale(k);
    }
    return out;
  }

 private:
  using Sums = Eigen::Matrix<double, kColumns + 1, kColumns + 1>;

  static void sweep(Sums& sums, int k) {
    const double pivot = sums(k, k);
    const Row column = sums.col(k);
    const Eigen::Matrix<double, 1, kColumns + 1> row = sums.row(k);
    sums.noalias() -= column * row / pivot;
    sums.row(k) = row / pivot;
    sums.col(k) = -column / pivot;
    sums(k, k) = 1.0 / pivot;
  }

  std::size_t count_ = 0;
  Row mean_ = Row::Zero();
  Sums sums_ = Sums::Zero();
};

}  // namespace servotwin
