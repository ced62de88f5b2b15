// What asterism.MDS and the starts of asterism.mds need of points that are placed one by one: distances,
// the place of a point among others that are held, and isotonic regression.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/run/executor.hpp>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"

namespace asterism::python {

namespace {

using Numbers = py::array_t<double, py::array::c_style>;
template <int Columns>
using Table =
    Eigen::Matrix<double, Eigen::Dynamic, Columns, Columns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;
template <int Columns>
using TableMap = Eigen::Map<const Table<Columns>>;

/// f(worker, row) for all rows, on threads that Ctrl-C ends.
template <typename F>
void for_each_row(Eigen::Index rows, int threads, F&& f) {
  constexpr Eigen::Index kChunk = 64;
  const int chunks = static_cast<int>((rows + kChunk - 1) / kChunk);
  interruptible([&](const std::atomic<bool>& stop) {
    detail::for_each_task(detail::thread_count(threads), chunks, [&](int worker, int chunk) {
      const Eigen::Index first = chunk * kChunk;
      for (Eigen::Index row = first; row < std::min(rows, first + kChunk) && !stop; ++row) f(worker, row);
    });
    return true;
  });
}

/// Places points, one by one, where sum_k w_k (d_k - |x - h_k|)^2 over the points h_k that are held is least.
template <int Dim>
class Placement {
 public:
  using Point = Eigen::Matrix<double, Dim, 1>;
  using Matrix = Eigen::Matrix<double, Dim, Dim>;
  using Points = Eigen::Matrix<double, Dim, Eigen::Dynamic>;

  explicit Placement(const Points& held)
      : held_(held), matrix_(Matrix::Zero(held.rows(), held.rows())), hessian_(matrix_) {}

  /// From the given place, or else from two: where the squares of the distances are nearest to those given,
  /// up to what they have in common, as classical scaling has it (Gower 1968); and the nearest held point, on
  /// which it stays if the distance from it is 0. Both go down to the minima of the first few held points,
  /// and the lower of the two to that of all.
  template <typename Distances, typename Weights>
  Point place(const Distances& given, const Weights& weights, const double* start) {
    const Eigen::Index all = given.size();
    weights_ = weights;
    distances_ = given;
    constexpr double kNear = 1e-2, kExact = 1e-6;  // of a step: the next one is near its square
    Eigen::Index nearest = -1, known = 0, few = 0;
    for (Eigen::Index k = 0; k < all; ++k) {
      if (!(weights_[k] > 0) || std::isnan(distances_[k])) {
        weights_[k] = distances_[k] = 0;
        continue;
      }
      constexpr Eigen::Index kFew = 24;
      if (++known <= kFew + 2 * held_.rows()) few = k + 1;
      if (nearest < 0 || distances_[k] < distances_[nearest]) nearest = k;
    }
    if (nearest < 0) return Point::Constant(held_.rows(), std::numeric_limits<double>::quiet_NaN());
    if (start != nullptr) return descend(Eigen::Map<const Point>(start, held_.rows()), all, kExact);
    if (distances_[nearest] == 0) return held_.col(nearest);
    const Point first = descend(by_squares(few), few, kNear);
    // From the held point itself there is no way down.
    const Point second = descend(held_.col(nearest) + 1e-3 * (first - held_.col(nearest)), few, kNear);
    Point unused(held_.rows());
    const bool are_one = (first - second).norm() <= 2 * kNear * size_of(few);
    const bool is_first = are_one || evaluate(first, all, unused) <= evaluate(second, all, unused);
    return descend(is_first ? first : second, all, kExact);
  }

