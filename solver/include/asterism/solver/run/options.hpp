#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/energy/certifier_reference.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <atomic>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options that every solver has.
struct SolverOptions {
  /// Stop when stationarity(system, x), a ratio without units, is at most this. Invariant to translation,
  /// rotation and scale of the points and to the unit of stiffness. 1e-8 with nodes 30 px apart: no node
  /// would move by more than 3e-7 px if the others stood still. The unit of length is characteristic_length,
  /// in which also a weak spring counts if it is long: beside nodes that are very far away, nodes close
  /// together need a smaller tolerance. Judged at the x that is returned, wherever
  /// the start was. A tolerance below 64 epsilons of the scalar (1.4e-14, in float 8e-6) counts as that. One
  /// below the rounding of the coordinates, which are then far from the origin, may end at NoProgress, and
  /// the message says so; so may, below some 1e-7, methods that compare energies (Ceres).
  double tolerance = 1e-8;

  /// Also stop when the energy of x is proven to exceed the least energy by at most this share, see certify;
  /// 0: do not test this. The test computes a certificate at every iterate. Where W is not positive definite
  /// at the minimum, nothing is proven and the tolerance decides. BatchNewton tests this only at its end.
  /// Solvers by name, BatchNewton, BranchAndBound and all methods for a System need nothing else; all others
  /// need a certifier, below, without which a gap is InvalidInput.
  double gap = 0;

  /// Computes these certificates: a Certifier of the same type of systems, which lives as long as the
  /// solve and keeps its memory.
  ///
  ///     asterism::Certifier<System> certifier;
  ///     solver.options.gap = 1e-6;
  ///     solver.options.certifier = certifier;
  CertifierReference certifier = {};

  /// Maximum number of iterations; 0: only evaluate the start.
  int max_iterations = 10000;

  /// The treatment of a connected component that no anchor holds (links of zero stiffness do not count): its
  /// energy does not change as it moves. False: InvalidInput; the message names one of its nodes. True: its
  /// first node is held where the start has it, which costs no energy.
  bool hold_floating = false;

  /// If given, tested in every iteration: once another thread, a signal handler or a custom model has set it
  /// to true, the solve ends with Status::Interrupted. A step that cannot be interrupted, such as a
  /// factorisation, is completed first.
  const std::atomic<bool>* stop = nullptr;

  /// If given, called at the start and after each iteration with x, energy and gradient norm, to observe the
  /// solve or to stop it. Iterations are counted from 0 again when a method begins from another start or
  /// hands over to another method. BatchNewton does not call it.
  IterationCallback on_iteration = {};

  /// Measure the wall-clock time of the solve, for Summary::seconds. Off, as to read the clock is a tenth of
  /// the solve of four nodes. BatchNewton, methods with a limit of seconds and all for a System measure it in
  /// any case.
  bool measure_seconds = false;

  /// Whether `stop` was set.
  bool stopped() const { return stop != nullptr && stop->load(std::memory_order_relaxed); }

  /// The first problem of the options, or nullptr. Solvers with more options hide it by their own.
  constexpr const char* problem() const {
    if (!(tolerance >= 0) || !detail::is_finite(tolerance))
      return "option tolerance is negative or not finite";
    if (!(gap >= 0) || !detail::is_finite(gap)) return "option gap is negative or not finite";
    if (max_iterations < 0) return "option max_iterations is negative";
    return nullptr;
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, SolverOptions& options) {
  visit("tolerance", options.tolerance, {0, 1e9});
  visit("gap", options.gap, {0, 1e9});
  visit("max_iterations", options.max_iterations, {0, 1e9});
  visit("hold_floating", options.hold_floating);
  visit("measure_seconds", options.measure_seconds);
}

/// Options of solvers that can start with rigid_alignment of x (unless x is stationary, or max_iterations is
/// 0). The alignment is not counted as an iteration, cannot raise the energy, and removes the modes that are
/// slowest if anchors are weak.
struct AlignedOptions : SolverOptions {
  /// Start with rigid_alignment of x.
  bool align = true;

  /// The alignment may also mirror x. For constellations whose mirror image is as good.
  bool allow_reflection = false;

  constexpr AlignedOptions() = default;
  constexpr AlignedOptions(const SolverOptions& options) : SolverOptions(options) {}
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, AlignedOptions& options) {
  visit_options(visit, static_cast<SolverOptions&>(options));
  visit("align", options.align);
  visit("allow_reflection", options.allow_reflection);
}

/// Options of the paper's IDA.
struct IdaOptions : AlignedOptions {
  /// Over-relaxation w: each step is w times IDA's. 0 < w < 2, else InvalidInput; every such w is monotone,
  /// as E falls by at least w (1 - w / 2) g^T K_dyn^-1 g. 1 is the paper's algorithm. About 1.7 needs fewer
  /// iterations, but may end in another minimum.
  double relaxation = 1;

  /// Without alignment, as in the paper.
  constexpr IdaOptions() { align = false; }
  constexpr IdaOptions(const SolverOptions& options) : AlignedOptions(options) { align = false; }

  constexpr const char* problem() const {
    if (!(relaxation > 0 && relaxation < 2)) return "option relaxation is not between 0 and 2";
    return AlignedOptions::problem();
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, IdaOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("relaxation", options.relaxation, {1e-9, 2 - 1e-9});
}

/// Options of solvers for large systems that can use several threads.
struct ThreadedOptions : AlignedOptions {
  /// Threads that work at the same time, the calling one included; 0: as many as the machine runs at once.
  /// The result does not depend on it, bit for bit. For "schwarz", each takes memory for an int per node. The
  /// functions of a custom model are then called from several threads.
  int threads = 1;

  constexpr ThreadedOptions() = default;
  constexpr ThreadedOptions(const SolverOptions& options) : AlignedOptions(options) {}
  constexpr ThreadedOptions(const AlignedOptions& options) : AlignedOptions(options) {}

  constexpr const char* problem() const {
    if (threads < 0) return "option threads is negative";
    return AlignedOptions::problem();
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, ThreadedOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("threads", options.threads, {0, 4096});
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
