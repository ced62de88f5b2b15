#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

// The widest vector of floats that the code is compiled for.
#if defined(__AVX512F__)
inline constexpr int kFloatLanes = 16;
#elif defined(__AVX__)
inline constexpr int kFloatLanes = 8;
#else
inline constexpr int kFloatLanes = 4;
#endif
typedef float FloatLanes __attribute__((vector_size(sizeof(float) * kFloatLanes)));
// The same anywhere in memory.
typedef float StoredLanes __attribute__((vector_size(sizeof(float) * kFloatLanes), aligned(4), may_alias));

// Where the compiler was not told of AVX, the processor is asked.
#if defined(__x86_64__) && !defined(__AVX__) && !defined(EIGEN_DONT_VECTORIZE)
#define ASTERISM_CHOOSE_LANES
#endif

/// The lines that are stepped together: 4, 8 or 16.
inline int chain_lanes() {
#ifdef ASTERISM_CHOOSE_LANES
  static const int lanes = __builtin_cpu_supports("avx512f") ? 16
                           : __builtin_cpu_supports("avx2")  ? 8
                                                             : kFloatLanes;
  return lanes;
#else
  return kFloatLanes;
#endif
}

inline constexpr int kLineBlock = 16;  ///< lines that are transformed together

/// The least of some numbers, infinity of none.
inline float least_of(const float* numbers, std::ptrdiff_t count) {
  FloatLanes a = FloatLanes{} + std::numeric_limits<float>::infinity(), b = a;
  std::ptrdiff_t k = 0;
  for (; k + 2 * kFloatLanes <= count; k += 2 * kFloatLanes) {
    const FloatLanes one = reinterpret_cast<const StoredLanes&>(numbers[k]);
    const FloatLanes two = reinterpret_cast<const StoredLanes&>(numbers[k + kFloatLanes]);
    a = one < a ? one : a;
    b = two < b ? two : b;
  }
  a = a < b ? a : b;
  float least = std::numeric_limits<float>::infinity();
  for (int l = 0; l < kFloatLanes; ++l) least = std::min(least, a[l]);
  for (; k < count; ++k) least = std::min(least, numbers[k]);
  return least;
}

/// One step to the neighbours: out(q) = min(in(q), in(q + 1) + up, in(q - 1) + down), row by row as `in`
/// comes in.
struct ChainStep {
  FloatLanes up, down;
  FloatLanes here, before;  // the last row and the one before it

  [[gnu::always_inline]] void start(float cost_up, float cost_down) {
    up = FloatLanes{} + cost_up;
    down = FloatLanes{} + cost_down;
    here = before = FloatLanes{} + std::numeric_limits<float>::infinity();
  }
  // Takes a row and replaces it by the row before it of the output.
  [[gnu::always_inline]] void operator()(FloatLanes& row) {
    const FloatLanes from_above = row + up, from_below = before + down;
    FloatLanes out = from_above < from_below ? from_above : from_below;
    out = out < here ? out : here;
    before = here;
    here = row;
    row = out;
  }
};

/// The lower envelope of the costs from the sites of a line, for kLineBlock lines at once:
///   D(q) = min_p f(p) + cost(p - q),   p = 0 .. sites - 1,  q = 0 .. queries - 1.
///
/// Quadratic costs are a chain of steps to the neighbours. As d^2 is the sum of the first |d| odd numbers,
/// and odd numbers grow, K steps that cost a, 3 a, 5 a, ... give the least cost over |d| <= K (Huang and
/// Mitchell, PAMI 1994). A step that changes nothing is the last that is needed, as later ones cost more.
/// Steps run in SIMD lanes, one line a lane. Lines that need more than kMostSteps steps go through the lower
/// envelope of parabolas (Felzenszwalb and Huttenlocher 2012), line by line, which takes O(sites + queries).
/// The number of steps that a line needs is not known before. With a limit of as many steps as take the time
/// of an envelope, a line takes at most twice the time of the better way. kMostSteps is between the limits of
/// SSE2 and AVX2, so that both take at most two and a half times as long (docs/pictorial-structures.md).
/// Absolute costs need one step for the fraction of the offset, and a pass in each direction.
class LineTransform {
 public:
  static constexpr int kMostSteps = 32;
  static constexpr int kStepsAtOnce = 4;

