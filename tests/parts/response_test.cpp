#include <gtest/gtest.h>

#include <Eigen/LU>
#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/features/patch.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>

namespace asterism {
namespace {

ResponseMap gaussian_map(double row, double col, double sigma_row, double sigma_col) {
  ResponseMap map;
  map.values.resize(40, 50);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 50; ++c)
      map.values(r, c) = static_cast<float>(
          0.8 * std::exp(-0.5 * (std::pow((r - row) / sigma_row, 2) + std::pow((c - col) / sigma_col, 2))));
  map.origin = {100, 200};
  map.spacing = {2, 3};
  return map;
}

TEST(Evidence, OfAGaussianResponse) {
  const Evidence evidence = evidence_of(gaussian_map(18.3, 24.6, 2, 3));
  EXPECT_NEAR(evidence.position.x(), 100 + 2 * 24.6, 0.05);
  EXPECT_NEAR(evidence.position.y(), 200 + 3 * 18.3, 0.05);
  EXPECT_NEAR(evidence.peak, 0.8, 0.03);
  // Variance of the Gaussian, plus that of the position within a cell.
  EXPECT_NEAR(evidence.covariance(0, 0), 4 * (9 + 1.0 / 12), 0.1);
  EXPECT_NEAR(evidence.covariance(1, 1), 9 * (4 + 1.0 / 12), 0.1);
  EXPECT_NEAR(evidence.covariance(0, 1), 0, 0.05);
}

// The paper's weighted variance, Sec. 2.3.3, summed literally.
TEST(Evidence, TraceIsTheWeightedVariance) {
  ResponseMap map = gaussian_map(10.2, 30.1, 4, 2);
  map.values -= 0.1f;  // negative responses must not count
  const Evidence evidence = evidence_of(map);
  double sum = 0, mass = 0;
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 50; ++c) {
      const double w = std::max(0.0f, map.values(r, c));
      sum += w * (map.position(r, c) - evidence.position).squaredNorm();
      mass += w;
    }
  EXPECT_NEAR(evidence.covariance.trace(), sum / mass + (4 + 9) / 12.0, 1e-6);
}

TEST(Evidence, OfMapsWithoutAPeak) {
  ResponseMap map = gaussian_map(10, 10, 2, 2);
  map.values.setConstant(-1);
  Evidence evidence = evidence_of(map);
  EXPECT_EQ(evidence.peak, 0);
  EXPECT_EQ(evidence.position, map.position(20, 25));
  EXPECT_GT(evidence.covariance.determinant(), 0);
  map.values.setConstant(0.3f);
  evidence = evidence_of(map);
  EXPECT_TRUE(evidence.position.allFinite());
  map.values.resize(1, 1);
  map.values(0, 0) = 1;
  evidence = evidence_of(map);
  EXPECT_EQ(evidence.position, map.origin);
  EXPECT_GT(evidence.covariance.determinant(), 0);
}

TEST(Evidence, IsNotRefinedAcrossABorderThatDoesNotRepeat) {
  ResponseMap map = gaussian_map(0, 20.3, 3, 3);
  map.values.row(39) = 0.5f * map.values.row(0);  // next to the first row only if the map is periodic
  EXPECT_NE(evidence_of(map).position.y(), map.origin.y());
  map.periodic = false;
  EXPECT_EQ(evidence_of(map).position.y(), map.origin.y());
  EXPECT_NEAR(evidence_of(map).position.x(), map.position(0, 20.3).x(), 0.05);
}

TEST(Evidence, WithTheCovarianceOfALikelihood) {
  ResponseMap map = gaussian_map(18.3, 24.6, 2, 3);
  const ResponseMap likelihood = gaussian_map(20.3, 23.6, 1, 1.5);
  const Evidence evidence = evidence_of(map, likelihood);
  EXPECT_EQ(evidence.position, evidence_of(map).position);
  EXPECT_EQ(evidence.peak, evidence_of(map).peak);
  const Point2 off = Point2(2 * -1, 3 * 2);
  const Eigen::Matrix2d expected = evidence_of(likelihood).covariance + off * off.transpose();
  EXPECT_TRUE(evidence.covariance.isApprox(expected, 0.01));
  map.values.setZero();
  EXPECT_EQ(evidence_of(map, likelihood).covariance, evidence_of(map).covariance);
}

