#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

// Where the compiler was not told of AVX, the processor is asked.
#if defined(__x86_64__) && defined(__GNUC__) && EIGEN_MAX_STATIC_ALIGN_BYTES == 16 && \
    !defined(EIGEN_DONT_VECTORIZE)
#include <immintrin.h>
#define ASTERISM_SPRING_ROWS_AVX2
#endif

namespace asterism::inline ASTERISM_ABI {

namespace detail {

/// The spring of a link as it lies in x: its length r = |x_i - x_j| and its direction u = (x_i - x_j) / r.
template <typename System>
struct Spring {
  typename System::Scalar length;
  typename System::Point direction;
};

/// v / |v| without overflow or underflow; false and untouched for v = 0.
template <typename Point>
bool normalise(Point& v) {
  const auto largest = v.cwiseAbs().maxCoeff();
  if (!(largest > 0)) return false;
  v /= largest;
  v /= v.norm();
  return true;
}

/// A unit vector that depends on the two node numbers alone and changes sign when they are swapped.
template <typename Point>
Point fixed_direction(Link link) {
  const auto low = static_cast<std::uint32_t>(std::min(link.i, link.j));
  const auto high = static_cast<std::uint32_t>(std::max(link.i, link.j));
  std::uint32_t state = low * 0x9e3779b9U ^ (high * 0x85ebca6bU + 0x27d4eb2fU);
  Point direction;
  for (auto& coordinate : direction) {
    state ^= state >> 15;
    state *= 0x2c1b3c6dU;
    state ^= state >> 12;
    const int odd = 2 * static_cast<int>(state >> 17) + 1 - (1 << 15);  // never zero
    coordinate = static_cast<typename Point::Scalar>(odd);
  }
  normalise(direction);
  return link.i < link.j ? direction : Point(-direction);
}

/// The one convention for coincident nodes, of energy, gradient, Hessian and every solver: where x_i = x_j, u
/// is the direction of a_i - a_j, or fixed_direction where that vanishes too. The energy has a conic peak
/// there (a spring with mu_ij > 0 wants its nodes apart), and any unit u makes -gradient a direction of
/// strict descent.
template <typename System>
Spring<System> coincident_spring(const System& system, Link link, const typename System::Point& d) {
  typename System::Point direction = d;
  const auto length = direction.stableNorm();
  if (!normalise(direction)) {
    direction = system.anchors.col(link.i) - system.anchors.col(link.j);
    if (!normalise(direction)) direction = fixed_direction<typename System::Point>(link);
  }
  return {length, direction};
}

/// The spring of `link` with d = x_i - x_j.
template <typename System>
Spring<System> spring(const System& system, Link link, const typename System::Point& d) {
  using Scalar = typename System::Scalar;
  // Below this the squared length loses digits to underflow.
  constexpr Scalar kTiny = std::numeric_limits<Scalar>::min() / std::numeric_limits<Scalar>::epsilon();
  const Scalar square = d.squaredNorm();
  if (square < kTiny) [[unlikely]]
    return coincident_spring(system, link, d);
  const Scalar length = std::sqrt(square);
  return {length, d * (Scalar(1) / length)};
}

/// S d with the anchor's shape S.
template <typename System>
typename System::Point anchor_shaped(const System& system, int i, const typename System::Point& d) {
  if constexpr (System::kAnisotropic) {
    return system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i) * d;
  } else {
    return d;
  }
}

/// Energy and gradient of node i's anchor with d = x_i - a_i.
template <typename System>
struct AnchorForce {
  typename System::Scalar energy;
  typename System::Point gradient;
};

template <typename System>
AnchorForce<System> anchor_force(const System& system, int i, const typename System::Point& d) {
  const typename System::Scalar k = system.anchor_stiffness[i];
  if constexpr (System::kPlainAnchors) {
    return {k * d.squaredNorm() / 2, k * d};
  } else {
    const typename System::Point shaped = anchor_shaped(system, i, d);
    const auto loss = system.anchor_loss(d.dot(shaped));
    return {k * loss.value / 2, (k * loss.first) * shaped};
  }
}

/// d2E/dx_i2 of node i's anchor, of 1/2 k rho(d^T S d): k (rho' S + 2 rho'' S d (S d)^T). With `clamp`
/// without the second term, which is negative.
template <typename System>
auto anchor_curvature(const System& system, int i, const typename System::Point& d, bool clamp) {
  using Block = Eigen::Matrix<typename System::Scalar, System::kDim, System::kDim>;
  const typename System::Scalar k = system.anchor_stiffness[i];
  if constexpr (System::kPlainAnchors) {
    return Block(k * Block::Identity());
  } else {
    const typename System::Point shaped = anchor_shaped(system, i, d);
    const auto loss = system.anchor_loss(d.dot(shaped));
    Block block = Block::Identity();
    if constexpr (System::kAnisotropic)
      block = system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i);
    block *= k * loss.first;
    if (!clamp) block += (2 * k * loss.second) * shaped * shaped.transpose();
    return block;
  }
}