  /// Prepares for a cost, and for numbers of sites and queries, at least 1 each.
  void plan(const AxisCost& cost, int sites, int queries);

  /// The costs f to be set: site p of line l is at [p * kLineBlock + l]; infinity forbids a site.
  float* source() { return source_.data(); }
  /// Transforms all lines.
  void run();
  /// The results of a query for all lines.
  const float* result(int query) const { return work_.data() + row_of(query) * kLineBlock; }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();

  FloatLanes source(std::ptrdiff_t site, int lane) const {
    return reinterpret_cast<const StoredLanes&>(source_[static_cast<std::size_t>(site * kLineBlock + lane)]);
  }
  StoredLanes& work(std::ptrdiff_t row, int lane) {
    return reinterpret_cast<StoredLanes&>(work_[static_cast<std::size_t>(row * kLineBlock + lane)]);
  }
  // The rows of work_: queries whose site is below 0, all sites, queries whose site is beyond the last.
  std::ptrdiff_t row_of(int query) const {
    if (query < below_) return query;
    const std::ptrdiff_t site = std::ptrdiff_t{query} + shift_;
    return site < sites_ ? below_ + site : std::ptrdiff_t{below_} + sites_ + query - first_above_;
  }
  void quadratic(int lane, int lanes);
  void absolute(int lane);
  bool sweep(const float* from, float* to, int step) const;
#ifdef ASTERISM_CHOOSE_LANES
  bool sweep_avx2(const float* from, float* to, int step) const;
  bool sweep_avx512(const float* from, float* to, int step) const;
#endif
  void outside(int lane, int window);
  void envelope(int line);
  // The cost, without truncation, of a place that is d from the query's site.
  double cost(double d) const {
    const double excess = d - fraction_;
    return weight_ * (shape_ == CostShape::Quadratic ? excess * excess : std::abs(excess));
  }
  static float rounded(double cost) {
    return cost > std::numeric_limits<float>::max() ? kInfinity : static_cast<float>(cost);
  }

  // The plan. A query's site is query + shift_, its ideal place fraction_ beyond it, |fraction_| <= 1/2.
  AxisCost planned_;
  CostShape shape_ = CostShape::Quadratic;
  double weight_ = 0, fraction_ = 0;
  float base_ = 0, truncation_ = 0;
  int sites_ = 0, queries_ = 0;
  int below_ = 0;        // queries below the first site
  int first_above_ = 0;  // query above the last site
  std::ptrdiff_t shift_ = 0, rows_ = 0;
  int steps_ = 0;         // as many as are taken at most
  bool is_short_ = true;  // they are always enough
  float up_[kMostSteps], down_[kMostSteps];
  std::vector<float> above_cost_, below_cost_;

  std::vector<float> source_, work_;
  // Of the envelope: 1 / (2 a k), the cost from 0, and a stack of parabolas.
  std::vector<double> inverse_, site_cost_, height_, begin_;
  std::vector<int> site_;
};

