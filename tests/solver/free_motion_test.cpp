// Rigid motions that cost no energy, of a component or a part of it: every solver that reports whether the
// Hessian is positive definite must report 0, and every covariance must be refused with a message that names
// the motion. One line per way of holding the nodes.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <functional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "by_terms.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

template <typename System>
struct Held {
  using Hold = std::function<void(System& system, typename System::Points& x)>;

  Held(const char* kind, std::string message, Hold how, std::vector<Link> linked = {})
      : name(kind), motion(std::move(message)), hold(std::move(how)), links(std::move(linked)) {}

  const char* name;
  std::string motion;  ///< message of the covariance's refusal; empty if all is held
  Hold hold;
  std::vector<Link> links;  ///< empty: all pairs
};

template <typename System>
void hold_by_anchors(System& system, const std::vector<int>& nodes, double stiffness = 0.5) {
  using Scalar = typename System::Scalar;
  for (const int i : nodes) system.anchor_stiffness[i] = static_cast<Scalar>(stiffness);
}

constexpr int kNodes = 6;

/// The same with another scalar or storage; anisotropic anchors become isotropic.
template <typename System, typename Given>
testing::RandomSystem<System> as(const testing::RandomSystem<Given>& given) {
  using Scalar = typename System::Scalar;
  if constexpr (std::is_same_v<System, Given>) {
    return given;
  } else {
    const Given& from = given.system;
    const auto topology = from.topology().is_full() ? System::TopologyType::full(kNodes)
                                                    : System::TopologyType::from_links(kNodes, from.links());
    testing::RandomSystem<System> result{System(topology), given.start.template cast<Scalar>()};
    System& system = result.system;
    system.anchors = from.anchors.template cast<Scalar>();
    system.anchor_stiffness = from.anchor_stiffness.template cast<Scalar>();
    system.rest_length = from.rest_length.template cast<Scalar>();
    system.link_stiffness = from.link_stiffness.template cast<Scalar>();
    for (int i = 0; i < kNodes; ++i) {
      if (from.is_fixed(i)) system.fix(i);
      if constexpr (System::kAnisotropic) {
        system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i).setIdentity();
      }
    }
    return result;
  }
}

// Nodes in general position without anchors, and a start nearby; the rest lengths differ from it.
template <typename Springs>
testing::RandomSystem<Springs> unheld_springs(std::uint64_t seed, const std::vector<Link>& links) {
  testing::Rng rng(seed);
  const auto topology = links.empty() ? Topology<>::full(kNodes) : Topology<>::from_links(kNodes, links);
  testing::RandomSystem<Springs> result{Springs(topology),
                                        testing::random_points<Springs>(rng, kNodes, 0, 1)};
  Springs& system = result.system;
  system.anchors = result.start;
  system.anchor_stiffness.setZero();
  system.link_stiffness.setOnes();
  system.set_rest_lengths(result.start);
  for (auto& length : system.rest_length) length *= 1 + 0.05 * rng.uniform(-1, 1);
  result.start += testing::random_points<Springs>(rng, kNodes, -0.05, 0.05);
  return result;
}

template <typename System>
testing::RandomSystem<System> unheld(std::uint64_t seed, const std::vector<Link>& links) {
  return as<System>(unheld_springs<SpringSystem<double, System::kDim>>(seed, links));
}

