#pragma once

#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <functional>
#include <limits>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of locate().
struct LocateOptions {
  double within = 5;  ///< minima up to this much above the least energy are listed, >= 0
  /// From this residual on [sigma], > 0, a range counts as an outlier, which costs cutoff^2 / 2 wherever the
  /// position is. Infinity: least squares, without outliers.
  double cutoff = std::numeric_limits<double>::infinity();
  int max_cells = 1'000'000;  ///< of the search, >= 1; where more are needed, the result is not proven

  /// Null if the options are valid, otherwise what is wrong.
  const char* problem() const;
};

/// A local minimum of the energy of a position.
template <int Dim>
struct PositionMinimum {
  std::array<double, Dim> x;                 ///< position [m]
  std::array<double, Dim * Dim> covariance;  ///< inverse of the Hessian (Laplace's approximation) [m^2]
  double energy;  ///< 1/2 sum ((|x - b_i| - r_i) / sigma_i)^2, where no term exceeds cutoff^2 / 2
  double weight;  ///< its part of the posterior probability, by Laplace's approximation, of all listed minima
};

/// The result of locate().
template <int Dim>
struct PositionFix {
  static constexpr int kMost = 32;  ///< minima that can be listed

  Status status = Status::NotRun;  ///< Converged, or InvalidInput
  /// What is wrong, or what the geometry cannot tell, or why nothing is proven; may be empty.
  Message message;
  /// Whether it is proven, up to 1e-6 in energy and to rounding, that the first minimum is the global one and
  /// that all minima up to `within` above it are listed. Two minima between which the energy rises by less
  /// than 1e-6, on the straight line, count as one. In a curved valley that is flat to that much, several
  /// places may be listed.
  bool proven = false;
  double within = 0;  ///< LocateOptions::within, or less where that would be more than kMost minima
  int count = 0;      ///< of minima, at least 1 if Converged
  std::array<PositionMinimum<Dim>, kMost> minima;  ///< the lowest first
  int cells = 0;                                   ///< of the search; 0 where a closed form proved it all
};

/// The most probable position from ranges to M known beacons in the plane or in space (Dim 2 or 3), proven by
/// branch and bound: see docs/locate.md. Needs no heap for up to 64 beacons.
///
/// beacons: (M, Dim), beacon after beacon [m]. ranges: M numbers, >= 0; NaN where a beacon was not heard [m].
/// sigma: the standard deviation of each range, > 0 [m]; what belongs to a range of NaN is not read. The
/// status is InvalidInput, and the message names what is wrong, for anything else, and where no position can
/// be told: for beacons in one place, on one line in space, or fewer than Dim of them.
template <int Dim>
ASTERISM_API PositionFix<Dim> locate(std::span<const double> beacons, std::span<const double> ranges,
                                     std::span<const double> sigma, const LocateOptions& options = {});

/// Ranges of many tags.
struct RangeBatch {
  int tags = 0;                     ///< whose positions are asked for
  int beacons_per_tag = 0;          ///< M
  std::span<const double> beacons;  ///< (M, Dim) of all tags, or (tags, M, Dim)
  std::span<const double> ranges;   ///< (tags, M)
  std::span<const double> sigma;    ///< (M) of all tags, or (tags, M)
};

/// locate() for each tag: take(tag, fix) is called once for each, from several threads at the same time.
/// threads: including the calling one; 0: as many as the machine runs at once. is_stopped, if not empty, is
/// asked in the calling thread now and then; once it returns true, the other tags are left out. Returns false
/// then, or if the sizes do not match.
template <int Dim>
ASTERISM_API bool locate_each(const RangeBatch& batch, const LocateOptions& options, int threads,
                              const std::function<void(int tag, const PositionFix<Dim>& fix)>& take,
                              const std::function<bool()>& is_stopped = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
