#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <cmath>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The posterior of many chains of points, each with evidence at its own points and second differences along
/// it:
///
///   E(x) = sum_t 1/2 (x_t - m_t)^T A_t (x_t - m_t) + sum_t 1/2 w_t |a_t x_t + b_t x_{t+1} + c_t x_{t+2}|^2
///
/// and, where a longer chain was cut, what its former points say about the first two.
///
/// Each chain is a block band of width two, so that the factors, the minimum, log det and the covariances of
/// neighbouring points take time linear in the number of points. The chains are stored side by side: arrays
/// are (points, chains, ...), in C order.
template <int Dim>
class DifferenceChains {
 public:
  using Block = Eigen::Matrix<double, Dim, Dim>;  ///< of information, covariance or factors
  using Point = Eigen::Matrix<double, Dim, 1>;    ///< coordinates
  /// The entries of a symmetric block: its upper triangle, row by row.
  static constexpr int kEntries = Dim * (Dim + 1) / 2;

  /// information: A (points, chains, kEntries). coefficients: a, b, c (points - 2, 3). weight: w (points - 2,
  /// chains). prior, if any: the information about the first two points together (chains, 2 Dim, 2 Dim), for
  /// chains of two points or more. False if a chain is not positive definite.
  bool factorize(std::size_t points, std::size_t chains, const double* information,
                 const double* coefficients, const double* weight, const double* prior = nullptr) {
    points_ = points;
    chains_ = chains;
    inverse_.resize(points * chains * kEntries);
    next_.resize(points * chains * Dim * Dim);
    second_.resize(points * chains);
    log_det_.assign(chains, 0);
    // What is left of the rows t and t + 1, to which eliminated points have already contributed.
    std::vector<Block> here(chains), after(chains), coupling(chains);
    const auto diagonal = [&](std::size_t t, std::size_t j) {
      Block s = unpacked(information + (t * chains + j) * kEntries);
      double sum = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        if (t < k || t - k + 2 >= points) continue;
        const double c = coefficients[(t - k) * 3 + k];
        sum += weight[(t - k) * chains + j] * c * c;
      }
      s.diagonal().array() += sum;
      return s;
    };
    const auto neighbour = [&](std::size_t t, std::size_t j) {  // t and t + 1
      double sum = 0;
      for (std::size_t k = 0; k < 2; ++k) {
        if (t < k || t - k + 2 >= points) continue;
        const double* c = coefficients + (t - k) * 3;
        sum += weight[(t - k) * chains + j] * c[k] * c[k + 1];
      }
      return sum;
    };
    for (std::size_t j = 0; j < chains; ++j) {
      here[j] = diagonal(0, j);
      if (points > 1) after[j] = diagonal(1, j);
      coupling[j] = neighbour(0, j) * Block::Identity();
      if (prior == nullptr || points < 2) continue;
      const Eigen::Map<const Eigen::Matrix<double, 2 * Dim, 2 * Dim>> past(prior + j * 4 * Dim * Dim);
      here[j] += past.template topLeftCorner<Dim, Dim>();
      coupling[j] += past.template topRightCorner<Dim, Dim>();
      after[j] += past.template bottomRightCorner<Dim, Dim>();
    }
    for (std::size_t t = 0; t < points; ++t) {
      for (std::size_t j = 0; j < chains; ++j) {
        const Eigen::LLT<Block> llt(here[j]);
        if (llt.info() != Eigen::Success) return false;
        log_det_[j] += 2 * Block(llt.matrixL()).diagonal().array().log().sum();
        if (!std::isfinite(log_det_[j])) return false;
        const Block inverse = llt.solve(Block::Identity());
        const std::size_t i = t * chains + j;
        pack(inverse, inverse_.data() + i * kEntries);
        const double u2 = t + 2 < points ? weight[i] * coefficients[t * 3] * coefficients[t * 3 + 2] : 0.0;
        second_[i] = u2;
        const Block g1 = inverse * coupling[j];
        Eigen::Map<Block>(next_.data() + i * Dim * Dim) = g1;
        if (t + 1 == points) continue;
        here[j] = after[j] - coupling[j].transpose() * g1;
        if (t + 2 == points) continue;
        after[j] = diagonal(t + 2, j) - u2 * u2 * inverse;
        coupling[j] = neighbour(t + 1, j) * Block::Identity() - u2 * g1.transpose();
      }
    }
    return true;
  }

  /// The logarithm of the determinant of each chain's matrix.
  const std::vector<double>& log_det() const { return log_det_; }

  /// x (points, chains, Dim), which holds the right side A_t m_t, becomes the minimum.
  void solve(double* x) const {
    for (std::size_t t = 0; t < points_; ++t) {
      for (std::size_t j = 0; j < chains_; ++j) {
        const Point z = point(x, t, j);
        if (t + 1 < points_) point(x, t + 1, j).noalias() -= next(t, j).transpose() * z;
        if (t + 2 < points_) point(x, t + 2, j).noalias() -= second_[t * chains_ + j] * (inverse(t, j) * z);
      }
    }
    for (std::size_t t = points_; t-- > 0;) {
      for (std::size_t j = 0; j < chains_; ++j) {
        Point z = point(x, t, j);
        if (t + 2 < points_) z -= second_[t * chains_ + j] * point(x, t + 2, j);
        Point found = inverse(t, j) * z;
        if (t + 1 < points_) found.noalias() -= next(t, j) * point(x, t + 1, j);
        point(x, t, j) = found;
      }
    }
  }

  /// covariance: of each point (points, chains, kEntries). spread: the trace of the covariance of each
  /// difference (points - 2, chains). Takahashi's recursion from the last point.
  void covariance(const double* coefficients, double* covariance, double* spread) const {
    struct Window {
      Block first, second, both;  ///< Cov(t + 1), Cov(t + 2) and Cov(t + 1, t + 2)
    };
    std::vector<Window> windows(chains_);
    for (std::size_t t = points_; t-- > 0;) {
      for (std::size_t j = 0; j < chains_; ++j) {
        Window& w = windows[j];
        const Block s = inverse(t, j), g1 = next(t, j);
        Block c = s, c1 = Block::Zero(), c2 = Block::Zero();
        if (t + 1 < points_) {
          c1 = -g1 * w.first;
          if (t + 2 < points_) {
            const Block g2 = second_[t * chains_ + j] * s;
            c1 -= g2 * w.both.transpose();
            c2 = -g1 * w.both - g2 * w.second;
            c -= c1 * g1.transpose() + c2 * g2.transpose();
            const double* a = coefficients + t * 3;
            spread[t * chains_ + j] =
                a[0] * a[0] * c.trace() + a[1] * a[1] * w.first.trace() + a[2] * a[2] * w.second.trace() +
                2 * (a[0] * a[1] * c1.trace() + a[0] * a[2] * c2.trace() + a[1] * a[2] * w.both.trace());
          } else {
            c -= c1 * g1.transpose();
          }
        }
        c = (0.5 * (c + c.transpose())).eval();
        pack(c, covariance + (t * chains_ + j) * kEntries);
        w.second = w.first;
        w.both = c1;
        w.first = c;
      }
    }
  }

 private:
  static Block unpacked(const double* p) {
    Block s;
    for (int r = 0, i = 0; r < Dim; ++r) {
      for (int c = r; c < Dim; ++c, ++i) s(r, c) = s(c, r) = p[i];
    }
    return s;
  }
  static void pack(const Block& s, double* p) {
    for (int r = 0, i = 0; r < Dim; ++r) {
      for (int c = r; c < Dim; ++c, ++i) p[i] = s(r, c);
    }
  }
  Block inverse(std::size_t t, std::size_t j) const {
    return unpacked(inverse_.data() + (t * chains_ + j) * kEntries);
  }
  Eigen::Map<const Block> next(std::size_t t, std::size_t j) const {
    return Eigen::Map<const Block>(next_.data() + (t * chains_ + j) * Dim * Dim);
  }
  Eigen::Map<Point> point(double* x, std::size_t t, std::size_t j) const {
    return Eigen::Map<Point>(x + (t * chains_ + j) * Dim);
  }

  std::size_t points_ = 0, chains_ = 0;
  std::vector<double> inverse_;  ///< of the eliminated diagonal blocks S_t, packed
  std::vector<double> next_;     ///< S_t^-1 times the block (t, t + 1)
  std::vector<double> second_;   ///< the block (t, t + 2) is this times the identity
  std::vector<double> log_det_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
