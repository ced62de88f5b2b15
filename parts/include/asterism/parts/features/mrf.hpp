#pragma once

#include <asterism/solver/base/config.hpp>
#include <opencv2/core.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of `regularize_posterior`.
struct MrfOptions {
  /// Smooth the posterior; false: leave it as it is.
  bool enabled = true;
  /// Maximum number of iterations, in [1, 1000]; without one, the tolerance is reached after about eight.
  int max_iterations = 50;
  /// Stop when the mean log posterior changes by less than this, >= 0.
  double tolerance = 0.1;
  /// Radius of the Gaussian neighbourhood as a fraction of the map's larger side, in (0, 1]; at least one
  /// pixel. The radius is three standard deviations. (The group's code takes the width, which makes the
  /// result depend on whether a map lies or stands.)
  double neighbourhood = 0.06;
};

/// Scratch memory of `regularize_posterior`. Reused, it avoids allocations for maps that are not larger.
struct MrfWorkspace {
  std::vector<float> planes;      ///< of the maps
  std::vector<float> weights;     ///< of the neighbourhood
  std::vector<float> padded_row;  ///< of the map that is convolved
  std::vector<float> row_others;  ///< sums along rows without the centre
  std::vector<float> row_all;     ///< sums along rows
};

/// Smooths a foreground posterior with a Markov random field whose prior and posterior are spatially averaged
/// (Diplaros et al. 2007, Kristan et al. 2014), by expectation maximisation.
///
/// foreground_likelihood: CV_32FC1, the per-pixel posterior L_f in [0, 1] (L_b = 1 - L_f).
/// foreground_prior: CV_32FC1 of the same size, in [0, 1], or empty for one half everywhere. It starts the
/// iteration and is not part of the likelihood (the group's code multiplies it into both). Returns the
/// regularised foreground posterior, CV_32FC1 in [0, 1]. Throws std::invalid_argument for other types, sizes
/// or values (NaN included), and for options out of range.
ASTERISM_API cv::Mat regularize_posterior(const cv::Mat& foreground_likelihood,
                                          const cv::Mat& foreground_prior = {},
                                          const MrfOptions& options = {});
/// As above, into `posterior`, which may be `foreground_likelihood` itself; it is allocated where it has
/// another size or type.
ASTERISM_API void regularize_posterior(const cv::Mat& foreground_likelihood, const cv::Mat& foreground_prior,
                                       const MrfOptions& options, MrfWorkspace& workspace,
                                       cv::Mat& posterior);

}  // namespace ASTERISM_ABI
}  // namespace asterism
