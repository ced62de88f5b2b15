#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/energy/newton_kernels.hpp>
#include <asterism/solver/linear/vector_kernels.hpp>
#include <cstddef>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The last steps of a descent with the changes of the gradient, and the direction H g of L-BFGS that follows
/// from them and a metric M, in the compact form of Byrd, Nocedal and Schnabel (1994, Eq. 3.1):
///
///     H = gamma M^-1 + [S, gamma W] [R^-T (D + gamma Y^T W) R^-1, -R^-T; -R^-1, 0] [S, gamma W]^T
///
/// where S and Y have the steps and changes of the gradient as columns, W = M^-1 Y, R is the upper triangle
/// of S^T Y and D its diagonal. A gradient takes one solve with M, and two passes over S and W. `kSize` is
/// the number of coordinates and `kMaxSize` the largest, or Eigen::Dynamic. `kHasKernels`: vectors are those
/// of the widest instructions, by kernels of asterism::system.
template <typename Scalar, int kSize, int kMaxSize, int kMemory, bool kHasKernels>
class LbfgsPairs {
 public:
  bool empty() const { return used_ == 0; }

  /// Forgets all pairs, of points with so many coordinates.
  void clear(Eigen::Index size) {
    used_ = 0;
    next_ = 0;
    if constexpr (kSize == Eigen::Dynamic) size_ = size;
    columns_.setZero(rows(static_cast<int>(size)), 2 * kMemory);
    steps_changes_ = changes_changes_ = {};
    of_gradient_ = {};
  }

  /// Writes -H g for the gradient g of the last `add`, which is given again; `descent` is -M^-1 g. Returns
  /// its product with the gradient.
  template <typename Points>
  Scalar direction(const Points& descent, const Points& gradient, Points& result) const {
    if (used_ == 0) {
      result = descent;
      return gradient.cwiseProduct(result).sum();
    }
    result.resizeLike(descent);
    std::array<Scalar, kPairs> u{};  // R^-1 S^T g
    Products weights{};              // of all columns
    for (int i = used_ - 1; i >= 0; --i) {
      const std::size_t at = slot(i);
      Scalar rest = of_gradient_[at];
      for (int j = used_ - 1; j > i; --j) rest -= steps_changes_[at][slot(j)] * u[slot(j)];
      u[at] = rest * inverse_curvatures_[at];
    }
    for (int i = 0; i < used_; ++i) {  // -R^-T ((D + gamma Y^T W) u - gamma W^T g)
      const std::size_t at = slot(i);
      Scalar changed = -of_gradient_[kPairs + at];
      for (std::size_t j = 0; j < kPairs; ++j) changed += changes_changes_[at][j] * u[j];
      Scalar rest = -steps_changes_[at][at] * u[at] - gamma_ * changed;
      for (int j = 0; j < i; ++j) rest -= steps_changes_[slot(j)][at] * weights[slot(j)];
      weights[at] = rest * inverse_curvatures_[at];
    }
    for (std::size_t c = 0; c < kPairs; ++c) weights[kPairs + c] = gamma_ * u[c];
    return add_columns(weights, descent, gradient, result);
  }

  /// Remembers `step` times `direction`, which has led to `gradient`, unless the slope along it has hardly
  /// changed or has fallen. The slopes are those along `direction` before and there; the descents -M^-1 g
  /// likewise.
  template <typename Points>
  void add(Scalar step, const Points& direction, Scalar slope_before, Scalar slope, const Points& gradient,
           const Points& gradient_before, const Points& descent, const Points& descent_before) {
    constexpr Scalar kCurvature = Scalar(1e-3);              // least change of the slope
    const Scalar curvature = step * (slope - slope_before);  // s . y
    const bool is_taken = curvature > kCurvature * step * -slope_before;
    const auto before = of_gradient_;
    const std::size_t newest = next_;
    if (is_taken) {
      next_ = (next_ + 1) % kPairs;
      used_ = std::max(used_, static_cast<int>(newest) + 1);
    }
    const Scalar newest_before =
        update(is_taken, newest, step, direction, descent, descent_before, gradient, gradient_before);
    if (!is_taken) return;
    for (std::size_t i = 0; i < kPairs; ++i) {
      if (i == newest) continue;
      steps_changes_[i][newest] = of_gradient_[i] - before[i];
      changes_changes_[i][newest] = changes_changes_[newest][i] =
          of_gradient_[kPairs + i] - before[kPairs + i];
    }
    steps_changes_[newest][newest] = curvature;
    inverse_curvatures_[newest] = 1 / curvature;
    const Scalar square = of_gradient_[kPairs + newest] - newest_before;  // y . M^-1 y
    changes_changes_[newest][newest] = square;
    gamma_ = curvature / square;
    if (!(gamma_ > 0 && is_finite(gamma_))) clear(size());
  }

