#pragma once

// Derivatives of solutions against central differences of solutions, for any type of system.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <iostream>
#include <string>
#include <type_traits>
#include <vector>

#include "environment.hpp"
#include "matrices.hpp"
#include "model_kits.hpp"

namespace asterism::testing {

/// A spring that yields, phi = c^2 (sqrt(1 + (r - mu)^2 / c^2) - 1), with all derivatives.
struct YieldingSpring {
  static constexpr int kParameters = 1;
  double c = 0.2;

  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const auto scale = static_cast<Scalar>(c);
    const Scalar t = (r - mu) / scale;
    const Scalar root = std::sqrt(1 + t * t);
    return {scale * scale * (root - 1), scale * t / root, 1 / (root * root * root)};
  }
  template <typename Scalar>
  Scalar first_by_rest_length(Scalar r, Scalar mu) const {
    return -(*this)(r, mu).second;
  }
  template <typename Scalar>
  std::array<Scalar, 1> first_by_parameters(Scalar r, Scalar mu) const {  // phi' = (r - mu) / root
    const Scalar t = (r - mu) / static_cast<Scalar>(c);
    const Scalar root = std::sqrt(1 + t * t);
    return {t * t * t / (root * root * root)};
  }
};

/// How many random systems of each type, 300 or what the environment says.
inline int sensitivity_systems() { return std::max(1, environment("ASTERISM_SENSITIVITY_SYSTEMS", 300)); }

/// `system` with each value moved by t times that of the tangent.
template <typename System>
System moved(System system, const SystemTangent<System>& tangent, double t) {
  system.anchors += t * tangent.anchors;
  system.anchor_stiffness += t * tangent.anchor_stiffness;
  system.rest_length += t * tangent.rest_length;
  system.link_stiffness += t * tangent.link_stiffness;
  if (system.has_offsets()) system.rest_offset += t * tangent.rest_offset;
  if (system.has_loads()) system.loads += t * tangent.loads;
  if constexpr (System::kAnisotropic) system.anchor_shape += t * tangent.anchor_shape;
  if constexpr (requires { system.anchor_loss.scale; })
    system.anchor_loss.scale += t * tangent.anchor_loss[0];
  if constexpr (requires { system.link_potential.c; })
    system.link_potential.c += t * tangent.link_potential[0];
  return system;
}

/// Newton's method from near a minimum, until steps are rounding.
template <typename System>
typename System::Points follow(const System& system, typename System::Points x) {
  for (int step = 0; step < 8; ++step) {
    const typename System::Points g = gradient(system, x);
    const Eigen::VectorXd p = inverse(hessian(system, x)) * g.reshaped();
    x -= p.reshaped(x.rows(), x.cols());
    if (p.norm() < 1e-15 * x.norm()) break;
  }
  return x;
}

/// A stationary point: descent by the diagonal of a majoriser, then Newton's method. It takes a compiler less
/// time than a solver does.
template <typename System>
typename System::Points stationary_point(const System& system, typename System::Points x) {
  const typename System::NodeVector steps = 0.5 * node_stiffness(system).cwiseInverse();
  for (int step = 0; step < 400; ++step) x -= gradient(system, x) * steps.asDiagonal();
  return follow(system, x);
}

/// Tangents of one value each, one of every kind that the system has, as large as the value.
template <typename System>
std::vector<SystemTangent<System>> unit_tangents(const System& system, const typename System::Points& x,
                                                 Rng& rng) {
  constexpr int kDim = System::kDim;
  std::vector<SystemTangent<System>> tangents;
  const auto add = [&]() -> SystemTangent<System>& { return tangents.emplace_back(system); };
  const auto draw = [&rng](Eigen::Index size) {
    return static_cast<int>(rng.uniform(0, static_cast<double>(size)));
  };
  const int i = draw(system.nodes());
  add().anchors(draw(kDim), i) = characteristic_length(system, x);
  add().anchor_stiffness[i] = system.anchor_stiffness[i];
  if (system.has_loads()) {
    add().loads(draw(kDim), i) = system.anchor_stiffness[i] * characteristic_length(system, x);
  }
  if (system.link_count() > 0) {
    const int l = draw(system.link_count());
    add().rest_length[l] = system.rest_length[l];
    add().link_stiffness[l] = system.link_stiffness[l];
    if (system.has_offsets()) add().rest_offset(draw(kDim), l) = characteristic_length(system, x);
  }
  if constexpr (System::kAnisotropic) {
    auto block = add().anchor_shape.template block<kDim, kDim>(0, kDim * i);
    for (int c = 0; c < kDim; ++c) {
      for (int r = 0; r <= c; ++r) block(r, c) = block(c, r) = rng.uniform(-1, 1);
    }
  }
  if constexpr (requires { system.anchor_loss.scale; }) add().anchor_loss[0] = system.anchor_loss.scale;
  if constexpr (requires { system.link_potential.c; }) add().link_potential[0] = system.link_potential.c;
  return tangents;
}

