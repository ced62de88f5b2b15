#include "statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <stdexcept>

namespace asterism::bench {

namespace {

struct Ranks {
  std::vector<std::size_t> doubled;  // twice the ranks, so that the means of ties are whole
  double tie_correction = 0;         // sum of t^3 - t over groups of t equal values
};

Ranks ranks(std::span<const double> values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return values[i]; });
  Ranks result{.doubled = std::vector<std::size_t>(values.size())};
  for (std::size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    while (end < order.size() && values[order[end]] == values[order[begin]]) ++end;
    for (std::size_t i = begin; i < end; ++i) result.doubled[order[i]] = begin + 1 + end;
    const auto tied = static_cast<double>(end - begin);
    result.tie_correction += tied * tied * tied - tied;
  }
  return result;
}

double two_sided_normal(double z) { return std::erfc(std::abs(z) / std::numbers::sqrt2); }

double sum(std::span<const double> values) { return std::accumulate(values.begin(), values.end(), 0.0); }

double quantile(const std::vector<double>& sorted, double share) {
  const double position = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(position);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], position - static_cast<double>(below));
}

}  // namespace

double signed_rank_p(std::span<const double> differences) {
  std::vector<double> sizes;
  std::vector<bool> positive;
  for (const double d : differences) {
    if (d == 0 || std::isnan(d)) continue;
    sizes.push_back(std::abs(d));
    positive.push_back(d > 0);
  }
  const std::size_t n = sizes.size();
  if (n == 0) return 1;
  const Ranks ranked = ranks(sizes);
  const std::size_t total = n * (n + 1);
  std::size_t plus = 0;
  for (std::size_t i = 0; i < n; ++i) plus += positive[i] ? ranked.doubled[i] : 0;
  const std::size_t smaller = std::min(plus, total - plus);

  if (n <= 15) {  // each of the 2^n choices of signs is equally likely
    std::vector<std::size_t> ways(total + 1);
    ways[0] = 1;
    for (const std::size_t rank : ranked.doubled)
      for (std::size_t s = total; s >= rank; --s) ways[s] += ways[s - rank];
    const auto tail = std::accumulate(ways.begin(), ways.begin() + static_cast<std::ptrdiff_t>(smaller) + 1,
                                      std::size_t{0});
    return std::min(1.0, 2 * static_cast<double>(tail) / std::ldexp(1, static_cast<int>(n)));
  }
  const auto count = static_cast<double>(n);
  const double deviation = static_cast<double>(smaller) / 2 - count * (count + 1) / 4;
  const double variance = (count * (count + 1) * (2 * count + 1) - ranked.tie_correction / 2) / 24;
  return two_sided_normal(deviation / std::sqrt(variance));
}

double rank_sum_p(std::span<const double> a, std::span<const double> b) {
  if (a.empty() || b.empty()) throw std::invalid_argument("rank-sum test of an empty sample");
  if (a.size() > b.size()) std::swap(a, b);
  std::vector<double> all(a.begin(), a.end());
  all.insert(all.end(), b.begin(), b.end());
  if (std::ranges::any_of(all, [](double x) { return std::isnan(x); }))
    throw std::invalid_argument("rank-sum test of NaN");
  const Ranks ranked = ranks(all);
  const std::size_t n = all.size();
  const std::size_t total = n * (n + 1);
  const std::size_t of_a = std::accumulate(
      ranked.doubled.begin(), ranked.doubled.begin() + static_cast<std::ptrdiff_t>(a.size()), std::size_t{0});

  if (a.size() < 10 && n < 20) {  // each choice of a.size() of the ranks is equally likely
    std::vector<std::vector<std::size_t>> ways(a.size() + 1, std::vector<std::size_t>(total + 1));
    ways[0][0] = 1;
    for (const std::size_t rank : ranked.doubled)
      for (std::size_t k = a.size(); k > 0; --k)
        for (std::size_t s = rank; s <= total; ++s) ways[k][s] += ways[k - 1][s - rank];
    std::size_t below = 0, above = 0, every = 0;
    for (std::size_t s = 0; s <= total; ++s) {
      const std::size_t count = ways[a.size()][s];
      every += count;
      if (s <= of_a) below += count;
      if (s >= of_a) above += count;
    }
    return std::min(1.0, 2 * static_cast<double>(std::min(below, above)) / static_cast<double>(every));
  }
  const auto size_a = static_cast<double>(a.size()), size_b = static_cast<double>(b.size());
  const double size = size_a + size_b;
  const double variance = size_a * size_b / 12 * (size + 1 - ranked.tie_correction / (size * (size - 1)));
  const double deviation = std::abs(static_cast<double>(of_a) / 2 - size_a * (size + 1) / 2);
  if (variance <= 0 || deviation == 0) return 1;
  return two_sided_normal((deviation - 0.5) / std::sqrt(variance));
}