/// The force and the curvatures of link l at length r: along it, and across it, where a link that pulls at
/// its end resists sideways as well.
template <typename Scalar>
struct LinkForce {
  Scalar energy;
  Scalar tension;
  Scalar along;
  Scalar across;  // has no limit at r = 0; taken as 0 where the link pushes there
};

template <typename System>
LinkForce<typename System::Scalar> link_force(const System& system, int l, typename System::Scalar r) {
  const typename System::Scalar k = system.link_stiffness[l];
  const auto phi = system.link_potential(r, system.rest_length[l]);
  const auto ratio = phi.first / r;
  const auto across =
      r > 0 && std::isfinite(ratio) ? ratio : (phi.first < 0 ? typename System::Scalar(0) : phi.second);
  return {k * phi.value, k * phi.first, k * phi.second, k * across};
}

/// A fixed node does not move, whatever pulls at it.
template <typename System>
void clear_fixed(const System& system, typename System::Points& gradient) {
  if (system.fixed_count() == 0) [[likely]]
    return;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) gradient.col(i).setZero();
  }
}

/// The nodes of a row of links side by side, for as many springs at a time as the processor's registers hold:
/// the rows of a full topology, (i, i + 1), (i, i + 2), ..., whose rest lengths and stiffness are next to
/// each other.
template <typename System>
class SpringRows {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// Whether it serves: springs alone, in a few dimensions, enough of them and not too many for the stack.
  static bool serve(const System& system) {
    return kPossible && system.topology().is_full() && system.nodes() >= kLeastNodes &&
           system.nodes() <= kMostNodes;
  }

  /// The springs' energy.
  static Scalar energy(const System& system, const Points& x) {
    if constexpr (kPossible) {
      return SpringRows(system, x).template total<false>();
    } else {
      return 0;
    }
  }

  /// The same, their gradient added to `gradient`.
  static Scalar evaluate(const System& system, const Points& x, Points& gradient) {
    if constexpr (kPossible) {
      SpringRows rows(system, x);
      const Scalar energy = rows.template total<true>();
      for (int i = 0; i < system.nodes(); ++i) {
        for (int c = 0; c < kDim; ++c) gradient(c, i) += rows.forces_[c][i];
      }
      return energy;
    } else {
      return 0;
    }
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kLeastNodes = 9;
  static constexpr int kMostNodes = System::kMaxNodes == Eigen::Dynamic ? 1024 : System::kMaxNodes;
  static constexpr bool kPossible = (kDim == 2 || kDim == 3) && kMostNodes >= kLeastNodes &&
                                    kMostNodes <= 1024 &&
                                    std::is_same_v<typename System::Model::LinkPotential, Hooke>;
  // Springs at a time.
  static constexpr int kWidth =
      std::max<int>(2, static_cast<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(Scalar)));
  using Pack = Eigen::Array<Scalar, kWidth, 1>;
  using Row = Eigen::Map<Pack>;
  using ConstRow = Eigen::Map<const Pack>;

  SpringRows(const System& system, const Points& x) : system_(system), x_(x) {
    for (int i = 0; i < system.nodes(); ++i) {
      for (int c = 0; c < kDim; ++c) {
        coordinates_[c][i] = x(c, i);
        forces_[c][i] = 0;
      }
    }
  }

  template <bool kWithGradient>
  Scalar total() {
#ifdef ASTERISM_SPRING_ROWS_AVX2
    if constexpr (std::is_same_v<Scalar, double>) {
      if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return sum_avx2<kWithGradient>();
    }
#endif
    return sum<kWithGradient>();
  }

