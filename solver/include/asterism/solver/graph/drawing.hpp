#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/graph/graph.hpp>
#include <asterism/solver/graph/rules.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of draw_graph.
struct DrawingOptions {
  double power = 2;        ///< the weight of two nodes is their distance along the graph ^ -power
  int iterations = 0;      ///< 0: 60 up to 100,000 nodes, and 20 for more
  std::uint64_t seed = 1;  ///< of the paths that are drawn
  int threads =
      0;  ///< at most 4 are used; 0: as many as the machine runs at once; the result does not depend on it
  bool is_refining = false;  ///< x is nearly a drawing already: the steps are small from the first one on
  const std::atomic<bool>* stop = nullptr;  ///< if set to true, the drawing ends, with Status::Interrupted
};

/// Known positions of nodes: the energy w |x_i - a_i|^2 each. The default: none.
struct DrawingAnchors {
  std::span<const double> positions;  ///< dim for each node
  std::span<const double>
      weights;  ///< one for each node: 0 for none, infinite to hold the node there from the start
};

/// A start for draw_graph: `dim` coordinates for each node, each component around the origin, by classical
/// scaling of the distances to 50 pivots, each the farthest node from those before it (Brandes and Pich
/// 2006). Throws std::bad_alloc if memory runs out.
ASTERISM_API std::vector<double> pivot_start(const Graph& graph, int dim,
                                             const std::atomic<bool>* stop = nullptr);

/// Draws a large graph: moves x, `dim` (2 or 3) coordinates for each node, towards least stress
///
///   sum w_ij (d_ij - |x_i - x_j|)^2 over all pairs of nodes that a path joins, w_ij = d_ij ^ -power,
///
/// by stochastic gradient descent (Zheng, Pawar and Goodman 2018) in time of N log N and memory of N for an
/// iteration. Other than with fixed pivots (Ortmann, Klimenta and Brandes 2016), each iteration draws other
/// pairs: of the nodes around each node, by ascending distance, the nearest `b` always, the next 3 b with
/// the probability 1/4, the next 12 b with 1/16 and so on, with as many times their weights, so that the
/// expected value of their stress is that of all pairs. Components may overlap: they are drawn each for
/// itself.
///
/// The summary's final_energy is half the stress, estimated from such a sample of pairs, and initial_energy
/// that of the x given, from the same ones. If it is not lower, x is as it was, with Status::NoProgress;
/// Status::MaxIterations otherwise. Of Status::Interrupted both are -1. InvalidInput for a weight beyond the
/// range of double, as that of a path of length 0, for numbers of coordinates or weights that do not fit, and
/// for coordinates that are not finite or weights below 0; OutOfMemory.
///
/// With rules, x keeps to them exactly, even if its stress is then higher than that of the x given. After
/// each iteration, one pass moves apart what breaks a rule, and in the end x is moved as by apply_rules.
/// InvalidInput also where apply_rules has it.
ASTERISM_API Summary draw_graph(const Graph& graph, int dim, std::span<double> x,
                                const DrawingAnchors& anchors, const DrawingOptions& options,
                                const DrawingRules& rules = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