inline void LineTransform::plan(const AxisCost& planned, int sites, int queries) {
  if (planned == planned_ && sites == sites_ && queries == queries_) return;
  sites_ = 0;  // until all is done
  shape_ = planned.shape;
  weight_ = planned.weight;
  const double whole = std::round(planned.offset);
  shift_ = static_cast<std::ptrdiff_t>(whole);
  fraction_ = planned.offset - whole;
  base_ = rounded(cost(0));
  truncation_ = rounded(planned.truncation);
  const auto clamp = [&](std::ptrdiff_t query) {
    return static_cast<int>(std::clamp<std::ptrdiff_t>(query, 0, queries));
  };
  below_ = clamp(-shift_);
  first_above_ = clamp(sites - shift_);
  const int above = queries - first_above_;
  rows_ = std::ptrdiff_t{below_} + sites + above;

  // Steps until the far end of the line, or until a step costs more than the truncation.
  steps_ = 0;
  is_short_ = false;
  for (int k = 1; k <= kMostSteps; ++k) {
    up_[k - 1] = rounded(cost(k) - cost(k - 1));
    down_[k - 1] = rounded(cost(-k) - cost(1 - k));
    is_short_ |= k >= sites || std::min(cost(k), cost(-k)) >= planned.truncation;
    steps_ += !is_short_;
  }
  steps_ = (steps_ + kStepsAtOnce - 1) / kStepsAtOnce * kStepsAtOnce;

  // As much as any cost needs, so that another cost does not allocate.
  const auto size = static_cast<std::size_t>(sites), most = size + static_cast<std::size_t>(queries);
  source_.resize(size * kLineBlock);
  work_.resize(most * kLineBlock);
  above_cost_.resize(static_cast<std::size_t>(queries) + kMostSteps);
  below_cost_.resize(static_cast<std::size_t>(queries) + kMostSteps);
  inverse_.resize(size);
  site_cost_.resize(size);
  height_.resize(size);
  begin_.resize(size + 1);
  site_.resize(size);
  if (shape_ == CostShape::Quadratic && weight_ > 0) {
    // From the last site for the first query above, and on; and the same below.
    for (int k = 0; k < (above > 0 ? above + kMostSteps : 0); ++k) {
      const double d = static_cast<double>(sites - 1 - k - (first_above_ + shift_));
      above_cost_[static_cast<std::size_t>(k)] = rounded(cost(d));
    }
    for (int k = 0; k < (below_ > 0 ? below_ + kMostSteps : 0); ++k) {
      const double d = static_cast<double>(k - (below_ - 1 + shift_));
      below_cost_[static_cast<std::size_t>(k)] = rounded(cost(d));
    }
    for (int k = 0; k < sites; ++k) {
      inverse_[static_cast<std::size_t>(k)] = 1 / (2 * weight_ * k);
      site_cost_[static_cast<std::size_t>(k)] = cost(k);
    }
  }
  planned_ = planned;
  queries_ = queries;
  sites_ = sites;
}

inline void LineTransform::run() {
  const bool is_flat = weight_ <= 0;
  if (shape_ == CostShape::Quadratic && !is_flat) {
    const int lanes = chain_lanes();
    for (int lane = 0; lane < kLineBlock; lane += lanes) quadratic(lane, lanes);
  }
  for (int lane = 0; lane < kLineBlock; lane += kFloatLanes) {
    if (shape_ == CostShape::Absolute && !is_flat) absolute(lane);
    if (!is_flat && !(truncation_ < kInfinity)) continue;
    FloatLanes least = FloatLanes{} + kInfinity;
    for (int p = 0; p < sites_; ++p) {
      const FloatLanes f = source(p, lane);
      least = f < least ? f : least;
    }
    least += is_flat ? 0 : truncation_;
    for (std::ptrdiff_t row = 0; row < rows_; ++row) {
      const FloatLanes all = is_flat ? least : work(row, lane);
      work(row, lane) = all < least ? all : least;
    }
  }
}

inline void LineTransform::quadratic(int lane, int lanes) {
  float* const inside = work_.data() + std::ptrdiff_t{below_} * kLineBlock + lane;
  const float* from = source_.data() + lane;
  int step = 0;
  bool is_done = false;
  for (; step < steps_ && !is_done; step += kStepsAtOnce) {
#ifdef ASTERISM_CHOOSE_LANES
    is_done = lanes == 16  ? !sweep_avx512(from, inside, step)
              : lanes == 8 ? !sweep_avx2(from, inside, step)
                           : !sweep(from, inside, step);
#else
    is_done = !sweep(from, inside, step);
#endif
    from = inside;
  }
  if (!is_done && !is_short_) {
    for (int line = lane; line < lane + lanes; ++line) envelope(line);
    return;
  }
  // The last step that changes something is at most this one; queries beyond the sites take no site that is
  // farther from the end.
  const int window = std::min(is_done ? step : step + 1, sites_);
  for (const int end = lane + lanes; lane < end; lane += kFloatLanes, from += kFloatLanes) {
    if (step == 0) {
      for (int p = 0; p < sites_; ++p) {
        const FloatLanes f = reinterpret_cast<const StoredLanes&>(from[std::ptrdiff_t{p} * kLineBlock]);
        work(below_ + p, lane) = f + base_;
      }
    }
    outside(lane, window);
  }
}