double area_under_roc(std::vector<std::pair<double, bool>> scores) {
  if (std::ranges::any_of(scores, [](const auto& score) { return std::isnan(score.first); }))
    throw std::invalid_argument("area under the ROC curve of a score that is NaN");
  std::ranges::sort(scores);
  double pairs = 0, members = 0, others = 0;
  for (std::size_t i = 0; i < scores.size();) {
    double equal_members = 0, equal_others = 0;
    const double score = scores[i].first;
    for (; i < scores.size() && scores[i].first == score; ++i)
      (scores[i].second ? equal_members : equal_others) += 1;
    pairs += equal_members * (others + equal_others / 2);
    members += equal_members;
    others += equal_others;
  }
  return members > 0 && others > 0 ? pairs / (members * others) : std::numeric_limits<double>::quiet_NaN();
}

double kde_bandwidth(std::span<const double> values) {
  const auto count = static_cast<double>(values.size());
  const double mean = sum(values) / count;
  double variance = 0;
  for (const double x : values) variance += (x - mean) * (x - mean) / count;
  if (!(variance > 0)) throw std::invalid_argument("kernel density of fewer than two different values");

  // All in units of the standard deviation. The pilot's variance is that of the normal scale rule.
  const double pilot = std::pow(4 / (3 * count), 0.4);
  double roughness = 0;  // integral of the squared second derivative
  for (const double x : values)
    for (const double y : values) {
      const double m = (x - y) * (x - y) / (variance * pilot);
      roughness += std::exp(-m / 2) * (3 - 6 * m + m * m);
    }
  roughness /= count * count * std::sqrt(2 * std::numbers::pi * pilot) * pilot * pilot;
  return std::sqrt(variance) * std::pow(count * std::sqrt(4 * std::numbers::pi) * roughness, -0.2);
}

double kde_density(std::span<const double> values, double bandwidth, double x) {
  double density = 0;
  for (const double value : values) {
    const double z = (x - value) / bandwidth;
    density += std::exp(-z * z / 2);
  }
  return density / (static_cast<double>(values.size()) * bandwidth * std::sqrt(2 * std::numbers::pi));
}

Bootstrapped bootstrap(std::span<const std::size_t> starts,
                       const std::function<double(std::span<const Draw>)>& measure,
                       const BootstrapOptions& options) {
  if (starts.empty() || std::ranges::count(starts, std::size_t{0}) > 0)
    throw std::invalid_argument("bootstrap without sequences or of one without starts");
  std::vector<Draw> draws(starts.size());
  for (std::size_t s = 0; s < starts.size(); ++s) {
    draws[s] = {s, std::vector<std::size_t>(starts[s])};
    std::iota(draws[s].starts.begin(), draws[s].starts.end(), std::size_t{0});
  }
  Bootstrapped result{.value = measure(draws), .resamples = {}};

  // The engine is the same on every platform, the standard library's distributions are not. With 64 bits the
  // remainder is practically uniform.
  std::mt19937_64 random(options.seed);
  result.resamples.reserve(options.resamples);
  for (std::size_t r = 0; r < options.resamples; ++r) {
    for (Draw& draw : draws) {
      draw.sequence = static_cast<std::size_t>(random() % starts.size());
      draw.starts.resize(starts[draw.sequence]);
      for (std::size_t& start : draw.starts)
        start = static_cast<std::size_t>(random() % starts[draw.sequence]);
    }
    result.resamples.push_back(measure(draws));
  }
  return result;
}

Bootstrapped difference(const Bootstrapped& a, const Bootstrapped& b) {
  if (a.resamples.size() != b.resamples.size())
    throw std::invalid_argument("difference of measures of different numbers of resamples");
  Bootstrapped result{.value = a.value - b.value, .resamples = a.resamples};
  std::ranges::transform(a.resamples, b.resamples, result.resamples.begin(), std::minus());
  return result;
}

Estimate estimate(const Bootstrapped& measure, double confidence) {
  std::vector<double> sorted = measure.resamples;
  std::erase_if(sorted, [](double x) { return std::isnan(x); });
  if (sorted.empty()) throw std::invalid_argument("interval of no resample");
  std::ranges::sort(sorted);
  return {measure.value, quantile(sorted, (1 - confidence) / 2), quantile(sorted, (1 + confidence) / 2)};
}

double mean(std::span<const std::vector<double>> values, std::span<const Draw> draws) {
  double total = 0;
  for (const Draw& draw : draws) {
    double of_sequence = 0;
    for (const std::size_t start : draw.starts) of_sequence += values[draw.sequence][start];
    total += of_sequence / static_cast<double>(draw.starts.size());
  }
  return total / static_cast<double>(draws.size());
}

}  // namespace asterism::bench
