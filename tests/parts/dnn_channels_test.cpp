// User-defined channels in the correlation filters, among them those of a network that tiny_network.py
// writes.
#include <gtest/gtest.h>

#include <asterism/parts/features/dnn_channels.hpp>
#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/siamese.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace asterism {
namespace {

using testing::texture;

const std::string kNetwork = ASTERISM_TINY_NETWORK;

// The gray level of each cell, as CellFeatures::gray defines it.
class Gray : public CellChannels {
 public:
  int channels() const override { return 1; }
  void compute(const cv::Mat& window, int rows, int cols, float* planes) const override {
    EXPECT_EQ(window.type(), CV_8UC3);
    const int cell = window.rows / rows;
    EXPECT_EQ(window.cols, cols * cell);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const cv::Scalar mean = cv::mean(window({c * cell, r * cell, cell, cell}));
        *planes++ = static_cast<float>(std::rint(mean[0]) / 255) - 0.5F;
      }
  }
};

TEST(CellChannels, AreAnotherFeature) {
  cv::Mat image;
  cv::cvtColor(texture(240, 320), image, cv::COLOR_BGR2GRAY);
  const Frame frame(image), next(testing::shifted(image, 5, -3));
  Kcf built_in({.features = {.hog = false, .gray = true}});
  Kcf own({.features = {.hog = false, .gray = false, .own = std::make_shared<Gray>()}});
  built_in.init(frame, {160, 120}, {48, 40});
  own.init(frame, {160, 120}, {48, 40});
  const Evidence expected = built_in.localize(next, {160, 120}), found = own.localize(next, {160, 120});
  EXPECT_LT((found.position - expected.position).norm(), 1e-3);
  EXPECT_LT((own.response().values - built_in.response().values).abs().maxCoeff(), 1e-3F);
}

// NaN is refused, and so is a filter without any feature.
TEST(CellChannels, MustBeFinite) {
  struct Bad : Gray {
    void compute(const cv::Mat&, int rows, int cols, float* planes) const override {
      std::fill(planes, planes + rows * cols, std::numeric_limits<float>::quiet_NaN());
    }
  };
  Kcf part({.features = {.own = std::make_shared<Bad>()}});
  EXPECT_THROW(part.init(Frame(texture(240, 320)), {160, 120}, {48, 40}), std::runtime_error);
  EXPECT_THROW(Kcf({.features = {.hog = false, .gray = false}}), std::invalid_argument);
}

TEST(CellChannels, TypicalIsHogs) {
  Fhog hog(4);
  cv::Mat image;
  cv::cvtColor(texture(128, 128), image, cv::COLOR_BGR2GRAY);
  std::vector<float> planes(static_cast<std::size_t>(Fhog::kChannels) * 32 * 32);
  hog.compute(image, planes.data());
  double squares = 0;
  for (const float value : planes) squares += std::pow(static_cast<double>(value), 2);
  const double typical = static_cast<double>(CellChannels::kTypical);
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(planes.size())), typical, 0.5 * typical);
}

TEST(DnnChannels, AreTheNetworksLayer) {
  const DnnChannels channels(kNetwork, "out");
  EXPECT_EQ(channels.channels(), 4);
  EXPECT_EQ(channels.stride(), 4);
  const int rows = 8, cols = 12;
  const cv::Mat window = texture(4 * rows, 4 * cols);
  std::vector<float> planes(static_cast<std::size_t>(4 * rows * cols));
  channels.compute(window, rows, cols, planes.data());

  // The convolution, by its definition.
  std::vector<double> expected;
  double squares = 0;
  for (int k = 0; k < 4; ++k)
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        double sum = 0.1 * k - 0.1;
        for (int channel = 0; channel < 3; ++channel)
          for (int dr = 0; dr < 3; ++dr)
            for (int dc = 0; dc < 3; ++dc) {
              const int y = 4 * r + dr - 1, x = 4 * c + dc - 1;
              if (y < 0 || x < 0 || y >= window.rows || x >= window.cols) continue;
              const int level = window.at<cv::Vec3b>(y, x)[2 - channel];
              sum += std::sin(1 + 27 * k + 9 * channel + 3 * dr + dc) * level / 255;
            }
        expected.push_back(std::max(sum, 0.0));
        squares += expected.back() * expected.back();
      }
  const double scale =
      static_cast<double>(CellChannels::kTypical) / std::sqrt(squares / static_cast<double>(expected.size()));
  for (std::size_t i = 0; i < expected.size(); ++i)
    ASSERT_NEAR(static_cast<double>(planes[i]), scale * expected[i], 1e-5) << i;
}

template <class Part>
Part of_network() {
  const auto channels = std::make_shared<DnnChannels>(kNetwork, "out");
  return Part({.features = {.hog = false, .gray = false, .color = false, .own = channels},
               .cell_size = channels->stride()});
}
TEST(DnnChannels, MakeAPart) {
  testing::check_part_axioms(of_network<Kcf>());
  testing::check_part_faults(of_network<Kcf>());
  testing::check_part_axioms(of_network<Strcf>());
}

TEST(DnnChannels, AreChannelsOfSpatialReliability) {
  SpatialReliabilityOptions options;
  options.hog_channels = false;
  EXPECT_THROW(SpatialReliability{options}, std::invalid_argument);  // without any
  options.network.text = kNetwork;
  options.layer.text = "no-such";
  EXPECT_THROW(SpatialReliability{options}, std::invalid_argument);
  options.layer.text = "out";
  testing::check_part_axioms(SpatialReliability(options));
  SpatialReliability part(options);
  part.init(Frame(texture(240, 320)), {160, 120}, {48, 40});
  EXPECT_EQ(part.weights().size(), 4);
}

// With trained networks; they place a box to about a pixel of theirs.
TEST(Siamese, IsAPart) {
  if (!std::filesystem::exists(ASTERISM_NANOTRACK "/head.onnx"))
    GTEST_SKIP() << "no networks in " ASTERISM_NANOTRACK;
  const Siamese fresh({.network = {ASTERISM_NANOTRACK}});
  testing::check_part_axioms(fresh, 4);
  testing::check_part_axioms(Siamese({.network = {ASTERISM_NANOTRACK}, .filter_share = 0.4}), 4);
  // A larger target is measured.
  const cv::Mat image = texture(240, 320);
  Siamese part = fresh;
  part.init(Frame(image), {159.5, 119.5}, {48, 40});
  cv::Mat larger;
  cv::warpAffine(image, larger, cv::Matx23d(1.2, 0, -0.2 * 159.5, 0, 1.2, -0.2 * 119.5), image.size());
  const Evidence found = part.localize(Frame(larger), {159.5, 119.5});
  EXPECT_LT((found.position - Point2(159.5, 119.5)).norm(), 4);
  EXPECT_GT(part.found_size().minCoeff() / 40, 1);
}

TEST(DnnChannels, SayWhatIsWrong) {
  const auto text = [](const std::string& file, const std::string& layer) -> std::string {
    try {
      const DnnChannels channels(file, layer);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "nothing was thrown";
  };
  EXPECT_EQ(text("no-such.onnx", "").find("DnnChannels: no-such.onnx: "), 0U);
  EXPECT_EQ(text(kNetwork, "mean"),
            "DnnChannels: " + kNetwork + ", layer mean: its output is no map of cells");
  EXPECT_EQ(text(kNetwork, "other"), "DnnChannels: " + kNetwork +
                                         ", layer other: unknown layer, expected one of onnx_node!edges, "
                                         "onnx_node!out, onnx_node!mean, mean");
}

}  // namespace
}  // namespace asterism
