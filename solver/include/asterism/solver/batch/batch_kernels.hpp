#pragma once

// The border between the headers in asterism/solver/batch and their compiled kernels. No Eigen and no
// standard library on it: the kernels are compiled for wider instructions than their callers, and whatever
// both would emit, the linker could take from either. For the same reason its names do not depend on Eigen's
// alignment, so that one build of the kernels serves programs compiled for any machine.
#include <asterism/solver/base/export.hpp>
#include <cstddef>
#include <cstdint>

/// Moves with the library's version.
namespace asterism::lanes_v0_1 {

/// The state of a system of a batch after its kernel ran.
enum Outcome : std::int32_t {
  kLeft = 0,       ///< x is as it was: the system is for the scalar solver, which also says what is wrong
  kConverged = 1,  ///< stationary, the last Hessian that was factored is positive definite
  kStopped = 2,    ///< the iterations ran out before
};

/// Systems of one topology in structure-of-arrays form. A plane holds one number of every system; planes of
/// one kind follow each other at `stride` elements, those of points in the order of a Dim x N column-major
/// matrix.
template <typename T>
struct SystemPlanes {
  int nodes;
  int link_count;
  bool is_full;              ///< the links are Topology::full's, in its order
  const std::int32_t* ends;  ///< the two nodes of every link
  std::ptrdiff_t stride;     ///< at least the number of systems and kPadding more, all of it readable
  const T* anchors;
  const T* anchor_stiffness;
  const T* rest_length;
  const T* link_stiffness;
};

/// The arrays that a solver reads and writes.
template <typename T>
struct Planes : SystemPlanes<T> {
  T* x;
  T* work;  ///< kernel's own: work_planes(...) of them

  T* initial_energy;  ///< one plane each, written where the outcome is not kLeft
  T* final_energy;
  T* stationarity;
  T* lower_bound;  ///< of the least energy; written, in double alone, where Settings::prove asks for it
  std::int32_t* iterations;
  std::int32_t* outcome;
};

/// The arrays from which derivatives of solutions are computed, and to which they are written; those of
/// systems whose outcome is kConverged may be used.
template <typename T>
struct GradientPlanes : SystemPlanes<T> {
  const T* x;       ///< solutions
  const T* grad_x;  ///< dL/dx
  T* by_anchors;    ///< dL/d(anchors) and so on
  T* by_anchor_stiffness;
  T* by_rest_length;
  T* by_link_stiffness;
  std::int32_t* outcome;
};

struct Settings {
  double tolerance;
  int max_iterations;
  bool align;
  bool prove;
};

constexpr int kPadding = 32;  ///< lanes of the widest kernel

constexpr int work_planes(int dim, int nodes) { return dim * nodes + nodes + 6; }

/// The kernels for a topology, for the systems first, ..., last - 1.
template <typename T>
struct Kernels {
  void (*solve)(const Planes<T>& planes, const Settings& settings, std::ptrdiff_t first, std::ptrdiff_t last);
  /// Of connected topologies of at least two nodes; x is to be stationary to `stationarity`.
  void (*differentiate)(const GradientPlanes<T>& planes, double stationarity, std::ptrdiff_t first,
                        std::ptrdiff_t last);
};

/// The kernels for a topology, nullptr where there are none.
template <typename T>
using KernelsFor = Kernels<T> (*)(int dim, int nodes, int link_count, bool is_full);

/// One instruction set.
struct KernelSet {
  KernelsFor<float> of_float;
  KernelsFor<double> of_double;
};

enum Isa : int { kPortable = 0, kAvx2 = 1, kAvx512 = 2 };

/// The kernels for an instruction set, nullptr where this build or this machine does not have it.
ASTERISM_API const KernelSet* kernels(Isa isa);

}  // namespace asterism::lanes_v0_1
