#pragma once

/// Floating-point operations of the kernels' formulas: additions, products, divisions and square roots count
/// as one each, whatever they cost; comparisons, index arithmetic and an implementation's other work do not
/// count. D dimensions, N nodes, M links; systems of springs alone.
namespace asterism::bench::flops {

// Of a link: difference and length of its nodes, its stretch.
constexpr double length(int D) { return 3 * D; }  // D differences, D squares, D - 1 sums, root
constexpr double stretch = 1;

/// E(x): an anchor's k |x - a|^2 and a link's k (mu - r)^2, summed, halved once.
template <typename System>
double energy(const System& system) {
  constexpr int D = System::kDim;
  return system.nodes() * (3 * D + 1) + system.link_count() * (length(D) + stretch + 3);
}

/// dE/dx: an anchor's k (x - a), and a link's k (mu - r) / r times the difference, at both its nodes.
template <typename System>
double gradient(const System& system) {
  constexpr int D = System::kDim;
  return system.nodes() * 2 * D + system.link_count() * (length(D) + stretch + 2 + 3 * D);
}

/// Both, with their common terms counted once.
template <typename System>
double energy_and_gradient(const System& system) {
  constexpr int D = System::kDim;
  return gradient(system) + system.nodes() * 2 * D + system.link_count() * 2;
}

// The block of a link's curvature, given its length: u, the two curvatures, and bend u u^T + across I.
constexpr double curvature(int D) { return (1 + D) + 4 + D + D * (D + 1) / 2 + D; }

/// The lower triangle of d2E/dx2: a link's block is added to two diagonal blocks and an off-diagonal one.
template <typename System>
double hessian(const System& system) {
  constexpr int D = System::kDim;
  return system.link_count() * (length(D) + curvature(D) + D * (D + 1) + D * D);
}

/// Energy, gradient and the lower triangle of the Hessian.
template <typename System>
double newton_assembly(const System& system) {
  return energy_and_gradient(system) + hessian(system) - system.link_count() * length(System::kDim);
}

/// L D L^T of a matrix of order n, with the forward substitution of a right-hand side.
constexpr double ldlt(double n) { return (n - 1) * n * (2 * n - 1) / 6 + 2 * n * (n - 1) + n; }

/// L^-T D^-1, and the product of right-hand side and result.
constexpr double ldlt_solve(double n) { return n * (n - 1) + 3 * n; }

/// K_dyn, N x N: assembled, and L L^T or, for up to 40 nodes as DenseCholesky does, its inverse.
template <typename System>
double dense_cholesky(const System& system) {
  const double n = system.nodes();
  return 3 * system.link_count() + (n <= 40 ? n * n * n : n * n * n / 3);
}

/// x - K_dyn^-1 g by two triangular solves or one product per dimension, which take the same number.
template <typename System>
double dense_cholesky_solve(const System& system) {
  const double n = system.nodes();
  return System::kDim * (2 * n * n + n);
}

/// Rigid alignment without the computation of the rotation, which does not depend on N.
template <typename System>
double alignment(const System& system) {
  constexpr int D = System::kDim;
  constexpr int centres = 4 * D + 1;
  constexpr int moments = 2 * D + D + 2 * D * D + 2 * (2 * D + 1);
  constexpr int move = D + 2 * D * D;
  return system.nodes() * (centres + moments + move);
}

}  // namespace asterism::bench::flops