 private:
  Point by_squares(Eigen::Index rows) {
    const auto weights = weights_.head(rows);
    const double total = weights.sum();
    const Point mean = held_.leftCols(rows) * weights / total;
    const auto excess = [&](Eigen::Index k) {
      return (held_.col(k) - mean).squaredNorm() - distances_[k] * distances_[k];
    };
    double common = 0;
    for (Eigen::Index k = 0; k < rows; ++k) common += weights_[k] * excess(k) / total;
    Point side = Point::Zero(held_.rows());
    matrix_.setZero();
    for (Eigen::Index k = 0; k < rows; ++k) {
      const Point offset = held_.col(k) - mean;
      side += 0.5 * weights_[k] * (excess(k) - common) * offset;
      add_square(weights_[k], offset);
    }
    matrix_.diagonal().array() += 1e-9 * matrix_.trace();  // held points may lie on a line
    return mean + solved(side).value_or(Point::Zero(side.size()));
  }

  double size_of(Eigen::Index rows) const {
    return weights_.head(rows).dot(distances_.head(rows)) / weights_.head(rows).sum();
  }

  /// Adds weight u u^T to the lower triangle.
  void add_square(double weight, const Point& u) {
    for (Eigen::Index j = 0; j < u.size(); ++j) {
      const double factor = weight * u[j];
      for (Eigen::Index i = j; i < u.size(); ++i) matrix_(i, j) += factor * u[i];
    }
  }

  /// matrix_^-1 side, if the matrix is positive definite.
  std::optional<Point> solved(const Point& side) {
    const Eigen::LLT<Matrix> factor(matrix_);
    if (factor.info() != Eigen::Success) return std::nullopt;
    return factor.solve(side);
  }

  /// The stress at x of the first held points; also half its gradient, and in matrix_ half its Hessian.
  double evaluate(const Point& x, Eigen::Index rows, Point& gradient) {
    gradient.setZero();
    matrix_.setZero();
    double stress = 0, across = 0;
    for (Eigen::Index k = 0; k < rows; ++k) {
      const Point u = x - held_.col(k);
      constexpr double kLeast = 1e-150;  // its square is a normal number
      const double r = std::max(u.norm(), kLeast), w = weights_[k], d = distances_[k];
      const double inverse = 1 / r, share = w * d * inverse;
      stress += w * (d - r) * (d - r);
      gradient += (w - share) * u;
      across += w - share;
      add_square(share * inverse * inverse, u);
    }
    matrix_.diagonal().array() += across;
    return stress;
  }

  /// Newton's method with a multiple of the identity added to the Hessian where that is not positive definite
  /// or the step would raise the stress.
  Point descend(Point x, Eigen::Index rows, double tolerance) {
    const double total = weights_.head(rows).sum(), end = tolerance * size_of(rows);
    Point gradient(x.size()), next_gradient(x.size());
    double stress = evaluate(x, rows, gradient), shift = 0;
    constexpr int kMost = 100;
    for (int iteration = 0; iteration < kMost; ++iteration) {
      hessian_ = matrix_;
      Point step = Point::Zero(x.size());
      double found = std::numeric_limits<double>::infinity();
      while (true) {
        matrix_ = hessian_;
        matrix_.diagonal().array() += shift;
        if (const std::optional<Point> newton = solved(gradient)) {
          step = -*newton;
          found = evaluate(x + step, rows, next_gradient);
          if (found <= stress) break;
        }
        shift = std::max(4 * shift, 0.02 * total);
        if (!(shift < 1e6 * total)) return x;  // all that is left is rounding
      }
      x += step;
      stress = found;
      gradient.swap(next_gradient);
      shift = shift > 0.02 * total ? shift / 8 : 0;
      if (step.norm() <= end) break;
    }
    return x;
  }

