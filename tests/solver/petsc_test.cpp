// asterism::petsc, to be run by one process and by several: all of them run the same tests.
#include <gtest/gtest.h>
#include <petscsys.h>

#include <asterism/solver/distributed/petsc.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <string>

namespace asterism {
namespace {

using Plane = SpringSystem<double, 2>;
using Space = SpringSystem<double, 3>;

int rank() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}
int size() {
  int size = 1;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

/// Process r's part of a system that all processes have: a range of the nodes, and every size()-th link.
template <int kDim>
SystemShare<kDim> part(const SpringSystem<double, kDim>& system,
                       const typename SpringSystem<double, kDim>::Points& start) {
  const int begin = system.nodes() * rank() / size();
  const int count = system.nodes() * (rank() + 1) / size() - begin;
  SystemShare<kDim> share;
  share.anchors = system.anchors.middleCols(begin, count);
  share.anchor_stiffness = system.anchor_stiffness.segment(begin, count);
  share.start = start.middleCols(begin, count);
  std::vector<double> lengths, stiffness;
  for (int l = rank(); l < system.link_count(); l += size()) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    share.links.push_back({link.i, link.j});
    lengths.push_back(system.rest_length[l]);
    stiffness.push_back(system.link_stiffness[l]);
  }
  share.rest_length = Eigen::Map<Eigen::VectorXd>(lengths.data(), std::ssize(lengths));
  share.link_stiffness = Eigen::Map<Eigen::VectorXd>(stiffness.data(), std::ssize(stiffness));
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i) && i % size() == rank()) share.fixed.push_back(i);
  }
  return share;
}

/// Solves by PETSc from `start`, and expects a minimum that is our Newton's too, and the same figures. With
/// `from_near` also that, from near our Newton's minimum, PETSc finds the same. (From afar there are
/// several.)
template <int kDim>
void expect_minimum(const SpringSystem<double, kDim>& system,
                    const typename SpringSystem<double, kDim>::Points& start,
                    const DistributedOptions& options = {}, bool from_near = true) {
  using System = SpringSystem<double, kDim>;
  const auto ours = [&](typename System::Points& x) {
    AnySolver<System> newton = system_solver<System>(
        "newton", {{"continuation", false}, {"align", false}, {"hold_floating", options.hold_floating}});
    const Summary summary = newton.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    return summary;
  };
  System judged = system;  // as a Session judges it
  if (options.hold_floating) {
    detail::ComponentScratch<System> scratch;
    detail::for_each_floating_component(system, scratch, [&](int i) { judged.fix(i); });
  }
  typename System::Points minimum = start;
  ours(minimum);
  typename System::Points near = minimum;
  testing::Rng rng(1);
  for (int i = 0; i < near.cols(); ++i) {
    if (!system.is_fixed(i)) near.col(i).array() += 1e-3 * rng.uniform(-1, 1);
  }

  for (const typename System::Points* from : {&start, &std::as_const(near)}) {
    if (from == &near && !from_near) break;
    DistributedSystem<kDim> distributed(MPI_COMM_WORLD, part(system, *from));
    ASSERT_EQ(distributed.problem(), "");
    EXPECT_EQ(distributed.nodes(), system.nodes());
    EXPECT_EQ(distributed.links(), system.link_count());
    const Summary summary = distributed.solve(options);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_NEAR(summary.initial_energy, energy(system, *from), 1e-12 * summary.initial_energy);

    typename System::Points x = distributed.gather(0);
    const auto share = distributed.placement();
    const int begin = system.nodes() * rank() / size();
    const int end = system.nodes() * (rank() + 1) / size();
    EXPECT_EQ(share.cols(), end - begin);
    if (rank() != 0) {
      EXPECT_EQ(x.cols(), 0);
      continue;
    }
    ASSERT_EQ(x.cols(), system.nodes());
    EXPECT_EQ(share, x.leftCols(end));
    EXPECT_NEAR(summary.final_energy, energy(system, x), 1e-12 * summary.final_energy);
    EXPECT_NEAR(summary.stationarity, stationarity(judged, x), 1e-3 * options.tolerance + 1e-12);
    if (from == &near) {
      EXPECT_NEAR(summary.final_energy, energy(system, minimum), 1e-8 * summary.final_energy);
      EXPECT_LT((x - minimum).cwiseAbs().maxCoeff(), 1e3 * options.tolerance * minimum.norm());
    }
    // L-BFGS may end at a saddle, which ours leaves.
    if (options.method == PetscMethod::NewtonTrustRegion || from == &near) {
      EXPECT_NEAR(summary.final_energy, ours(x).final_energy, 1e-8 * summary.final_energy);
    }
  }
}