  template <bool kWithGradient>
  Scalar sum() {
    const int n = system_.nodes();
    const Scalar* rest_length = system_.rest_length.data();
    const Scalar* stiffness = system_.link_stiffness.data();
    Pack energies = Pack::Zero();
    Scalar rest = 0;
    for (int i = 0; i < n; ++i) {
      Pack forces[kDim];
      for (int c = 0; c < kDim; ++c) forces[c].setZero();
      int j = i + 1;
      for (; j + kWidth <= n; j += kWidth, rest_length += kWidth, stiffness += kWidth) {
        Pack d[kDim];
        for (int c = 0; c < kDim; ++c) d[c] = coordinates_[c][i] - ConstRow(coordinates_[c] + j);
        Pack square = d[0] * d[0];
        for (int c = 1; c < kDim; ++c) square += d[c] * d[c];
        if (!(square.minCoeff() >= kTiny)) [[unlikely]] {
          for (int w = 0; w < kWidth; ++w) {
            rest += one<kWithGradient>(i, j + w, rest_length[w], stiffness[w]);
          }
          continue;
        }
        const Pack length = square.sqrt();
        const Pack stretch = length - ConstRow(rest_length);
        const Pack tension = ConstRow(stiffness) * stretch;
        energies += tension * stretch;
        if constexpr (kWithGradient) {
          const Pack weight = tension / length;
          for (int c = 0; c < kDim; ++c) {
            const Pack force = weight * d[c];
            forces[c] += force;
            Row(forces_[c] + j) -= force;
          }
        }
      }
      for (; j < n; ++j) rest += one<kWithGradient>(i, j, *rest_length++, *stiffness++);
      if constexpr (kWithGradient) {
        for (int c = 0; c < kDim; ++c) forces_[c][i] += forces[c].sum();
      }
    }
    return (energies.sum() + rest) / 2;
  }

#ifdef ASTERISM_SPRING_ROWS_AVX2
  // The same by four springs at a time.
  template <bool kWithGradient>
  [[gnu::target("avx2,fma")]] double sum_avx2() {
    const int n = system_.nodes();
    const double* rest_length = system_.rest_length.data();
    const double* stiffness = system_.link_stiffness.data();
    __m256d energies = _mm256_setzero_pd();
    double rest = 0;
    for (int i = 0; i < n; ++i) {
      __m256d forces[kDim];
      for (int c = 0; c < kDim; ++c) forces[c] = _mm256_setzero_pd();
      int j = i + 1;
      for (; j + 4 <= n; j += 4, rest_length += 4, stiffness += 4) {
        __m256d d[kDim];
        __m256d square = _mm256_setzero_pd();
        for (int c = 0; c < kDim; ++c) {
          d[c] = _mm256_sub_pd(_mm256_set1_pd(coordinates_[c][i]), _mm256_loadu_pd(coordinates_[c] + j));
          square = _mm256_fmadd_pd(d[c], d[c], square);
        }
        if (_mm256_movemask_pd(_mm256_cmp_pd(square, _mm256_set1_pd(kTiny), _CMP_LT_OQ)) != 0) [[unlikely]] {
          for (int w = 0; w < 4; ++w) rest += one<kWithGradient>(i, j + w, rest_length[w], stiffness[w]);
          continue;
        }
        const __m256d length = _mm256_sqrt_pd(square);
        const __m256d stretch = _mm256_sub_pd(length, _mm256_loadu_pd(rest_length));
        const __m256d tension = _mm256_mul_pd(_mm256_loadu_pd(stiffness), stretch);
        energies = _mm256_fmadd_pd(tension, stretch, energies);
        if constexpr (kWithGradient) {
          const __m256d weight = _mm256_div_pd(tension, length);
          for (int c = 0; c < kDim; ++c) {
            forces[c] = _mm256_fmadd_pd(weight, d[c], forces[c]);
            double* const other = forces_[c] + j;
            _mm256_storeu_pd(other, _mm256_fnmadd_pd(weight, d[c], _mm256_loadu_pd(other)));
          }
        }
      }
      for (; j < n; ++j) rest += one<kWithGradient>(i, j, *rest_length++, *stiffness++);
      if constexpr (kWithGradient) {
        for (int c = 0; c < kDim; ++c) forces_[c][i] += sum_avx2(forces[c]);
      }
    }
    return (sum_avx2(energies) + rest) / 2;
  }

  [[gnu::target("avx2,fma")]] static double sum_avx2(__m256d v) {
    const __m128d halves = _mm_add_pd(_mm256_castpd256_pd128(v), _mm256_extractf128_pd(v, 1));
    return _mm_cvtsd_f64(_mm_add_sd(halves, _mm_unpackhi_pd(halves, halves)));
  }
#endif

