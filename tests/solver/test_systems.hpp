#pragma once

// The types of systems that several tests use besides those of asterism::solver_compiled, and the functions
// that they need for all of them: compiled once, in test_systems_*.cpp, as they would take each test seconds
// per type.

#include <Eigen/SparseCore>
#include <asterism/solver.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>

namespace asterism {
namespace testing {

using Fixed2 = SpringSystem<double, 2, 4>;
using Plane = SpringSystem<double, 2>;
using Space = SpringSystem<double, 3>;
using Line = SpringSystem<double, 1, Eigen::Dynamic, 12>;  // Auto has sparse solvers beyond
using Bounded2 = SpringSystem<double, 2, Eigen::Dynamic, 16>;
using Bounded3 = SpringSystem<double, 3, Eigen::Dynamic, 8>;
using Fixed2f = SpringSystem<float, 2, 4>;
using Planef = SpringSystem<float, 2>;
using Spacef = SpringSystem<float, 3>;
using Bounded3f = SpringSystem<float, 3, Eigen::Dynamic, 8>;
/// Robust anisotropic anchors.
using FixedEllipses = SpringSystem<double, 2, 4, 4, Model<Hooke, Huber, AnchorShape::Anisotropic>>;

}  // namespace testing

inline namespace ASTERISM_ABI {

// Each list declares if `Extern` is `extern`, and defines if it is empty.
// NOLINTBEGIN(bugprone-macro-parentheses): types cannot have them
// Functions that all solvers use.
#define ASTERISM_TEST_ENERGY(Extern, System)                                                                 \
  Extern template System::Scalar energy(const System&, const System::Points&);                               \
  Extern template System::Scalar energy_and_gradient(const System&, const System::Points&, System::Points&); \
  Extern template System::Points gradient(const System&, const System::Points&);                             \
  Extern template System::NodeVector node_stiffness(const System&);                                          \
  Extern template bool detail::align(const System&, System::Points&, bool);                                  \
  Extern template System::Scalar detail::characteristic_length(const System&, const System::Points&,         \
                                                               const System::NodeVector&);                   \
  Extern template Defect detail::validate_values(const System&, const System::Points&);

#define ASTERISM_TEST_FUNCTIONS(Extern, System)                                                             \
  ASTERISM_TEST_ENERGY(Extern, System)                                                                      \
  Extern template DenseHessian<System> hessian(const System&, const System::Points&);                       \
  Extern template Eigen::SparseMatrix<System::Scalar> sparse_hessian(const System&, const System::Points&); \
  Extern template System::Scalar characteristic_length(const System&, const System::Points&);               \
  Extern template double stationarity(const System&, const System::Points&);                                \
  Extern template Defect validate(const System&, const System::Points&);                                    \
  Extern template Covariance<System> covariance(const System&, const System::Points&);                      \
  Extern template NodeCovariances<System> node_covariances(const System&, const System::Points&);

#define ASTERISM_TEST_RANDOM(Extern, System)                                                         \
  Extern template RandomSystem<System> random_paper_system(Rng&, const System::TopologyType&, Kind); \
  Extern template RandomSystem<System> random_track_system(Rng&, const System::TopologyType&);

// SOLVER(Extern, System, type of the solver)
#define ASTERISM_TEST_SOLVER(Extern, System, ...) \
  Extern template Summary detail::Compiled::solve(__VA_ARGS__&, const System&, System::Points&);
#define ASTERISM_TEST_PROVER(Extern, System)                                          \
  Extern template void detail::Prover<System, detail::SparseFactor<double>>::certify( \
      const System&, const System::Points&, double, Certificate&);
// NOLINTEND(bugprone-macro-parentheses)

#define ASTERISM_TEST_PLANE(Extern)                                                                    \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Fixed2)                                                     \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Plane)                                                      \
  ASTERISM_TEST_SOLVER(Extern, testing::Plane, Lbfgs<testing::Plane, SparseCholesky<testing::Plane>>)  \
  Extern template CovarianceStatus detail::sparse_node_covariances(                                    \
      const testing::Plane&, const testing::Plane::Points&, NodeCovariances<testing::Plane>::Blocks&); \
  Extern template CovarianceStatus detail::dense_node_covariances(                                     \
      const testing::Plane&, const testing::Plane::Points&, NodeCovariances<testing::Plane>::Blocks&);

#define ASTERISM_TEST_SPACE(Extern)                                  \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Space)                    \
  ASTERISM_TEST_PROVER(Extern, testing::Line)                        \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Line)                     \
  ASTERISM_TEST_PROVER(Extern, testing::Bounded3)                    \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Bounded3)                 \
  ASTERISM_TEST_SOLVER(Extern, testing::Line, Newton<testing::Line>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Line, Auto<testing::Line>)

#define ASTERISM_TEST_BOUNDED(Extern)                                     \
  ASTERISM_TEST_PROVER(Extern, testing::Bounded2)                         \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Bounded2)                      \
  ASTERISM_TEST_PROVER(Extern, testing::FixedEllipses)                    \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::FixedEllipses)                 \
  ASTERISM_TEST_SOLVER(Extern, testing::Bounded2, Ida<testing::Bounded2>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Bounded2, Newton<testing::Bounded2>)

#define ASTERISM_TEST_PLANEF(Extern)                                       \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Fixed2f)                        \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Planef)                         \
  ASTERISM_TEST_SOLVER(Extern, testing::Fixed2f, Ida<testing::Fixed2f>)    \
  ASTERISM_TEST_SOLVER(Extern, testing::Fixed2f, Newton<testing::Fixed2f>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Fixed2f, Auto<testing::Fixed2f>)

#define ASTERISM_TEST_SPACEF(Extern)                                           \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Spacef)                             \
  ASTERISM_TEST_FUNCTIONS(Extern, testing::Bounded3f)                          \
  ASTERISM_TEST_SOLVER(Extern, testing::Bounded3f, Ida<testing::Bounded3f>)    \
  ASTERISM_TEST_SOLVER(Extern, testing::Bounded3f, Newton<testing::Bounded3f>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Spacef, Newton<testing::Spacef>)

ASTERISM_TEST_PLANE(extern)
ASTERISM_TEST_SPACE(extern)
ASTERISM_TEST_BOUNDED(extern)
ASTERISM_TEST_PLANEF(extern)
ASTERISM_TEST_SPACEF(extern)

}  // namespace ASTERISM_ABI

namespace testing {

#define ASTERISM_TEST_RANDOMS(Extern)                                    \
  ASTERISM_TEST_RANDOM(Extern, Fixed2)                                   \
  ASTERISM_TEST_RANDOM(Extern, Plane)                                    \
  ASTERISM_TEST_RANDOM(Extern, Space)                                    \
  ASTERISM_TEST_RANDOM(Extern, Line)                                     \
  ASTERISM_TEST_RANDOM(Extern, Bounded2)                                 \
  ASTERISM_TEST_RANDOM(Extern, Bounded3)                                 \
  ASTERISM_TEST_RANDOM(Extern, Fixed2f)                                  \
  ASTERISM_TEST_RANDOM(Extern, Planef)                                   \
  ASTERISM_TEST_RANDOM(Extern, Spacef)                                   \
  ASTERISM_TEST_RANDOM(Extern, Bounded3f)                                \
  Extern template RandomSystem<Plane> sparse_system(std::uint64_t, int); \
  Extern template RandomSystem<Space> sparse_system(std::uint64_t, int); \
  Extern template RandomSystem<Planef> sparse_system(std::uint64_t, int);

ASTERISM_TEST_RANDOMS(extern)

}  // namespace testing
}  // namespace asterism