/// Without Schwarz first.
DistributedOptions petsc_only() {
  DistributedOptions options;
  options.schwarz_first = false;
  return options;
}

template <typename System>
void weaken_anchors(System& system, double factor) {
  system.anchor_stiffness *= factor;
}

TEST(Petsc, FindsTheMinimumInThePlane) {
  // Small: each iteration of conjugate gradients waits for the other processes, which may wait for a core.
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const auto random = testing::sparse_system<Plane>(seed, 150);
    expect_minimum<2>(random.system, random.start, petsc_only());
    expect_minimum<2>(random.system, random.start);
  }
}

TEST(Petsc, FindsTheMinimumInSpace) {
  for (const std::uint64_t seed : {1U, 2U}) {
    const auto random = testing::sparse_system<Space>(seed, 150);
    expect_minimum<3>(random.system, random.start, petsc_only());
    expect_minimum<3>(random.system, random.start);
  }
}

TEST(Petsc, FindsTheMinimumOfWeakAnchors) {
  auto random = testing::sparse_system<Plane>(4, 150);
  weaken_anchors(random.system, 1e-4);
  DistributedOptions options = petsc_only();
  options.preconditioner = PetscPreconditioner::AdditiveSchwarz;
  expect_minimum<2>(random.system, random.system.anchors, options);
}

TEST(Petsc, FindsTheMinimumOfAFullyLinkedSystem) {
  const auto random = testing::numbered_system<Plane>(testing::Kind::Lit, Topology<>::full(30), 3);
  expect_minimum<2>(random.system, random.start, petsc_only());
}

TEST(Petsc, FindsTheMinimumByEveryMethod) {
  const auto random = testing::sparse_system<Plane>(5, 100);
  for (const PetscMethod method : {PetscMethod::NewtonTrustRegion, PetscMethod::Lmvm}) {
    for (const auto preconditioner :
         {PetscPreconditioner::Jacobi, PetscPreconditioner::Gamg, PetscPreconditioner::AdditiveSchwarz}) {
      DistributedOptions options = petsc_only();
      options.tolerance = 1e-6;  // first-order methods compare energies
      options.method = method;
      options.preconditioner = preconditioner;
      SCOPED_TRACE(static_cast<int>(method));
      SCOPED_TRACE(static_cast<int>(preconditioner));
      expect_minimum<2>(random.system, random.start, options);
    }
  }
}

TEST(Petsc, LeavesLittleToPetscAfterSchwarz) {
  const auto random = testing::sparse_system<Plane>(15, 400);
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(random.system, random.start));
  const Summary first = distributed.solve();
  EXPECT_EQ(first.status, Status::Converged) << first;
  if (size() == 1) {
    EXPECT_EQ(first.iterations, 0);
    Plane::Points x = random.start;
    const Summary ours = system_solver<Plane>("schwarz", {{"align", false}}).solve(random.system, x);
    EXPECT_NEAR(first.final_energy, ours.final_energy, 1e-12 * ours.final_energy);
    EXPECT_LT((distributed.gather(0) - x).cwiseAbs().maxCoeff(), 1e-12);
  } else {
    EXPECT_GT(distributed.cut_links(), 0);
    EXPECT_LT(distributed.cut_links(), random.system.link_count() / 3);
    const Summary plain =
        DistributedSystem<2>(MPI_COMM_WORLD, part(random.system, random.start)).solve(petsc_only());
    EXPECT_LT(2 * first.iterations, plain.iterations);
  }
}

TEST(Petsc, HoldsAfterwardsOnlyWhatWasHeldBefore) {
  auto random = testing::sparse_system<Plane>(16, 100);
  for (const int i : {3, 50, 99}) random.system.fix(i);
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(random.system, random.start));
  EXPECT_EQ(distributed.solve().status, Status::Converged);
  const auto x = distributed.gather(0);
  if (rank() != 0) return;
  for (int i = 0; i < 100; ++i) {
    const double moved = (x.col(i) - random.start.col(i)).norm();
    if (random.system.is_fixed(i)) {
      EXPECT_LT(moved, 1e-14) << i;
    } else {
      EXPECT_GT(moved, 1e-6) << i;
    }
  }
}