TEST(ResponseMap, InterpolatesInsideAndIsZeroOutside) {
  ResponseMap map = gaussian_map(10, 10, 3, 3);
  map.values(4, 7) = 0.25f;
  map.values(4, 8) = 0.75f;
  map.values(5, 7) = -1;
  map.values(5, 8) = 1;
  EXPECT_DOUBLE_EQ(map.at(map.position(4, 7)), 0.25);
  EXPECT_DOUBLE_EQ(map.at(map.position(4, 7.5)), 0.5);
  EXPECT_DOUBLE_EQ(map.at(map.position(4.5, 8)), 0.875);
  EXPECT_DOUBLE_EQ(map.at(map.position(5, 7)), 0) << "negative responses are no similarity";
  EXPECT_DOUBLE_EQ(map.at(map.position(39, 49)), static_cast<double>(map.values(39, 49)));
  // A border cell extends half a cell outwards.
  map.values(0, 5) = 0.5f;
  map.values(5, 49) = 0.25f;
  EXPECT_DOUBLE_EQ(map.at(map.position(-0.4, 5)), 0.5);
  EXPECT_DOUBLE_EQ(map.at(map.position(5, 49.4)), 0.25);
  EXPECT_EQ(map.at(map.position(-0.6, 5)), 0);
  EXPECT_EQ(map.at(map.position(5, 49.6)), 0);
  EXPECT_EQ(map.at({std::nan(""), 0}), 0);
}

TEST(SamplePatch, CopiesPixelsAtUnitScale) {
  cv::Mat gray;
  cv::cvtColor(testing::texture(100, 120), gray, cv::COLOR_BGR2GRAY);
  cv::Mat patch;
  // A 20 x 10 window around the corner shared by pixels (49, 39) and (50, 40) covers x 40..59, y 35..44.
  sample_patch(gray, {49.5, 39.5}, {20, 10}, {20, 10}, patch);
  EXPECT_EQ(cv::norm(patch, gray(cv::Rect(40, 35, 20, 10)), cv::NORM_INF), 0);
}

TEST(SamplePatch, ReplicatesBorders) {
  cv::Mat gray;
  cv::cvtColor(testing::texture(100, 120), gray, cv::COLOR_BGR2GRAY);
  cv::Mat padded, patch;
  cv::copyMakeBorder(gray, padded, 300, 300, 300, 300, cv::BORDER_REPLICATE);
  for (const Point2& centre :
       {Point2(-0.5, -0.5), Point2(119.5, 50.5), Point2(-200.5, 40.5), Point2(300.5, 350.5)}) {
    sample_patch(gray, centre, {40, 30}, {40, 30}, patch);
    const cv::Rect there(static_cast<int>(centre.x() - 19.5) + 300, static_cast<int>(centre.y() - 14.5) + 300,
                         40, 30);
    EXPECT_EQ(cv::norm(patch, padded(there & cv::Rect({}, padded.size())), cv::NORM_INF), 0)
        << centre.transpose();
  }
}

// When a window is downsampled, positions outside the image see the filtered border.
TEST(SamplePatch, FiltersAtTheBorderAsInside) {
  cv::Mat gray;
  cv::cvtColor(testing::texture(100, 120), gray, cv::COLOR_BGR2GRAY);
  cv::Mat smooth, expected, patch;
  cv::blur(gray, smooth, {5, 5}, {-1, -1}, cv::BORDER_REPLICATE);
  for (const Point2& centre :
       {Point2(60, 50), Point2(0, 50), Point2(-80, 40), Point2(125, 110), Point2(1e4, -1e4)}) {
    sample_patch(gray, centre, {100, 75}, {20, 15}, patch);
    const Point2 first = centre - 5 * Size2(19, 14) / 2;
    cv::warpAffine(smooth, expected, cv::Matx23d(5, 0, first.x(), 0, 5, first.y()), {20, 15},
                   cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
    EXPECT_EQ(cv::norm(patch, expected, cv::NORM_INF), 0) << centre.transpose();
  }
}

// A linear ramp is reproduced at any scale and sub-pixel position, up to the rounding to eight bits and the
// 1/32 px of OpenCV's interpolation tables.
TEST(SamplePatch, IsExactOnARamp) {
  cv::Mat gray(200, 250, CV_8UC1);
  for (int r = 0; r < gray.rows; ++r)
    for (int c = 0; c < gray.cols; ++c) gray.at<uchar>(r, c) = static_cast<uchar>((c + r) / 2);
  cv::Mat patch;
  for (const double scale : {0.4, 1.0, 1.7, 2.0, 3.3, 5.0}) {
    const Point2 centre(120.3, 100.8);
    sample_patch(gray, centre, {24 * scale, 16 * scale}, {24, 16}, patch);
    for (int r = 0; r < 16; ++r)
      for (int c = 0; c < 24; ++c) {
        const Point2 at = centre + scale * Point2(c - 11.5, r - 7.5);
        EXPECT_NEAR(patch.at<uchar>(r, c), (at.x() + at.y()) / 2 - 0.25, 1.0)
            << scale << " " << r << " " << c;
      }
  }
}

TEST(SamplePatch, ReusesItsBuffer) {
  const cv::Mat gray(100, 120, CV_8UC1, cv::Scalar(7));
  cv::Mat patch;
  sample_patch(gray, {50, 50}, {40, 40}, {20, 20}, patch);
  const uchar* data = patch.data;
  sample_patch(gray, {51, 50}, {44, 44}, {20, 20}, patch);
  EXPECT_EQ(patch.data, data);
}

}  // namespace
}  // namespace asterism
