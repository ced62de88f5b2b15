#include <Eigen/Cholesky>
#include <algorithm>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/graph/placement.hpp>
#include <asterism/solver/run/executor.hpp>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include "../terms/link_rows.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// The stress of one point in D coordinates, Eigen::Dynamic for a number known at run time, and its descent.
template <int D>
class PlacedPoint {
 public:
  using Point = Eigen::Matrix<double, D, 1>;
  using Matrix = Eigen::Matrix<double, D, D>;
  // A held point is a row, so that sums over them are sums of vectors.
  using Points = Eigen::Matrix<double, Eigen::Dynamic, D>;

  static Points padded(const Eigen::Ref<const Eigen::MatrixXd>& held) {
    Points result = Points::Zero(held.cols() + lanes_v0_1::kBeyond, held.rows());
    result.topRows(held.cols()) = held.transpose();
    return result;
  }

  PlacedPoint(const Points& held, Eigen::Index count)
      : held_(held), count_(count), weights_(count), distances_(count) {}

  template <typename Distances, typename Weights>
  Point place(const Distances& given, const Weights& weights, const double* start) {
    constexpr double kNear = 1e-2, kExact = 1e-6;  // of a step: the next one is near its square
    const Eigen::Index nearest = read(given, weights);
    if (nearest < 0) return Point::Constant(held_.cols(), std::numeric_limits<double>::quiet_NaN());
    if (start != nullptr) return descend(Eigen::Map<const Point>(start, held_.cols()), count_, kExact);
    const Point on = held_.row(nearest);
    if (distances_[nearest] == 0) return on;
    // To the minima of the first few held points, and from the lower of the two to that of all.
    const Point first = descend(by_squares(), few_, kNear);
    // From the held point itself there is no way down.
    const Point second = descend(on + 1e-3 * (first - on), few_, kNear);
    const bool are_one = (first - second).norm() <= 2 * kNear * size_of(few_);
    const bool is_first = are_one || stress_at(first, count_).value <= stress_at(second, count_).value;
    return descend(is_first ? first : second, count_, kExact);
  }

 private:
  // The stress of the first held points; half its gradient; and the lower triangle of half its Hessian.
  struct Stress {
    double value;
    Point gradient;
    Matrix hessian;
  };

  // The nearest held point, -1 if no distance is known. Those that are not have no weight.
  template <typename Distances, typename Weights>
  Eigen::Index read(const Distances& given, const Weights& weights) {
    const Eigen::Index enough = 24 + 2 * held_.cols();
    Eigen::Index nearest = -1, known = 0;
    few_ = 0;
    for (Eigen::Index k = 0; k < count_; ++k) {
      const bool is_known = weights[k] > 0 && !std::isnan(given[k]);
      weights_[k] = is_known ? weights[k] : 0;
      distances_[k] = is_known ? given[k] : 0;
      if (!is_known) continue;
      if (++known <= enough) few_ = k + 1;
      if (nearest < 0 || distances_[k] < distances_[nearest]) nearest = k;
    }
    return nearest;
  }

  // Where the squares of the first few distances are nearest to those given, up to what they have in common.
  Point by_squares() {
    const auto weights = weights_.head(few_);
    const double total = weights.sum();
    const Point mean = held_.topRows(few_).transpose() * weights / total;
    const Points offsets = held_.topRows(few_).rowwise() - mean.transpose();
    const Eigen::VectorXd excess = offsets.rowwise().squaredNorm() - distances_.head(few_).cwiseAbs2();
    const double common = weights.dot(excess) / total;
    const Point side = 0.5 * offsets.transpose() * weights.cwiseProduct((excess.array() - common).matrix());
    Matrix squares = offsets.transpose() * weights.asDiagonal() * offsets;
    squares.diagonal().array() += 1e-9 * squares.trace();  // held points may lie on a line
    return mean + solved(squares, side).value_or(Point::Zero(side.size()));
  }

  double size_of(Eigen::Index rows) const {
    return weights_.head(rows).dot(distances_.head(rows)) / weights_.head(rows).sum();
  }

  // matrix^-1 side, if the matrix is positive definite.
  static std::optional<Point> solved(const Matrix& matrix, const Point& side) {
    const Eigen::LLT<Matrix> factor(matrix);
    if (factor.info() != Eigen::Success) return std::nullopt;
    return factor.solve(side);
  }

  Stress stress_at(const Point& x, Eigen::Index rows) const {
    if constexpr (D == Eigen::Dynamic) {
      return stress_in_any_dimension(x, rows);
    } else {
      return stress_by_rows(x, rows);
    }
  }

  Stress stress_by_rows(const Point& x, Eigen::Index rows) const {
    const auto sums = lanes_v0_1::sum({.count = static_cast<int>(rows),
                                       .dim = D,
                                       .point = x.data(),
                                       .others = held_.data(),
                                       .stride = held_.rows(),
                                       .distances = distances_.data(),
                                       .weights = weights_.data()});
    Stress result{sums.stress, Eigen::Map<const Point>(sums.gradient), Matrix::Zero()};
    for (int j = 0, n = 0; j < D; ++j) {
      for (int i = j; i < D; ++i) result.hessian(i, j) = sums.hessian[n++];
    }
    return result;
  }