template <typename System>
void expect_covariance(const std::string& motion, const System& system, const typename System::Points& x) {
  const auto all = covariance(system, x);
  const auto blocks = node_covariances(system, x);
  EXPECT_EQ(std::string_view(all.message), std::string_view(blocks.message));
  if (motion.empty()) {
    EXPECT_TRUE(all) << all.message;
    EXPECT_TRUE(blocks) << blocks.message;
    return;
  }
  EXPECT_EQ(all.status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_EQ(blocks.status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_NE(std::string_view(all.message).find(motion), std::string_view::npos) << all.message;
}

template <typename System>
using Solve = std::function<Summary(const System& system, typename System::Points& x)>;

/// A solver with this tolerance.
template <typename Solver>
auto with(double tolerance) {
  return [tolerance](const auto& system, auto& x) {
    Solver solver;
    solver.options.tolerance = tolerance;
    return solver.solve(system, x);
  };
}

template <typename System, typename Given>
void expect_verdict(const std::vector<Held<Given>>& table, const Solve<System>& solve) {
  for (const Held<Given>& held : table) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      auto given = unheld<Given>(seed, held.links);
      held.hold(given.system, given.start);
      auto [system, x] = as<System>(given);
      const Summary summary = solve(system, x);
      SCOPED_TRACE(std::string(held.name) + ", " + std::string(summary.solver) + ", seed " +
                   std::to_string(seed));
      ASSERT_TRUE(summary.usable()) << summary;
      if (summary.positive_definite.has_value()) {
        EXPECT_EQ(summary.positive_definite, held.motion.empty()) << summary;
      }
      if (held.motion.empty() && summary.positive_definite != true) continue;
      expect_covariance(held.motion, system, x);
    }
  }
}

using Dynamic2 = testing::Plane;
using Dynamic3 = testing::Space;
using Fixed2f = SpringSystem<float, 2, kNodes>;

// For float, with stronger anchors and shorter distances.
std::vector<Held<Dynamic2>> in_the_plane(bool for_float = false) {
  using System = Dynamic2;
  using Points = System::Points;
  const auto anchors = [](std::vector<int> nodes) {
    return [nodes](System& system, Points&) { hold_by_anchors(system, nodes); };
  };
  const std::vector<Link> two_triangles = {{0, 1}, {1, 2}, {0, 2}, {3, 4}, {4, 5}, {3, 5}};
  const std::vector<Link> bow_tie = {{0, 1}, {1, 2}, {0, 2}, {2, 3}, {3, 4}, {2, 4}, {4, 5}, {3, 5}};
  const std::vector<Link> leaf = {{0, 1}, {0, 2}, {1, 2}, {0, 3}, {1, 3}, {0, 4}, {1, 4}, {2, 5}};
  return {
      {"one fixed node", "can rotate about node 2", [](System& s, Points&) { s.fix(2); }},
      {"one anchored node", "can rotate about node 1", anchors({1})},
      {"one anchored node of great stiffness", "can rotate about node 1",
       [](System& s, Points&) { hold_by_anchors(s, {1}, 1e6); }},
      {"one fixed and anchored node", "can rotate about node 1",
       [](System& s, Points&) {
         hold_by_anchors(s, {1});
         s.fix(1);
       }},
      {"all anchors on one point", "can rotate: its anchors do not hold it",
       [](System& s, Points&) {
         s.anchors.setConstant(0.5);
         s.anchor_stiffness.setConstant(1e-3);
       }},
      {"one of two components", "can rotate about node 3",
       [](System& s, Points&) {
         hold_by_anchors(s, {0, 1, 2, 3});
       },
       two_triangles},
      {"two components about one fixed node", "can rotate about node 2",
       [](System& s, Points&) {
         hold_by_anchors(s, {0, 1});
         s.fix(2);
       },
       bow_tie},
      {"a part about an anchored node", "can rotate about node 2, which alone connects it",
       anchors({0, 1, 2}), bow_tie},
      {"a part about a node of no anchor", "can rotate about node 2, which alone connects it",
       anchors({0, 1}), bow_tie},
      {"a leaf", "node 5 can rotate about node 2", anchors({0, 1, 2, 3, 4}), leaf},
      {"all anchors on a fixed node", "can rotate about node 0",
       [](System& s, Points& x) {
         hold_by_anchors(s, {1, 2, 4});
         s.anchors.colwise() = x.col(0).eval();
         s.fix(0);
       }},
      {"all anchors but one on a fixed node", "",
       [](System& s, Points& x) {
         hold_by_anchors(s, {1, 2, 4});
         s.anchors.leftCols<4>().colwise() = x.col(0).eval();
         s.fix(0);
       }},
      {"two anchored nodes", "", anchors({0, 3})},
      {"two anchored nodes, weakly", "",
       [for_float](System& s, Points&) {
         hold_by_anchors(s, {0, 3}, for_float ? 1e-3 : 1e-9);
       }},
      {"two fixed nodes", "",
       [](System& s, Points&) {
         s.fix(0);
         s.fix(3);
       }},
      {"a fixed and an anchored node", "",
       [](System& s, Points&) {
         s.fix(0);
         hold_by_anchors(s, {3});
       }},
      {"all anchored nodes", "", anchors({0, 1, 2, 3, 4, 5})},
      {"far from the origin", "",
       [for_float](System& s, Points& x) {
         const double far = for_float ? 30 : 1e5;
         x.array() += far;
         s.anchors.array() += far;
         hold_by_anchors(s, {0, 3});
       }},
  };
}

