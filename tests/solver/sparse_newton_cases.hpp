#pragma once

// Sparse Newton with its factorisations on types of systems; those that are not in asterism::solver_compiled
// are compiled in sparse_newton_cases.cpp.
#include <asterism/solver/method/sparse_newton.hpp>

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/linear/cholmod.hpp>
#endif

#include <gtest/gtest.h>

#include "test_systems.hpp"

namespace asterism {
namespace sparse_newton {

using testing::Plane;
using testing::Planef;
using testing::Space;

template <typename System_, template <typename> typename Factorization>
struct Case {
  using System = System_;
  using Solver = SparseNewton<System, Factorization<System>>;
};

using Cases = ::testing::Types<
#ifdef ASTERISM_TEST_CHOLMOD
    Case<Plane, CholmodLlt>, Case<Planef, CholmodLlt>,
#endif
    Case<Plane, SparseLdlt>, Case<Space, SparseLdlt>, Case<Planef, SparseLdlt>>;

}  // namespace sparse_newton

inline namespace ASTERISM_ABI {

#ifdef ASTERISM_TEST_CHOLMOD
#define ASTERISM_SPARSE_NEWTON_CHOLMOD(Extern)                                                           \
  ASTERISM_TEST_SOLVER(Extern, testing::Plane, SparseNewton<testing::Plane, CholmodLlt<testing::Plane>>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Planef, SparseNewton<testing::Planef, CholmodLlt<testing::Planef>>)
#else
#define ASTERISM_SPARSE_NEWTON_CHOLMOD(Extern)
#endif
#define ASTERISM_SPARSE_NEWTON_CASES(Extern)                          \
  ASTERISM_SPARSE_NEWTON_CHOLMOD(Extern)                              \
  ASTERISM_TEST_SOLVER(Extern, testing::Planef, Ida<testing::Planef>) \
  ASTERISM_TEST_SOLVER(Extern, testing::Planef, SparseNewton<testing::Planef>)

ASTERISM_SPARSE_NEWTON_CASES(extern)

}  // namespace ASTERISM_ABI
}  // namespace asterism
