#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <atomic>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of place_points.
struct PlacementOptions {
  int threads = 1;  ///< 0: as many as the machine runs at once; the result does not depend on it
  const std::atomic<bool>* stop = nullptr;  ///< if set to true, the rest is NaN
};

/// Places points one by one, each where sum_k w_k (d_k - |x - h_k|)^2 over the points h_k, which are held, is
/// least: new points of multidimensional scaling.
///
/// held: dim x N. distances: N x M, a column for each new point; NaN is not known. weights: N x M, or N x 1
/// for all points, >= 0. starts: dim x M, or empty. Returns dim x M, in which a column is NaN if no distance
/// of its point is known. A point goes down from its start by Newton's method; without a start, from where
/// the squares of the distances, with the weights w / d^2, are nearest to those given, up to what they have
/// in common, as classical scaling has it (Gower 1968). In up to 5 dimensions it goes down from two starts,
/// and takes the lower minimum: the second is the mirror image of the first minimum in the nearest held
/// point. A point without a start is on a held point from which its distance is 0.
///
/// Throws std::invalid_argument for sizes that do not fit, and std::bad_alloc if memory runs out.
ASTERISM_API Eigen::MatrixXd place_points(const Eigen::Ref<const Eigen::MatrixXd>& held,
                                          const Eigen::Ref<const Eigen::MatrixXd>& distances,
                                          const Eigen::Ref<const Eigen::MatrixXd>& weights,
                                          const Eigen::Ref<const Eigen::MatrixXd>& starts = Eigen::MatrixXd(),
                                          const PlacementOptions& options = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
