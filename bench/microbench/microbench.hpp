#pragma once

#include <benchmark/benchmark.h>

#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/energy/spring_rows.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cstdint>
#include <string>
#include <type_traits>

#include "hardware_counters.hpp"

namespace asterism::bench {

// The systems that kernels are measured on. Fixed sizes are compiled in.
using Fixed = SpringSystem<double, 2, 4>;
using FixedFloat = SpringSystem<float, 2, 4>;
using FixedSpace = SpringSystem<double, 3, 4>;
using Dynamic = SpringSystem<double, 2>;
using DynamicFloat = SpringSystem<float, 2>;
using DynamicSpace = SpringSystem<double, 3>;

enum class Linking {
  Full,    ///< every pair of nodes: the paper's Sec. 3.2.1
  Nearest  ///< each node with its six nearest
};

/// Random system number `index` with a linking.
template <typename System>
testing::RandomSystem<System> make_system(Linking linking, int nodes, int index) {
  if constexpr (System::kNodes == Eigen::Dynamic) {
    if (linking == Linking::Nearest)
      return testing::sparse_system<System>(static_cast<std::uint64_t>(index), nodes);
  }
  return testing::numbered_system<System>(testing::Kind::Lit, System::TopologyType::full(nodes),
                                          static_cast<std::uint64_t>(index));
}

/// The name of a benchmark: "kernel/double/2-D/fixed/4", "kernel/double/2-D/nearest/10000".
template <typename System>
std::string name_of(const std::string& kernel, Linking linking, int nodes) {
  const char* const scalar = std::is_same_v<typename System::Scalar, float> ? "float" : "double";
  const char* const kind = linking == Linking::Nearest        ? "nearest"
                           : System::kNodes == Eigen::Dynamic ? "dynamic"
                                                              : "fixed";
  return kernel + "/" + scalar + "/" + std::to_string(System::kDim) + "-D/" + kind + "/" +
         std::to_string(nodes);
}

/// The instruction set that computes a system's energy and gradient: in a build for SSE2, SpringRows uses
/// AVX2 if the processor has it.
template <typename System>
Simd instructions_of_springs(const System& system) {
  constexpr bool kAsks =
      std::is_same_v<typename System::Scalar, double> && EIGEN_MAX_STATIC_ALIGN_BYTES == 16;
  return kAsks && asterism::detail::SpringRows<System>::serve(system) && is_available(Simd::Avx2)
             ? Simd::Avx2
             : Simd::Portable;
}

/// The arithmetic limit [1/s]: operations by multiply-adds in registers, which count as two each, with the
/// widest vectors of an instruction set. Measured at the first call.
template <typename Scalar>
double arithmetic_peak(Simd instructions);

/// CPU time of this thread [s].
double thread_seconds();

/// Runs `work`, which repeats the timed operation `repeats` times, in the benchmark's loop; one repeat counts
/// as one iteration. Counters: `cycles` and `instructions` of an iteration if the processor counts them; if
/// an iteration has `flops` > 0 operations, their rate `flops` [1/s], and `of_peak`, its share of the peak of
/// `Scalar` and `instructions`.
template <typename Scalar, typename Work>
void measure(benchmark::State& state, double flops, Simd instructions, Work&& work, int repeats = 1) {
  HardwareCounters counters;
  counters.start();
  const double begin = thread_seconds();
  while (state.KeepRunningBatch(repeats)) work();
  const double seconds = thread_seconds() - begin;
  if (counters.stop()) {
    state.counters["cycles"] = {counters.cycles(), benchmark::Counter::kAvgIterations};
    state.counters["instructions"] = {counters.instructions(), benchmark::Counter::kAvgIterations};
  }
  if (flops > 0) {
    state.counters["flops"] = {flops, benchmark::Counter::kIsIterationInvariantRate};
    state.counters["of_peak"] =
        flops * static_cast<double>(state.iterations()) / seconds / arithmetic_peak<Scalar>(instructions);
  }
}

// Register the benchmarks, one file each.
void add_kernels();
void add_methods();

}  // namespace asterism::bench
