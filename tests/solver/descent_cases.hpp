#pragma once

// Descent methods with their policies on types of systems; those that are in neither
// asterism::solver_compiled nor test_systems.hpp are compiled in descent_cases.cpp.
#include <asterism/solver.hpp>

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

#include <gtest/gtest.h>

#include "test_systems.hpp"

namespace asterism {
namespace descent {

template <typename Solver_, typename System_>
struct Case {
  using Solver = Solver_;
  using System = System_;
};

template <template <typename, typename> typename Method, template <typename> typename Policy, typename System>
using With = Case<Method<System, Policy<System>>, System>;

using Fixed2 = testing::Fixed2;
using Dynamic2 = testing::Plane;
using Dynamic3 = testing::Space;
using testing::Bounded3f;

using Cases = ::testing::Types<
#ifdef ASTERISM_TEST_ALL_CASES  // at night
#ifdef ASTERISM_TEST_CHOLMOD
    With<Lbfgs, CholmodCholesky, Dynamic2>,
#endif
    With<Lbfgs, DenseCholesky, Bounded3f>, With<Lbfgs, JacobiMetric, Dynamic3>,
    With<Lbfgs, JacobiMetric, Bounded3f>,
#endif
    With<Lbfgs, DenseCholesky, Fixed2>, With<Lbfgs, SparseCholesky, Dynamic2>>;

}  // namespace descent

inline namespace ASTERISM_ABI {

#ifdef ASTERISM_TEST_ALL_CASES
#ifdef ASTERISM_TEST_CHOLMOD
#define ASTERISM_DESCENT_CHOLMOD(Extern) \
  ASTERISM_TEST_SOLVER(Extern, testing::Plane, Lbfgs<testing::Plane, CholmodCholesky<testing::Plane>>)
#else
#define ASTERISM_DESCENT_CHOLMOD(Extern)
#endif
#define ASTERISM_DESCENT_CASES(Extern)                                        \
  ASTERISM_DESCENT_CHOLMOD(Extern)                                            \
  ASTERISM_TEST_SOLVER(Extern, testing::Bounded3f, Lbfgs<testing::Bounded3f>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Bounded3f,                            \
                       Lbfgs<testing::Bounded3f, JacobiMetric<testing::Bounded3f>>)

ASTERISM_DESCENT_CASES(extern)
#endif

}  // namespace ASTERISM_ABI
}  // namespace asterism
