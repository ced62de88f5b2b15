// Losses and potentials with parameters of their own for each anchor and link.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cmath>
#include <cstdint>
#include <vector>

#include "by_terms.hpp"
#include "matrices.hpp"

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

template <typename Model>
using System = SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic, Model>;
using All = System<Model<RobustHooke<Huber>, GemanMcClure>>;
using Own = System<Model<Each<RobustHooke<Huber>>, Each<GemanMcClure>>>;

template <typename To, typename From>
void copy_values(const From& from, To& to) {
  to.anchors = from.anchors;
  to.anchor_stiffness = from.anchor_stiffness;
  to.rest_length = from.rest_length;
  to.link_stiffness = from.link_stiffness;
}

struct Pair {
  All all;
  Own own;
  All::Points start;
};

Pair random_pair(std::uint64_t seed, int nodes) {
  Rng rng(seed);
  Pair pair{All(Topology<>::full(nodes)), Own(Topology<>::full(nodes)), {}};
  All& all = pair.all;
  all.anchors = random_points<All>(rng, nodes, -10, 10);
  all.set_rest_lengths(random_points<All>(rng, nodes, -10, 10));
  for (auto& k : all.anchor_stiffness) k = rng.uniform(0.5, 2);
  for (auto& k : all.link_stiffness) k = rng.uniform(0.2, 2);
  all.anchor_loss.scale = 6;
  all.link_potential.loss.scale = 2;
  copy_values(all, pair.own);
  pair.own.anchor_loss.values.assign(static_cast<std::size_t>(nodes), all.anchor_loss);
  pair.own.link_potential.values.assign(static_cast<std::size_t>(all.link_count()), all.link_potential);
  pair.start = all.anchors;
  return pair;
}

TEST(Each, WithEqualParametersIsOneForAll) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto [all, own, start] = random_pair(seed, 6);
    EXPECT_EQ(energy(own, start), energy(all, start));
    EXPECT_EQ(gradient(own, start), gradient(all, start));
    EXPECT_EQ(hessian(own, start), hessian(all, start));
    const auto expect_same = [&, &one = all, &other = own, &from = start](auto solver, auto same) {
      auto x = from, y = from;
      const Summary summary = solver.solve(one, x);
      EXPECT_EQ(same.solve(other, y).iterations, summary.iterations);
      EXPECT_EQ(x, y) << summary;
    };
    expect_same(Newton<All>(), Newton<Own>());
    expect_same(Ida<All>(), Ida<Own>());
  }
}

TEST(Each, HasTheEnergyOfItsOwnParameters) {
  auto [all, own, start] = random_pair(3, 5);
  double sum = 0;
  for (int i = 0; i < 5; ++i) {
    own.anchor_loss.values[static_cast<std::size_t>(i)].scale = 1 + i;
    start.col(i).array() += i;
    const double s = (start.col(i) - own.anchors.col(i)).squaredNorm();
    sum += own.anchor_stiffness[i] / 2 * s / (1 + s / ((1 + i) * (1 + i)));
  }
  for (int l = 0; l < own.link_count(); ++l) {
    own.link_potential.values[static_cast<std::size_t>(l)].loss.scale = 0.5 + l;
    const Link link = own.links()[static_cast<std::size_t>(l)];
    const double r = std::abs((start.col(link.i) - start.col(link.j)).norm() - own.rest_length[l]);
    const double c = 0.5 + l;
    sum += own.link_stiffness[l] * (r <= c ? r * r / 2 : c * r - c * c / 2);
  }
  EXPECT_NEAR(energy(own, start), sum, 1e-12 * sum);
  const Own::Points g = gradient(own, start);
  const double h = 1e-6;
  for (int c = 0; c < start.size(); ++c) {
    Own::Points ahead = start, behind = start;
    ahead.data()[c] += h;
    behind.data()[c] -= h;
    EXPECT_NEAR(g.data()[c], (energy(own, ahead) - energy(own, behind)) / (2 * h), 1e-6);
  }
  auto x = start;
  const Summary newton = Newton<Own>().solve(own, x);
  EXPECT_EQ(newton.status, Status::Converged) << newton;
  auto y = x;
  y.array() += 1e-3;
  Ida<Own> ida;
  ida.options.max_iterations = 100000;
  EXPECT_EQ(ida.solve(own, y).status, Status::Converged);
  EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-4);
}

