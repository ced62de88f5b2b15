#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/parts/features/mrf.hpp>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace {

using asterism::MrfOptions;
using asterism::regularize_posterior;

cv::Mat uniform_map(cv::Size size, double low, double high, std::uint64_t seed) {
  cv::Mat map(size, CV_32FC1);
  cv::RNG random(seed);
  random.fill(map, cv::RNG::UNIFORM, low, high);
  return map;
}

double largest_difference(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF); }

/// False for NaN too.
bool in_unit_interval(const cv::Mat& map) {
  return std::all_of(map.begin<float>(), map.end<float>(), [](float v) { return v >= 0 && v <= 1; });
}

/// The equations as published: in double precision, for both classes, with the two-dimensional kernel.
cv::Mat oracle(const cv::Mat& likelihood, const cv::Mat& prior, const MrfOptions& options) {
  const double eps = double(std::numeric_limits<float>::epsilon());
  const int larger = std::max(likelihood.rows, likelihood.cols);
  const int r = std::max(1, int(std::floor(options.neighbourhood * larger + 0.5)));
  cv::Mat lambda(2 * r + 1, 2 * r + 1, CV_64FC1);
  for (int y = -r; y <= r; ++y) {
    for (int x = -r; x <= r; ++x)
      lambda.at<double>(y + r, x + r) = std::exp(-(x * x + y * y) / (2 * (r / 3.0) * (r / 3.0)));
  }
  lambda.at<double>(r, r) = 0;
  lambda /= cv::sum(lambda)[0];
  const auto filter = [&](const cv::Mat& map) {
    cv::Mat result(map.size(), CV_64FC1, cv::Scalar(0));
    for (int y = 0; y < map.rows; ++y) {
      for (int x = 0; x < map.cols; ++x) {
        for (int dy = -r; dy <= r; ++dy) {
          for (int dx = -r; dx <= r; ++dx) {
            result.at<double>(y, x) +=
                lambda.at<double>(dy + r, dx + r) *
                map.at<double>(cv::borderInterpolate(y + dy, map.rows, cv::BORDER_REFLECT),
                               cv::borderInterpolate(x + dx, map.cols, cv::BORDER_REFLECT));
          }
        }
      }
    }
    return result;
  };
  const auto normalise = [](cv::Mat(&maps)[2]) {
    const cv::Mat sum = maps[0] + maps[1];
    for (cv::Mat& map : maps) map /= sum;
  };

  cv::Mat l[2], pi[2], p[2], s[2], q[2], s_sum[2], q_sum[2];
  likelihood.convertTo(l[0], CV_64F);
  l[1] = 1 - l[0];
  pi[0] = cv::Mat(likelihood.size(), CV_64FC1, cv::Scalar(0.5));
  if (!prior.empty()) prior.convertTo(pi[0], CV_64F);
  pi[1] = 1 - pi[0];
  double previous = std::numeric_limits<double>::max();
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    for (int k = 0; k < 2; ++k) p[k] = pi[k].mul(l[k]) + eps;
    for (int k = 0; k < 2; ++k) s[k] = pi[k].mul(filter(pi[k]));
    for (int k = 0; k < 2; ++k) q[k] = p[k].mul(filter(p[k]));
    normalise(s);
    normalise(q);
    for (int k = 0; k < 2; ++k) s_sum[k] = s[k] + filter(s[k]);
    for (int k = 0; k < 2; ++k) q_sum[k] = q[k] + filter(q[k]);
    for (int k = 0; k < 2; ++k) pi[k] = (s_sum[k] + q_sum[k]) / 4;
    normalise(pi);
    double e = 0;
    for (const cv::Mat& map : q_sum) {
      cv::Mat logarithm;
      cv::log(map, logarithm);
      e -= cv::sum(logarithm)[0] / (2.0 * double(map.total()));
    }
    if (std::abs(e - previous) < options.tolerance) break;
    previous = e;
  }
  cv::Mat result;
  q_sum[0].convertTo(result, CV_32F, 0.5);
  return result;
}