std::vector<Held<Dynamic3>> in_space() {
  using System = Dynamic3;
  using Points = System::Points;
  const auto anchors = [](std::vector<int> nodes) {
    return [nodes](System& system, Points&) { hold_by_anchors(system, nodes); };
  };
  const auto on_a_line = [](System& s, Points& x, const std::vector<int>& nodes) {
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      x.col(nodes[k]) << 0.1 + 0.3 * double(k), 0.2 + 0.1 * double(k), 0.3 - 0.7 * double(k);
      s.anchors.col(nodes[k]) = x.col(nodes[k]);
    }
    s.set_rest_lengths(x);
  };
  const std::vector<Link> two_links = {{0, 1}, {0, 2}, {1, 2}, {0, 3}, {1, 3}, {2, 3},
                                       {0, 4}, {1, 4}, {2, 4}, {3, 4}, {3, 5}, {4, 5}};
  return {
      {"one fixed node", "can rotate about node 2", [](System& s, Points&) { s.fix(2); }},
      {"one anchored node", "can rotate about node 1", anchors({1})},
      {"two anchored nodes", "can rotate about the line through nodes 0 and 3", anchors({0, 3})},
      {"two fixed nodes", "can rotate about the line through nodes 1 and 4",
       [](System& s, Points&) {
         s.fix(1);
         s.fix(4);
       }},
      {"a fixed and an anchored node", "can rotate about the line through nodes 1 and 4",
       [](System& s, Points&) {
         s.fix(1);
         hold_by_anchors(s, {4});
       }},
      {"three anchored nodes on a line", "can rotate",
       [=](System& s, Points& x) {
         on_a_line(s, x, {0, 1, 2});
         hold_by_anchors(s, {0, 1, 2});
       }},
      {"three fixed nodes on a line", "can rotate about the line through nodes 0 and 1",
       [=](System& s, Points& x) {
         on_a_line(s, x, {0, 1, 2});
         for (const int i : {0, 1, 2}) s.fix(i);
       }},
      {"all anchors on a fixed node", "can rotate about node 0",
       [](System& s, Points& x) {
         hold_by_anchors(s, {1, 2, 4});
         s.anchors.colwise() = x.col(0).eval();
         s.fix(0);
       }},
      {"all anchors on the line through fixed nodes", "can rotate about the line through nodes 0 and 1",
       [](System& s, Points& x) {
         hold_by_anchors(s, {2, 4});
         for (int i = 2; i < kNodes; ++i) s.anchors.col(i) = (1 - 0.2 * i) * x.col(0) + 0.2 * i * x.col(1);
         s.fix(0);
         s.fix(1);
       }},
      {"a node that two links hold",
       "node 5 can rotate about the line through nodes 3 and 4, which alone connect it", anchors({0, 1, 2}),
       two_links},
      {"a node that two links hold, between fixed nodes", "node 5 can rotate about the line",
       [](System& s, Points&) {
         hold_by_anchors(s, {0, 1, 2});
         s.fix(3);
         s.fix(4);
       },
       two_links},
      {"a node of a taut cable", "",
       [](System& s, Points& x) {
         for (const int i : {0, 1, 2, 3, 4}) s.fix(i);
         s.rest_length.tail<2>().setConstant(0.3 * (x.col(3) - x.col(4)).norm());
       },
       two_links},
      {"three anchored nodes", "", anchors({0, 3, 4})},
      {"three fixed nodes", "",
       [](System& s, Points&) {
         for (const int i : {0, 1, 2}) s.fix(i);
       }},
      {"all anchored nodes", "", anchors({0, 1, 2, 3, 4, 5})},
  };
}

