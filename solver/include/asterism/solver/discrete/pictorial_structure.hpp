#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/joint.hpp>
#include <asterism/solver/discrete/layered_tree.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <atomic>
#include <new>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The best placement of parts that each have a map of costs, linked to a tree by costs of displacement: a
/// pictorial structure (Fischler and Elschlager 1973; Felzenszwalb and Huttenlocher, IJCV 2005). The energy
///   E(x) = sum_i f_i(x_i) + sum_joints cost(x_child - x_parent)
/// is minimised over all positions of all parts by dynamic programming (min-sum) from the leaves to the root;
/// each joint is one generalised distance transform, so that the time is linear in the pixels of all maps.
///
/// The result is exact, for any maps: no placement has a lower energy, up to the rounding of sums of floats
/// (see DistanceTransform). If several placements have the least energy, one of them is found. Maps may have
/// different sizes and strides; a position is in pixels of the part's own map, so that an offset between two
/// maps' origins belongs into the joint's offset. Infinity in a map forbids a position, and an energy above
/// the range of float counts as infinite.
///
/// An object holds its workspace: reuse it to solve without allocation while the sizes of the maps and the
/// tree stay the same, one thread at a time.
class PictorialStructure {
 public:
  /// If given, tested at every part and every further placement: once another thread has set it to true, a
  /// solve ends with Status::Interrupted and leaves `best` as it was, and best_placements finds no more.
  const std::atomic<bool>* stop = nullptr;

  /// Finds the best placement. `joints` is a tree of all parts, in any order: its root is the part that is no
  /// child. `maps` has a map for each part. For bad input, or if every placement is forbidden, the status is
  /// InvalidInput, the message names the joint or the map, and `best` stays as it was.
  PictorialSummary solve(std::span<const Joint> joints, std::span<const MapView<const float>> maps,
                         PartPlacement& best) {
    constexpr double kOneLayer[] = {1};
    return tree_.solve(joints, std::span<const double>(kOneLayer), maps, stop, best);
  }

  /// The root of the last tree, -1 if the last solve was not successful. What follows needs a successful
  /// solve, and its maps, alive and unchanged.
  int root() const { return tree_.root(); }

  /// The root's min-marginals: for each position of the root, the least energy of a placement that has it
  /// there; infinity if there is none. Valid until the next solve.
  MapView<const float> root_min_marginals() const { return tree_.root_min_marginals(0); }

  /// The same for any part, to a map of the part's size. Two distance transforms for each joint between the
  /// part and the root. Returns what is wrong with the input, or an empty text.
  Message min_marginals(int part, const MapView<float>& result) { return tree_.min_marginals(part, result); }

  /// Up to `count` good placements whose roots differ: the first is the best of all, and each further one
  /// is the best of all placements whose root is farther than `distance` [px] from the roots of those before
  /// it. Each is exact in that sense. They are not the placements of the `count` lowest energies: two that
  /// have their roots at the same place, or near to each other, are not both found. Fewer are found if no
  /// root is left. Returns their number; `placements` is resized only if it is shorter. Without a successful
  /// solve, 0.
  int best_placements(int count, double distance, std::vector<PartPlacement>& placements) {
    return tree_.best_placements(count, distance, stop, placements);
  }

 private:
  detail::LayeredTree tree_;
};

/// The result of pictorial_structure.
struct PictorialResult : PictorialSummary {
  PartPlacement best;  ///< the best placement
  int root = -1;       ///< the part that is no child
  /// The root's min-marginals, height x width of its map: see PictorialStructure.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> min_marginals;
};

/// The best placement of parts on a tree, with a workspace of its own; see PictorialStructure, which solves
/// repeatedly without allocation and has further placements and the min-marginals of all parts.
inline PictorialResult pictorial_structure(std::span<const Joint> joints,
                                           std::span<const MapView<const float>> maps) {
  PictorialResult result;
  PictorialStructure structure;
  static_cast<PictorialSummary&>(result) = structure.solve(joints, maps, result.best);
  if (!result.usable()) return result;
  result.root = structure.root();
  const MapView<const float> marginals = structure.root_min_marginals();
  detail::attempt<std::bad_alloc>(
      [&] {
        result.min_marginals =
            decltype(result.min_marginals)::Map(marginals.data, marginals.height, marginals.width);
      },
      [&](const std::bad_alloc& error) {
        static_cast<PictorialSummary&>(result) = PictorialSummary();
        result.status = Status::OutOfMemory;
        result.message = detail::memory_message(error);
      });
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
