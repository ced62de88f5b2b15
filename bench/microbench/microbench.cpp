// Microbenchmarks of the solver's kernels; docs/microbenchmarks.md says what is measured and how to read it.
//   asterism-solver-bench [--benchmark_filter=REGEX] [--benchmark_out=FILE.json --benchmark_out_format=json]
#include "microbench.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <ctime>

namespace asterism::bench {

namespace {

// The operations in `rounds` rounds of multiply-adds, c <- c a + b, on independent chains of vectors: as many
// as fit in 16 registers beside a and b. With fewer chains SSE2, where a multiply-add is two instructions,
// would wait for its own results.
#define ASTERISM_CHAINS(name, bytes, ...)                                          \
  template <typename Scalar>                                                       \
  __VA_ARGS__ double name(int rounds, Scalar factor, Scalar addend) {              \
    constexpr int kChains = 14;                                                    \
    typedef Scalar Vector [[gnu::vector_size(bytes)]];                             \
    const Vector a = factor - Vector{};                                            \
    const Vector b = addend - Vector{};                                            \
    Vector c[kChains];                                                             \
    for (int k = 0; k < kChains; ++k) c[k] = b * static_cast<Scalar>(k);           \
    for (int round = 0; round < rounds; ++round) {                                 \
      for (int k = 0; k < kChains; ++k) c[k] = c[k] * a + b;                       \
    }                                                                              \
    for (int k = 1; k < kChains; ++k) c[0] += c[k];                                \
    benchmark::DoNotOptimize(c);                                                   \
    return 2.0 * kChains * (bytes / static_cast<double>(sizeof(Scalar))) * rounds; \
  }

#if defined(__AVX512F__)
ASTERISM_CHAINS(portable_chains, 64)
#elif defined(__AVX__)
ASTERISM_CHAINS(portable_chains, 32)
#else
ASTERISM_CHAINS(portable_chains, 16)
#endif
#ifdef __x86_64__
ASTERISM_CHAINS(avx2_chains, 32, [[gnu::target("avx2,fma")]])
ASTERISM_CHAINS(avx512_chains, 64, [[gnu::target("avx512f,fma")]])
#endif

template <typename Scalar>
double chains([[maybe_unused]] Simd instructions, int rounds) {
  Scalar factor = Scalar(0.5);
  Scalar addend = Scalar(0.25);
  benchmark::DoNotOptimize(factor);
  benchmark::DoNotOptimize(addend);
#ifdef __x86_64__
  if (instructions == Simd::Avx512) return avx512_chains(rounds, factor, addend);
  if (instructions == Simd::Avx2) return avx2_chains(rounds, factor, addend);
#endif
  return portable_chains(rounds, factor, addend);
}

// The best of several runs of a millisecond, as other programs on the machine can only slow it down.
template <typename Scalar>
double measure_peak(Simd instructions) {
  constexpr int kRounds = 200000;
  constexpr int kRuns = 10;
  double best = 0;
  for (int run = 0; run < kRuns; ++run) {
    const double begin = thread_seconds();
    const double operations = chains<Scalar>(instructions, kRounds);
    best = std::max(best, operations / (thread_seconds() - begin));
  }
  return best;
}

}  // namespace

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

template <typename Scalar>
double arithmetic_peak(Simd instructions) {
  static double peaks[4] = {};
  double& peak = peaks[static_cast<std::size_t>(instructions)];
  if (peak == 0) peak = measure_peak<Scalar>(instructions);
  return peak;
}

template double arithmetic_peak<float>(Simd);
template double arithmetic_peak<double>(Simd);

}  // namespace asterism::bench

int main(int argc, char** argv) {
  using namespace asterism;
  using namespace asterism::bench;
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;

  const HardwareCounters counters;
  const std::string counting = counters.available() ? "yes" : "none (" + counters.problem() + ")";
  std::fprintf(stderr, "counters of cycles and instructions: %s\n", counting.c_str());
  benchmark::AddCustomContext("hardware_counters", counting);
  for (const Simd instructions : available_simd()) {
    char peaks[80];
    std::snprintf(peaks, sizeof peaks, "double %.1f, float %.1f Gflop/s",
                  1e-9 * arithmetic_peak<double>(instructions), 1e-9 * arithmetic_peak<float>(instructions));
    benchmark::AddCustomContext("peak, " + std::string(to_string(instructions)), peaks);
  }

  add_kernels();
  add_methods();
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
