#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/linear/difference_chain.hpp>
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
    for (std::size_t j = 0; j < chains; ++j) {
      const auto sum_logs = [&](double pivot) { log_det_[j] += std::log(pivot); };
      chain(j, coefficients)
          .factorize(information + j * kEntries, weight + j,
                     prior == nullptr ? nullptr : prior + j * 4 * Dim * Dim, sum_logs);
      if (!std::isfinite(log_det_[j])) return false;
    }
    return true;
  }

  /// The logarithm of the determinant of each chain's matrix.
  const std::vector<double>& log_det() const { return log_det_; }

  /// x (points, chains, Dim), which holds the right side A_t m_t, becomes the minimum.
  void solve(double* x) const {
    for (std::size_t j = 0; j < chains_; ++j) chain(j, nullptr).solve(x + j * Dim);
  }

  /// covariance: of each point (points, chains, kEntries). spread: the trace of the covariance of each
  /// difference (points - 2, chains). Takahashi's recursion from the last point.
  void covariance(const double* coefficients, double* covariance, double* spread) const {
    for (std::size_t j = 0; j < chains_; ++j)
      chain(j, coefficients).covariance(covariance + j * kEntries, spread + j);
  }

 private:
  using Chain = lanes_v0_1::DifferenceChain<Dim, double>;

  // Of which const functions only read.
  Chain chain(std::size_t j, const double* coefficients) const {
    const auto factors = [](const std::vector<double>& of, std::size_t at) {
      return const_cast<double*>(of.data()) + at;
    };
    return {static_cast<std::ptrdiff_t>(points_), static_cast<std::ptrdiff_t>(chains_), coefficients,
            factors(inverse_, j * kEntries),      factors(next_, j * Dim * Dim),        factors(second_, j)};
  }

  std::size_t points_ = 0, chains_ = 0;
  std::vector<double> inverse_;  ///< of the eliminated diagonal blocks S_t, packed
  std::vector<double> next_;     ///< S_t^-1 times the block (t, t + 1), by rows
  std::vector<double> second_;   ///< the block (t, t + 2) is this times the identity
  std::vector<double> log_det_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