 private:
  static constexpr std::size_t kPairs = kMemory;
  static constexpr int rows(int size) {
    return size == Eigen::Dynamic ? size : static_cast<int>(lanes_v0_1::aligned_rows(size));
  }
  // Coordinates at a time.
  static constexpr int kWidth =
      std::max<int>(2, static_cast<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(Scalar)));
  using Pack = Eigen::Array<Scalar, kWidth, 1>;
  using Products = std::array<Scalar, 2 * kPairs>;
  using Square = std::array<std::array<Scalar, kPairs>, kPairs>;

  Eigen::Index size() const { return kSize == Eigen::Dynamic ? size_ : kSize; }

  // The slot of the pair that is `age`-th oldest.
  std::size_t slot(int age) const {
    const auto at = static_cast<std::size_t>(age);
    if (used_ < kMemory) return at;
    return next_ + at < kPairs ? next_ + at : next_ + at - kPairs;
  }

  lanes_v0_1::Columns columns() const {
    return {columns_.data(), columns_.rows(), 2 * kMemory, static_cast<int>(size())};
  }

  // Writes the columns of the newest pair, if it is taken, and S^T g and W^T g; slots that are not in use are
  // 0. The product of the newest column of W with `gradient_before`.
  template <typename Points>
  Scalar update(bool is_taken, std::size_t newest, Scalar step, const Points& direction,
                const Points& descent, const Points& descent_before, const Points& gradient,
                const Points& gradient_before) {
    Scalar* const step_column = columns_.data() + static_cast<Eigen::Index>(newest) * columns_.rows();
    Scalar* const change_column = step_column + static_cast<Eigen::Index>(kPairs) * columns_.rows();
    if constexpr (kHasKernels && std::is_same_v<Scalar, double>) {
      if (size() >= lanes_v0_1::kLeastKernelSize)
        return lanes_v0_1::update({.columns = columns(),
                                   .step_column = is_taken ? step_column : nullptr,
                                   .change_column = change_column,
                                   .step = step,
                                   .direction = direction.data(),
                                   .descent = descent.data(),
                                   .descent_before = descent_before.data(),
                                   .gradient = gradient.data(),
                                   .gradient_before = gradient_before.data(),
                                   .products = of_gradient_.data()});
    }
    Scalar newest_before = 0;
    if (is_taken) {
      using Row = Eigen::Map<const Eigen::Array<Scalar, kSize, 1>>;
      using Column = Eigen::Map<Eigen::Array<Scalar, kSize, 1>>;
      const auto row = [&](const Points& points) { return Row(points.data(), size()); };
      Column change(change_column, size());
      Column(step_column, size()) = step * row(direction);
      change = row(descent_before) - row(descent);
      newest_before = (change * row(gradient_before)).sum();
    }
    const Eigen::Index whole = size() - size() % kWidth, stride = columns_.rows();
    Pack sums[2 * kMemory];
    for (Pack& sum : sums) sum.setZero();
    for (Eigen::Index i = 0; i < whole; i += kWidth) {
      const Pack at = Eigen::Map<const Pack>(gradient.data() + i);
      for (int c = 0; c < 2 * kMemory; ++c)
        sums[c] += Eigen::Map<const Pack>(columns_.data() + c * stride + i) * at;
    }
    for (int c = 0; c < 2 * kMemory; ++c) {
      Scalar& product = of_gradient_[static_cast<std::size_t>(c)];
      product = sums[c].sum();
      for (Eigen::Index i = whole; i < size(); ++i) product += columns_(i, c) * gradient.data()[i];
    }
    return newest_before;
  }

  // result = gamma descent + the columns times their weights. Its product with the gradient.
  template <typename Points>
  Scalar add_columns(const Products& weights, const Points& descent, const Points& gradient,
                     Points& result) const {
    if constexpr (kHasKernels && std::is_same_v<Scalar, double>) {
      if (size() >= lanes_v0_1::kLeastKernelSize)
        return lanes_v0_1::add(
            {columns(), weights.data(), gamma_, descent.data(), gradient.data(), result.data()});
    }
    const Eigen::Index whole = size() - size() % kWidth, stride = columns_.rows();
    const Scalar* const first = descent.data();
    Scalar* const to = result.data();
    for (Eigen::Index i = 0; i < whole; i += kWidth) {
      Pack sum = gamma_ * Eigen::Map<const Pack>(first + i);
      for (int c = 0; c < 2 * kMemory; ++c) {
        sum +=
            weights[static_cast<std::size_t>(c)] * Eigen::Map<const Pack>(columns_.data() + c * stride + i);
      }
      Eigen::Map<Pack>(to + i) = sum;
    }
    for (Eigen::Index i = whole; i < size(); ++i) {
      to[i] = gamma_ * first[i];
      for (int c = 0; c < 2 * kMemory; ++c) to[i] += weights[static_cast<std::size_t>(c)] * columns_(i, c);
    }
    return gradient.cwiseProduct(result).sum();
  }

  // S and W. What follows is initialised for a new object to be moved into this one.
  Eigen::Matrix<Scalar, rows(kSize), 2 * kMemory, Eigen::ColMajor, rows(kMaxSize), 2 * kMemory> columns_;
  Square steps_changes_{}, changes_changes_{};  // S^T Y (upper triangle by age), Y^T W
  std::array<Scalar, kPairs> inverse_curvatures_{};
  Products of_gradient_{};  // S^T g and W^T g
  Scalar gamma_ = 1;
  Eigen::Index size_ = 0;  // if it is not known before
  int used_ = 0;           // pairs remembered
  std::size_t next_ = 0;   // slot of the next
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
