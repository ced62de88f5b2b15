#pragma once

// Systems that are hard on a solver, of 26 kinds, and every solver behind one interface. What they return is
// judged in hostile_test.cpp.

#include <Eigen/Core>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::hostile {

/// The types of systems that the solvers are instantiated for. A plane of four nodes also goes through the
/// solvers of fixed size.
enum class Type { Line, Plane, Space, PlaneInFloat, RobustPlane };

constexpr int dimensions(Type type) { return type == Type::Line ? 1 : type == Type::Space ? 3 : 2; }
constexpr double epsilon(Type type) {
  return type == Type::PlaneInFloat ? double{std::numeric_limits<float>::epsilon()}
                                    : std::numeric_limits<double>::epsilon();
}

/// A system, its start, and what is expected of a solver. The numbers are what the type's scalar holds.
struct Problem {
  Type type = Type::Plane;
  std::vector<Link> links;
  Eigen::MatrixXd anchors, start;  ///< Dim x N
  Eigen::VectorXd anchor_stiffness, rest_length, link_stiffness;
  /// Of a RobustPlane: information matrices over k_i, Dim x (Dim N), and the scale of Geman and McClure's
  /// loss.
  Eigen::MatrixXd shapes;
  double scale = 1;
  std::vector<int> fixed;
  bool ground_components = false;
  bool align = true;

  bool refused = false;       ///< it is no system: InvalidInput
  bool may_overflow = false;  ///< NumericalFailure is an answer, too
  bool moves_freely = false;  ///< a rotation or translation costs nothing: no minimum is strict
  /// Where every descent ends in the same minimum, all methods have to find it to a millionth of its energy.
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

/// What a solver made of a problem.
struct Attempt {
  std::string solver;
  Summary summary;
  Eigen::MatrixXd x;
  bool is_untouched = false;  ///< x is the start, bit for bit
};

inline constexpr double kTolerance = 1e-8;
inline constexpr int kIterations = 2000;

/// The problem solved by every solver of its type. The solvers keep their workspaces from one problem to the
/// next.
std::vector<Attempt> solve_by_all(const Problem& problem);

// Of solve_by_all, a source file each.
void solve_line(const Problem& problem, std::vector<Attempt>& attempts);
void solve_plane(const Problem& problem, std::vector<Attempt>& attempts);
void solve_space(const Problem& problem, std::vector<Attempt>& attempts);
void solve_float(const Problem& problem, std::vector<Attempt>& attempts);
void solve_robust(const Problem& problem, std::vector<Attempt>& attempts);

}  // namespace asterism::hostile