// kStepsAtOnce steps in one pass, for as many lines as a vector of kBytes has floats. Written once for all
// instructions; as functions that they call could not be compiled for the same, it is a macro. Row p of a
// step is known when row p + 1 of the step before it is. Returns whether the last step changed anything.
#define ASTERISM_CHAIN_STEP(k)         \
  above = row + up##k;                 \
  below = before##k + down##k;         \
  out = above < below ? above : below; \
  out = out < here##k ? out : here##k; \
  before##k = here##k;                 \
  here##k = row;                       \
  row = out;
#define ASTERISM_SWEEP(kBytes)                                                                 \
  typedef float V __attribute__((vector_size(kBytes)));                                        \
  typedef float Stored __attribute__((vector_size(kBytes), aligned(4), may_alias));            \
  typedef int Bits __attribute__((vector_size(kBytes)));                                       \
  const float *const up = up_ + step, *const down = down_ + step;                              \
  const V infinite = V{} + kInfinity, up0 = V{} + up[0], up1 = V{} + up[1], up2 = V{} + up[2], \
          up3 = V{} + up[3], base = V{} + (step == 0 ? base_ : 0), down0 = V{} + down[0],      \
          down1 = V{} + down[1], down2 = V{} + down[2], down3 = V{} + down[3];                 \
  V here0 = infinite, here1 = infinite, here2 = infinite, here3 = infinite;                    \
  V before0 = infinite, before1 = infinite, before2 = infinite, before3 = infinite;            \
  V row, above, below, out;                                                                    \
  Bits changed = {};                                                                           \
  for (std::ptrdiff_t p = 0; p < sites_ + kStepsAtOnce; ++p) {                                 \
    row = infinite;                                                                            \
    if (p < sites_) row = reinterpret_cast<const Stored&>(from[p * kLineBlock]) + base;        \
    ASTERISM_CHAIN_STEP(0)                                                                     \
    ASTERISM_CHAIN_STEP(1)                                                                     \
    ASTERISM_CHAIN_STEP(2)                                                                     \
    const V unchanged = here3;                                                                 \
    ASTERISM_CHAIN_STEP(3)                                                                     \
    if (p < kStepsAtOnce) continue; /* a row below the first */                                \
    changed |= reinterpret_cast<Bits>(row) ^ reinterpret_cast<Bits>(unchanged);                \
    reinterpret_cast<Stored&>(to[(p - kStepsAtOnce) * kLineBlock]) = row;                      \
  }                                                                                            \
  int any = 0;                                                                                 \
  for (std::size_t l = 0; l < (kBytes) / sizeof(float); ++l) any |= changed[l];                \
  return any != 0;

static_assert(LineTransform::kStepsAtOnce == 4 && LineTransform::kMostSteps % 4 == 0);
inline bool LineTransform::sweep(const float* from, float* to, int step) const {
  ASTERISM_SWEEP(sizeof(FloatLanes))
}
#ifdef ASTERISM_CHOOSE_LANES
[[gnu::target("avx2")]] inline bool LineTransform::sweep_avx2(const float* from, float* to, int step) const {
  ASTERISM_SWEEP(32)
}
[[gnu::target("avx512f")]] inline bool LineTransform::sweep_avx512(const float* from, float* to,
                                                                   int step) const {
  ASTERISM_SWEEP(64)
}
#endif
#undef ASTERISM_SWEEP
#undef ASTERISM_CHAIN_STEP

