#include "identification/response/multivariable_problem.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "identification/least_squares/gram_solver.h"
#include "identification/least_squares/pole_filter.h"

namespace servotwin {

namespace {

using Index = Eigen::Index;

/// A Maxwell element along a motion and its derivative by the logarithm of its break distance: a
/// sticking element depends on its travel over that distance, a sliding one does not.
struct Element {
  Eigen::ArrayXd force, by_log_distance;
};
Element element_along(const Eigen::ArrayXd& position, double break_distance) {
  Element out{friction_input(position, break_distance), Eigen::ArrayXd::Zero(position.size())};
  for (Index k = 1; k < position.size(); ++k) {
    if (std::abs(out.force(k)) < 1.0)
      out.by_log_distance(k) =
          out.by_log_distance(k - 1) - (position(k) - position(k - 1)) / break_distance;
  }
  return out;
}

Eigen::ArrayXd spread_of(const Eigen::MatrixXd& columns) {
  const Eigen::RowVectorXd mean = columns.colwise().mean();
  return rms_of(columns.rowwise() - mean).max(std::numeric_limits<double>::min());
}

}  // namespace

Eigen::ArrayXd rms_of(const Eigen::MatrixXd& columns) {
  return (columns.colwise().squaredNorm() / std::max(1.0, static_cast<double>(columns.rows())))
      .transpose()
      .array()
      .sqrt();
}

MultivariableProblem::MultivariableProblem(const MultivariableData& data, double share)
    : data_(data) {
  for (std::size_t i = 0; i < data.inputs.size(); ++i) {
    if (data.inputs[i].break_distance > 0.0) elements_.push_back(i);
  }
  const double h = data.sample_time_s;
  for (const MultivariableRecord& record : data.records) {
    Course course;
    course.size = record.inputs.front().size();
    course.head = static_cast<Index>(share * static_cast<double>(course.size));
    for (std::size_t i = 0; i < record.inputs.size(); ++i)
      course.inputs.push_back(data.inputs[i].break_distance > 0.0 ? Spline{}
                              : data.inputs[i].smooth ? Spline::through(record.inputs[i], h)
                                                      : Spline::straight(record.inputs[i], h));
    course.by_distance.resize(elements_.size());
    courses_.push_back(std::move(course));
  }
  heads_ = target_of(false);
  scale_ = spread_of(heads_);
}

void MultivariableProblem::move_elements(const MultivariablePlace& at) const {
  if (log_distances_ == at.log_distances) return;
  log_distances_ = at.log_distances;
  for (std::size_t r = 0; r < courses_.size(); ++r) {
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      Element element =
          element_along(data_.records[r].inputs[elements_[e]], std::exp(at.log_distances[e]));
      courses_[r].inputs[elements_[e]] = Spline::straight(element.force, data_.sample_time_s);
      courses_[r].by_distance[e] = Spline::straight(element.by_log_distance, data_.sample_time_s);
    }
  }
}

void MultivariableProblem::fill_pole(bool pair, const double* value, bool whole,
                                     Eigen::Ref<Eigen::MatrixXd> columns,
                                     std::vector<Eigen::MatrixXd>* by) const {
  const bool derivatives = by != nullptr;
  const PoleFilter filter(pair, value, data_.sample_time_s, derivatives);
  const int n = filter.width();
  const double omega = filter.omega(), a = filter.a(), b = filter.b();
  columns.setZero();
  if (derivatives) {
    by->resize(static_cast<std::size_t>(n));
    for (Eigen::MatrixXd& one : *by) one.setZero(columns.rows(), columns.cols());
  }
  Index row0 = 0;
  for (Index r = 0; r < records(); ++r) {
    const Course& course = courses_[static_cast<std::size_t>(r)];
    const Index count = course.count(whole);
    for (Index i = 0; i < inputs(); ++i) {
      // Column c: of the rate for a pair, column c + 1 (c): of the value.
      const Index c = n * i;
      filter.answer(course.inputs[static_cast<std::size_t>(i)], count,
                    [&](Index k, const Eigen::Vector4d& w) {
                      const Index row = row0 + k;
                      if (!pair) {
                        columns(row, c) = w(0);
                        if (derivatives) (*by)[0](row, c) = -omega * w(1);
                        return;
                      }
                      columns(row, c) = w(1);
                      columns(row, c + 1) = w(0);
                      if (!derivatives) return;
                      // By a: -s y / M, by b: -y / M, of y and of s y; s^2 g = y - a s g - b g.
                      const double g = w(2), sg = w(3), ssg = w(0) - a * sg - b * g;
                      (*by)[0](row, c) = -a * ssg - 2.0 * b * sg;
                      (*by)[0](row, c + 1) = -a * sg - 2.0 * b * g;
                      (*by)[1](row, c) = -a * ssg;
                      (*by)[1](row, c + 1) = -a * sg;
                    });
    }
    for (int start = 0; start < n; ++start) {
      const Index c = n * (inputs() + r) + start;
      filter.free_motion(start, count, [&](Index k, const Eigen::Vector4d& w) {
        columns(row0 + k, c) = w(0);
        if (!derivatives) return;
        if (pair) {
          // But for what the other start has a share in.
          (*by)[0](row0 + k, c) = -a * w(3) - 2.0 * b * w(2);
          (*by)[1](row0 + k, c) = -a * w(3);
        } else {
          (*by)[0](row0 + k, c) = -omega * w(1);
        }
      });
    }
    row0 += count;
  }
}