  const Points& held_;
  Eigen::VectorXd weights_, distances_;
  Matrix matrix_, hessian_;
};

template <int Dim>
void place_all(const TableMap<Eigen::Dynamic>& held, const TableMap<Eigen::Dynamic>& distances,
               const TableMap<Eigen::Dynamic>& weights, const double* starts, int threads, double* result) {
  const typename Placement<Dim>::Points columns = held.transpose();
  std::vector<Placement<Dim>> workers(static_cast<std::size_t>(detail::thread_count(threads)),
                                      Placement<Dim>(columns));
  for_each_row(distances.rows(), threads, [&](int worker, Eigen::Index row) {
    const Eigen::Index dim = held.cols();
    const double* const start = starts == nullptr ? nullptr : starts + row * dim;
    Eigen::Map<typename Placement<Dim>::Point>(result + row * dim, dim) =
        workers[static_cast<std::size_t>(worker)].place(
            distances.row(row).transpose(), weights.row(weights.rows() == 1 ? 0 : row).transpose(), start);
  });
}

TableMap<Eigen::Dynamic> map(const Numbers& array) { return {array.data(), array.shape(0), array.shape(1)}; }

/// (M, Dim): a place for each row of the distances.
py::array_t<double> place(const Numbers& held, const Numbers& distances, const Numbers& weights,
                          const Numbers& starts, int threads) {
  const py::ssize_t rows = distances.shape(0), dim = held.shape(1);
  if (held.shape(0) != distances.shape(1) || weights.shape(1) != distances.shape(1) ||
      (weights.shape(0) != 1 && weights.shape(0) != rows) ||
      (starts.size() > 0 && starts.size() != rows * dim) || dim < 1)
    throw py::value_error("a column for each point that is held");
  py::array_t<double> result(Shape{rows, dim});
  const double* const from = starts.size() > 0 ? starts.data() : nullptr;
  const auto work = dim == 2 ? place_all<2> : dim == 3 ? place_all<3> : place_all<Eigen::Dynamic>;
  work(map(held), map(distances), map(weights), from, threads, result.mutable_data());
  return result;
}

/// (M, K): Euclidean distances of the rows of a from those of b; equal rows have the distance 0.
py::array_t<double> distances(const Numbers& a, const Numbers& b, int threads) {
  if (a.shape(1) != b.shape(1)) throw py::value_error("as many columns in both");
  py::array_t<double> result(Shape{a.shape(0), b.shape(0)});
  const auto from = map(a), to = map(b);
  const Eigen::MatrixXd columns = to;  // K x features: the loop along it is over memory
  double* const out = result.mutable_data();
  for_each_row(a.shape(0), threads, [&](int, Eigen::Index row) {
    Eigen::Map<Eigen::ArrayXd> sum(out + row * columns.rows(), columns.rows());
    sum.setZero();
    for (Eigen::Index f = 0; f < columns.cols(); ++f) sum += (columns.col(f).array() - from(row, f)).square();
    sum = sum.sqrt();
  });
  return result;
}

/// The non-decreasing sequence nearest to the values, in the sense of weighted squares: pool adjacent
/// violators (Kruskal 1964).
py::array_t<double> isotonic(const Numbers& values, const Numbers& weights) {
  if (values.size() != weights.size()) throw py::value_error("a weight for each value");
  struct Block {
    double mean, weight;
    py::ssize_t count;
  };
  std::vector<Block> blocks;
  for (py::ssize_t i = 0; i < values.size(); ++i) {
    Block block{values.data()[i], weights.data()[i], 1};
    while (!blocks.empty() && blocks.back().mean >= block.mean) {
      const Block& last = blocks.back();
      const double weight = last.weight + block.weight;
      block = {last.mean + block.weight / weight * (block.mean - last.mean), weight,
               last.count + block.count};
      blocks.pop_back();
    }
    blocks.push_back(block);
  }
  py::array_t<double> result(values.size());
  double* next = result.mutable_data();
  for (const Block& block : blocks) next = std::fill_n(next, block.count, block.mean);
  return result;
}

}  // namespace

void bind_placement(py::module_& m) {
  m.def("_place", &place, py::arg("held"), py::arg("distances"), py::arg("weights"), py::arg("starts"),
        py::arg("threads"));
  m.def("_distances", &distances, py::arg("a"), py::arg("b"), py::arg("threads"));
  m.def("_isotonic", &isotonic, py::arg("values"), py::arg("weights"));
}

}  // namespace asterism::python
