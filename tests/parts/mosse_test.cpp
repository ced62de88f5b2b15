#include <gtest/gtest.h>

#include <asterism/parts/models/mosse.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
namespace {

using testing::displaced;
using testing::texture;

TEST(Mosse, FulfilsThePartAxioms) { testing::check_part_axioms(Mosse()); }
TEST(Mosse, WithstandsFaults) { testing::check_part_faults(Mosse()); }

double label(const ResponseMap& response, Eigen::Index r, Eigen::Index c, double sigma) {
  const double dr = static_cast<double>(r - response.values.rows() / 2),
               dc = static_cast<double>(c - response.values.cols() / 2);
  return std::exp(-0.5 * (dr * dr + dc * dc) / (sigma * sigma));
}

TEST(Mosse, ReturnsItsLabelOnTheImageItWasTrainedOn) {
  MosseOptions options;
  options.perturbations = 0;
  options.regularisation = 1e-8;
  Mosse part(options);
  const cv::Mat image = texture(240, 320);
  const Frame frame(image);
  for (const Size2& size : {Size2(40, 32), Size2(61, 23)}) {
    part.init(frame, {160, 120}, size);
    part.localize(frame, {160, 120});
    const ResponseMap& response = part.response();
    for (Eigen::Index r = 0; r < response.values.rows(); ++r)
      for (Eigen::Index c = 0; c < response.values.cols(); ++c)
        ASSERT_NEAR(response.values(r, c), label(response, r, c, options.label_sigma), 5e-3);
  }
}

TEST(Mosse, FindsAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  Mosse part;
  part.init(Frame(image), {160, 120}, {34, 30});
  for (const auto& [dx, dy] : {std::pair{1.0, 0.0}, {-3, 2}, {5, -7}, {0.5, 0.25}, {-4.3, 2.6}}) {
    const cv::Mat moved = displaced(image, dx, dy);
    const Frame frame(moved);
    const Point2 truth(160 + dx, 120 + dy);
    const Evidence first = part.localize(frame, {160, 120});
    EXPECT_LT((first.position - truth).norm(), 0.05 + 0.04 * std::hypot(dx, dy)) << dx << ", " << dy;
    const Evidence second = part.localize(frame, first.position);
    EXPECT_LT((second.position - truth).norm(), 0.05) << dx << ", " << dy;
    EXPECT_LT(second.covariance.trace(), 4);
  }
}

// The least-squares filter over two images does not depend on their order.
TEST(Mosse, RunningAverageWeighsBothImages) {
  MosseOptions options;
  options.perturbations = 0;
  options.regularisation = 1e-8;
  options.learning_rate = 0.5;
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  const Frame frame(image), later(other);
  const Point2 centre(160, 120);
  Mosse both(options), swapped(options);
  both.init(frame, centre, {40, 32});
  both.adapt(later, centre);
  swapped.init(later, centre, {40, 32});
  swapped.adapt(frame, centre);
  for (const Frame* seen : {&frame, &later}) {
    both.localize(*seen, centre);
    swapped.localize(*seen, centre);
    EXPECT_LT((both.response().values - swapped.response().values).abs().maxCoeff(), 5e-3);
    EXPECT_GT(both.response().values.maxCoeff(), 0.3);
  }
  // At full rate the first image is forgotten.
  options.learning_rate = 1;
  Mosse forgetful(options), fresh(options);
  forgetful.init(frame, centre, {40, 32});
  forgetful.adapt(later, centre);
  fresh.init(later, centre, {40, 32});
  forgetful.localize(later, centre);
  fresh.localize(later, centre);
  EXPECT_LT((forgetful.response().values - fresh.response().values).abs().maxCoeff(), 1e-3);
}

TEST(Mosse, PerturbationsMakeItTolerant) {
  const cv::Mat image = texture(240, 320);
  cv::Mat turned;
  cv::warpAffine(image, turned, cv::getRotationMatrix2D({160, 120}, 5, 1.05), image.size());
  const auto ratio = [&](int perturbations) {
    MosseOptions options;
    options.perturbations = perturbations;
    Mosse part(options);
    part.init(Frame(image), {160, 120}, {48, 40});
    const Evidence evidence = part.localize(Frame(turned), {160, 120});
    EXPECT_LT((evidence.position - Point2(160, 120)).norm(), 1);
    return part.psr();
  };
  EXPECT_GT(ratio(8), 1.3 * ratio(0));
}

TEST(Mosse, OcclusionShowsInRatioAndCovariance) {
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  const Frame frame(image), foreign(other);
  Mosse part;
  part.init(frame, {160, 120}, {48, 40});
  const Evidence seen = part.localize(frame, {160, 120});
  EXPECT_GT(part.psr(), 20);
  const Evidence occluded = part.localize(foreign, {160, 120});
  EXPECT_LT(part.psr(), 7);
  EXPECT_LT(occluded.peak, 0.5 * seen.peak);
  EXPECT_GT(occluded.covariance.trace(), 50 * seen.covariance.trace());
  part.localize(Frame(cv::Mat(240, 320, CV_8UC1, cv::Scalar(77))), {160, 120});
  EXPECT_EQ(part.psr(), 0);
}

// A change of light that scales all levels is removed by the logarithm.
TEST(Mosse, IsBlindToExposure) {
  const cv::Mat image = texture(240, 320);
  Mosse part;
  part.init(Frame(image), {160, 120}, {48, 40});
  const double before = part.localize(Frame(image), {160, 120}).peak;
  EXPECT_NEAR(part.localize(Frame(0.5 * image), {160, 120}).peak, before, 0.05);
}

TEST(Mosse, ForgetsItsResponseWhereItStartsAnew) {
  const Frame frame(texture(240, 320));
  Mosse part;
  part.init(frame, {160, 120}, {48, 40});
  part.localize(frame, {160, 120});
  EXPECT_GT(part.similarity_at({160, 120}), 0);
  part.init(frame, {160, 120}, {48, 40});
  EXPECT_EQ(part.similarity_at({160, 120}), 0);
  EXPECT_EQ(part.psr(), 0);
}

TEST(Mosse, RefusesBadOptions) {
  const auto refused = [](auto change) {
    MosseOptions options;
    change(options);
    EXPECT_THROW(Mosse{options}, std::invalid_argument);
  };
  refused([](MosseOptions& o) { o.learning_rate = -0.1; });
  refused([](MosseOptions& o) { o.label_sigma = 0; });
  refused([](MosseOptions& o) { o.label_sigma = 1e-300; });
  refused([](MosseOptions& o) { o.regularisation = 0; });
  refused([](MosseOptions& o) { o.regularisation = 1e-300; });
  refused([](MosseOptions& o) { o.perturbations = -1; });
  refused([](MosseOptions& o) { o.perturbations = 2'000'000'000; });
  refused([](MosseOptions& o) { o.perturbation = 1; });
  refused([](MosseOptions& o) { o.window.padding = -1; });
  refused([](MosseOptions& o) { o.window.min_template_side = 10; });
  refused([](MosseOptions& o) { o.window.max_template_side = 20; });
}

}  // namespace
}  // namespace asterism