TEST(FreeMotion, IsNoStrictMinimumInThePlane) {
  const auto table = in_the_plane();
  for (const double tolerance : {1e-4, 1e-8, 1e-12}) {
    expect_verdict<Dynamic2>(table, with<Newton<Dynamic2>>(tolerance));
    expect_verdict<Dynamic2>(table, with<Ida<Dynamic2>>(tolerance));
    expect_verdict<Dynamic2>(table, with<Auto<Dynamic2>>(tolerance));
  }
  // Tight, as with looser tolerances these stop before weak anchors have rotated the constellation.
  expect_verdict<Dynamic2>(table, with<testing::SparseNewton<Dynamic2>>(1e-12));
}

TEST(FreeMotion, IsNoStrictMinimumInSpace) {
  const auto table = in_space();
  for (const double tolerance : {1e-4, 1e-8, 1e-12}) {
    expect_verdict<Dynamic3>(table, with<Newton<Dynamic3>>(tolerance));
  }
  expect_verdict<Dynamic3>(table, with<testing::SparseNewton<Dynamic3>>(1e-12));
}

TEST(FreeMotion, IsNoStrictMinimumOfBoundedOrFixedSize) {
  using Bounded2 = testing::Bounded2;
  expect_verdict<Bounded2>(in_the_plane(), with<Newton<Bounded2>>(1e-8));
  expect_verdict<Fixed2f>(in_the_plane(true), with<Newton<Fixed2f>>(1e-5));
}

TEST(FreeMotion, IsNoStrictMinimumInABatch) {
  for (const auto& held : in_the_plane()) {
    if (!held.links.empty()) continue;
    constexpr int kSystems = 40;
    SpringBatch<double, 2> batch(Topology<>::full(kNodes), kSystems);
    bool has_fixed = false;
    for (int s = 0; s < kSystems; ++s) {
      auto [system, x] = unheld<Dynamic2>(static_cast<std::uint64_t>(s) + 1, {});
      held.hold(system, x);
      has_fixed |= system.fixed_count() > 0;
      batch.set(s, system, x);
    }
    if (has_fixed) continue;  // a batch has no fixed nodes
    BatchNewton(batch).solve(batch);
    for (int s = 0; s < kSystems; ++s) {
      if (batch.status(s) != Status::Converged) continue;
      EXPECT_EQ(batch.positive_definite(s), held.motion.empty()) << held.name << ", system " << s;
    }
  }
}

// Independent of scale, position and the unit of stiffness.
TEST(FreeMotion, IsFoundAtAnyScale) {
  for (const double length : {1e-6, 1.0, 1e6}) {
    for (const double stiffness : {1e-6, 1.0, 1e6}) {
      for (const bool is_free : {true, false}) {
        auto [system, x] = unheld<Dynamic3>(3, {});
        hold_by_anchors(system, is_free ? std::vector<int>{0, 3} : std::vector<int>{0, 3, 4});
        system.anchors *= length;
        system.rest_length *= length;
        x *= length;
        system.anchor_stiffness *= stiffness;
        system.link_stiffness *= stiffness;
        EXPECT_EQ(Newton<Dynamic3>().solve(system, x).positive_definite, !is_free);
        EXPECT_EQ(covariance(system, x).status,
                  is_free ? CovarianceStatus::NotPositiveDefinite : CovarianceStatus::Computed);
      }
    }
  }
}

