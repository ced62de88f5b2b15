// Compares the functions behind the playground's page with the library's own, bit for bit.
#include "playground.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/testing/random_system.hpp>
#include <string>
#include <vector>

namespace asterism {
namespace {

using System = SpringSystem<double, 2>;
using Points = System::Points;

/// What the page holds: a handle and its arrays.
class Page {
 public:
  explicit Page(const System& system) {
    std::vector<int> ends;
    for (const Link& link : system.links()) ends.insert(ends.end(), {link.i, link.j});
    handle_ = asterism_playground_new(system.nodes(), system.link_count(), ends.data());
    write(0, system.anchors);
    write(1, system.anchor_stiffness);
    write(2, system.rest_length);
    write(3, system.link_stiffness);
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
  Points x() {
    return Eigen::Map<const Points>(read(4).data(), 2, asterism_playground_count(handle_, 4) / 2);
  }
  asterism_playground* handle() { return handle_; }
  std::string message() { return asterism_playground_message(handle_); }

 private:
  asterism_playground* handle_ = nullptr;
};

testing::RandomSystem<System> some_problem(std::uint64_t index = 3) {
  auto problem = testing::numbered_system<System>(testing::Kind::Lit, Topology<>::full(6), index);
  problem.system.fix(1);
  return problem;
}

TEST(Playground, EveryMethodIsTheLibrarys) {
  const auto problem = some_problem();
  Page page(problem.system);
  int method = 0;
  for (; const char* name = asterism_playground_method(method); ++method) {
    SCOPED_TRACE(name);
    std::vector<double> energies;
    auto record = [&](const Iteration& at) {
      energies.push_back(at.energy);
      return true;
    };
    auto solver = make_solver<System>(name, {{"tolerance", 1e-9}, {"hold_floating", true}});
    solver.options().on_iteration = record;
    Points x = problem.start;
    const Summary summary = solver.solve(problem.system, x);
    for (int again = 0; again < 2; ++again) {  // the object is reusable
      page.write(4, problem.start);
      ASSERT_EQ(asterism_playground_solve(page.handle(), method, 1e-9, 10000),
                static_cast<int>(summary.status));
      EXPECT_EQ(page.x(), x);
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
      EXPECT_EQ(page.read(6).size(), 12 * energies.size());
    }
  }
  EXPECT_EQ(method, 5);
}

TEST(Playground, CertificateAndCovariancesAreTheLibrarys) {
  auto problem = some_problem(8);
  problem.system.release(1);
  Page page(problem.system);
  Points x = problem.start;
  ASSERT_EQ(solve(problem.system, x).status, Status::Converged);
  page.write(4, x);

  const Certificate certificate = certify(problem.system, x);
  EXPECT_EQ(asterism_playground_certify(page.handle()), static_cast<int>(certificate.proof));
  const std::vector<double> said = page.read(8);
  EXPECT_EQ(said[1], certificate.energy);
  EXPECT_EQ(said[2], certificate.lower_bound);
  EXPECT_EQ(page.message(), std::string_view(certificate.reason));
  EXPECT_EQ(asterism_playground_proof(static_cast<int>(said[0])), to_string(certificate.proof));

  const auto covariances = node_covariances(problem.system, x);
  EXPECT_EQ(asterism_playground_covariances(page.handle()), static_cast<int>(covariances.status));
  const std::vector<double> blocks = page.read(9);
  ASSERT_EQ(static_cast<Eigen::Index>(blocks.size()), covariances.blocks.size());
  EXPECT_TRUE(std::equal(blocks.begin(), blocks.end(), covariances.blocks.data()));
  EXPECT_EQ(asterism_playground_energy(page.handle()), energy(problem.system, x));
}

TEST(Playground, LandscapeIsTheEnergyOfAMovedNode) {
  const auto problem = some_problem();
  Page page(problem.system);
  page.write(4, problem.start);
  asterism_playground_landscape(page.handle(), 2, -1, -2, 0.25, 7, 5);
  const std::vector<double> map = page.read(10);
  ASSERT_EQ(map.size(), 35u);
  for (int row = 0; row < 5; ++row) {
    for (int column = 0; column < 7; ++column) {
      Points x = problem.start;
      x.col(2) << -1 + 0.25 * column, -2 + 0.25 * row;
      const double expected = energy(problem.system, x);
      EXPECT_NEAR(map[static_cast<std::size_t>(7 * row + column)], expected, 1e-12 * expected);
    }
  }
}

TEST(Playground, BadInputIsAStatusWithAMessage) {
  const int ends[] = {0, 1, 1, 7};
  asterism_playground* const p = asterism_playground_new(3, 2, ends);
  EXPECT_EQ(asterism_playground_solve(p, 3, 1e-8, 100), static_cast<int>(Status::InvalidInput));
  EXPECT_STREQ(asterism_playground_message(p), "link 1 has an end that is out of range");
  asterism_playground_delete(p);

  auto problem = some_problem();
  problem.system.link_stiffness[4] = -1;
  Page page(problem.system);
  page.write(4, problem.start);
  EXPECT_EQ(asterism_playground_solve(page.handle(), 0, 1e-8, 100), static_cast<int>(Status::InvalidInput));
  Points x = problem.start;
  EXPECT_EQ(page.message(), std::string_view(solve(problem.system, x).message));
  EXPECT_EQ(asterism_playground_array(page.handle(), 11), nullptr);
  EXPECT_EQ(asterism_playground_method(5), nullptr);
  EXPECT_EQ(asterism_playground_method(-1), nullptr);
}

}  // namespace
}  // namespace asterism