// Subdomains take the parameters of their own links and anchors with them.
TEST(Each, IsDividedWithItsSystem) {
  using Ropes = System<Model<Each<RobustHooke<Huber>>, Each<Huber>>>;
  const auto [springs, start] = testing::sparse_system<SpringSystem<double, 2>>(5, 2000);
  Ropes system(Topology<>::from_links(springs.nodes(), springs.links()));
  copy_values(springs, system);
  Rng rng(2);
  const double length = characteristic_length(springs, start);
  for (int i = 0; i < system.nodes(); ++i)
    system.anchor_loss.values.push_back({length * rng.uniform(0.1, 1)});
  for (int l = 0; l < system.link_count(); ++l)
    system.link_potential.values.push_back({{length * rng.uniform(0.1, 1)}});
  auto x = start, y = start;
  const Summary direct = testing::SparseNewton<Ropes>().solve(system, x);
  const Summary divided = system_solver<Ropes>("schwarz").solve(system, y);
  EXPECT_EQ(direct.status, Status::Converged) << direct;
  EXPECT_EQ(divided.status, Status::Converged) << divided;
  EXPECT_NEAR(divided.final_energy, direct.final_energy, 1e-2 * direct.final_energy);
}

TEST(Each, IsCertifiedWhereItsPotentialIs) {
  using Mixed = System<Model<Each<Rope>>>;
  static_assert(detail::has_minoriser<Each<Rope>>());
  static_assert(!detail::has_minoriser<Each<RobustHooke<Huber>>>());
  Mixed system(Topology<>::full(3));
  system.anchors << 0, 9, 0, 0, 0, 9;
  system.anchor_stiffness.setOnes();
  system.rest_length.setConstant(3);
  system.link_stiffness.setOnes();
  system.link_potential.values.resize(3);
  auto x = system.anchors;
  EXPECT_EQ(Newton<Mixed>().solve(system, x).status, Status::Converged);
  EXPECT_TRUE(certify(system, x).certified());
}

TEST(Each, IsGraduated) {
  using Loose = System<Model<Hooke, Each<GemanMcClure>>>;
  Rng rng(5);
  const int n = 12;
  Loose system(Topology<>::full(n));
  const Loose::Points truth = random_points<Loose>(rng, n, -20, 20);
  system.anchors = truth;
  system.set_rest_lengths(truth);
  system.anchor_stiffness.setOnes();
  system.link_stiffness.setConstant(0.5);
  for (int i = 0; i < n; ++i) system.anchor_loss.values.push_back({0.5 + 0.1 * i});
  for (const int i : {1, 4, 7, 9}) system.anchors.col(i).setConstant(30);  // outliers that agree
  Eigen::MatrixXd x = system.anchors;
  EXPECT_EQ(solve("graduated", to_system(system), x).status, Status::Converged);
  EXPECT_LT((x - truth).cwiseAbs().maxCoeff(), 0.5);
}

TEST(Each, HasDerivativesByWhatIsNotItsParameter) {
  auto [all, own, start] = random_pair(2, 5);
  for (std::size_t i = 0; i < 5; ++i) own.anchor_loss.values[i].scale = 8 + static_cast<double>(i);
  Newton<Own> newton;
  newton.options.tolerance = 1e-13;
  auto x = start;
  ASSERT_EQ(newton.solve(own, x).status, Status::Converged);
  Rng rng(8);
  const Own::Points grad_x = random_points<Own>(rng, 5, -1, 1);
  const auto gradient = sensitivity(own, x, grad_x);
  ASSERT_EQ(gradient.status, SensitivityStatus::Computed) << gradient.message;
  const double h = 1e-6;
  const auto by = [&, &given = own, &from = x](auto&& change) {
    double value[2];
    for (int side = 0; side < 2; ++side) {
      Own changed = given;
      change(changed, side == 0 ? -h : h);
      auto y = from;
      newton.solve(changed, y);
      value[side] = grad_x.cwiseProduct(y).sum();
    }
    return (value[1] - value[0]) / (2 * h);
  };
  for (int i = 0; i < 5; ++i)
    EXPECT_NEAR(gradient.anchors(1, i), by([i](Own& s, double t) { s.anchors(1, i) += t; }), 1e-5);
  for (int l = 0; l < own.link_count(); ++l) {
    EXPECT_NEAR(gradient.rest_length[l], by([l](Own& s, double t) { s.rest_length[l] += t; }), 1e-5);
    EXPECT_NEAR(gradient.link_stiffness[l], by([l](Own& s, double t) { s.link_stiffness[l] += t; }), 1e-5);
  }
}

TEST(Each, IsValidated) {
  auto [all, own, start] = random_pair(1, 4);
  const auto says = [&own = own, &start = start](const char* expected) {
    auto x = start;
    const Summary summary = Newton<Own>().solve(own, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
  };
  own.anchor_loss.values[2].scale = 0;
  says("anchor loss 2 is not a positive, finite scale");
  own.anchor_loss.values.pop_back();
  says("anchor loss must have one entry for each");
  own.anchor_loss.values.assign(4, {1});
  own.link_potential.values.clear();
  says("link potential must have one entry for each");
}

}  // namespace
}  // namespace asterism