TEST(MrfTest, AgreesWithTheEquations) {
  const cv::Size sizes[] = {{32, 32}, {45, 22}, {9, 40}, {1, 1}, {1, 9}, {2, 3}, {3, 4}};
  for (const cv::Size size : sizes) {
    const cv::Mat likelihood = uniform_map(size, 0, 1, 3);
    for (const bool with_prior : {false, true}) {
      const cv::Mat prior = with_prior ? uniform_map(size, 0.1, 0.9, 4) : cv::Mat();
      for (const double neighbourhood : {0.06, 0.2, 1.0}) {
        if (neighbourhood == 1 && size.area() > 10) continue;  // the oracle takes minutes
        MrfOptions options;
        options.neighbourhood = neighbourhood;
        for (const int iterations : {1, 2, 50}) {
          options.max_iterations = iterations;
          EXPECT_LT(largest_difference(regularize_posterior(likelihood, prior, options),
                                       oracle(likelihood, prior, options)),
                    1e-5)
              << size << " prior " << with_prior << " neighbourhood " << neighbourhood << " iterations "
              << iterations;
        }
      }
    }
  }
}

TEST(MrfTest, AgreesWithTheEquationsOnCertainLabels) {
  // Likelihoods of exactly 0 and 1 are common: most colors occur in only one histogram.
  cv::Mat likelihood = uniform_map({32, 30}, 0, 1, 5);
  cv::threshold(likelihood, likelihood, 0.6, 1, cv::THRESH_BINARY);
  EXPECT_LT(largest_difference(regularize_posterior(likelihood), oracle(likelihood, {}, {})), 1e-5);
}

TEST(MrfTest, CleansANoisyImageOfTwoRegions) {
  cv::Mat truth(32, 32, CV_32FC1, cv::Scalar(0));
  truth(cv::Rect(8, 10, 14, 12)).setTo(1);
  cv::RNG random(11);
  cv::Mat likelihood = truth.clone();
  for (auto it = likelihood.begin<float>(); it != likelihood.end<float>(); ++it) {
    *it = 0.2f + 0.6f * *it;                             // 0.2 and 0.8 ...
    if (random.uniform(0.0, 1.0) < 0.12) *it = 1 - *it;  // ... and one in eight wrong
  }
  const auto wrong = [&](const cv::Mat& posterior) {
    return cv::countNonZero((posterior > 0.5f) != (truth > 0.5f));
  };
  const cv::Mat posterior = regularize_posterior(likelihood);
  EXPECT_GT(wrong(likelihood), 80);
  EXPECT_LT(wrong(posterior), 25);
  EXPECT_GT(cv::mean(posterior, truth > 0.5f)[0], 0.9);
  EXPECT_LT(cv::mean(posterior, truth < 0.5f)[0], 0.1);
}

TEST(MrfTest, ConstantMapsStayConstant) {
  for (const double value : {0.0, 0.1, 0.5, 0.9, 1.0}) {
    const cv::Mat posterior = regularize_posterior(cv::Mat(20, 31, CV_32FC1, cv::Scalar(value)));
    double low = 0, high = 0;
    cv::minMaxLoc(posterior, &low, &high);
    EXPECT_NEAR(low, high, 1e-5) << value;
    if (value == 0.5) {
      EXPECT_NEAR(low, 0.5, 1e-5);
    } else {
      EXPECT_EQ(low > 0.5, value > 0.5) << value;  // sharper, on the same side
    }
  }
}

TEST(MrfTest, ClassesAreSymmetric) {
  const cv::Mat likelihood = uniform_map({33, 29}, 0, 1, 6);
  const cv::Mat prior = uniform_map({33, 29}, 0.2, 0.8, 7);
  const cv::Mat foreground = regularize_posterior(likelihood, prior);
  const cv::Mat background = regularize_posterior(1 - likelihood, 1 - prior);
  EXPECT_LT(largest_difference(foreground, 1 - background), 1e-5);
}

TEST(MrfTest, PriorMattersAndEmptyMeansOneHalf) {
  const cv::Mat likelihood = uniform_map({30, 30}, 0.3, 0.7, 8);
  const cv::Mat half(30, 30, CV_32FC1, cv::Scalar(0.5)), high(30, 30, CV_32FC1, cv::Scalar(0.8));
  const cv::Mat neutral = regularize_posterior(likelihood);
  EXPECT_EQ(largest_difference(neutral, regularize_posterior(likelihood, half)), 0);
  EXPECT_GT(cv::mean(regularize_posterior(likelihood, high))[0], cv::mean(neutral)[0] + 0.1);
}

