#pragma once

#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/solver/terms/system.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

// The methods for a System. Each keeps its options and no more: workspaces live for one solve.

/// Options of Newton's method, in addition to those of all methods.
struct SystemNewtonOptions : AlignedOptions {
  /// Continue from stationary points whose Hessian has a negative eigenvalue.
  bool escape_saddles = true;

  /// Begin with strong anchors if they are weak and the start is far from a minimum.
  bool continuation = true;

  constexpr SystemNewtonOptions() = default;
  constexpr SystemNewtonOptions(const AlignedOptions& options) : AlignedOptions(options) {}
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, SystemNewtonOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("escape_saddles", options.escape_saddles);
  visit("continuation", options.continuation);
}

/// Newton's method with a line search. Where the Hessian is not positive definite, or its step is too long
/// to be trusted, the step is that of the matrix without the elements' negative curvature (projected Newton;
/// Teran et al. 2005), plus a share of the nodes' stiffness. A saddle is left along a direction of negative
/// curvature.
///
/// Two things are for systems of more than 64 unknowns, where a factorisation is expensive for a short step.
/// If the Hessian at the start is not positive definite, weak anchors are made strong at first, and their
/// minimum is followed as they weaken a hundredfold at a time: while anchors pull the nodes along a curved
/// valley of the other terms' energy, steps are short, and the minimum hardly moves once anchors are far
/// weaker. The energy of the given system may rise on the way; if the way ends above the start's energy, the
/// solve begins again there. And steps without a positive definite Hessian, and those that the line search
/// shortens, alternate with turns of L-BFGS, whose steps cost and count as a hundredth. A chain, whose factor
/// is thin, takes no turns.
struct SystemNewton {
  SystemNewtonOptions options;
  std::string_view its_name = "Newton, sparse LDL^T";
  std::function<std::unique_ptr<SparseFactorization>()> make_factorization = nullptr;  // none: Eigen's

