#include <algorithm>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/features/mrf.hpp>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace {

/// Added to posteriors so that every class stays possible in every cell.
constexpr float kEps = std::numeric_limits<float>::epsilon();

/// Convolution with the neighbourhood's weights lambda: a Gaussian of radius r and standard deviation r / 3
/// whose centre is zero, normalised to sum 1; the border is reflected (cv::BORDER_REFLECT).
///
/// Zeroing the centre makes the kernel inseparable. Convolving with the full, separable Gaussian and
/// subtracting the centre's term would cancel badly: for r = 1 nearly all weight is at the centre. So the
/// neighbours are summed in two parts, those in the same row and those in other rows, and nothing is
/// subtracted.
class Neighbourhood {
 public:
  Neighbourhood(cv::Size size, int radius, MrfWorkspace& workspace)
      : rows_(size.height),
        cols_(size.width),
        radius_(radius),
        weights_(workspace.weights),
        padded_(workspace.padded_row),
        row_others_(workspace.row_others),
        row_all_(workspace.row_all) {
    const auto gaussian = [sigma = radius / 3.0](int d) {
      return std::exp(-0.5 * (d / sigma) * (d / sigma));
    };
    double sum = 1;
    for (int d = 1; d <= radius; ++d) sum += 2 * gaussian(d);
    weights_.resize(std::size_t(radius) + 1);
    for (int d = 0; d <= radius; ++d) weights_[std::size_t(d)] = float(gaussian(d) / sum);
    scale_ = float(1 / (1 - (1 / sum) * (1 / sum)));
    padded_.resize(std::size_t(cols_) + 2 * std::size_t(radius));
    row_others_.resize(std::size_t(rows_) * std::size_t(cols_));
    row_all_.resize(row_others_.size());
  }

  /// out = lambda * in; both row-major planes of the size given at construction, not the same memory.
  void apply(const float* in, float* out) {
    for (int y = 0; y < rows_; ++y) convolve_row(in + y * std::ptrdiff_t(cols_), y);
    for (int y = 0; y < rows_; ++y) {
      float* target = out + y * std::ptrdiff_t(cols_);
      const float* others = row(row_others_, y);
      const float centre = weights_[0] * scale_;
      for (int x = 0; x < cols_; ++x) target[x] = centre * others[x];
      for (int d = 1; d <= radius_; ++d) {
        const float* above = row(row_all_, cv::borderInterpolate(y - d, rows_, cv::BORDER_REFLECT));
        const float* below = row(row_all_, cv::borderInterpolate(y + d, rows_, cv::BORDER_REFLECT));
        const float weight = weights_[std::size_t(d)] * scale_;
        for (int x = 0; x < cols_; ++x) target[x] += weight * (above[x] + below[x]);
      }
    }
  }

 private:
  float* row(std::vector<float>& plane, int y) const { return plane.data() + y * std::ptrdiff_t(cols_); }

  void convolve_row(const float* in, int y) {
    float* middle = padded_.data() + radius_;
    std::copy(in, in + cols_, middle);
    for (int d = 1; d <= radius_; ++d) {
      middle[-d] = in[cv::borderInterpolate(-d, cols_, cv::BORDER_REFLECT)];
      middle[cols_ - 1 + d] = in[cv::borderInterpolate(cols_ - 1 + d, cols_, cv::BORDER_REFLECT)];
    }
    float* others = row(row_others_, y);
    float* all = row(row_all_, y);
    std::fill(others, others + cols_, 0.0f);
    for (int d = 1; d <= radius_; ++d) {
      const float weight = weights_[std::size_t(d)];
      const float* left = middle - d;
      const float* right = middle + d;
      for (int x = 0; x < cols_; ++x) others[x] += weight * (left[x] + right[x]);
    }
    const float centre = weights_[0];
    for (int x = 0; x < cols_; ++x) all[x] = others[x] + centre * middle[x];
  }

  int rows_, cols_, radius_;
  float scale_ = 1;              // 1 / (1 - weight of the centre)
  std::vector<float>& weights_;  // one side of the normalised 1-D Gaussian, the centre first
  std::vector<float>&padded_, &row_others_, &row_all_;
};

void check_map(const cv::Mat& map, const char* message) {
  if (map.dims > 2 || map.type() != CV_32FC1) throw std::invalid_argument(message);
  for (int y = 0; y < map.rows; ++y) {
    const float* value = map.ptr<float>(y);
    // Written so that NaN is not valid.
    const bool valid = std::all_of(value, value + map.cols, [](float v) { return v >= 0 && v <= 1; });
    if (!valid) throw std::invalid_argument(message);
  }
}

/// sum_i log(f_i b_i) with one logarithm per eight elements: f_i + b_i = 2 and f_i, b_i > 1e-15, so that the
/// product of eight pairs stays well within the range of double.
double log_of_product(std::span<const float> f, std::span<const float> b) {
  constexpr std::size_t kGroup = 8;
  double sum = 0;
  for (std::size_t begin = 0; begin < f.size(); begin += kGroup) {
    double product = 1;
    const std::size_t end = std::min(begin + kGroup, f.size());
    for (std::size_t i = begin; i < end; ++i) product *= double(f[i]) * double(b[i]);
    sum += std::log(product);
  }
  return sum;
}

}  // namespace