/// The first system, the second far off, and `isolated` nodes without links.
Plane together(const testing::RandomSystem<Plane>& a, const testing::RandomSystem<Plane>& b, int isolated,
               Plane::Points& start) {
  const int n = a.system.nodes();
  const int m = b.system.nodes();
  std::vector<Link> links(a.system.links().begin(), a.system.links().end());
  for (const Link& link : b.system.links()) links.push_back({n + link.i, n + link.j});
  Plane both(Topology<>::from_links(n + m + isolated, links));
  both.anchors.setZero();
  both.anchor_stiffness.setOnes();
  both.anchors.leftCols(n) = a.system.anchors;
  both.anchors.middleCols(n, m) = b.system.anchors.array() + 1000;
  both.anchor_stiffness.head(n) = a.system.anchor_stiffness;
  both.anchor_stiffness.segment(n, m) = b.system.anchor_stiffness;
  both.rest_length << a.system.rest_length, b.system.rest_length;
  both.link_stiffness << a.system.link_stiffness, b.system.link_stiffness;
  start.setConstant(2, n + m + isolated, 3);
  start.leftCols(n) = a.start;
  start.middleCols(n, m) = b.start.array() + 1000;
  return both;
}

TEST(Petsc, SolvesSeveralComponents) {
  Plane::Points start;
  Plane system =
      together(testing::sparse_system<Plane>(6, 150), testing::sparse_system<Plane>(7, 90), 3, start);
  expect_minimum<2>(system, start);

  system.fix(7);
  system.fix(system.nodes() - 1);
  expect_minimum<2>(system, start);
}

TEST(Petsc, TreatsComponentsWithoutAnchors) {
  Plane::Points start;
  Plane system =
      together(testing::sparse_system<Plane>(6, 150), testing::sparse_system<Plane>(7, 90), 0, start);
  system.anchor_stiffness.tail(90).setZero();
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(system, start));
  const Summary refused = distributed.solve();
  EXPECT_EQ(refused.status, Status::InvalidInput);
  EXPECT_EQ(refused.message, "node 150 is in a connected component without anchor stiffness");
  system.fix(200);
  EXPECT_EQ(DistributedSystem<2>(MPI_COMM_WORLD, part(system, start)).solve().status, Status::Converged);
  system.release(200);
  DistributedOptions options;
  options.hold_floating = true;
  expect_minimum<2>(system, start, options);
}

TEST(Petsc, SolvesFewerNodesThanProcesses) {
  Plane one(Topology<>::full(1));
  one.anchors << 3, 4;
  one.anchor_stiffness << 2;
  expect_minimum<2>(one, Plane::Points::Constant(2, 1, 1));

  Plane two(Topology<>::full(2));
  two.anchors << 0, 10, 0, 0;
  two.anchor_stiffness << 1, 2;
  two.rest_length << 5;
  two.link_stiffness << 3;
  Plane::Points start(2, 2);
  start << 0, 7, 1, 2;
  expect_minimum<2>(two, start);
}

TEST(Petsc, TakesTheSameDirectionWhereNodesCoincide) {
  // A chain whose nodes all start at one point.
  std::vector<Link> links;
  for (int i = 0; i + 1 < 40; ++i) links.push_back({i, i + 1});
  Plane system(Topology<>::from_links(40, links));
  system.anchors.setZero();
  system.anchor_stiffness.setConstant(0.1);
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  const Plane::Points start = Plane::Points::Zero(2, 40);
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(system, start));
  DistributedOptions options;
  options.max_iterations = 0;
  const Summary summary = distributed.solve(options);
  EXPECT_EQ(summary.status, Status::MaxIterations);
  EXPECT_NEAR(summary.stationarity, stationarity(system, start), 1e-12);
  EXPECT_NEAR(summary.gradient_norm, gradient(system, start).norm(), 1e-12);
}