  // Twice the energy of spring (i, j), its forces added.
  template <bool kWithGradient>
  Scalar one(int i, int j, Scalar rest_length, Scalar stiffness) {
    Scalar d[kDim];
    Scalar square = 0;
    for (int c = 0; c < kDim; ++c) {
      d[c] = coordinates_[c][i] - coordinates_[c][j];
      square += d[c] * d[c];
    }
    Scalar length;
    Scalar inverse = 1;
    if (square < kTiny) [[unlikely]] {
      const auto coincident = coincident_spring(system_, Link{i, j}, x_.col(i) - x_.col(j));
      length = coincident.length;
      for (int c = 0; c < kDim; ++c) d[c] = coincident.direction[c];
    } else {
      length = std::sqrt(square);
      inverse = 1 / length;
    }
    const Scalar stretch = length - rest_length;
    const Scalar tension = stiffness * stretch;
    if constexpr (kWithGradient) {
      for (int c = 0; c < kDim; ++c) {
        const Scalar force = tension * inverse * d[c];
        forces_[c][i] += force;
        forces_[c][j] -= force;
      }
    }
    return tension * stretch;
  }

  // As spring().
  static constexpr Scalar kTiny = std::numeric_limits<Scalar>::min() / std::numeric_limits<Scalar>::epsilon();

  const System& system_;
  const Points& x_;
  alignas(64) Scalar coordinates_[kDim][kMostNodes];
  alignas(64) Scalar forces_[kDim][kMostNodes];
};

/// Gradient and, if wanted, energy (else some number) in one pass over the springs.
template <bool kWithEnergy, typename System>
typename System::Scalar evaluate(const System& system, const typename System::Points& x,
                                 typename System::Points& gradient) {
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  gradient.resize(System::kDim, system.nodes());
  Scalar energy = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const auto anchor = anchor_force(system, i, x.col(i) - system.anchors.col(i));
    gradient.col(i) = anchor.gradient;
    if constexpr (kWithEnergy) energy += anchor.energy;
  }
  if (SpringRows<System>::serve(system)) {
    energy += SpringRows<System>::evaluate(system, x, gradient);
  } else {
    int l = 0;
    for (const Link& link : system.links()) {
      const auto [length, direction] = spring(system, link, x.col(link.i) - x.col(link.j));
      const auto phi = system.link_potential(length, system.rest_length[l]);
      const Scalar k = system.link_stiffness[l];
      const Point force = (k * phi.first) * direction;
      gradient.col(link.i) += force;
      gradient.col(link.j) -= force;
      if constexpr (kWithEnergy) energy += k * phi.value;
      ++l;
    }
  }
  clear_fixed(system, gradient);
  return energy;
}

/// Calls add(node, node, block) for the Dim x Dim blocks of the Hessian; a block may come more than once.
/// With `clamp`, curvature below 0 counts as 0, which makes the matrix positive semi-definite. A fixed node
/// is coupled to none and has its springs' stiffness on the diagonal.
template <typename System, typename Add>
void for_each_hessian_block(const System& system, const typename System::Points& x, bool clamp, Add&& add) {
  using Scalar = typename System::Scalar;
  using Block = Eigen::Matrix<Scalar, System::kDim, System::kDim>;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) [[unlikely]] {
      const Scalar k = system.anchor_stiffness[i];
      add(i, i, Block((k > 0 ? k : Scalar(1)) * Block::Identity()));
    } else {
      add(i, i, anchor_curvature(system, i, x.col(i) - system.anchors.col(i), clamp));
    }
  }
  int l = 0;
  for (const Link& link : system.links()) {
    const auto [length, direction] = spring(system, link, x.col(link.i) - x.col(link.j));
    auto force = link_force(system, l, length);
    if (clamp) {
      force.along = std::max(force.along, Scalar(0));
      force.across = std::max(force.across, Scalar(0));
    }
    const Block along = direction * direction.transpose();
    const Block block = force.along * along + force.across * (Block::Identity() - along);
    const Block stiffness = system.link_stiffness[l] * Block::Identity();
    const bool fixed_i = system.is_fixed(link.i);
    const bool fixed_j = system.is_fixed(link.j);
    add(link.i, link.i, fixed_i ? stiffness : block);
    add(link.j, link.j, fixed_j ? stiffness : block);
    if (!fixed_i && !fixed_j) {
      add(link.i, link.j, Block(-block));
      add(link.j, link.i, Block(-block));
    }
    ++l;
  }
}

