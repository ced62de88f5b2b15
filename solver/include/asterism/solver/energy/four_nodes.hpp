#pragma once

// The border between Newton's method, or Sensitivity, and compiled kernels for four nodes; like that of the
// batches, it has no Eigen on it (asterism/solver/batch/batch_kernels.hpp says why).
#include <asterism/solver/base/export.hpp>

namespace asterism::lanes_v0_1 {

/// Four nodes in the plane with plain anchors, each pair linked by a spring, and the scales of the stopping
/// rule. Arrays are those of SpringSystem: x and y of a node are side by side; links are those of
/// Topology::full.
struct FourNodes {
  const double* anchors;           ///< of each node
  const double* anchor_stiffness;  ///< of each node
  const double* link_stiffness;    ///< of each link
  const double* rest_length;       ///< of each link
  const double* node_stiffness;    ///< A_ii
  double length;                   ///< the characteristic one
  double tolerance;                ///< of the stopping rule
};

/// Newton's iterate.
struct FourNodesSearch {
  FourNodes nodes;     ///< the system
  int max_iterations;  ///< at most
  bool realigns;       ///< after every step

  double* x;               ///< the start, then the last iterate
  bool clamps = true;      ///< the next matrix at x is the clamped one
  bool converged = false;  ///< by the stopping rule
  bool definite = false;   ///< the Hessian at x or one such last step before it, if converged
  int iterations = 0;      ///< taken
  int evaluations = 0;     ///< of energy and gradient
  int factorizations = 0;  ///< of Hessians
};

/// Takes Newton's steps from x, with the decisions of Newton::iterate, until it has converged or reached
/// max_iterations, or needs what only Newton does: saddles, and steps that do not lower the energy. False,
/// with x as it was, if there is no kernel for this processor or these values, or the energy hardly fell.
ASTERISM_API bool iterate_four_nodes(FourNodesSearch& at);

/// Derivatives of a function L of the solution x, see Sensitivity.
struct FourNodesGradient {
  const double* x;              ///< the solution
  const double* by_x;           ///< dL/dx
  double* by_anchors;           ///< dL/d(anchors); this and the following are results
  double* by_anchor_stiffness;  ///< of each node
  double* by_link_stiffness;    ///< of each link
  double* by_rest_length;       ///< of each link
};

/// Reverse mode of Sensitivity. False, with nothing written, if there is no kernel for this
/// processor or these values, or if one of Sensitivity's tests is not passed with room to spare.
ASTERISM_API bool differentiate_four_nodes(const FourNodes& at, const FourNodesGradient& gradient);

}  // namespace asterism::lanes_v0_1
