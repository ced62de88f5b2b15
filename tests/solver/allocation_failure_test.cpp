// Makes each allocation of a solve fail once, in a solver's first solve and in one after a system of another
// size: it must return OutOfMemory, leave x unchanged, and then solve as a fresh solver does.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/batch_sensitivity.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <new>
#include <optional>
#include <string_view>

#ifdef ASTERISM_TEST_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif
#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>

#include "by_terms.hpp"
#include "failing_allocator.hpp"

namespace asterism {
namespace {

using System = SpringSystem<double, 2>;
using Points = System::Points;

// Enough nodes of the search tree to make all its allocations.
struct ShortSearch : BranchAndBound<System> {
  ShortSearch() {
    options.max_nodes = 8;
    options.max_seconds = 1e6;
  }
};

template <typename Solver>
class OutOfMemory : public ::testing::Test {};
using Solvers = ::testing::Types<
#ifdef ASTERISM_TEST_CHOLMOD
    CholmodIda<System>, testing::CholmodNewton<System>,
#endif
    Ida<System>, SparseIda<System>, Newton<System>, Lbfgs<System>, testing::NewtonCg<System>,
    NonlinearCg<System>, Auto<System>, testing::SparseNewton<System>, testing::MultiStart<System>,
    testing::Staircase<System>, ShortSearch>;
TYPED_TEST_SUITE(OutOfMemory, Solvers);

using Problem = testing::RandomSystem<System>;

// If `other` is given, the solver solves it first.
template <typename Solver>
void expect_out_of_memory(const Problem& problem, const Problem* other = nullptr) {
  Points expected = problem.start;
  ASSERT_TRUE(Solver().solve(problem.system, expected).usable());

  // If memory for CHOLMOD's best ordering is lacking, it keeps another one, which rounds differently and so
  // ends at another point within the tolerance.
  const double rounding = Solver::name().ends_with("CHOLMOD") ? 1e-9 : 0;
  std::optional<Solver> solver;
  Points x;
  Summary summary;
  int out_of_memory = 0;
  const auto renew = [&] {
    solver.emplace();
    if (other != nullptr) {
      x = other->start;
      ASSERT_TRUE(solver->solve(other->system, x).usable());
    }
    x = problem.start;
  };
  renew();
  const long allocations =
      testing::fail_each_allocation([&] { summary = solver->solve(problem.system, x); },
                                    [&](long k) {
                                      SCOPED_TRACE(k);
                                      if (summary.status == Status::OutOfMemory) {
                                        ++out_of_memory;
                                        EXPECT_EQ(x, problem.start);
                                      } else {  // the method may manage with less memory
                                        EXPECT_TRUE(summary.usable()) << summary;
                                        EXPECT_TRUE(x.allFinite());
                                      }
                                      x = problem.start;
                                      EXPECT_TRUE(solver->solve(problem.system, x).usable());
                                      EXPECT_LE((x - expected).norm(), rounding);
                                      renew();
                                    });
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(x, expected);
  EXPECT_GT(allocations, 2);
  EXPECT_GT(out_of_memory, 0);
}

TYPED_TEST(OutOfMemory, IsAStatusAndLeavesNothingBehind) {
  testing::Rng rng(1);
  expect_out_of_memory<TypeParam>(testing::random_system<System>(rng, System::TopologyType::full(17)));
}

TYPED_TEST(OutOfMemory, AfterAnotherSize) {
  testing::Rng rng(2);
  const Problem problem = testing::random_system<System>(rng, System::TopologyType::full(17));
  for (const int nodes : {13, 21}) {
    SCOPED_TRACE(nodes);
    const Problem other = testing::random_system<System>(rng, System::TopologyType::full(nodes));
    expect_out_of_memory<TypeParam>(problem, &other);
  }
  // The same number of nodes, with other links.
  const Problem star = testing::random_system<System>(rng, System::TopologyType::star(17, 0));
  expect_out_of_memory<TypeParam>(problem, &star);
}

template <typename Solver>
class TooLarge : public ::testing::Test {};
using DenseSolvers = ::testing::Types<
#ifdef ASTERISM_TEST_CERES
    reference::Ceres<System, reference::CeresMethod::LevenbergMarquardtDense>,
#endif
    Ida<System>, Newton<System>, Lbfgs<System>>;
TYPED_TEST_SUITE(TooLarge, DenseSolvers);

// Dense matrices of 10^13 bytes and more, which an operating system may grant piece by piece until it kills
// the process, must be refused before anything is allocated.
TYPED_TEST(TooLarge, IsRefusedBeforeItIsAllocated) {
  constexpr int kNodes = 2'000'000;
  System system(Topology<>::from_links(kNodes, {}));
  system.anchors.setZero(2, kNodes);
  system.anchor_stiffness.setOnes();
  const Points start = Points::Ones(2, kNodes);
  Points x = start;
  const Summary summary = TypeParam().solve(system, x);
  EXPECT_EQ(summary.status, Status::OutOfMemory) << summary;
  EXPECT_NE(std::string_view(summary.message).find("000.0 GB of memory, and"), std::string_view::npos)
      << summary;
  EXPECT_EQ(x, start);
}

TEST(TooLarge, CovarianceAndHessian) {
  constexpr int kNodes = 200'000;
  System system(Topology<>::from_links(kNodes, {}));
  system.anchors.setZero(2, kNodes);
  system.anchor_stiffness.setOnes();
  const auto all = covariance(system, system.anchors);
  EXPECT_EQ(all.status, CovarianceStatus::OutOfMemory);
  EXPECT_NE(std::string_view(all.message).find("needs 3840.0 GB"), std::string_view::npos) << all.message;
  EXPECT_THROW(hessian(system, system.anchors), std::bad_alloc);
  EXPECT_TRUE(node_covariances(system, system.anchors));
}

TEST(TooLarge, Matrices) {
  EXPECT_GT(detail::available_memory(), 1e7);
  EXPECT_NO_THROW(detail::require_memory(1e6));
  EXPECT_NO_THROW(detail::require_memory(0));
  EXPECT_THROW(detail::require_memory(1e16), std::bad_alloc);
  EXPECT_NO_THROW(detail::require_entries(1e6, 8));
  EXPECT_THROW(detail::require_entries(2147483648.0, 8), std::bad_alloc);
  EXPECT_THROW((SpringBatch<double, 2>(Topology<>::full(1000), 1'000'000)), std::bad_alloc);
}

// Including the allocations outside the subdomains' solvers.
TEST(OutOfMemorySparse, WithSubdomains) {
  const Problem problem = testing::sparse_system<System>(1, 700);
  expect_out_of_memory<testing::Schwarz<System>>(problem);
  const Problem other = testing::sparse_system<System>(1, 900);
  expect_out_of_memory<testing::Schwarz<System>>(problem, &other);
}

// Gradients by each of the factorisations, for the first system of a workspace and after another one.
TEST(OutOfMemorySensitivity, IsTheReasonAndLeavesNothingBehind) {
  testing::Rng rng(4);
  Problem problems[] = {testing::random_system<System>(rng, System::TopologyType::full(17)),
                        testing::random_system<System>(rng, System::TopologyType::full(70)),
                        testing::sparse_system<System>(1, 300)};
  for (Problem& problem : problems) {  // at rest
    problem.system.set_rest_lengths(problem.start);
    problem.system.anchors = problem.start;
  }
  for (const Problem& problem : problems) {
    const Points grad_x = Points::Ones(2, problem.start.cols());
    const auto expected = sensitivity(problem.system, problem.start, grad_x);
    ASSERT_TRUE(expected) << expected.message;
    for (const Problem& other : problems) {
      std::optional<Sensitivity<System>> workspace;
      SystemGradient<System> gradient;
      int out_of_memory = 0;
      const auto renew = [&] {
        workspace.emplace();
        if (&other != &problem)
          workspace->backward(other.system, other.start, Points::Ones(2, other.start.cols()));
      };
      renew();
      testing::fail_each_allocation(
          [&] { gradient = workspace->backward(problem.system, problem.start, grad_x); },
          [&](long k) {
            SCOPED_TRACE(k);
            ++out_of_memory;
            EXPECT_EQ(gradient.status, SensitivityStatus::OutOfMemory);
            EXPECT_EQ(gradient.message, "the workspace does not fit into memory");
            EXPECT_EQ(gradient.anchors.size(), 0);
            gradient = workspace->backward(problem.system, problem.start, grad_x);
            EXPECT_EQ(gradient.anchors, expected.anchors);
            renew();
          });
      EXPECT_EQ(gradient.anchors, expected.anchors);
      EXPECT_GT(out_of_memory, 5);
    }
  }
}

// Certificates with a dense and a sparse matrix, for the first system of a workspace and after another one.
TEST(OutOfMemoryProof, IsTheReasonAndLeavesNothingBehind) {
  testing::Rng rng(4);
  const Problem dense = testing::random_system<System>(rng, System::TopologyType::full(17));
  const Problem sparse = testing::sparse_system<System>(1, 300);
  const Problem* const problems[] = {&dense, &sparse};
  for (const Problem* problem : problems) {
    const Certificate expected = certify(problem->system, problem->start);
    for (const Problem* other : problems) {
      std::optional<Certifier<System>> certifier;
      Certificate certificate;
      int out_of_memory = 0;
      const auto renew = [&] {
        certifier.emplace();
        if (other != problem) certifier->certify(other->system, other->start);
      };
      renew();
      testing::fail_each_allocation(
          [&] { certificate = certifier->certify(problem->system, problem->start); },
          [&](long k) {
            SCOPED_TRACE(k);
            ++out_of_memory;
            EXPECT_EQ(certificate.proof, Proof::NotApplicable);
            EXPECT_EQ(certificate.reason, "the workspace does not fit into memory");
            certificate = certifier->certify(problem->system, problem->start);
            EXPECT_EQ(certificate.lower_bound, expected.lower_bound);
            renew();
          });
      EXPECT_EQ(certificate.lower_bound, expected.lower_bound);
      EXPECT_GT(out_of_memory, 5);
    }
  }
}

// After a batch of another size; with nodes in lanes, and with systems that are left to Newton.
TEST(OutOfMemoryBatch, IsAStatusAndLeavesNothingBehind) {
  using Batch = SpringBatch<double, 2>;
  testing::Rng rng(3);
  const auto batch_of = [&rng](int nodes) {
    Batch batch(System::TopologyType::full(nodes), 40);
    for (int s = 0; s < batch.size(); ++s) {
      const Problem problem = testing::random_system<System>(rng, batch.topology());
      batch.set(s, problem.system, problem.start);
    }
    return batch;
  };
  for (const int nodes : {5, 17}) {  // in lanes, and one by one
    SCOPED_TRACE(nodes);
    const Batch first = batch_of(nodes - 1);
    const Batch second = batch_of(nodes);
    Batch expected = second;
    ASSERT_EQ(BatchNewton<Batch>().solve(expected).status, Status::Converged);
    std::optional<BatchNewton<Batch>> solver;
    Batch batch = second;
    BatchSummary summary;
    int out_of_memory = 0;
    const auto renew = [&] {
      solver.emplace();
      Batch other = first;
      ASSERT_EQ(solver->solve(other).status, Status::Converged);
      batch = second;
    };
    renew();
    testing::fail_each_allocation([&] { summary = solver->solve(batch); },
                                  [&](long k) {
                                    SCOPED_TRACE(k);
                                    if (summary.status == Status::OutOfMemory) ++out_of_memory;
                                    batch = second;
                                    EXPECT_EQ(solver->solve(batch).status, Status::Converged);
                                    renew();
                                  });
    EXPECT_EQ(summary.status, Status::Converged);
    EXPECT_GT(out_of_memory, 0);
    for (int s = 0; s < batch.size(); ++s) EXPECT_EQ(batch.points(s), expected.points(s));
  }
}

// Of systems that the lanes leave to Sensitivity, after a batch of another size.
TEST(OutOfMemoryBatch, OfGradientsIsAStatusAndLeavesNothingBehind) {
  using Batch = SpringBatch<double, 2>;
  testing::Rng rng(3);
  const auto batch_of = [&rng](int nodes) {
    Batch batch(System::TopologyType::full(nodes), 3);
    for (int s = 0; s < batch.size(); ++s) {
      Problem problem = testing::random_system<System>(rng, batch.topology());
      problem.system.set_rest_lengths(problem.start);  // at rest
      problem.system.anchors = problem.start;
      batch.set(s, problem.system, problem.start);
    }
    return batch;
  };
  const auto gradient_of = [](const Batch& batch) {
    BatchGradient<Batch> gradient(batch);
    for (int s = 0; s < batch.size(); ++s) gradient.set(s, Points::Ones(2, batch.nodes()));
    return gradient;
  };
  const Batch first = batch_of(16), second = batch_of(17);
  BatchGradient<Batch> other = gradient_of(first), gradient = gradient_of(second);
  std::optional<BatchSensitivity<Batch>> sensitivity;
  const auto renew = [&] {
    sensitivity.emplace();
    ASSERT_TRUE(sensitivity->backward(first, other));
  };
  renew();
  BatchGradientSummary summary;
  int out_of_memory = 0;
  testing::fail_each_allocation([&] { summary = sensitivity->backward(second, gradient); },
                                [&](long k) {
                                  SCOPED_TRACE(k);
                                  for (int s = 0; s < second.size(); ++s) {
                                    if (gradient.status(s) == SensitivityStatus::Computed) continue;
                                    EXPECT_EQ(gradient.status(s), SensitivityStatus::OutOfMemory);
                                    EXPECT_TRUE(std::isnan(gradient.rest_length(3)[s]));
                                    ++out_of_memory;
                                  }
                                  EXPECT_TRUE(sensitivity->backward(second, gradient));
                                  renew();
                                });
  EXPECT_TRUE(summary);
  EXPECT_GT(out_of_memory, 0);
}

}  // namespace
}  // namespace asterism
