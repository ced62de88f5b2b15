#include "filter_plan.hpp"

#include <cmath>
#include <map>
#include <mutex>
#include <numbers>
#include <tuple>

namespace asterism::part_kernels_v0_1 {
namespace {

// Few passes, as many as possible of radix 4, which costs least per point.
std::vector<int> radices(int n) {
  std::vector<int> result;
  const auto take = [&](int radix) {
    while (n % radix == 0) {
      result.push_back(radix);
      n /= radix;
    }
  };
  take(4);
  if (n % 6 == 0) {
    result.push_back(6);
    n /= 6;
  }
  for (int radix = 2; radix <= n; ++radix) take(radix);
  return result;
}

// exp(-2 pi i k / n)
void append_root(std::vector<float>& to, std::ptrdiff_t k, int n) {
  const double angle = -2 * std::numbers::pi * static_cast<double>(k % n) / n;
  to.push_back(static_cast<float>(std::cos(angle)));
  to.push_back(static_cast<float>(std::sin(angle)));
}

Passes make_passes(int points, std::vector<float>& table) {
  Passes passes{};
  passes.points = points;
  const std::vector<int> of_passes = radices(points);
  std::vector<std::size_t> twiddles, roots;
  int left = points;
  for (const int radix : of_passes) {
    passes.radix[passes.count++] = radix;
    twiddles.push_back(table.size());
    for (int q = 0; q < left / radix; ++q)
      for (int k = 1; k < radix; ++k) append_root(table, std::ptrdiff_t{q} * k, left);
    roots.push_back(table.size());
    if (radix % 2 != 0) {
      for (int j = 0; j < radix; ++j)
        table.push_back(static_cast<float>(std::cos(2 * std::numbers::pi * j / radix)));
      for (int j = 0; j < radix; ++j)
        table.push_back(static_cast<float>(std::sin(2 * std::numbers::pi * j / radix)));
    }
    left /= radix;
  }
  for (std::size_t i = 0; i < of_passes.size(); ++i) {
    passes.twiddles[i] = table.data() + twiddles[i];
    passes.roots[i] = table.data() + roots[i];
  }
  return passes;
}

int padded(int n, int lanes) { return (n + lanes - 1) / lanes * lanes; }

}  // namespace

FilterPlan::FilterPlan(const KernelSet& kernel_set, int rows, int cols) : kernels(kernel_set) {
  transform.rows = rows;
  transform.cols = cols;
  transform.bins = cols / 2 + 1;
  transform.padded_rows = padded(rows, kernels.lanes);
  transform.padded_bins = padded(transform.bins, kernels.lanes);
  transform.down = make_passes(rows, down_);
  transform.across = make_passes(cols / 2, across_);
  for (int k = 0; k <= cols / 2; ++k) append_root(real_, k, cols);
  transform.real_twiddles = real_.data();
}

std::shared_ptr<const FilterPlan> FilterPlan::shared(int rows, int cols) {
  static std::mutex mutex;
  static std::map<std::tuple<const KernelSet*, int, int>, std::weak_ptr<const FilterPlan>> cache;
  const KernelSet& set = part_kernels_v0_1::kernels();
  const std::tuple key(&set, rows, cols);
  const std::lock_guard lock(mutex);
  if (auto plan = cache[key].lock()) return plan;
  auto plan = std::make_shared<const FilterPlan>(set, rows, cols);
  std::erase_if(cache, [](const auto& entry) { return entry.second.expired(); });
  cache[key] = plan;
  return plan;
}

}  // namespace asterism::part_kernels_v0_1