// Poles one after the other, then the inputs themselves, then an offset per record.
void MultivariableProblem::fill(const MultivariablePlace& at, bool whole, bool derivatives) const {
  move_elements(at);
  Index count = inputs() + records();
  for (const bool pair : at.pair) count += (pair ? 2 : 1) * (inputs() + records());
  columns_.resize(rows_of(whole), count);
  derivatives_.resize(derivatives ? at.pair.size() : 0);
  Index c = 0;
  std::size_t value = 0;
  for (std::size_t k = 0; k < at.pair.size(); ++k) {
    const bool pair = at.pair[k];
    const Index width = (pair ? 2 : 1) * (inputs() + records());
    fill_pole(pair, at.poles.data() + value, whole, columns_.middleCols(c, width),
              derivatives ? &derivatives_[k] : nullptr);
    value += pair ? 2 : 1;
    c += width;
  }
  columns_.rightCols(inputs() + records()).setZero();
  Index row = 0;
  for (Index r = 0; r < records(); ++r) {
    const Course& course = courses_[static_cast<std::size_t>(r)];
    const Index rows = course.count(whole);
    for (Index i = 0; i < inputs(); ++i)
      columns_.col(c + i).segment(row, rows) =
          course.inputs[static_cast<std::size_t>(i)].value.head(rows).matrix();
    columns_.col(c + inputs() + r).segment(row, rows).setOnes();
    row += rows;
  }
}

Eigen::MatrixXd MultivariableProblem::moved_by(std::size_t element, const MultivariablePlace& at,
                                               const Eigen::MatrixXd& coefficients) const {
  const auto input = static_cast<Index>(elements_[element]);
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(heads_.rows(), outputs());
  Index first = 0, row0 = 0;
  std::size_t value = 0;
  for (const bool pair : at.pair) {
    const PoleFilter filter(pair, at.poles.data() + value, data_.sample_time_s, false);
    const int n = filter.width();
    const auto c = coefficients.middleRows(first + n * input, n);
    row0 = 0;
    for (const Course& course : courses_) {
      filter.answer(course.by_distance[element], course.head,
                    [&](Index k, const Eigen::Vector4d& w) {
                      if (pair)
                        out.row(row0 + k) += w(1) * c.row(0) + w(0) * c.row(1);
                      else
                        out.row(row0 + k) += w(0) * c.row(0);
                    });
      row0 += course.head;
    }
    value += static_cast<std::size_t>(n);
    first += n * (inputs() + records());
  }
  row0 = 0;
  for (const Course& course : courses_) {
    out.middleRows(row0, course.head) +=
        course.by_distance[element].value.head(course.head).matrix() *
        coefficients.row(first + input);
    row0 += course.head;
  }
  return out;
}