  std::string_view name() const { return its_name; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// Truncated Newton: conjugate gradients on the Hessian with its diagonal blocks as the preconditioner, to
/// the forcing term of Eisenstat and Walker (1996, choice 2), or to a direction of negative curvature.
struct SystemNewtonCg {
  AlignedOptions options;
  static constexpr std::string_view name() { return "Newton-CG"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// Limited memory BFGS (Nocedal & Wright, algorithm 7.4) that starts from the inverse of IDA's matrix, or
/// from the curvature at the start where there is no such bound, or from the nodes' stiffness. Where links of
/// about the same stiffness connect a third of all pairs or more, the matrix is that of all pairs, which
/// needs no factorisation.
struct SystemLbfgs {
  AlignedOptions options;
  static constexpr std::string_view name() { return "L-BFGS"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// Nonlinear conjugate gradients, Polak-Ribiere+, in the metric of the nodes' stiffness.
struct SystemCg {
  AlignedOptions options;
  static constexpr std::string_view name() { return "nonlinear CG"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// The paper's IDA: steps -K^-1 g with the majorising matrix K, which is factored once.
struct SystemIda {
  IdaOptions options;
  static constexpr std::string_view name() { return "IDA"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// L-BFGS where a term has no second derivatives; else Newton for up to 64 unknowns and for quadratic
/// energies, L-BFGS where a third of all pairs or more are linked and there is a majorising matrix to start
/// from, Newton up to 30,000 nodes for a floppy system or a chain on weak anchors or few, and Newton-CG up to
/// 1000 nodes (bench/laboratory/terms_auto.py). For more nodes with few elements each, as Auto for
/// SpringSystem: "schwarz", but where anchors are weak, Newton-CG up to 30,000 nodes and "schwarz-direct" up
/// to 300,000.
struct SystemAuto {
  ThreadedOptions options;
  static constexpr std::string_view name() { return "auto"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// Options of "multi-start", in addition to those of its solves.
struct MultiStartOptions : AlignedOptions {
  /// Number of starts: the given x, the anchors (for nodes whose anchor has stiffness; without any such node,
  /// a random displacement of x), and then, alternately, random displacements of these two.
  int starts = 8;

  /// Each coordinate is displaced by up to this many times the characteristic_length.
  double spread = 0.5;

  /// Seed of the displacements: the same seed gives the same starts on every machine.
  std::uint64_t seed = 1;

  constexpr const char* problem() const {
    if (starts < 1) return "option starts is not positive";
    if (!(spread >= 0 && spread <= 1e6)) return "option spread is not between 0 and 1e6";
    return AlignedOptions::problem();
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, MultiStartOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("starts", options.starts, {1, 1e9});
  visit("spread", options.spread, {0, 1e6});
  visit("seed", options.seed);
}

/// The lowest of the minima from many starts, which MultiStartOptions lists. The first is the given one, so
/// that the result is never worse than that of "auto"; of equal minima, that of the earlier start is kept.
struct SystemMultiStart {
  MultiStartOptions options;
  static constexpr std::string_view name() { return "multi-start"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// Alternating minimisation over overlapping subdomains, for large sparse systems (Schwarz's method for
/// minimisation: Tai & Espedal 1998), finished by a method for all nodes at once.
///
/// A large system is slow to solve not because of its size but because of its worst places: springs far from
/// their rest length, where the energy is not convex, limit the length of a step of all nodes together, and
/// more nodes have more such places. Here each subdomain, some hundred connected nodes and their neighbours,
/// is minimised by Newton-CG on its own, with the others held, so that each place takes the steps that it
/// needs, in cache. All of them are a sweep, which never raises the energy: color by color, as subdomains of
/// one color do not depend on each other, and can be minimised on several threads. When sweeps gain little,
/// `Global` (Newton-CG; Newton's method where anchors are weak beside the links) has to correct what is
/// smooth over many subdomains, which it does in a few steps. Where it does not, sweeps and Global take
/// turns.
///
/// Summary::iterations counts sweeps and iterations of Global; the other counts are of work on all nodes at
/// once. Summary::positive_definite stays empty. Time and memory of a sweep are O(nodes + elements). A common
/// length depends on all elements of its term, and leaves nothing to divide: Global solves such a system
/// alone.
template <typename Global>
struct SystemSchwarz {
  ThreadedOptions options;
  static constexpr std::string_view name() {
    return std::is_same_v<Global, SystemNewton> ? "Schwarz, sparse LDL^T" : "Schwarz, Newton-CG";
  }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};
extern template struct SystemSchwarz<SystemNewtonCg>;
extern template struct SystemSchwarz<SystemNewton>;

/// The most dimensions that the staircase adds.
inline constexpr int kMostLifts = 3;
/// Why the staircase cannot solve the system; empty if it can.
std::string why_not_liftable(const System& system);

/// The Riemannian staircase, see solve_staircase.
struct SystemStaircase {
  StaircaseOptions options;
  static constexpr std::string_view name() { return "staircase"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

/// Options of graduated non-convexity, in addition to those of its solves.
struct GraduatedOptions : AlignedOptions {
  /// From one solve to the next, the losses come nearer to themselves by this factor.
  double factor = 1.4;

  constexpr const char* problem() const {
    if (!(factor >= 1.001 && factor <= 1e6)) return "option factor is not between 1.001 and 1e6";
    return AlignedOptions::problem();
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, GraduatedOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("factor", options.factor, {1.001, 1e6});
}

/// Graduated non-convexity (Blake and Zisserman 1987): solves the system with plain springs first, then with
/// losses that come from a convex one to the given one, each from the last solution, as Yang et al. (2020)
/// do. Where many elements are outliers, it finds the placement that the others agree on. Nothing is proven.
/// If the sequence fails or leads above the start, the result is that of "auto" alone.
struct SystemGraduated {
  GraduatedOptions options;
  static constexpr std::string_view name() { return "graduated non-convexity"; }
  Summary solve(const System& system, Eigen::MatrixXd& x) const;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
