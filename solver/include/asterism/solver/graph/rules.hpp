#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// An order of two nodes along an axis: x[after] - x[before] >= gap.
struct Separation {
  int before;  ///< a node
  int after;   ///< another one
  int axis;    ///< 0 to dim - 1
  double gap;  ///< >= 0 and finite
};

/// Rules that a drawing keeps exactly. Each member may be empty.
struct DrawingRules {
  /// The width and the height of each node's box, in whose middle the node is: >= 0 and finite. No two boxes
  /// overlap, but they may touch. Only in the plane.
  std::vector<double> sizes;
  /// Orders of nodes.
  std::vector<Separation> separations;
  /// `dim` for each node: coordinates that are given, NaN for those that are free.
  std::vector<double> fixed;
  /// `dim` for each node: nodes with the same number >= 0 have the same coordinate along that axis; -1 for
  /// nodes on their own.
  std::vector<int> aligned;
  /// One for each node: nodes with the same number >= 0 are kept together. The boxes that bound them overlap
  /// neither each other nor the boxes of nodes in no group, whose number is -1. Only in the plane. Nodes of
  /// different groups cannot be aligned.
  std::vector<int> groups;

  /// Whether there is none.
  bool empty() const {
    return sizes.empty() && separations.empty() && fixed.empty() && aligned.empty() && groups.empty();
  }
};

/// Options of apply_rules.
struct RuleOptions {
  int passes = 300;  ///< at most, before the rules are enforced in one sweep along each axis
  const std::atomic<bool>* stop = nullptr;  ///< if set to true, it ends, with Status::Interrupted
};

/// Moves points x, `dim` (2 or 3) coordinates each, so that they keep to the rules.
///
/// Passes over the boxes that overlap move the two of each pair apart, each by half, along the axis in which
/// they overlap less (a projected Gauss-Seidel method, as in Mueller et al. 2007). If some still overlap
/// after the last pass, their order along one axis and then along the other is kept from there on: then all
/// rules are differences of coordinates, of which the sweeps of a scan line find enough (Dwyer, Marriott and
/// Stuckey 2006), and x is moved to where they hold, about as little as possible.
///
/// Status::Converged, or InvalidInput with a message, and x as it was: sizes or coordinates that do not fit,
/// rules that contradict each other, or no room found between points whose coordinates are given.
/// `iterations` counts the passes.
ASTERISM_API Summary apply_rules(int dim, std::span<double> x, const DrawingRules& rules,
                                 const RuleOptions& options = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