TEST(FreeMotion, OfComponentsThatWereGrounded) {
  auto [system, x] = unheld<Dynamic2>(1, {});
  Newton<Dynamic2> solver;
  solver.options.hold_floating = true;
  EXPECT_EQ(solver.solve(system, x).status, Status::Converged);
  auto grounded = system;
  grounded.fix(0);
  const auto result = covariance(grounded, x);
  EXPECT_EQ(result.status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_NE(std::string_view(result.message).find("can rotate about node 0"), std::string_view::npos);
  EXPECT_EQ(solver.solve(system, x).positive_definite, false);
}

// Anchors that hold only one direction, and robust anchors.
TEST(FreeMotion, OfOtherModels) {
  using Along = testing::Ellipses::System;
  const Eigen::Matrix2d along_x{{1.0, 0.0}, {0.0, 0.0}};
  const Eigen::Matrix2d along_y{{0.0, 0.0}, {0.0, 1.0}};
  const std::vector<Held<Along>> table = {
      {"all along x", "can slide",
       [&](Along& s, auto&) {
         for (int i = 0; i < kNodes; ++i) s.set_anchor_information(i, along_x);
       }},
      {"x and y of one node", "can rotate about node 0",
       [&](Along& s, auto&) { s.set_anchor_information(0, Eigen::Matrix2d::Identity()); }},
      {"x of one node and y of another", "can rotate",
       [&](Along& s, auto&) {
         s.set_anchor_information(0, along_x);
         s.set_anchor_information(3, along_y);
       }},
      {"a point and a direction", "",
       [&](Along& s, auto& x) {
         x.col(0) << 0, 0;
         x.col(3) << 1, 0.1;
         s.anchors = x;
         s.set_rest_lengths(x);
         s.set_anchor_information(0, Eigen::Matrix2d::Identity());
         s.set_anchor_information(3, along_y);
       }},
  };
  expect_verdict<Along>(table, with<Newton<Along>>(1e-10));

  using Robust = testing::Hubers::System;
  const std::vector<Held<Robust>> robust = {
      {"one robust anchor", "can rotate about node 4", [](Robust& s, auto&) { hold_by_anchors(s, {4}); }},
      {"two robust anchors", "",
       [](Robust& s, auto&) {
         hold_by_anchors(s, {4, 1});
       }},
  };
  expect_verdict<Robust>(robust, with<Newton<Robust>>(1e-10));
}

// A single node, or coincident nodes, cannot rotate.
TEST(FreeMotion, OfPointsThatDoNotTurn) {
  SpringSystem<double, 3> system(Topology<>::full(3));
  system.anchors.setConstant(3, 3, 7.0);
  system.anchor_stiffness << 1, 0, 0;
  system.rest_length.setZero();
  system.link_stiffness.setOnes();
  EXPECT_TRUE(covariance(system, system.anchors));
  SpringSystem<double, 2> line(Topology<>::full(2));
  line.anchors << 0, 1, 0, 0;
  line.anchor_stiffness << 1, 1;
  line.set_rest_lengths(line.anchors);
  line.link_stiffness << 1;
  EXPECT_TRUE(covariance(line, line.anchors));
  // Rotation about the line through the nodes moves nothing.
  for (const int n : {2, 3}) {
    SpringSystem<double, 3> rod(Topology<>::full(n));
    for (int i = 0; i < n; ++i) rod.anchors.col(i) << 0.3 + 0.7 * i, 0.1 - 0.9 * i, 0.2 + 0.4 * i;
    rod.anchor_stiffness.setConstant(0.7);
    rod.set_rest_lengths(rod.anchors);
    rod.rest_length *= 0.9;
    rod.link_stiffness.setOnes();
    auto x = rod.anchors;
    EXPECT_EQ(Newton(rod).solve(rod, x).positive_definite, true);
    EXPECT_TRUE(covariance(rod, x));
  }
}

// Nodes that are all but on a line, or on a point, turn about it without going anywhere: what is known of
// these by hand is that their Hessians have no eigenvalue near 0.
template <typename System>
struct NearlyCollinear {
  const char* name;
  std::function<void(System& system, typename System::Points& x, double off)> make;
  int nodes;
  std::vector<Link> links = {};  ///< a chain if empty
};

template <typename System>
void expect_held(const std::vector<NearlyCollinear<System>>& kinds) {
  using Points = typename System::Points;
  for (const auto& kind : kinds) {
    std::vector<Link> links = kind.links;
    for (int i = 0; links.empty() || (kind.links.empty() && i + 1 < kind.nodes); ++i)
      links.push_back({i, i + 1});
    for (const double off : {0.0, 1e-12, 1e-9, 1e-6, 1e-3}) {
      for (const double tolerance : {1e-4, 1e-8, 1e-12}) {
        SCOPED_TRACE(std::string(kind.name) + ", off by " + std::to_string(std::log10(off)) + ", tolerance " +
                     std::to_string(std::log10(tolerance)));
        System system(Topology<>::from_links(kind.nodes, links));
        Points x(System::kDim, kind.nodes);
        kind.make(system, x, off);
        Newton<System> newton;
        newton.options.tolerance = tolerance;
        const Summary summary = newton.solve(system, x);
        EXPECT_EQ(summary.status, Status::Converged) << summary;
        EXPECT_EQ(summary.positive_definite, true) << summary;
        expect_covariance("", system, x);
        const auto gradient = sensitivity(system, x, Points(Points::Ones(System::kDim, kind.nodes)), {1e-3});
        EXPECT_TRUE(gradient) << gradient.message;
      }
    }
  }
}

TEST(FreeMotion, OfNodesThatAreNearlyCollinear) {
  using Space = Dynamic3;
  using Points = Space::Points;
  const auto on_a_line = [](Points& x, double step) {
    for (int i = 0; i < x.cols(); ++i) x.col(i) << step * i, 0, 0;
  };
  const auto bend = [](Points& x, double off) {
    for (int i = 1; i < x.cols(); ++i) {
      x(1, i) += i % 2 == 1 ? off : 0;
      x(2, i) += i % 3 == 2 ? off : 0;
    }
  };
  const auto soften = [](Space& s, double anchors) {
    s.anchor_stiffness.setConstant(anchors);
    s.link_stiffness.setOnes();
  };
  expect_held<Space>({
      {"anchors on a line",
       [&](Space& s, Points& x, double off) {
         x << 0, 10, 25, 0, off, 0, 0, 0, off;
         s.anchors = x;
         soften(s, 1);
         s.rest_length.setConstant(5);
       },
       3},
      {"a taut cable",
       [&](Space& s, Points& x, double off) {
         on_a_line(x, 1);
         s.anchors = x;
         soften(s, 0);
         s.rest_length.setConstant(0.7);
         s.fix(0);
         s.fix(9);
         bend(x, off);
         x.col(9) << 9, 0, 0;
       },
       10},
      {"a taut cable between anchors",
       [&](Space& s, Points& x, double off) {
         on_a_line(x, 1);
         s.anchors = x;
         soften(s, 0);
         s.anchor_stiffness[0] = s.anchor_stiffness[4] = 2;
         s.rest_length.setConstant(0.7);
         bend(x, off);
       },
       5},
      {"a leaf of rest length 0",
       [&](Space& s, Points& x, double off) {
         x << 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1;
         s.anchors = x;
         soften(s, 1);
         s.anchor_stiffness[3] = 0;
         s.rest_length << 1, 1.5, 0, 1;
         x(0, 3) += off;
         x(2, 3) -= off;
       },
       4,
       {{0, 1}, {1, 2}, {2, 3}, {0, 2}}},
  });
}

}  // namespace
}  // namespace asterism
