#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/joint.hpp>
#include <asterism/solver/discrete/layered_tree.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <atomic>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A joint whose parts have layers of scale.
struct ScaledJoint : Joint {
  /// The cost of the difference of the child's and the parent's layer [layers]; by default the square of the
  /// difference.
  AxisCost layer;
};

/// A place and a layer for each part.
struct ScaledPlacement : PartPlacement {
  Eigen::VectorXi layers;  ///< of each part, from 0
};

/// The best placement of parts that each have a map of costs for each of several layers of scale, linked to a
/// tree: PictorialStructure with the scale as a third axis. The energy
///   E(x, l) = sum_i f_i(x_i, l_i) + sum_joints cost((x_child - x_parent) / s) + layer(l_child - l_parent),
/// where s is the scale of the parent's layer, is minimised over all positions and layers of all parts:
/// offsets grow with the scale, and weights fall, so that a larger object is as deformable as a small one.
/// Exact, as PictorialStructure is; a joint is as many distance transforms as there are layers, and a minimum
/// over pairs of layers, so that the time is linear in the pixels.
///
/// All maps are on the image's pixels: a response that was computed in a pyramid has to be resampled. The
/// layers of a part have the same size; different parts may have different sizes, and any strides.
///
/// An object holds its workspace: reuse it to solve without allocation while the sizes of the maps, their
/// layers and the tree stay the same, one thread at a time.
class ScaledStructure {
 public:
  /// As PictorialStructure::stop.
  const std::atomic<bool>* stop = nullptr;

  /// Finds the best placement. `scales` are those of the layers, > 0, in any order; `maps` has that of part i
  /// in layer l at [i * layers + l]; `joints` is a tree of all parts. For bad input, or if every placement is
  /// forbidden, the status is InvalidInput, the message names what is wrong, and `best` stays as it was.
  PictorialSummary solve(std::span<const ScaledJoint> joints, std::span<const double> scales,
                         std::span<const MapView<const float>> maps, ScaledPlacement& best) {
    return tree_.solve(joints, scales, maps, stop, best);
  }

  /// The root of the last tree, -1 if the last solve was not successful. What follows needs a successful
  /// solve, and its maps, alive and unchanged.
  int root() const { return tree_.root(); }

  /// For each position of the root in a layer, the least energy of a placement that has it there; infinity if
  /// there is none. Valid until the next solve; empty for a layer that does not exist.
  MapView<const float> root_min_marginals(int layer) const { return tree_.root_min_marginals(layer); }

  /// Up to `count` good placements: the first is the best of all, and each further one is the best of all
  /// whose root, in any layer, is farther than `distance` [px] from the roots of those before it. Returns
  /// their number; `placements` is resized only if it is shorter. Without a successful solve, 0.
  int best_placements(int count, double distance, std::vector<ScaledPlacement>& placements) {
    return tree_.best_placements(count, distance, stop, placements);
  }

 private:
  detail::LayeredTree tree_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
