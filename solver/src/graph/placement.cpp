#include <algorithm>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/graph/placement.hpp>
#include <asterism/solver/run/executor.hpp>
#include <limits>
#include <stdexcept>
#include <vector>

#include "../terms/kernels.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

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
  const Eigen::MatrixXd at = held;  // without gaps
  Eigen::MatrixXd result = starts;
  result.resize(dim, points);
  constexpr Eigen::Index kChunk = 256;
  const int threads = detail::thread_count(options.threads);
  std::vector<Eigen::VectorXd> rooms(static_cast<std::size_t>(threads));
  detail::for_each_task(
      threads, static_cast<int>((points + kChunk - 1) / kChunk), [&](int worker, int chunk) {
        const Eigen::Index first = chunk * kChunk, here = std::min(kChunk, points - first);
        if (options.stop != nullptr && *options.stop) {
          result.middleCols(first, here).setConstant(std::numeric_limits<double>::quiet_NaN());
          return;
        }
        Eigen::VectorXd& room = rooms[static_cast<std::size_t>(worker)];
        room.resize(lanes_v0_1::kMostLanes * (2 * count + 6 + 9 * dim + 3 * dim * (dim + 1) / 2));
        lanes_v0_1::place({.held = static_cast<int>(count),
                           .dim = static_cast<int>(dim),
                           .at = at.data(),
                           .count = static_cast<int>(here),
                           .distances = distances.col(first).data(),
                           .distances_stride = distances.outerStride(),
                           .weights = weights.col(weights.cols() == 1 ? 0 : first).data(),
                           .weights_stride = weights.cols() == 1 ? 0 : weights.outerStride(),
                           .have_starts = starts.size() > 0,
                           .places = result.col(first).data(),
                           .room = room.data()});
      });
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
