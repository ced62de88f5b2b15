#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/line_transform.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/discrete/window_transform.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <cstddef>
#include <limits>
#include <new>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {
class LayeredTree;
}  // namespace detail

/// The generalised distance transform of a map of costs f (Felzenszwalb and Huttenlocher, Theory of Computing
/// 2012):
///   D(q) = min_p f(p) + cost(p - q),   q = (x, y) anywhere in a map of any size.
///
/// Where f is the cost of a part at p, D(q) is the cost of the part's best place for a reference at q, such
/// as the part it is linked to. Costs are sums of a cost along x and a cost along y, so that columns are
/// transformed first, then rows. Infinity in f forbids a place. In time linear in the pixels of both maps. A
/// cost of the length is not such a sum: its time is that of the result's pixels times the window's.
///
/// Results are floats: D is exact up to rounding, which is at most a few hundred times the precision of float
/// (1e-7) of the numbers that are added. An object holds its workspace, which includes the map between
/// the two passes: reuse it to transform without allocation, one thread at a time.
class DistanceTransform {
 public:
  /// Transforms f to D, which must not overlap f. Returns what is wrong with the input, or an empty text; D
  /// is then as it was. NaN and minus infinity are refused.
  Message run(const MapView<const float>& f, const DisplacementCost& cost, const MapView<float>& result) {
    float least = 0;
    if (const char* problem = detail::map_problem(f, least)) return Defect{"map", Defect::kNoIndex, problem};
    if (result.empty()) return Defect{"result", Defect::kNoIndex, "is empty"};
    if (result.width > 1 << 20 || result.height > 1 << 20)
      return Defect{"result", Defect::kNoIndex, "is wider or higher than 2^20"};
    if (const char* problem = cost.problem()) return Defect{"cost", Defect::kNoIndex, problem};
    Message message;
    detail::attempt<std::bad_alloc>(
        [&] {
          reserve(f.width, f.height, cost, result.width, result.height);
          write<false>(f, result);
        },
        [&](const std::bad_alloc& error) { message = detail::memory_message(error); });
    return message;
  }

  /// The place p at which the least cost for the reference q is, the one with the least x and y if there are
  /// several; (-1, -1) if all are forbidden. f and cost are those of the last run, as they were. O(width +
  /// height), or that of the window.
  Eigen::Vector2i best_place(const MapView<const float>& f, const DisplacementCost& cost, int x,
                             int y) const {
    if (cost.has_window()) return best_in_window(f, cost, x, y);
    const float* const row = between_.data() + std::ptrdiff_t{y} * stride_;
    const int px = least(f.width, [&](int p) { return static_cast<double>(row[p]) + cost.x(p - x); });
    const int py =
        px < 0 ? -1 : least(f.height, [&](int p) { return static_cast<double>(f(px, p)) + cost.y(p - y); });
    return py < 0 ? Eigen::Vector2i(-1, -1) : Eigen::Vector2i(px, py);
  }

 private:
  friend class LoopyStructure;
  friend class detail::LayeredTree;

  // For valid input: allocates what a run needs.
  void reserve(int width, int height, const DisplacementCost& cost, int result_width, int result_height) {
    if (cost.has_window()) {
      window_.plan(cost, width, height, result_width);
      has_window_ = true;
      return;
    }
    has_window_ = false;
    stride_ = padded(width);
    const std::ptrdiff_t rows = padded(result_height);
    detail::require_memory(sizeof(float) * static_cast<double>(stride_) * static_cast<double>(rows));
    const auto size = static_cast<std::size_t>(stride_ * rows);
    if (between_.size() < size) between_.resize(size, std::numeric_limits<float>::infinity());
    columns_.plan(cost.y, height, result_height);
    rows_.plan(cost.x, width, result_width);
  }

  // After reserve, for valid input: sets `result` to D or adds D to it.
  template <bool kAdd>
  void write(const MapView<const float>& f, const MapView<float>& result);

  static constexpr int kBlock = detail::kLineBlock;

  static std::ptrdiff_t padded(int size) { return (std::ptrdiff_t{size} + kBlock - 1) / kBlock * kBlock; }

  static Eigen::Vector2i best_in_window(const MapView<const float>& f, const DisplacementCost& cost, int x,
                                        int y) {
    const Eigen::Vector2i first = cost.first_displacement() + Eigen::Vector2i(x, y);
    const int side = 2 * cost.length.reach + 1;
    Eigen::Vector2i best(-1, -1);
    double least = std::numeric_limits<double>::infinity();
    for (int px = std::max(first.x(), 0); px < std::min(first.x() + side, f.width); ++px) {
      for (int py = std::max(first.y(), 0); py < std::min(first.y() + side, f.height); ++py) {
        const double one = static_cast<double>(f(px, py)) + cost(px - x, py - y);
        if (one < least) {
          least = one;
          best << px, py;
        }
      }
    }
    return best;
  }