inline void LineTransform::absolute(int lane) {
  // A step for the fraction, then passes in both directions.
  ChainStep step;
  const bool has_fraction = fraction_ < 0 || fraction_ > 0;
  step.start(has_fraction ? up_[0] : kInfinity, has_fraction ? down_[0] : kInfinity);
  const float slope = rounded(weight_);
  FloatLanes run = FloatLanes{} + kInfinity;
  FloatLanes to_above = run, to_below = run;
  for (int p = 0; p <= sites_; ++p) {
    FloatLanes row = FloatLanes{} + kInfinity;
    if (p < sites_) {
      row = source(p, lane);
      to_above += slope;
      to_above = row < to_above ? row : to_above;
    }
    step(row);
    if (p == 0) continue;
    run += slope;
    run = row < run ? row : run;
    work(below_ + p - 1, lane) = run;
  }
  run = FloatLanes{} + kInfinity;
  for (int p = sites_ - 1; p >= 0; --p) {
    const FloatLanes f = source(p, lane), row = work(below_ + p, lane);
    to_below += slope;
    to_below = f < to_below ? f : to_below;
    run += slope;
    run = row < run ? row : run;
    work(below_ + p, lane) = run + base_;
  }
  // A query beyond the sites sees all of them in one direction.
  for (int q = 0; q < below_; ++q) {
    work(q, lane) = to_below + rounded(cost(static_cast<double>(-(q + shift_))));
  }
  for (int q = first_above_; q < queries_; ++q) {
    work(row_of(q), lane) = to_above + rounded(cost(static_cast<double>(sites_ - 1 - (q + shift_))));
  }
}

inline void LineTransform::outside(int lane, int window) {
  for (int q = 0; q < below_; ++q) {
    const float* const costs = below_cost_.data() + (below_ - 1 - q);
    FloatLanes least = FloatLanes{} + kInfinity;
    for (int k = 0; k < window; ++k) {
      const FloatLanes one = source(k, lane) + costs[k];
      least = one < least ? one : least;
    }
    work(q, lane) = least;
  }
  for (int q = first_above_; q < queries_; ++q) {
    const float* const costs = above_cost_.data() + (q - first_above_);
    FloatLanes least = FloatLanes{} + kInfinity;
    for (int k = 0; k < window; ++k) {
      const FloatLanes one = source(sites_ - 1 - k, lane) + costs[k];
      least = one < least ? one : least;
    }
    work(row_of(q), lane) = least;
  }
}

inline void LineTransform::envelope(int line) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const float* const f = source_.data() + line;
  // Parabolas by where they begin to be the least, below a first one that begins nowhere. The last one is in
  // variables: most are not removed, and to store and load it again takes time.
  std::size_t count = 0;
  int last_site = 0;
  double last_height = 0, last_begin = -kNever;
  for (int p = 0; p < sites_; ++p) {
    const double value = f[std::ptrdiff_t{p} * kLineBlock];
    if (!(value < kNever)) continue;
    const double height = value + site_cost_[static_cast<std::size_t>(p)];
    double begin = -kNever;
    while (count > 0) {
      begin = (height - last_height) * inverse_[static_cast<std::size_t>(p - last_site)];
      if (begin > last_begin) [[likely]]
        break;
      begin = -kNever;
      if (--count == 0) break;
      last_site = site_[count - 1];
      last_height = height_[count - 1];
      last_begin = begin_[count - 1];
    }
    site_[count] = last_site = p;
    height_[count] = last_height = height;
    begin_[count] = last_begin = begin;
    ++count;
  }
  if (count == 0) site_[count++] = 0;  // whose value is infinity
  begin_[count] = kNever;
  std::size_t best = 0;
  const auto fill = [&](std::ptrdiff_t row, int rows, std::ptrdiff_t first) {
    float* result = work_.data() + row * kLineBlock + line;
    auto q = static_cast<double>(first);
    double value = 0, place = 0;
    const auto take = [&] {
      value = f[std::ptrdiff_t{site_[best]} * kLineBlock];
      place = site_[best] - fraction_;
    };
    take();
    for (int k = 0; k < rows; ++k, result += kLineBlock, q += 1) {
      if (begin_[best + 1] < q) {
        do ++best;
        while (begin_[best + 1] < q);
        take();
      }
      *result = rounded(value + weight_ * (place - q) * (place - q));
    }
  };
  fill(0, below_, shift_);
  fill(below_, sites_, 0);
  if (first_above_ < queries_) fill(row_of(first_above_), queries_ - first_above_, first_above_ + shift_);
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism

#undef ASTERISM_CHOOSE_LANES
