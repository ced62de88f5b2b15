// The random systems are the same on all platforms: their digests are stored here.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cmath>
#include <cstdint>

namespace asterism::testing {
namespace {

template <typename System>
std::uint64_t digest_of_kind(Kind kind, int n, int count) {
  std::uint64_t result = 0xcbf29ce484222325ULL;
  for (int index = 0; index < count; ++index) {
    const auto random =
        numbered_system<System>(kind, System::TopologyType::full(n), static_cast<std::uint64_t>(index));
    result = digest(random, result);
  }
  return result;
}

TEST(RandomSystem, DigestsAreTheStoredOnes) {
  using Plane = SpringSystem<double, 2>;
  using Space = SpringSystem<double, 3>;
  EXPECT_EQ(digest_of_kind<Plane>(Kind::Lit, 4, 1000), 0xebfc18ccad88465au);
  EXPECT_EQ(digest_of_kind<Plane>(Kind::Orig, 4, 1000), 0xc4e375dcd14b1741u);
  EXPECT_EQ(digest_of_kind<Plane>(Kind::Disp, 4, 1000), 0xc4fb72f4f2b697f3u);
  EXPECT_EQ(digest_of_kind<Plane>(Kind::Track, 4, 1000), 0xd45ccd5088bd7a8cu);
  EXPECT_EQ(digest_of_kind<Plane>(Kind::Lit, 64, 10), 0xcfe7c8335c68ae9eu);
  EXPECT_EQ(digest_of_kind<Plane>(Kind::Track, 64, 10), 0x187650453f06d48fu);
  EXPECT_EQ(digest_of_kind<Space>(Kind::Lit, 9, 100), 0x94473309546cf600u);
  EXPECT_EQ(digest_of_kind<Space>(Kind::Track, 9, 100), 0x9d7b22a67d92ac72u);
  EXPECT_EQ(digest(sparse_system<Plane>(1, 2000)), 0xc6f94383d5410cb0u);
}

TEST(RandomSystem, SizesAndScalarsAreTheSameSystems) {
  using Dynamic = SpringSystem<double, 2>;
  using Fixed = SpringSystem<double, 2, 4>;
  using Float = SpringSystem<float, 2, 4>;
  for (const Kind kind : kKinds) {
    const auto expected = numbered_system<Dynamic>(kind, Topology<>::full(4), 7);
    const auto fixed = numbered_system<Fixed>(kind, Topology<4>::full(), 7);
    const auto single = numbered_system<Float>(kind, Topology<4>::full(), 7);
    EXPECT_EQ(digest(fixed), digest(expected));
    EXPECT_EQ(single.start, expected.start.cast<float>());
    EXPECT_EQ(single.system.link_stiffness, expected.system.link_stiffness.cast<float>());
    EXPECT_NE(digest(expected), digest(numbered_system<Dynamic>(kind, Topology<>::full(4), 8)));
  }
}

// The systems follow Sec. 3.2.1 of the paper, as far as relations between their numbers show.
TEST(RandomSystem, IsThePapers) {
  using System = SpringSystem<double, 2>;
  for (const Kind kind : {Kind::Lit, Kind::Orig, Kind::Disp}) {
    double largest_displacement = 0;
    double largest_pull = 0;
    for (std::uint64_t index = 0; index < 200; ++index) {
      const auto [system, start] = numbered_system<System>(kind, Topology<>::full(6), index);
      const double mean = system.link_stiffness.mean();
      EXPECT_GE(system.anchor_stiffness.minCoeff(), 0.5);
      EXPECT_LT(system.anchor_stiffness.maxCoeff(), 0.5 + mean);
      for (int l = 0; const Link& link : system.links()) {
        const double length =
            kind == Kind::Disp ? (start.col(link.i) - start.col(link.j)).norm() : system.rest_length[l];
        EXPECT_NEAR(system.link_stiffness[l], 100 / (length * length), 1e-9 * system.link_stiffness[l]);
        ++l;
      }
      largest_displacement = std::max(largest_displacement, start.cwiseAbs().maxCoeff());
      largest_pull = std::max(largest_pull, (start - system.anchors).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(largest_displacement, 1.4);
    EXPECT_LE(largest_displacement, 1.5);
    EXPECT_GT(largest_pull, kind == Kind::Orig ? 0.7 : 0.24);
    EXPECT_LE(largest_pull, kind == Kind::Orig ? 0.75 : 0.25);
  }
}

TEST(RandomSystem, NormalNumbersAreNormal) {
  Rng rng(3);
  constexpr int kCount = 100000;
  double sum = 0, squares = 0, within = 0;
  for (int i = 0; i < kCount; ++i) {
    const double z = rng.normal();
    sum += z;
    squares += z * z;
    within += std::abs(z) < 1;
  }
  EXPECT_NEAR(sum / kCount, 0, 0.015);
  EXPECT_NEAR(squares / kCount, 1, 0.02);
  EXPECT_NEAR(within / kCount, 0.6827, 0.006);
}

}  // namespace
}  // namespace asterism::testing