cv::Mat regularize_posterior(const cv::Mat& foreground_likelihood, const cv::Mat& foreground_prior,
                             const MrfOptions& options) {
  MrfWorkspace workspace;
  cv::Mat posterior;
  regularize_posterior(foreground_likelihood, foreground_prior, options, workspace, posterior);
  return posterior;
}

void regularize_posterior(const cv::Mat& foreground_likelihood, const cv::Mat& foreground_prior,
                          const MrfOptions& options, MrfWorkspace& workspace, cv::Mat& posterior) {
  if (foreground_likelihood.empty()) throw std::invalid_argument("regularize_posterior: the map is empty");
  check_map(foreground_likelihood, "regularize_posterior: the likelihood must be CV_32FC1 in [0, 1]");
  if (!foreground_prior.empty()) {
    check_map(foreground_prior, "regularize_posterior: the prior must be CV_32FC1 in [0, 1]");
    if (foreground_prior.size() != foreground_likelihood.size()) {
      throw std::invalid_argument("regularize_posterior: prior and likelihood differ in size");
    }
  }
  check_options("MrfOptions", options);
  if (!options.enabled) return foreground_likelihood.copyTo(posterior);

  // All maps are contiguous planes. For pi and s only the foreground's plane is stored: their classes sum to
  // one, which lambda preserves. For q both are stored, since the background's value matters where it is far
  // below the rounding error of one.
  const auto off_the_ends = [](float pi_f) { return std::min(std::max(pi_f, kEps), 1 - kEps); };
  const cv::Size size = foreground_likelihood.size();
  const std::size_t cells = foreground_likelihood.total();
  Neighbourhood lambda(
      size, std::max(1, cvFloor(options.neighbourhood * std::max(size.width, size.height) + 0.5)), workspace);

  workspace.planes.resize(9 * cells);
  const auto plane = [&](std::size_t k) { return std::span(workspace.planes).subspan(k * cells, cells); };
  const std::span<float> pi = plane(0), p_f = plane(1), p_b = plane(2), s = plane(3), q_f = plane(4),
                         q_b = plane(5), mean_f = plane(6), mean_b = plane(7), l = plane(8);
  float* copy = l.data();
  for (int y = 0; y < size.height; ++y, copy += size.width)
    std::copy_n(foreground_likelihood.ptr<float>(y), size.width, copy);
  std::fill(pi.begin(), pi.end(), 0.5f);
  if (!foreground_prior.empty()) {
    // A prior of exactly 0 beside one of exactly 1 would leave no class possible (0 / 0 in s).
    float* target = pi.data();
    for (int y = 0; y < size.height; ++y) {
      const float* value = foreground_prior.ptr<float>(y);
      target = std::transform(value, value + size.width, target, off_the_ends);
    }
  }

  double previous = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    // P_k = pi_k L_k, kept off zero.
    for (std::size_t i = 0; i < cells; ++i) {
      p_f[i] = pi[i] * l[i] + kEps;
      p_b[i] = (1 - pi[i]) * (1 - l[i]) + kEps;
    }
    // s_k = pi_k (lambda * pi_k), normalised over k: the prior weighted by that of its neighbourhood.
    lambda.apply(pi.data(), mean_f.data());
    for (std::size_t i = 0; i < cells; ++i) {
      const float f = pi[i] * mean_f[i], b = (1 - pi[i]) * (1 - mean_f[i]);
      s[i] = f / (f + b);
    }
    // q_k = P_k (lambda * P_k), normalised over k: the same for the posterior.
    lambda.apply(p_f.data(), mean_f.data());
    lambda.apply(p_b.data(), mean_b.data());
    for (std::size_t i = 0; i < cells; ++i) {
      const float f = p_f[i] * mean_f[i], b = p_b[i] * mean_b[i];
      q_f[i] = f / (f + b);
      q_b[i] = b / (f + b);
    }
    // S_k = s_k + lambda * s_k, Q_k = q_k + lambda * q_k, and the M step pi_k = (S_k + Q_k) / 4.
    lambda.apply(q_f.data(), mean_f.data());
    lambda.apply(q_b.data(), mean_b.data());
    for (std::size_t i = 0; i < cells; ++i) {
      q_f[i] += mean_f[i];
      q_b[i] += mean_b[i];
    }
    // e = -1/(2N) sum_i sum_k log Q_k. It grows while the labels sharpen; only its change is meaningful.
    const double energy = -log_of_product(q_f, q_b) / (2.0 * double(cells));
    if (std::abs(energy - previous) < options.tolerance) break;
    previous = energy;

    lambda.apply(s.data(), mean_f.data());
    for (std::size_t i = 0; i < cells; ++i) pi[i] = off_the_ends((s[i] + mean_f[i] + q_f[i]) / 4);
  }
  // Since Q_f + Q_b = 2, the regularised posterior is Q_f / 2.
  posterior.create(size, CV_32FC1);
  const float* q = q_f.data();
  for (int y = 0; y < size.height; ++y, q += size.width)
    std::transform(q, q + size.width, posterior.ptr<float>(y),
                   [](float value) { return std::min(value / 2, 1.0f); });
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
