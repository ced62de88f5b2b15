#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace asterism::bench {

/// A measure that is not defined.
inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// Significance of differences. Definitions and sources: docs/evaluation-measures.md.

/// Two-sided p of Wilcoxon's signed-rank test that differences are symmetric about zero. Zeros and NaN are
/// left out, ties share their mean rank. As MATLAB's signrank by default: exact for up to 15 differences,
/// else normal without continuity correction. 1 if no difference is left.
double signed_rank_p(std::span<const double> differences);

/// Two-sided p of Wilcoxon's rank-sum test (Mann and Whitney's U) that two samples have one distribution. As
/// MATLAB's ranksum by default: exact if the smaller sample has fewer than 10 values and both together fewer
/// than 20, else normal with continuity correction. 1 if all values are equal. Throws std::invalid_argument
/// for an empty sample or NaN.
double rank_sum_p(std::span<const double> a, std::span<const double> b);

/// Area under the ROC curve of a score that tells two classes apart: the probability that a member of the
/// class `true` has a higher score than a member of the other, equal ones counting half (Mann and Whitney).
/// NaN if either class is empty. Throws std::invalid_argument for a score that is NaN.
double area_under_roc(std::vector<std::pair<double, bool>> scores);

/// Standard deviation of the Gaussian kernels by the plug-in rule of the legacy VOT toolkit (gmm_estimate.m,
/// after Wand and Jones, Kernel Smoothing): that of least mean integrated squared error for the fourth
/// derivative of a pilot estimate. Throws std::invalid_argument unless two values differ.
double kde_bandwidth(std::span<const double> values);
/// Density at `x` of equally weighted Gaussians around `values`.
double kde_density(std::span<const double> values, double bandwidth, double x);

/// One sequence of a resample, and its drawn starts.
struct Draw {
  std::size_t sequence = 0;
  std::vector<std::size_t> starts;
};

struct BootstrapOptions {
  std::size_t resamples = 2000;
  std::uint64_t seed = 1;
};

/// A measure of the data as they are, and of each resample of them.
struct Bootstrapped {
  double value = 0;
  std::vector<double> resamples;  ///< NaN for a resample on which the measure is not defined
};

/// Resamples on two levels: as many sequences as there are, with replacement, and of each as many of its
/// starts, with replacement. `starts`: the number of each sequence. The same starts and options give the same
/// draws on every platform, so the measures of two trackers are paired. Throws std::invalid_argument without
/// sequences or for one without starts.
Bootstrapped bootstrap(std::span<const std::size_t> starts,
                       const std::function<double(std::span<const Draw>)>& measure,
                       const BootstrapOptions& options = {});

/// a - b, draw by draw. Throws std::invalid_argument if the numbers of resamples differ.
Bootstrapped difference(const Bootstrapped& a, const Bootstrapped& b);

struct Estimate {
  double value = 0, low = 0, high = 0;
  /// Of a difference: whether it is significant.
  bool excludes_zero() const { return low > 0 || high < 0; }
};
/// The percentile interval that holds the share `confidence` of the resamples, NaN left out.
Estimate estimate(const Bootstrapped& measure, double confidence = 0.95);

/// Mean over the drawn sequences of the mean over their drawn starts; `values`: by sequence and start.
double mean(std::span<const std::vector<double>> values, std::span<const Draw> draws);

/// The drawn sequences with the drawn runs, for measures that are not means. `Sequence` has a vector `runs`.
template <class Sequence>
std::vector<Sequence> resampled(const std::vector<Sequence>& sequences, std::span<const Draw> draws) {
  std::vector<Sequence> result;
  result.reserve(draws.size());
  for (const Draw& draw : draws) {
    Sequence& sequence = result.emplace_back(sequences[draw.sequence]);
    sequence.runs.clear();
    for (const std::size_t start : draw.starts) sequence.runs.push_back(sequences[draw.sequence].runs[start]);
  }
  return result;
}

}  // namespace asterism::bench