/// Reverse mode against forward mode, and both against central differences of solutions, of fourth order.
/// `make(seed)` returns a RandomSystem.
template <typename System, typename Make>
void expect_true_derivatives(const std::string& name, Make&& make) {
  constexpr double kStep = 5e-4;  // about the fifth root of epsilon
  constexpr double kConditioned = 1e-3;
  std::vector<double> errors;
  Sensitivity<System> sensitivity;
  int refused = 0;
  const int count = sensitivity_systems();
  for (int seed = 1; seed <= count; ++seed) {
    auto [system, x] = make(seed);
    Rng rng(static_cast<std::uint64_t>(seed));
    x = stationary_point(system, x);
    const Eigen::VectorXd modes = eigenvalues(hessian(system, x));
    if (!(modes[0] > kConditioned * modes[modes.size() - 1] && stationarity(system, x) < 1e-12)) continue;
    const auto w = random_points<System>(rng, system.nodes(), -1, 1);
    const SystemGradient<System> gradient = sensitivity.backward(system, x, w);
    if (!gradient) {
      EXPECT_EQ(gradient.status, SensitivityStatus::NotPositiveDefinite) << gradient.message;
      ++refused;  // a rigid motion that is held by rounding alone
      continue;
    }
    for (const SystemTangent<System>& tangent : unit_tangents(system, x, rng)) {
      const double reverse = gradient.dot(tangent);
      const SolutionTangent<System> forward = sensitivity.forward(system, x, tangent);
      ASSERT_TRUE(forward) << forward.message;
      const double scale = std::max(std::abs(reverse), 1e-2 * w.norm() * forward.x.norm());
      EXPECT_NEAR(w.cwiseProduct(forward.x).sum(), reverse, 1e-10 * scale) << name << " seed " << seed;
      const auto at = [&, &system = system, &x = x](double t) {
        return w.cwiseProduct(follow(moved(system, tangent, t), x) - x).sum();
      };
      const double numeric = (8 * (at(kStep) - at(-kStep)) - (at(2 * kStep) - at(-2 * kStep))) / (12 * kStep);
      if (scale > 0) errors.push_back(std::abs(numeric - reverse) / scale);
    }
  }
  ASSERT_GT(errors.size(), static_cast<std::size_t>(count)) << name;
  EXPECT_LE(refused, count / 20);
  std::sort(errors.begin(), errors.end());
  const double median = errors[errors.size() / 2];
  const double most = errors[errors.size() * 99 / 100];
  std::cout << name << ": " << errors.size() << " derivatives, relative error: median " << median
            << ", 99 % below " << most << '\n';
  EXPECT_LT(median, 1e-9) << name;
  EXPECT_LT(most, 1e-6) << name;
}

/// Random systems of every kind, and for anisotropic anchors random shapes.
template <typename System>
RandomSystem<System> sensitivity_system(int seed, const typename System::TopologyType& topology) {
  constexpr int kDim = System::kDim;
  Rng rng(static_cast<std::uint64_t>(seed));
  const auto kind = kKinds[static_cast<std::size_t>(seed) % (kKinds.size() - 1)];  // of the unit cube
  auto result = random_system<System>(rng, topology, kind);
  if constexpr (System::kAnisotropic) {
    for (int i = 0; i < topology.nodes(); ++i) {
      Eigen::Matrix<double, kDim, kDim> root;
      for (auto& entry : root.reshaped()) entry = rng.uniform(-1, 1);
      result.system.set_anchor_information(i, root * root.transpose() * result.system.anchor_stiffness[i]);
    }
  }
  // A loss that lets go of too many anchors leaves systems badly conditioned.
  constexpr bool kLetsGo = std::is_same_v<typename System::Model::AnchorLoss, GemanMcClure>;
  if constexpr (requires { result.system.anchor_loss.scale; })
    result.system.anchor_loss.scale = kLetsGo ? 0.6 : 0.2;
  return result;
}

template <typename System>
void expect_true_derivatives(const std::string& name, int nodes) {
  expect_true_derivatives<System>(name, [nodes](int seed) {
    return sensitivity_system<System>(seed, System::TopologyType::full(nodes));
  });
}

}  // namespace asterism::testing
