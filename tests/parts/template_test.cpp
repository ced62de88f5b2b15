#include <gtest/gtest.h>

#include <asterism/parts/models/template.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
namespace {

using Distance = TemplateOptions::Distance;
using testing::displaced;
using testing::texture;

class Templates : public ::testing::TestWithParam<std::tuple<Distance, bool>> {
 protected:
  TemplateOptions options() const {
    TemplateOptions options;
    std::tie(options.distance, options.color) = GetParam();
    return options;
  }
};

TEST_P(Templates, FulfilThePartAxioms) { testing::check_part_axioms(Template(options())); }
TEST_P(Templates, WithstandFaults) { testing::check_part_faults(Template(options())); }

// At unit scale the distances equal those of cv::matchTemplate on the image itself, and the definition.
TEST_P(Templates, EqualMatchTemplateAndTheDefinition) {
  const cv::Mat image = texture(120, 160);
  const Frame frame(image);
  const cv::Mat& seen = options().color ? frame.bgr() : frame.gray();
  const cv::Mat pattern = seen(cv::Rect(70, 50, 21, 17));
  Template part(options());
  part.init(frame, {80, 58}, {21, 17});
  part.localize(frame, {75, 60});
  const auto& values = part.response().values;
  const int reach = static_cast<int>(values.rows() / 2);
  ASSERT_EQ(reach, static_cast<int>(std::ceil(0.75 * std::sqrt(21.0 * 17))));
  const cv::Mat search = seen(cv::Rect(65 - reach, 52 - reach, 21 + 2 * reach, 17 + 2 * reach));

  const bool ncc = options().distance == Distance::Ncc;
  cv::Mat peer, z, y;
  cv::matchTemplate(search, pattern, peer, ncc ? cv::TM_CCOEFF_NORMED : cv::TM_SQDIFF);
  ASSERT_EQ(peer.size(), cv::Size(2 * reach + 1, 2 * reach + 1));
  pattern.convertTo(z, CV_64F);
  const cv::Mat centred = z - cv::mean(z);
  const double contrast = centred.dot(centred);
  for (int r = 0; r <= 2 * reach; ++r)
    for (int c = 0; c <= 2 * reach; ++c) {
      search(cv::Rect(c, r, 21, 17)).convertTo(y, CV_64F);
      const cv::Mat deviation = y - cv::mean(y);
      const double distance =
          ncc ? 2 - 2 * centred.dot(deviation) / std::sqrt(contrast * deviation.dot(deviation))
              : cv::norm(y, z, cv::NORM_L2SQR) / contrast;
      const double score = peer.at<float>(r, c);
      EXPECT_NEAR(ncc ? 2 - 2 * score : score / contrast, distance, 1e-4);
      // Ties are settled by up to 1e-4 of the value along each axis.
      EXPECT_NEAR(values(r, c), 1 - distance / 2, 1e-4 + 2e-4 * std::abs(1 - distance / 2));
    }
}

TEST_P(Templates, FindAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  Template part(options());
  part.init(Frame(image), {160, 120}, {45, 38});
  for (const auto& [dx, dy] : {std::pair{1.0, 0.0}, {-3, 2}, {13, 11}, {0.5, 0.25}, {-7.3, 4.6}}) {
    const Evidence evidence = part.localize(Frame(displaced(image, dx, dy)), {160, 120});
    // Parabolas along the axes ignore the tilt of a peak; the error is less than a tenth of a pixel.
    const bool whole = dx == std::round(dx) && dy == std::round(dy);
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), whole ? 0.05 : 0.1)
        << dx << ", " << dy;
    EXPECT_GT(evidence.peak, 0.95);
    EXPECT_LT(evidence.covariance.trace(), 4);
  }
}

// The position of a stripe is certain across it and not along it, which the covariance must show.
TEST_P(Templates, KnowTheDirectionTheyCannotSee) {
  cv::Mat image(200, 200, CV_8UC3, cv::Scalar::all(60));
  cv::line(image, {40, 20}, {160, 180}, cv::Scalar(200, 220, 180), 9, cv::LINE_AA);
  const Frame frame(image);
  Template part(options());
  part.init(frame, {100, 100}, {30, 30});
  const Evidence evidence = part.localize(frame, {103, 99});
  const Point2 along = Point2(120, 160).normalized(), across(-along.y(), along.x());
  EXPECT_LT(std::abs((evidence.position - Point2(100, 100)).dot(across)), 0.3);
  EXPECT_GT(along.dot(evidence.covariance * along), 10 * across.dot(evidence.covariance * across));
}