TEST(Petsc, RefusesBadInputOnAllProcesses) {
  const auto random = testing::sparse_system<Plane>(8, 60);
  const int last = size() - 1;
  const auto refuse = [&](const std::function<void(SystemShare<2>&)>& spoil, const std::string& message) {
    SystemShare<2> share = part(random.system, random.start);
    if (rank() == last) spoil(share);
    DistributedSystem<2> distributed(MPI_COMM_WORLD, share);
    EXPECT_EQ(distributed.problem(), message);
    const Summary summary = distributed.solve();
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(summary.message, message);
    EXPECT_EQ(distributed.placement().cols(), 0);
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::string first = std::to_string(60 * last / size());
  refuse([](auto& share) { share.anchors(1, 0) = kNan; }, "anchor " + first + " is not finite");
  refuse([](auto& share) { share.anchor_stiffness[0] = -1; },
         "anchor stiffness " + first + " is negative or not finite");
  refuse([](auto& share) { share.start(0, 0) = kNan; }, "x of node " + first + " is not finite");
  refuse(
      [](auto& share) {
        share.links[0] = {3, 60};
      },
      "link of nodes 3 and 60 has an end that is out of range");
  refuse([](auto& share) { share.links[0] = {3, 3}; }, "link of nodes 3 and 3 joins a node to itself");
  refuse(
      [](auto& share) {
        share.links[0] = {3, 4}, share.rest_length[0] = -1;
      },
      "link of nodes 3 and 4 has a rest length that is negative or not finite");
  refuse(
      [](auto& share) {
        share.links[0] = {3, 4}, share.link_stiffness[0] = kNan;
      },
      "link of nodes 3 and 4 has a stiffness that is negative or not finite");
  refuse([](auto& share) { share.fixed.push_back(-1); }, "fixed node -1 is out of range");
  refuse([](auto& share) { share.rest_length.conservativeResize(1); },
         "rest length must have one entry for each link");

  EXPECT_EQ(DistributedSystem<2>(MPI_COMM_WORLD, SystemShare<2>()).problem(), "system has no nodes");

  DistributedSystem<2> good(MPI_COMM_WORLD, part(random.system, random.start));
  DistributedOptions options;
  if (rank() == last) options.tolerance = kNan;
  EXPECT_EQ(good.solve(options).message, "option tolerance is negative or not finite");
}

TEST(Petsc, RefusesNumbersThatOverflow) {
  auto random = testing::sparse_system<Plane>(8, 60);
  random.system.link_stiffness *= 1e300;
  random.system.rest_length *= 1e200;
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(random.system, random.start));
  EXPECT_EQ(distributed.solve().status, Status::NumericalFailure);
}

TEST(Petsc, IsOfTheSameResultInOtherUnits) {
  const auto random = testing::sparse_system<Plane>(9, 100);
  Plane system = random.system;
  const double length = 0x1p40;
  const double stiffness = 0x1p-60;
  system.anchors *= length;
  system.rest_length *= length;
  system.anchor_stiffness *= stiffness;
  system.link_stiffness *= stiffness;
  const Summary plain =
      DistributedSystem<2>(MPI_COMM_WORLD, part(random.system, random.start)).solve(petsc_only());
  const Summary other =
      DistributedSystem<2>(MPI_COMM_WORLD, part<2>(system, random.start * length)).solve(petsc_only());
  // On several processes the partition may differ, and with it the rounding of sums.
  const double energy = plain.final_energy * stiffness * length * length;
  if (size() == 1) {
    EXPECT_EQ(plain.iterations, other.iterations);
    EXPECT_EQ(energy, other.final_energy);
  } else {
    EXPECT_NEAR(energy, other.final_energy, 1e-6 * energy);
  }
}

TEST(Petsc, StopsWhereItIsAskedTo) {
  const auto random = testing::sparse_system<Plane>(10, 100);
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(random.system, random.start));
  const std::atomic<bool> stop = true;
  DistributedOptions options = petsc_only();
  if (rank() == size() - 1) options.stop = &stop;
  EXPECT_EQ(distributed.solve(options).status, Status::Interrupted);
  options.stop = nullptr;
  options.max_iterations = 1;
  const Summary one = distributed.solve(options);
  EXPECT_EQ(one.status, Status::MaxIterations);
  EXPECT_EQ(one.iterations, 1);
  EXPECT_LT(one.final_energy, one.initial_energy);
  EXPECT_EQ(distributed.solve().status, Status::Converged);
  EXPECT_EQ(distributed.solve().iterations, 0);
}