  Stress stress_in_any_dimension(const Point& x, Eigen::Index rows) const {
    constexpr double kLeast = 1e-150;  // its square is a normal number
    const auto weights = weights_.head(rows).array(), distances = distances_.head(rows).array();
    const Points offsets = (-held_.topRows(rows)).rowwise() + x.transpose();
    const Eigen::ArrayXd inverse = 1 / offsets.rowwise().norm().array().max(kLeast);
    const Eigen::ArrayXd shares = weights * distances * inverse, pulls = weights - shares;
    const Eigen::ArrayXd bends = shares * inverse.square();
    Stress result{(weights * (distances - 1 / inverse).square()).sum(), offsets.transpose() * pulls.matrix(),
                  Matrix::Zero(x.size(), x.size())};
    for (Eigen::Index j = 0; j < x.size(); ++j) {
      const Eigen::ArrayXd bent = bends * offsets.col(j).array();
      for (Eigen::Index i = j; i < x.size(); ++i) result.hessian(i, j) = offsets.col(i).dot(bent.matrix());
    }
    result.hessian.diagonal().array() += pulls.sum();
    return result;
  }

  // Newton's method with a multiple of the identity added to the Hessian where that is not positive definite
  // or the step would raise the stress.
  Point descend(Point x, Eigen::Index rows, double tolerance) {
    const double total = weights_.head(rows).sum(), end = tolerance * size_of(rows), least = 0.02 * total;
    Stress here = stress_at(x, rows);
    double shift = 0;
    constexpr int kMost = 100;
    for (int iteration = 0; iteration < kMost; ++iteration) {
      const std::optional<Point> step = lower(x, rows, total, here, shift);
      if (!step) break;  // all that is left is rounding
      x += *step;
      shift = shift > least ? shift / 8 : 0;
      if (step->norm() <= end) break;
    }
    return x;
  }

  // A step to where the stress is no higher, with the least shift from the given one on; `here` becomes that
  // there.
  std::optional<Point> lower(const Point& x, Eigen::Index rows, double total, Stress& here, double& shift) {
    while (shift < 1e6 * total) {
      Matrix shifted = here.hessian;
      shifted.diagonal().array() += shift;
      if (const std::optional<Point> newton = solved(shifted, here.gradient)) {
        Stress there = stress_at(x - *newton, rows);
        if (there.value <= here.value) {
          here = std::move(there);
          return -*newton;
        }
      }
      shift = std::max(4 * shift, 0.02 * total);
    }
    return std::nullopt;
  }

  const Points& held_;
  Eigen::Index count_, few_ = 0;
  Eigen::VectorXd weights_, distances_;
};

template <int D>
void place_all(const Eigen::Ref<const Eigen::MatrixXd>& held,
               const Eigen::Ref<const Eigen::MatrixXd>& distances,
               const Eigen::Ref<const Eigen::MatrixXd>& weights,
               const Eigen::Ref<const Eigen::MatrixXd>& starts, const PlacementOptions& options,
               Eigen::MatrixXd& result) {
  const auto rows = PlacedPoint<D>::padded(held);
  const int threads = detail::thread_count(options.threads);
  std::vector<PlacedPoint<D>> workers(static_cast<std::size_t>(threads), PlacedPoint<D>(rows, held.cols()));
  constexpr Eigen::Index kChunk = 64;
  const int chunks = static_cast<int>((distances.cols() + kChunk - 1) / kChunk);
  detail::for_each_task(threads, chunks, [&](int worker, int chunk) {
    const Eigen::Index first = chunk * kChunk, last = std::min(distances.cols(), first + kChunk);
    for (Eigen::Index m = first; m < last && !(options.stop != nullptr && *options.stop); ++m) {
      result.col(m) = workers[static_cast<std::size_t>(worker)].place(
          distances.col(m), weights.col(weights.cols() == 1 ? 0 : m),
          starts.size() > 0 ? starts.col(m).data() : nullptr);
    }
  });
}

}  // namespace

Eigen::MatrixXd place_points(const Eigen::Ref<const Eigen::MatrixXd>& held,
                             const Eigen::Ref<const Eigen::MatrixXd>& distances,
                             const Eigen::Ref<const Eigen::MatrixXd>& weights,
                             const Eigen::Ref<const Eigen::MatrixXd>& starts,
                             const PlacementOptions& options) {
  const Eigen::Index dim = held.rows(), count = held.cols(), points = distances.cols();
  if (dim < 1 || distances.rows() != count || weights.rows() != count ||
      (weights.cols() != 1 && weights.cols() != points) ||
      (starts.size() > 0 && (starts.rows() != dim || starts.cols() != points)))
    detail::raise(
        std::invalid_argument("expected a row of distances and weights for each point that is held"));
  Eigen::MatrixXd result = Eigen::MatrixXd::Constant(dim, points, std::numeric_limits<double>::quiet_NaN());
  const auto work = dim == 2 ? place_all<2> : dim == 3 ? place_all<3> : place_all<Eigen::Dynamic>;
  work(held, distances, weights, starts, options, result);
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