template <int N>
constexpr int times(int factor) {
  return N == Eigen::Dynamic ? Eigen::Dynamic : N * factor;
}

}  // namespace detail

// The functions below take x as Dim x N points of the same number of nodes as the system, and do not
// validate: NaN in is NaN out.

/// E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i - x_j|)^2, the paper's energy with the
/// second 1/2 that its forces (Eq. 13) imply; for another Model than Springs sum_i 1/2 k_i rho(|x_i - a_i|^2)
/// + sum_ij k_ij phi(|x_i - x_j|, mu_ij). Not convex: a spring shorter than its rest length has negative
/// curvature across its axis.
template <typename System>
typename System::Scalar energy(const System& system, const typename System::Points& x) {
  typename System::Scalar energy = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    energy += detail::anchor_force(system, i, x.col(i) - system.anchors.col(i)).energy;
  }
  if (detail::SpringRows<System>::serve(system))
    return energy + detail::SpringRows<System>::energy(system, x);
  int l = 0;
  for (const Link& link : system.links()) {
    const auto length = detail::spring(system, link, x.col(link.i) - x.col(link.j)).length;
    energy += system.link_stiffness[l] * system.link_potential(length, system.rest_length[l]).value;
    ++l;
  }
  return energy;
}

/// Writes dE/dx_i = k_i (x_i - a_i) + sum_j k_ij (r_ij - mu_ij) u_ij into column i of `gradient` (Dim x N)
/// and returns E(x). Minus the gradient is the paper's F_nodes (Eq. 15). Where two linked nodes coincide,
/// u_ij is the direction of a_i - a_j, or a fixed one of (i, j) where the anchors coincide too. The column of
/// a fixed node is zero.
template <typename System>
typename System::Scalar energy_and_gradient(const System& system, const typename System::Points& x,
                                            typename System::Points& gradient) {
  return detail::evaluate<true>(system, x, gradient);
}

/// The gradient alone, as above.
template <typename System>
typename System::Points gradient(const System& system, const typename System::Points& x) {
  typename System::Points result;
  detail::evaluate<false>(system, x, result);
  return result;
}

template <typename System>
using DenseHessian = Eigen::Matrix<typename System::Scalar, detail::times<System::kNodes>(System::kDim),
                                   detail::times<System::kNodes>(System::kDim), Eigen::ColMajor,
                                   detail::times<System::kMaxNodes>(System::kDim),
                                   detail::times<System::kMaxNodes>(System::kDim)>;

/// d2E/dx2, (Dim N) x (Dim N), symmetric; coordinate d of node i is row Dim i + d. A spring contributes
/// k_ij (u u^T + (1 - mu_ij / r_ij) (I - u u^T)), indefinite where r_ij < mu_ij. Where two linked nodes
/// coincide and mu_ij > 0, the curvature across the spring is minus infinity and k_ij u u^T alone is used. A
/// fixed node is coupled to none; its diagonal has the stiffness of its springs.
template <typename System>
DenseHessian<System> hessian(const System& system, const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  DenseHessian<System> result;
  result.setZero(kDim * system.nodes(), kDim * system.nodes());
  detail::for_each_hessian_block(system, x, false, [&](int i, int j, const auto& block) {
    result.template block<kDim, kDim>(kDim * i, kDim * j) += block;
  });
  return result;
}

/// The same as a sparse matrix with both triangles.
template <typename System>
Eigen::SparseMatrix<typename System::Scalar> sparse_hessian(const System& system,
                                                            const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  std::vector<Eigen::Triplet<typename System::Scalar>> entries;
  entries.reserve(static_cast<std::size_t>(kDim) * kDim *
                  (static_cast<std::size_t>(system.nodes()) + 4 * system.links().size()));
  detail::for_each_hessian_block(system, x, false, [&](int i, int j, const auto& block) {
    for (int row = 0; row < kDim; ++row) {
      for (int column = 0; column < kDim; ++column) {
        entries.emplace_back(kDim * i + row, kDim * j + column, block(row, column));
      }
    }
  });
  Eigen::SparseMatrix<typename System::Scalar> result(kDim * system.nodes(), kDim * system.nodes());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

}  // namespace asterism::inline ASTERISM_ABI