TEST(Petsc, ReturnsPetscsErrors) {
  const auto random = testing::sparse_system<Plane>(11, 100);
  DistributedSystem<2> distributed(MPI_COMM_WORLD, part(random.system, random.start));
  PetscOptionsSetValue(nullptr, "-asterism_pc_type", "nonsense");
  const Summary failed = distributed.solve();
  PetscOptionsClearValue(nullptr, "-asterism_pc_type");
  EXPECT_EQ(failed.status, Status::NumericalFailure);
  EXPECT_NE(std::string_view(failed.message).find("nonsense"), std::string_view::npos) << failed.message;
  const auto x = distributed.gather(0);
  if (rank() == 0) {
    EXPECT_TRUE(x.isApprox(random.start));
  }
  EXPECT_EQ(distributed.solve().status, Status::Converged);
}

class PetscFile : public ::testing::Test {
 protected:
  // One file for all processes.
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("asterism_petsc_test_" + std::to_string(size()) + ".petsc");
  void TearDown() override {
    MPI_Barrier(MPI_COMM_WORLD);
    if (rank() == 0) std::filesystem::remove(path);
    MPI_Barrier(MPI_COMM_WORLD);
  }
  void expect_refused(const std::string& words) const {
    try {
      read_petsc<2>(MPI_COMM_WORLD, path);
      ADD_FAILURE() << "read";
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(path.string()), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  }
};

TEST_F(PetscFile, IsReadAsItWasWritten) {
  auto random = testing::sparse_system<Space>(12, 101);
  random.system.fix(5);
  random.system.fix(100);
  write_petsc(MPI_COMM_WORLD, path, part(random.system, random.start));
  EXPECT_EQ(petsc_file_dim(MPI_COMM_WORLD, path), 3);
  const auto share = read_petsc<3>(MPI_COMM_WORLD, path);
  DistributedSystem<3> distributed(MPI_COMM_WORLD, share);
  ASSERT_EQ(distributed.problem(), "");
  const auto start = distributed.gather(0);
  if (rank() == 0) {
    EXPECT_TRUE(start.isApprox(random.start, 1e-15));
  }
  const Summary read = distributed.solve();
  const Summary given = DistributedSystem<3>(MPI_COMM_WORLD, part(random.system, random.start)).solve();
  EXPECT_EQ(read.status, Status::Converged);
  EXPECT_NEAR(read.final_energy, given.final_energy, 1e-12 * given.final_energy);
  expect_refused("3 coordinates");
}

TEST_F(PetscFile, OfOneProcessIsReadByAll) {
  const auto random = testing::sparse_system<Plane>(13, 50);
  write_petsc(MPI_COMM_WORLD, path,
              rank() == 0 ? whole_share<2>(random.system, random.start) : SystemShare<2>());
  expect_minimum<2>(random.system, random.start);
  const Summary summary = DistributedSystem<2>(MPI_COMM_WORLD, read_petsc<2>(MPI_COMM_WORLD, path)).solve();
  EXPECT_NEAR(summary.initial_energy, energy(random.system, random.start), 1e-12 * summary.initial_energy);
}

TEST_F(PetscFile, IsRefusedWhereItIsBad) {
  expect_refused("");  // there is none
  if (rank() == 0) std::ofstream(path) << "{\"asterism_system\": 1}";
  MPI_Barrier(MPI_COMM_WORLD);
  expect_refused("is not a system in PETSc's binary format");
  const auto random = testing::sparse_system<Plane>(14, 50);
  write_petsc(MPI_COMM_WORLD, path, part(random.system, random.start));
  const auto whole = std::filesystem::file_size(path);
  for (const auto& [bytes, words] : {std::pair(whole / 20, "anchors"), std::pair(whole / 2, "links")}) {
    MPI_Barrier(MPI_COMM_WORLD);
    if (rank() == 0) std::filesystem::resize_file(path, bytes);
    MPI_Barrier(MPI_COMM_WORLD);
    (void)words;
    expect_refused("");
    write_petsc(MPI_COMM_WORLD, path, part(random.system, random.start));
  }
}

}  // namespace
}  // namespace asterism

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  const asterism::PetscRuntime runtime(argc, argv);
  return RUN_ALL_TESTS();
}