// Along an edge or a stripe, all matches are equal: a still one must not move.
TEST_P(Templates, StayAtTheMiddleOfEqualMatches) {
  cv::Mat image(120, 160, CV_8UC3, cv::Scalar::all(20));
  image.colRange(80, 160).setTo(cv::Scalar(220, 200, 180));
  for (const cv::Mat& edge : {image, cv::Mat(image.t())}) {
    const Frame frame(edge);
    const Point2 centre(0.5 * (edge.cols - 1), 0.5 * (edge.rows - 1));
    Template part(options());
    part.init(frame, centre, {30, 25});
    EXPECT_LT((part.localize(frame, centre).position - centre).norm(), 0.05);
  }
}

INSTANTIATE_TEST_SUITE_P(All, Templates,
                         ::testing::Combine(::testing::Values(Distance::Ncc, Distance::Ssd),
                                            ::testing::Bool()));

TEST(Template, NccIsBlindToBrightnessAndContrast) {
  const cv::Mat image = texture(120, 160);
  const Frame frame(image), darker(0.6 * image + cv::Scalar::all(10));
  TemplateOptions options;
  for (const auto& [distance, lowest, highest] :
       {std::tuple{Distance::Ncc, 0.95, 1.0}, {Distance::Ssd, 0.0, 0.8}}) {
    options.distance = distance;
    Template part(options);
    part.init(frame, {80, 60}, {30, 24});
    const Evidence evidence = part.localize(darker, {80, 60});
    EXPECT_GE(evidence.peak, lowest);
    EXPECT_LE(evidence.peak, highest);
  }
}

TEST(Template, AveragesWhatItSees) {
  const cv::Mat image = texture(120, 160), other = texture(120, 160, 7);
  const Frame frame(image), later(other);
  const Point2 centre(80, 60);
  TemplateOptions options;
  options.distance = Distance::Ssd;
  const auto peak_after = [&](double rate, const Frame& seen) {
    options.learning_rate = rate;
    Template part(options);
    part.init(frame, centre, {30, 24});
    part.adapt(later, centre);
    return part.localize(seen, centre).peak;
  };
  EXPECT_NEAR(peak_after(0, frame), 1, 1e-3);
  EXPECT_NEAR(peak_after(1, later), 1, 1e-3);
  EXPECT_LT(peak_after(0.2, frame), peak_after(0.1, frame));
  cv::Mat mean;
  cv::addWeighted(image, 0.75, other, 0.25, 0, mean);
  EXPECT_GT(peak_after(0.25, Frame(mean)), 0.99);
}

TEST(Template, SaysNothingWithoutContrast) {
  const cv::Mat image = texture(120, 160);
  const Frame frame(image), flat(cv::Mat(120, 160, CV_8UC3, cv::Scalar(10, 90, 200)));
  const Point2 centre(80, 60);
  for (const Distance distance : {Distance::Ncc, Distance::Ssd}) {
    TemplateOptions options;
    options.distance = distance;
    Template part(options);
    for (const auto& [learned, seen] : {std::pair{&flat, &frame}, {&frame, &flat}, {&flat, &flat}}) {
      part.init(*learned, centre, {30, 24});
      const Evidence evidence = part.localize(*seen, centre);
      EXPECT_EQ(evidence.peak, 0);
      EXPECT_LT((evidence.position - centre).norm(), 1e-9);
      EXPECT_GT(evidence.covariance.trace(), 100);
    }
  }
}

TEST(Template, RefusesBadOptions) {
  const auto refused = [](auto change) {
    TemplateOptions options;
    change(options);
    EXPECT_THROW(Template{options}, std::invalid_argument);
  };
  refused([](TemplateOptions& o) { o.sigma = 0; });
  refused([](TemplateOptions& o) { o.window.padding = 1e308; });
  refused([](TemplateOptions& o) { o.learning_rate = std::nan(""); });
  refused([](TemplateOptions& o) { o.window.padding = 0; });
  refused([](TemplateOptions& o) { o.window.min_template_side = 0; });
  refused([](TemplateOptions& o) { o.window.max_template_side = 10; });
}

}  // namespace
}  // namespace asterism