MultivariableProblem::Left MultivariableProblem::solve(const MultivariablePlace& at,
                                                       Derivatives wanted) const {
  fill(at, false, wanted.by_poles);
  const GramSolver solver(columns_);
  Left out;
  out.residual = heads_;
  out.coefficients.resize(columns_.cols(), outputs());
  for (Index j = 0; j < outputs(); ++j)
    out.coefficients.col(j) = solver.take_out(out.residual.col(j));
  out.residual.array().rowwise() /= scale_.transpose();
  const Index rows = heads_.rows();
  out.by_poles.resize(rows * outputs(), wanted.by_poles ? std::ssize(at.poles) : 0);
  out.by_distances.resize(rows * outputs(), wanted.by_distances ? std::ssize(elements_) : 0);
  const auto put = [&](Eigen::VectorXd change, Index j, Eigen::MatrixXd& jacobian, Index column) {
    solver.take_out(change);
    jacobian.col(column).segment(j * rows, rows) = -change / scale_(j);
  };
  if (wanted.by_poles) {
    Index first = 0, parameter = 0;
    for (const auto& block : derivatives_) {
      for (const Eigen::MatrixXd& by : block) {
        for (Index j = 0; j < outputs(); ++j)
          put(by * out.coefficients.col(j).segment(first, by.cols()), j, out.by_poles, parameter);
        ++parameter;
      }
      first += block.front().cols();
    }
  }
  if (wanted.by_distances) {
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      const Eigen::MatrixXd moved = moved_by(e, at, out.coefficients);
      for (Index j = 0; j < outputs(); ++j)
        put(moved.col(j), j, out.by_distances, static_cast<Index>(e));
    }
  }
  return out;
}

Eigen::ArrayXd MultivariableProblem::judged(const MultivariablePlace& at,
                                            const Eigen::MatrixXd& coefficients, double from,
                                            double to) const {
  fill(at, true, false);
  return rms_of(between(target_of(true) - columns_ * coefficients, from, to));
}

Eigen::ArrayXXd MultivariableProblem::parts_between(const MultivariablePlace& at,
                                                    const Eigen::MatrixXd& coefficients,
                                                    double from, double to) const {
  fill(at, true, false);
  Eigen::ArrayXXd out(outputs(), data_.inputs.back().source + 1);
  for (int source = 0; source < out.cols(); ++source) {
    Eigen::MatrixXd alone = Eigen::MatrixXd::Zero(coefficients.rows(), coefficients.cols());
    Index first = 0;
    const auto keep = [&](Index width) {
      for (Index i = 0; i < inputs(); ++i) {
        if (data_.inputs[static_cast<std::size_t>(i)].source == source)
          alone.middleRows(first + width * i, width) =
              coefficients.middleRows(first + width * i, width);
      }
      first += width * (inputs() + records());
    };
    for (const bool pair : at.pair) keep(pair ? 2 : 1);
    keep(1);
    out.col(source) = spread_of(between(columns_ * alone, from, to));
  }
  return out;
}

Eigen::ArrayXd MultivariableProblem::spread_between(double from, double to) const {
  return spread_of(between(target_of(true), from, to));
}

Eigen::ArrayXd MultivariableProblem::spread() const { return spread_of(heads_); }

Index MultivariableProblem::rows_of(bool whole) const {
  Index rows = 0;
  for (const Course& course : courses_) rows += course.count(whole);
  return rows;
}

Eigen::MatrixXd MultivariableProblem::target_of(bool whole) const {
  const auto count = static_cast<Index>(data_.records.front().outputs.size());
  Eigen::MatrixXd out(rows_of(whole), count);
  Index row = 0;
  for (std::size_t r = 0; r < courses_.size(); ++r) {
    const Index rows = courses_[r].count(whole);
    for (Index j = 0; j < count; ++j)
      out.col(j).segment(row, rows) =
          data_.records[r].outputs[static_cast<std::size_t>(j)].head(rows).matrix();
    row += rows;
  }
  return out;
}

// Of every record the rows from one share of it to another.
Eigen::MatrixXd MultivariableProblem::between(const Eigen::MatrixXd& whole, double from,
                                              double to) const {
  Eigen::MatrixXd out(whole.rows(), whole.cols());
  Index row = 0, kept = 0;
  for (const Course& course : courses_) {
    const auto size = static_cast<double>(course.size);
    const auto first = static_cast<Index>(from * size);
    const Index count = static_cast<Index>(to * size) - first;
    out.middleRows(kept, count) = whole.middleRows(row + first, count);
    kept += count;
    row += course.size;
  }
  out.conservativeResize(kept, Eigen::NoChange);
  return out;
}

}  // namespace servotwin