TEST(MrfTest, StaysInRangeOnContradictions) {
  // Priors and likelihoods of exactly 0 and 1 that contradict each other, constant and in a checkerboard.
  cv::Mat board(24, 24, CV_32FC1);
  for (int y = 0; y < 24; ++y) {
    for (int x = 0; x < 24; ++x) board.at<float>(y, x) = float((x + y) % 2);
  }
  cv::Mat one_off(24, 24, CV_32FC1, cv::Scalar(1));
  one_off.at<float>(7, 9) = 0;
  const cv::Mat maps[] = {board, 1 - board, one_off, 1 - one_off};
  MrfOptions options;
  options.tolerance = 0;  // all iterations
  for (const cv::Mat& likelihood : maps) {
    for (const cv::Mat& prior : maps) {
      const cv::Mat posterior = regularize_posterior(likelihood, prior, options);
      EXPECT_TRUE(in_unit_interval(posterior));
    }
  }
}

TEST(MrfTest, ViewsAndRepeatedCallsGiveTheSame) {
  const cv::Mat large = uniform_map({50, 40}, 0, 1, 9);
  const cv::Mat view = large(cv::Rect(5, 6, 31, 30));
  const cv::Mat before = view.clone();
  const cv::Mat first = regularize_posterior(view, view);
  EXPECT_EQ(largest_difference(first, regularize_posterior(view.clone(), view.clone())), 0);
  EXPECT_EQ(largest_difference(view, before), 0);
}

TEST(MrfTest, AWorkspaceOfOtherMapsChangesNothing) {
  asterism::MrfWorkspace workspace;
  for (const bool enabled : {true, false})
    for (const cv::Size size : {cv::Size(30, 40), cv::Size(5, 1), cv::Size(41, 29), cv::Size(30, 40)}) {
      const MrfOptions options{.enabled = enabled};
      const cv::Mat map = uniform_map(size, 0, 1, 7), prior = uniform_map(size, 0, 1, 8);
      const cv::Mat expected = regularize_posterior(map, prior, options);
      cv::Mat other(3, 3, CV_8UC1), frame(size + cv::Size(2, 2), CV_32FC1, cv::Scalar(2));
      regularize_posterior(map, prior, options, workspace, other);
      EXPECT_EQ(largest_difference(other, expected), 0);
      // Computed in place, on a map that is part of a larger one.
      cv::Mat part = frame(cv::Rect({1, 1}, size));
      map.copyTo(part);
      regularize_posterior(part, prior, options, workspace, part);
      EXPECT_EQ(largest_difference(part, expected), 0);
      part.setTo(2);
      EXPECT_EQ(largest_difference(frame, cv::Mat(frame.size(), CV_32FC1, cv::Scalar(2))), 0);
    }
}

TEST(MrfTest, DisabledReturnsACopy) {
  const cv::Mat likelihood = uniform_map({8, 9}, 0, 1, 10);
  MrfOptions options;
  options.enabled = false;
  const cv::Mat result = regularize_posterior(likelihood, {}, options);
  EXPECT_EQ(largest_difference(result, likelihood), 0);
  EXPECT_NE(result.data, likelihood.data);
}

TEST(MrfTest, RefusesBadInput) {
  const cv::Mat good(6, 5, CV_32FC1, cv::Scalar(0.5));
  EXPECT_THROW(regularize_posterior(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(regularize_posterior(cv::Mat(6, 5, CV_64FC1, cv::Scalar(0.5))), std::invalid_argument);
  EXPECT_THROW(regularize_posterior(cv::Mat(6, 5, CV_32FC2, cv::Scalar(0.5))), std::invalid_argument);
  EXPECT_THROW(regularize_posterior(good, cv::Mat(5, 6, CV_32FC1, cv::Scalar(0.5))), std::invalid_argument);
  EXPECT_THROW(regularize_posterior(good, cv::Mat(6, 5, CV_8UC1, cv::Scalar(0))), std::invalid_argument);
  using Limits = std::numeric_limits<float>;
  for (const float value : {Limits::quiet_NaN(), Limits::infinity(), -0.01f, 1.01f}) {
    cv::Mat bad = good.clone();
    bad.at<float>(5, 4) = value;
    EXPECT_THROW(regularize_posterior(bad), std::invalid_argument) << value;
    EXPECT_THROW(regularize_posterior(good, bad), std::invalid_argument) << value;
  }
  MrfOptions options;
  options.max_iterations = 0;
  EXPECT_THROW(regularize_posterior(good, {}, options), std::invalid_argument);
  options = {};
  options.tolerance = std::nan("");
  EXPECT_THROW(regularize_posterior(good, {}, options), std::invalid_argument);
  for (const double value : {0.0, -1.0, 1.5, std::nan("")}) {
    options = {};
    options.neighbourhood = value;
    EXPECT_THROW(regularize_posterior(good, {}, options), std::invalid_argument) << value;
  }
}

}  // namespace
