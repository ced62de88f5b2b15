#pragma once

// 28 kinds of systems that are hard to solve, and all solvers behind one interface. hostile_test.cpp judges
// the results.

#include <Eigen/Core>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::hostile {

/// The types of systems for which the solvers are instantiated. A plane of four nodes also goes through the
/// solvers of fixed size.
enum class Type { Line, Plane, Space, PlaneInFloat, RobustPlane };

constexpr int dimensions(Type type) { return type == Type::Line ? 1 : type == Type::Space ? 3 : 2; }
constexpr double epsilon(Type type) {
  return type == Type::PlaneInFloat ? double{std::numeric_limits<float>::epsilon()}
                                    : std::numeric_limits<double>::epsilon();
}

/// A system, its start, and what is expected of a solver. The numbers are rounded to the type's scalar.
struct Problem {
  Type type = Type::Plane;
  std::vector<Link> links;
  Eigen::MatrixXd anchors, start;  ///< Dim x N
  Eigen::VectorXd anchor_stiffness, rest_length, link_stiffness;
  Eigen::MatrixXd rest_offset;  ///< Dim x L, or empty
  Eigen::MatrixXd loads;        ///< Dim x N, or empty
  /// For RobustPlane: information matrices relative to k_i, Dim x (Dim N), and the scale of Geman and
  /// McClure's loss.
  Eigen::MatrixXd shapes;
  double scale = 1;
  std::vector<int> fixed;
  bool hold_floating = false;
  bool align = true;

  bool refused = false;       ///< not a valid system: InvalidInput
  bool may_overflow = false;  ///< NumericalFailure is allowed
  bool moves_freely = false;  ///< a rotation or translation costs nothing: no minimum is strict
  /// If all reference descents end in the same minimum, every method must find it, to a millionth of its
  /// energy.
  bool agrees = false;

  int nodes() const { return static_cast<int>(anchors.cols()); }
  int dim() const { return static_cast<int>(anchors.rows()); }
};

/// A kind of systems.
struct Kind {
  const char* name;
  Problem (*make)(std::uint64_t seed);
};
const std::vector<Kind>& kinds();

/// A solver's result for a problem.
struct Attempt {
  std::string solver;
  Summary summary;
  Eigen::MatrixXd x;
  bool is_untouched = false;  ///< x is the start, bit for bit
};

inline constexpr double kTolerance = 1e-8;
inline constexpr int kIterations = 2000;

/// Solves the problem with every solver of its type. The solvers keep their workspaces between problems.
std::vector<Attempt> solve_by_all(const Problem& problem);

// Parts of solve_by_all, in one source file each.
void solve_line(const Problem& problem, std::vector<Attempt>& attempts);
void solve_plane(const Problem& problem, std::vector<Attempt>& attempts);
void solve_space(const Problem& problem, std::vector<Attempt>& attempts);
void solve_float(const Problem& problem, std::vector<Attempt>& attempts);
void solve_robust(const Problem& problem, std::vector<Attempt>& attempts);

}  // namespace asterism::hostile
