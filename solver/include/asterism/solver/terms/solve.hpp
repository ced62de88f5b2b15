#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/system.hpp>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Moves x (dim x nodes), the start, to a minimum of the energy: by Newton's method, by Newton-CG for large
/// systems with few links, by Schwarz's method for more than 1000 nodes with few links, and by L-BFGS for
/// those with many and where a term has no second derivatives. Bad input leaves x as it was and is named in
/// the summary. It throws only what a function of the user's throws.
ASTERISM_API Summary solve(const System& system, Eigen::MatrixXd& x, const AlignedOptions& options = {});

/// The same by the method of a name, see system_methods: "auto", "newton", "newton-cg", "lbfgs", "ncg",
/// "ida", "schwarz", "schwarz-direct", "multi-start", "staircase", "graduated". Throws std::invalid_argument
/// that names the nearest for an unknown one. For the options of one method alone, include
/// <asterism/solver/terms/registry.hpp>.
ASTERISM_API Summary solve(std::string_view method, const System& system, Eigen::MatrixXd& x,
                           const AlignedOptions& options = {});

/// The names of these methods.
ASTERISM_API std::vector<std::string_view> system_methods();

/// Options of solve_staircase.
struct StaircaseOptions : AlignedOptions {
  /// As on_iteration, which is not called there, for the iterations in more dimensions: x has more rows than
  /// a point of the system, and the energy is below that of the system.
  IterationCallback on_lifted_iteration = {};
};

/// The global minimum, or an interval that holds its energy: the Riemannian staircase of Boumal (2015), which
/// CORA climbs for range-aided SLAM (Papalia et al. 2023). By name, "staircase".
///
/// "auto" finds a minimum x. If certify does not prove it to be the lowest, the Hessian W of the energy in a
/// dimension that x does not use may have a negative direction v: the same system with one more dimension,
/// see Term::lifted, descends along v to a minimum, which is no higher than any in dim dimensions if W is
/// positive semi-definite there. If it is not, up to two more dimensions are added one by one. Its energy, as
/// far as it is proven despite rounding, is a lower bound. Without their last coordinates, its nodes are
/// another start for "auto". For up to 200 nodes the minimum is found to a finer tolerance; with more, all
/// nodes are moved in each new dimension.
///
/// With SolverOptions::gap, the climb ends where the interval is as narrow, and if none is and there are up
/// to 200 nodes, the space is divided around up to three nodes with plain anchors, each part with a bound of
/// its own.
///
/// The lower of both minima is returned. Summary::lower_bound is the lower end of the interval and
/// final_energy the upper; if their distance is within SolverOptions::gap (1e-6 if that is 0), the message
/// says that this is the global minimum. Where a term's curvature has no bound from below, the only lower
/// bound is 0. The Summary is that of the solve that found x, except that iterations, evaluations, linear
/// solves, factorisations and time are totals, and the initial energy is that of the given x. Statuses are
/// those of "auto"; a system with a term that is not liftable, such as loads, is refused by its name.
ASTERISM_API Summary solve_staircase(const System& system, Eigen::MatrixXd& x,
                                     const StaircaseOptions& options = {});

/// Options of solve_turning.
struct TurningOptions : AlignedOptions {
  /// The offsets also grow and shrink with the constellation; otherwise they only turn.
  bool scale = true;
};

/// Offsets that turn and scale with the constellation: minimises the energy in which a link prefers T m in
/// place of its offset m, over the placement x and one rotation T (dim x dim), with `scale` one similarity
/// (without reflection), for all links. Like the lengths of springs, the shape of a pictorial structure is
/// then the same however the object is turned.
///
/// If all links are offsets, or springs without rest length, and all anchors plain springs, the result is the
/// global minimum, whatever the start. For then the best x for a given T is x_0 + T y, with y the placement
/// that the offsets would have if all anchors were at the origin, and the energy of that x is, up to a
/// constant, 1/2 trace(T S T^T) - trace(C^T T) with dim x dim matrices S and C (variable projection, Golub
/// and Pereyra 1973). As trace(R S R^T) = trace(S) for every rotation R, the best T = s R is a Procrustes
/// problem in closed form.
///
/// For any other link or anchor the same step minimises IDA's quadratic, which lies above the energy, over x
/// and T together. "auto" then minimises the energy for that T, and so on until neither moves; no turn raises
/// the energy, and the sequence of T is extrapolated (Anderson 1965; Walker and Ni 2011).
///
/// The Summary is that of the last solve, except that iterations, evaluations, linear solves, factorisations
/// and time are totals, the initial energy is that of the given x and the best T there, and stationarity is
/// that of x or, if that is more, the largest distance that a step of T would move a node or change an offset
/// by, in units of the characteristic_length. Converged only if that is within the tolerance.
/// Summary::positive_definite is of the second derivatives by x and T, and empty if the energy is not
/// quadratic in them. Statuses are those of "auto"; refused are terms other than anchors, loads, links and
/// offsets, links without a bound of their curvature, and the option gap, of which nothing would be known.
ASTERISM_API Summary solve_turning(const System& system, Eigen::MatrixXd& x, Eigen::MatrixXd& transform,
                                   const TurningOptions& options = {});

/// Options of solve_global.
struct GlobalOptions : AlignedOptions {
  /// Maximum wall-clock time [s]. A step that cannot be interrupted, such as a factorisation, is completed
  /// first.
  double max_seconds = 1;

  /// Sets a gap of 1e-3.
  constexpr GlobalOptions() { gap = 1e-3; }

  /// The first problem of the options, or nullptr if there is none.
  constexpr const char* problem() const {
    if (!(gap > 0)) return "option gap is not positive";
    if (!(max_seconds >= 0)) return "option max_seconds is negative or not a number";
    return AlignedOptions::problem();
  }
};

/// The lowest minimum that the library finds: by solve_staircase, or from many starts where a term is not
/// liftable, such as loads. It keeps to options.max_seconds; where that ends the search, the status is
/// MaxIterations. Summary::lower_bound is the proven bound; Summary::is_within(gap) says whether x is the
/// global minimum.
ASTERISM_API Summary solve_global(const System& system, Eigen::MatrixXd& x,
                                  const GlobalOptions& options = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
