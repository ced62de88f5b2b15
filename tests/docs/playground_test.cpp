// Compares the functions behind the playground's page with the library's own, bit for bit.
#include "playground.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/random_system.hpp>
#include <string>
#include <vector>

namespace asterism {
namespace {

struct Problem {
  System system;
  Eigen::MatrixXd start;
};

template <int Dim>
Problem some_problem(std::uint64_t index) {
  const auto springs =
      testing::numbered_system<SpringSystem<double, Dim>>(testing::Kind::Lit, Topology<>::full(6), index);
  return {to_system(springs.system), springs.start};
}
Problem some_problem(int dim, std::uint64_t index) {
  return dim == 2 ? some_problem<2>(index) : some_problem<3>(index);
}

/// What the page holds: a handle and its arrays.
class Page {
 public:
  explicit Page(const System& system) {
    const Term &anchors = system.term(0), &links = system.term(1);
    handle_ = asterism_playground_new(system.dim(), system.nodes(), links.size(), links.nodes().data());
    write(0, anchors.values("position"));
    write(1, anchors.values("stiffness"));
    write(2, links.values("length"));
    write(3, links.values("stiffness"));
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) asterism_playground_fix(handle_, i, 1);
    }
  }
  ~Page() { asterism_playground_delete(handle_); }
  Page(const Page&) = delete;
  Page& operator=(const Page&) = delete;

  template <typename Values>
  void write(int which, const Values& values) {
    ASSERT_EQ(asterism_playground_count(handle_, which), values.size());
    std::copy(values.data(), values.data() + values.size(), asterism_playground_array(handle_, which));
  }
  std::vector<double> read(int which) {
    const double* const values = asterism_playground_array(handle_, which);
    return {values, values + asterism_playground_count(handle_, which)};
  }
  std::vector<double> x() { return read(4); }
  asterism_playground* handle() { return handle_; }
  std::string message() { return asterism_playground_message(handle_); }

 private:
  asterism_playground* handle_ = nullptr;
};

std::vector<double> numbers(const Eigen::MatrixXd& x) { return {x.data(), x.data() + x.size()}; }

class Playground : public ::testing::TestWithParam<int> {
 protected:
  int dim() const { return GetParam(); }
};
INSTANTIATE_TEST_SUITE_P(Dimensions, Playground, ::testing::Values(2, 3));

TEST_P(Playground, EveryMethodIsTheLibrarys) {
  Problem problem = some_problem(dim(), 3);
  problem.system.fix(1);
  Page page(problem.system);
  int method = 0;
  for (; const char* name = asterism_playground_method(method); ++method) {
    SCOPED_TRACE(name);
    std::vector<double> energies;
    auto record = [&](const Iteration& at) {
      energies.push_back(at.energy);
      return true;
    };
    auto solver = system_solvers().make(name, {{"tolerance", 1e-9}, {"hold_floating", true}});
    solver.options().on_iteration = record;
    Eigen::MatrixXd x = problem.start;
    const Summary summary = solver.solve(problem.system, x);
    for (int again = 0; again < 2; ++again) {  // the object is reusable
      page.write(4, problem.start);
      ASSERT_EQ(asterism_playground_solve(page.handle(), method, 1e-9, 10000),
                static_cast<int>(summary.status));
      EXPECT_EQ(page.x(), numbers(x));
      const std::vector<double> said = page.read(7);
      ASSERT_EQ(said.size(), 13u);
      EXPECT_EQ(said[1], summary.iterations);
      EXPECT_EQ(said[6], summary.initial_energy);
      EXPECT_EQ(said[7], summary.final_energy);
      EXPECT_EQ(said[8], summary.lower_bound);
      EXPECT_EQ(said[10], summary.stationarity);
      EXPECT_EQ(page.message(), std::string_view(summary.message));
      EXPECT_EQ(asterism_playground_solver(page.handle()), std::string(summary.solver));
      const std::vector<double> records = page.read(5);
      ASSERT_EQ(records.size(), 3 * energies.size());
      for (std::size_t k = 0; k < energies.size(); ++k) EXPECT_EQ(records[3 * k + 1], energies[k]);
      EXPECT_EQ(page.read(6).size(), numbers(x).size() * energies.size());
    }
  }
  EXPECT_EQ(method, 5);
}

TEST_P(Playground, CertificateAndCovariancesAreTheLibrarys) {
  const Problem problem = some_problem(dim(), 8);
  Page page(problem.system);
  Eigen::MatrixXd x = problem.start;
  ASSERT_EQ(solve(problem.system, x).status, Status::Converged);
  page.write(4, x);

  const Certificate certificate = certify(problem.system, x);
  EXPECT_EQ(asterism_playground_certify(page.handle()), static_cast<int>(certificate.proof));
  const std::vector<double> said = page.read(8);
  EXPECT_EQ(said[1], certificate.energy);
  EXPECT_EQ(said[2], certificate.lower_bound);
  EXPECT_EQ(page.message(), std::string_view(certificate.reason));
  EXPECT_EQ(asterism_playground_proof(static_cast<int>(said[0])), to_string(certificate.proof));

  EXPECT_EQ(asterism_playground_covariances(page.handle()), 1);
  EXPECT_EQ(page.read(9), numbers(Solution(problem.system, x).covariances()));
  EXPECT_EQ(asterism_playground_energy(page.handle()), energy(problem.system, x));
}

TEST_P(Playground, LandscapeIsTheEnergyOfAMovedNode) {
  const Problem problem = some_problem(dim(), 3);
  Page page(problem.system);
  page.write(4, problem.start);
  Eigen::MatrixXd grid(3, 3);
  grid << -1, 0.25, 0, /* y */ -2, 0, 0.25, /* z */ 3, -0.125, 0.5;
  page.write(11, Eigen::MatrixXd(grid.topRows(dim())));
  asterism_playground_landscape(page.handle(), 2, 7, 5);
  const std::vector<double> map = page.read(10);
  ASSERT_EQ(map.size(), 35u);
  for (int row = 0; row < 5; ++row) {
    for (int column = 0; column < 7; ++column) {
      Eigen::MatrixXd x = problem.start;
      x.col(2) << (grid * Eigen::Vector3d(1, column, row)).head(dim());
      const double expected = energy(problem.system, x);
      EXPECT_NEAR(map[static_cast<std::size_t>(7 * row + column)], expected, 1e-12 * expected);
    }
  }
}

TEST_P(Playground, BadInputIsAStatusWithAMessage) {
  const int ends[] = {0, 1, 1, 7};
  asterism_playground* const p = asterism_playground_new(dim(), 3, 2, ends);
  EXPECT_EQ(asterism_playground_solve(p, 3, 1e-8, 100), static_cast<int>(Status::InvalidInput));
  EXPECT_STREQ(asterism_playground_message(p), "links: element 1 has a node out of range: 7 of 3 nodes");
  asterism_playground_delete(p);

  Problem problem = some_problem(dim(), 3);
  problem.system.term(1).values("stiffness")(4) = -1;
  Page page(problem.system);
  page.write(4, problem.start);
  EXPECT_EQ(asterism_playground_solve(page.handle(), 0, 1e-8, 100), static_cast<int>(Status::InvalidInput));
  Eigen::MatrixXd x = problem.start;
  EXPECT_EQ(page.message(), std::string_view(solve(problem.system, x).message));
  EXPECT_EQ(asterism_playground_array(page.handle(), 12), nullptr);
  EXPECT_EQ(asterism_playground_method(5), nullptr);
  EXPECT_EQ(asterism_playground_method(-1), nullptr);
}

}  // namespace
}  // namespace asterism