  template <typename Cost>
  static int least(int count, Cost&& cost) {
    int best = -1;
    double least = std::numeric_limits<double>::infinity();
    for (int p = 0; p < count; ++p) {
      const double one = cost(p);
      if (one < least) {
        least = one;
        best = p;
      }
    }
    return best;
  }

  static void transpose(const float* from, std::ptrdiff_t from_stride, float* to, std::ptrdiff_t to_stride);

  detail::LineTransform columns_, rows_;
  detail::WindowTransform window_;
  bool has_window_ = false;
  std::vector<float> between_;  // after the columns: f.width wide, as high as the result
  std::ptrdiff_t stride_ = 0;
};

template <bool kAdd>
void DistanceTransform::write(const MapView<const float>& f, const MapView<float>& result) {
  if (has_window_) {
    window_.run(f, result.width, result.height, [&result](int x, int y, float cost) {
      if constexpr (kAdd) {
        result(x, y) += cost;
      } else {
        result(x, y) = cost;
      }
    });
    return;
  }
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (int x = 0; x < f.width; x += kBlock) {
    float* const source = columns_.source();
    const int lanes = std::min(kBlock, f.width - x);
    for (int y = 0; y < f.height; ++y) {
      const float* const from = &f(x, y);
      float* const to = source + std::ptrdiff_t{y} * kBlock;
      if (lanes == kBlock && f.column_stride == 1) {
        std::copy_n(from, kBlock, to);
      } else {
        for (int l = 0; l < lanes; ++l) to[l] = from[l * f.column_stride];
        std::fill(to + lanes, to + kBlock, kInfinity);
      }
    }
    columns_.run();
    for (int y = 0; y < result.height; ++y) {
      std::copy_n(columns_.result(y), kBlock, between_.data() + y * stride_ + x);
    }
  }
  alignas(64) float block[kBlock][kBlock];
  for (int y = 0; y < result.height; y += kBlock) {
    for (int x = 0; x < f.width; x += kBlock) {
      const float* const from = between_.data() + y * stride_ + x;
      if (x + kBlock <= f.width) {
        transpose(from, stride_, rows_.source() + std::ptrdiff_t{x} * kBlock, kBlock);
      } else {
        transpose(from, stride_, block[0], kBlock);
        std::copy_n(block[0], (f.width - x) * kBlock, rows_.source() + std::ptrdiff_t{x} * kBlock);
      }
    }
    rows_.run();
    const int lanes = std::min(kBlock, result.height - y);
    for (int x = 0; x < result.width; x += kBlock) {
      const int count = std::min(kBlock, result.width - x);
      const float* results = rows_.result(x);
      if (count < kBlock || rows_.result(x + kBlock - 1) - results != (kBlock - 1) * kBlock) {
        for (int q = 0; q < count; ++q) std::copy_n(rows_.result(x + q), kBlock, block[q]);
        results = block[0];
      }
      transpose(results, kBlock, block[0], kBlock);
      for (int l = 0; l < lanes; ++l) {
        float* const to = &result(x, y + l);
        const auto put = [&](int q, std::ptrdiff_t at) {
          if constexpr (kAdd) {
            to[at] += block[l][q];
          } else {
            to[at] = block[l][q];
          }
        };
        if (count == kBlock && result.column_stride == 1) {
          for (int q = 0; q < kBlock; ++q) put(q, q);
        } else {
          for (int q = 0; q < count; ++q) put(q, q * result.column_stride);
        }
      }
    }
  }
}

// A square of kBlock x kBlock, which may be transposed in place.
inline void DistanceTransform::transpose(const float* from, std::ptrdiff_t from_stride, float* to,
                                         std::ptrdiff_t to_stride) {
#if defined(__SSE2__)
  const auto load = [&](int i, int j, __m128(&square)[4]) {
    for (int k = 0; k < 4; ++k) square[k] = _mm_loadu_ps(from + (i + k) * from_stride + j);
    _MM_TRANSPOSE4_PS(square[0], square[1], square[2], square[3]);
  };
  const auto store = [&](int i, int j, const __m128(&square)[4]) {
    for (int k = 0; k < 4; ++k) _mm_storeu_ps(to + (i + k) * to_stride + j, square[k]);
  };
  for (int i = 0; i < kBlock; i += 4) {
    for (int j = 0; j <= i; j += 4) {
      __m128 lower[4], upper[4];
      load(i, j, lower);
      load(j, i, upper);
      store(j, i, lower);
      store(i, j, upper);
    }
  }
#else
  for (int i = 0; i < kBlock; ++i) {
    for (int j = 0; j <= i; ++j) {
      const float lower = from[i * from_stride + j], upper = from[j * from_stride + i];
      to[j * to_stride + i] = lower;
      to[i * to_stride + j] = upper;
    }
  }
#endif
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
