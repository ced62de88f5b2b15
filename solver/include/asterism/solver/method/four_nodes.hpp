#pragma once

// The border between Newton's method and its compiled kernel for four nodes; like that of the batches, it has
// no Eigen on it (asterism/solver/batch/batch_kernels.hpp says why).
#include <asterism/solver/base/export.hpp>

namespace asterism::lanes_v0_1 {

/// Four nodes in the plane with plain anchors, each pair linked by a spring, and Newton's iterate. Arrays are
/// those of SpringSystem: x and y of a node are side by side; links are those of Topology::full.
struct FourNodes {
  const double* anchors;           ///< of each node
  const double* anchor_stiffness;  ///< of each node
  const double* link_stiffness;    ///< of each link
  const double* rest_length;       ///< of each link
  const double* node_stiffness;    ///< A_ii
  double length;                   ///< the characteristic one
  double tolerance;                ///< of the stopping rule
  int max_iterations;              ///< at most
  bool realigns;                   ///< after every step

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
ASTERISM_API bool iterate_four_nodes(FourNodes& at);

}  // namespace asterism::lanes_v0_1
