#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/link_rows.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <type_traits>

// Where the compiler was not told of AVX, the processor is asked. Vectors are those of the compilers, as
// <immintrin.h> has a third as many lines as all of Eigen's core; they fuse a * b + c into one instruction.
#if defined(__x86_64__) && defined(__GNUC__) && EIGEN_MAX_STATIC_ALIGN_BYTES == 16 && \
    !defined(EIGEN_DONT_VECTORIZE)
#define ASTERISM_SPRING_ROWS_AVX2
#endif

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

#ifdef ASTERISM_SPRING_ROWS_AVX2
typedef double FourDoubles __attribute__((vector_size(32)));
typedef long long FourInts __attribute__((vector_size(32)));
#endif

/// The nodes of a row of links side by side, for as many springs at a time as the processor's registers hold:
/// the rows of a full topology, (i, i + 1), (i, i + 2), ..., whose rest lengths and stiffness are next to
/// each other.
template <typename System>
class SpringRows {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// Whether it serves: springs without offsets alone, in a few dimensions, enough of them and not too many
  /// for the stack.
  static bool serve(const System& system) {
    return kPossible && system.topology().is_full() && !system.has_offsets() &&
           system.nodes() >= kLeastNodes && system.nodes() <= kMostNodes;
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
  static constexpr int kPadding = lanes_v0_1::kBeyond;
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
    // What stands beside the last node in a vector has no stiffness.
    for (int i = system.nodes(); i < system.nodes() + kPadding; ++i) {
      for (int c = 0; c < kDim; ++c) {
        coordinates_[c][i] = coordinates_[c][system.nodes() - 1];
        forces_[c][i] = 0;
      }
    }
  }

  template <bool kWithGradient>
  Scalar total() {
    if constexpr (kIsCompiled && std::is_same_v<Scalar, double>) {
      // With fewer nodes, what the kernel does once for each row takes as long as it saves.
      constexpr int kLeastNodesOfKernel = 20;
      if (system_.nodes() >= kLeastNodesOfKernel) return sum_by_kernel<kWithGradient>();
    }
#ifdef ASTERISM_SPRING_ROWS_AVX2
    if constexpr (std::is_same_v<Scalar, double>) {
      if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return sum_avx2<kWithGradient>();
    }
#endif
    return sum<kWithGradient>();
  }

  // By the widest vectors of the processor.
  template <bool kWithGradient>
  double sum_by_kernel() {
    struct LeftOut {
      SpringRows& rows;
      double energy = 0;
    } left_out{*this};
    const lanes_v0_1::LinkNumbers rest_length{system_.rest_length.data(), 1};
    const lanes_v0_1::LinkRows rows{.pairs = nullptr,
                                    .count = system_.link_count(),
                                    .nodes = system_.nodes(),
                                    .dim = kDim,
                                    .stride = kMostNodes + kPadding,
                                    .points = coordinates_[0],
                                    .forces = kWithGradient ? forces_[0] : nullptr,
                                    .is_hooke = true,
                                    .lower = rest_length,
                                    .upper = rest_length,
                                    .stiffness = {system_.link_stiffness.data(), 1},
                                    .left_out =
                                        [](void* context, int l) {
                                          auto& here = *static_cast<LeftOut*>(context);
                                          const System& system = here.rows.system_;
                                          const Link& link = system.links()[static_cast<std::size_t>(l)];
                                          here.energy += here.rows.template one<kWithGradient>(
                                              link.i, link.j, system.rest_length[l],
                                              system.link_stiffness[l]);
                                        },
                                    .context = &left_out};
    const double twice = lanes_v0_1::sum(rows);
    return (twice + left_out.energy) / 2;
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
  // By memcpy, as clang forgets that a reference is to a vector that is not aligned.
  [[gnu::target("avx2,fma")]] static FourDoubles load(const double* at) {
    FourDoubles four;
    std::memcpy(&four, at, sizeof four);
    return four;
  }
  [[gnu::target("avx2,fma")]] static void store(double* at, const FourDoubles& four) {
    std::memcpy(at, &four, sizeof four);
  }

  // The same by four springs at a time, the end of a row with what follows in memory.
  template <bool kWithGradient>
  [[gnu::target("avx2,fma")]] double sum_avx2() {
    const int n = system_.nodes();
    const double* rest_length = system_.rest_length.data();
    const double* stiffness = system_.link_stiffness.data();
    const double* const last = stiffness + system_.link_count() - 4;
    FourDoubles energies = {};
    double rest = 0;
    for (int i = 0; i < n; ++i) {
      FourDoubles forces[kDim] = {};
      int j = i + 1;
      for (int count; j < n && stiffness <= last; j += count, rest_length += count, stiffness += count) {
        count = std::min(4, n - j);
        FourDoubles d[kDim];
        FourDoubles square = {};
        for (int c = 0; c < kDim; ++c) {
          d[c] = coordinates_[c][i] - load(coordinates_[c] + j);
          square = d[c] * d[c] + square;
        }
        if (__builtin_ia32_movmskpd256(FourDoubles(square < kTiny)) != 0) [[unlikely]] {
          for (int w = 0; w < count; ++w) rest += one<kWithGradient>(i, j + w, rest_length[w], stiffness[w]);
          continue;
        }
        const FourInts lanes = {0, 1, 2, 3};
        const FourDoubles k = FourDoubles(FourInts(load(stiffness)) & (lanes < count));
        const FourDoubles length = __builtin_ia32_sqrtpd256(square);
        const FourDoubles stretch = length - load(rest_length);
        const FourDoubles tension = k * stretch;
        energies = tension * stretch + energies;
        if constexpr (kWithGradient) {
          const FourDoubles weight = tension / length;
          for (int c = 0; c < kDim; ++c) {
            forces[c] = weight * d[c] + forces[c];
            double* const others = forces_[c] + j;
            store(others, load(others) - weight * d[c]);
          }
        }
      }
      for (; j < n; ++j) rest += one<kWithGradient>(i, j, *rest_length++, *stiffness++);
      if constexpr (kWithGradient) {
        for (int c = 0; c < kDim; ++c) forces_[c][i] += sum_of(forces[c]);
      }
    }
    return (sum_of(energies) + rest) / 2;
  }

  [[gnu::target("avx2,fma")]] static double sum_of(const FourDoubles& v) {
    return (v[0] + v[2]) + (v[1] + v[3]);
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

  static constexpr Scalar kTiny = kLeastSquare<Scalar>;

  const System& system_;
  const Points& x_;
  alignas(64) Scalar coordinates_[kDim][kMostNodes + kPadding];
  alignas(64) Scalar forces_[kDim][kMostNodes + kPadding];
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism

#undef ASTERISM_SPRING_ROWS_AVX2
