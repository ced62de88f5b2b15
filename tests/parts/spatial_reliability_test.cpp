#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <tuple>

namespace asterism {
namespace {

using testing::displaced;
using testing::shifted;
using testing::texture;

TEST(SpatialReliability, FulfilsThePartAxioms) { testing::check_part_axioms(SpatialReliability()); }
TEST(SpatialReliability, WithstandsFaults) { testing::check_part_faults(SpatialReliability()); }
TEST(SpatialReliability, FulfilsThePartAxiomsWithColorChannels) {
  SpatialReliabilityOptions options;
  options.color_channels = true;
  testing::check_part_axioms(SpatialReliability(options));
  testing::check_part_faults(SpatialReliability(options));
}

// An object and a background of the same gray level, distinguished only by color.
TEST(SpatialReliability, ColorChannelsSeeWhatGrayDoesNot) {
  const auto frame = [](int x, int y) {
    cv::Mat image(240, 320, CV_8UC3, cv::Scalar(60, 120, 60));
    image(cv::Rect(x, y, 40, 48)) = cv::Scalar(60, 60, 178);
    cv::Mat gray;
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
    double low = 0, high = 0;
    cv::minMaxLoc(gray, &low, &high);
    EXPECT_LE(high - low, 2);
    return image;
  };
  for (const bool color : {false, true}) {
    SpatialReliabilityOptions options;
    options.color_channels = color;
    SpatialReliability part(options);
    part.init(Frame(frame(140, 90)), {159.5, 113.5}, {40, 48});
    EXPECT_EQ(part.weights().size(), SpatialReliability::kHogChannels + 1 + (color ? 11 : 0));
    const Evidence evidence = part.localize(Frame(frame(153, 97)), {159.5, 113.5});
    const double error = (evidence.position - Point2(172.5, 120.5)).norm();
    if (color) {
      EXPECT_LT(error, 2);  // cells of 5.5 px, without gradients inside
      EXPECT_GT(evidence.peak, 0.8);
    } else {
      EXPECT_GT(error, 5);
    }
  }
}

// A small regression problem: a random image, a Gaussian label, the mask of a disc.
struct Problem {
  static constexpr int kRows = 12, kCols = 8, kPixels = kRows * kCols;
  RealFft2 fft{kRows, kCols};
  Eigen::ArrayXf image{kPixels}, label{kPixels}, mask{kPixels};
  Eigen::ArrayXcf cross, filter, dual;
  Eigen::ArrayXf energy;

  Problem() {
    std::uint32_t state = 1;
    for (float& value : image) {
      state = state * 1664525u + 1013904223u;
      value = static_cast<float>(state >> 8) * 0x1p-24f - 0.5f;
    }
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) {
        const double dr = std::min(r, kRows - r), dc = std::min(c, kCols - c);
        label(r * kCols + c) = static_cast<float>(std::exp(-0.5 * (dr * dr + dc * dc)));
        mask(r * kCols + c) = std::hypot(r - 5.5, c - 3.5) < 3 ? 1.0f : 0.0f;
      }
    const Eigen::Index bins = kRows * fft.spectrum_cols();
    Eigen::ArrayXcf f(bins), y(bins);
    fft.forward(image.data(), f.data());
    fft.forward(label.data(), y.data());
    cross = f * y.conjugate();
    energy = f.abs2();
    filter.resize(bins);
    dual.resize(bins);
  }

  // The filter of MaskedRegression, in the spatial domain.
  Eigen::ArrayXf solve(const MaskedRegressionOptions& options, const Eigen::ArrayXf& allowed) {
    MaskedRegression(kRows, kCols, options)
        .solve(cross.data(), energy.data(), allowed.data(), filter.data(), dual.data());
    Eigen::ArrayXcf spectrum = filter;
    Eigen::ArrayXf h(kPixels);
    fft.inverse(spectrum.data(), h.data());
    return h;
  }

  // Row s: the image at circular shift s, so that shifts() h is the response.
  Eigen::MatrixXd shifts() const {
    Eigen::MatrixXd a(kPixels, kPixels);
    for (int s = 0; s < kPixels; ++s)
      for (int x = 0; x < kPixels; ++x) {
        const int r = (x / kCols + s / kCols) % kRows, c = (x % kCols + s % kCols) % kCols;
        a(s, x) = static_cast<double>(image(r * kCols + c));
      }
    return a;
  }

  // The constrained minimiser by a dense solve of its normal equations.
  Eigen::VectorXd dense(double lambda) const {
    const Eigen::MatrixXd masked = shifts() * mask.cast<double>().matrix().asDiagonal();
    const Eigen::MatrixXd normal =
        masked.transpose() * masked + lambda * Eigen::MatrixXd::Identity(kPixels, kPixels);
    return normal.ldlt().solve(masked.transpose() * label.cast<double>().matrix());
  }

  double cost(const Eigen::VectorXd& h, double lambda) const {
    return (shifts() * h - label.cast<double>().matrix()).squaredNorm() + lambda * h.squaredNorm();
  }
};

TEST(MaskedRegression, IsRidgeRegressionWithoutAMask) {
  Problem problem;
  for (const int iterations : {0, 1, 4}) {
    MaskedRegressionOptions options;
    options.iterations = iterations;
    problem.solve(options, Eigen::ArrayXf::Ones(Problem::kPixels));
    const Eigen::ArrayXcf ridge = problem.cross / (problem.energy + static_cast<float>(options.lambda));
    EXPECT_LT((problem.filter - ridge).abs().maxCoeff(), 1e-4f * ridge.abs().maxCoeff()) << iterations;
  }
}

TEST(MaskedRegression, SolvesTheConstrainedLeastSquares) {
  Problem problem;
  MaskedRegressionOptions options;
  options.iterations = 500;
  for (const double lambda : {0.05, 2.0}) {
    options.lambda = lambda;
    const Eigen::VectorXd exact = problem.dense(lambda);
    const Eigen::VectorXd found = problem.solve(options, problem.mask).cast<double>().matrix();
    EXPECT_LT((found - exact).norm(), 2e-3 * exact.norm());
  }
}

TEST(MaskedRegression, FourRoundsHoldTheConstraintAndAreNearTheMinimum) {
  Problem problem;
  MaskedRegressionOptions options;
  const Eigen::VectorXd exact = problem.dense(options.lambda);
  options.iterations = 0;
  const Eigen::VectorXd cut = problem.solve(options, problem.mask).cast<double>().matrix();
  options.iterations = 4;
  const Eigen::ArrayXf found = problem.solve(options, problem.mask);
  EXPECT_LT(((1 - problem.mask) * found).abs().maxCoeff(), 1e-6f * found.abs().maxCoeff());
  const double lowest = problem.cost(exact, options.lambda);
  const double reached = problem.cost(found.cast<double>().matrix(), options.lambda) - lowest;
  EXPECT_GT(reached, 0);
  EXPECT_LT(reached, 0.2 * (problem.cost(cut, options.lambda) - lowest));
}

// The problem changes little between frames, so two rounds per frame replace many.
TEST(MaskedRegression, RefiningConverges) {
  Problem problem;
  const MaskedRegressionOptions options;
  problem.solve(options, problem.mask);
  MaskedRegression regression(Problem::kRows, Problem::kCols, options);
  for (int frame = 0; frame < 200; ++frame)
    regression.refine(problem.cross.data(), problem.energy.data(), problem.mask.data(), problem.filter.data(),
                      problem.dual.data());
  Eigen::ArrayXf found(Problem::kPixels);
  problem.fft.inverse(problem.filter.data(), found.data());
  const Eigen::VectorXd exact = problem.dense(options.lambda);
  EXPECT_LT((found.cast<double>().matrix() - exact).norm(), 2e-3 * exact.norm());
}

TEST(SpatialReliability, FindsAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  SpatialReliabilityOptions fine;
  fine.window.max_template_side = 50;
  for (const auto& [part, size, tolerance] :
       {std::tuple{SpatialReliability(fine), Size2(60, 48), 0.05},  // 0.93 template pixels per image pixel
        std::tuple{SpatialReliability(), Size2(32, 32), 0.08},
        std::tuple{SpatialReliability(), Size2(22, 26), 0.08}}) {
    SpatialReliability learned = part;
    learned.init(Frame(image), {160, 120}, size);
    for (const auto& [dx, dy] : {std::pair{1.0, 0.0}, {-3, 2}, {5, -7}, {0.5, 0.25}, {-4.3, 2.6}}) {
      const cv::Mat moved = displaced(image, dx, dy);
      const Frame frame(moved);
      const Point2 truth(160 + dx, 120 + dy);
      const Evidence first = learned.localize(frame, {160, 120});
      EXPECT_LT((first.position - truth).norm(), 0.3) << dx << ", " << dy;
      // A search around the position found has its cells on the target as when it was learned.
      const Evidence second = learned.localize(frame, first.position);
      EXPECT_LT((second.position - truth).norm(), tolerance) << dx << ", " << dy;
      EXPECT_GT(second.peak, 0.5);
    }
  }
}

TEST(SpatialReliability, TheTargetAsLearnedHasResponseOne) {
  const cv::Mat image = texture(240, 320);
  for (const bool weighted : {true, false}) {
    SpatialReliabilityOptions options;
    options.channel_weights = weighted;
    SpatialReliability part(options);
    part.init(Frame(image), {160, 120}, {48, 40});
    EXPECT_NEAR(part.localize(Frame(image), {160, 120}).peak, 1, 0.02);
    EXPECT_EQ(part.weights().size(), SpatialReliability::kHogChannels + 1);
    EXPECT_GE(part.weights().minCoeff(), 0);
    if (!weighted) {
      EXPECT_EQ(part.weights().minCoeff(), part.weights().maxCoeff());
    }
  }
}

// A red disc on green, inside a larger box.
cv::Mat disc(const Point2& centre, double radius) {
  cv::Mat image(240, 320, CV_8UC3);
  const cv::Mat noise = texture(240, 320);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const int level = noise.at<cv::Vec3b>(y, x)[0] / 4;
      const bool inside = (Point2(x, y) - centre).norm() < radius;
      image.at<cv::Vec3b>(y, x) = inside ? cv::Vec3b(20, 20, cv::saturate_cast<uchar>(150 + level))
                                         : cv::Vec3b(20, cv::saturate_cast<uchar>(110 + level), 20);
    }
  return image;
}

TEST(SpatialReliability, MasksTheTargetByItsColor) {
  const Point2 centre(160, 120);
  const double radius = 24;
  SpatialReliability part;
  const cv::Mat image = disc(centre, radius);
  part.init(Frame(image), centre, {56, 56});
  ASSERT_TRUE(part.segmented());
  const ResponseMap& mask = part.mask();
  // Cells at the contour, and those added by the dilation, may have either value.
  const double cell = mask.spacing.x();
  for (Eigen::Index r = 0; r < mask.values.rows(); ++r)
    for (Eigen::Index c = 0; c < mask.values.cols(); ++c) {
      const double distance = (mask.position(static_cast<double>(r), static_cast<double>(c)) - centre).norm();
      const float value = mask.values(r, c);
      EXPECT_TRUE(distance > radius - cell || value == 1) << r << ", " << c;
      EXPECT_TRUE(distance < radius + 3 * cell || value == 0) << r << ", " << c;
    }
  // The mask moves with the target.
  const cv::Mat moved = disc({170, 114}, radius);
  part.adapt(Frame(moved), {170, 114});
  EXPECT_TRUE(part.segmented());
  EXPECT_NEAR(part.mask().at({170, 114}), 1, 1e-6);
  EXPECT_EQ(part.mask().at({170 - 1.8 * radius, 114}), 0);
}

TEST(SpatialReliability, TheMaskIsTheBoxWithoutAPlausibleSegmentation) {
  const cv::Mat image = texture(240, 320), colored = disc({160, 120}, 24);
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  const auto expect_box = [](const SpatialReliability& part, const char* what) {
    EXPECT_FALSE(part.segmented()) << what;
    const double area = static_cast<double>(part.mask().values.sum()) * part.mask().spacing.prod();
    EXPECT_GE(area, 56 * 40) << what;
    EXPECT_LE(area, (56 + 2 * part.mask().spacing.x()) * (40 + 2 * part.mask().spacing.y())) << what;
    EXPECT_EQ(part.mask().at({160, 120}), 1) << what;
  };
  SpatialReliability part;
  part.init(Frame(gray), {160, 120}, {56, 40});
  expect_box(part, "gray");
  SpatialReliabilityOptions options;
  options.segmentation = false;
  SpatialReliability plain(options);
  plain.init(Frame(colored), {160, 120}, {56, 40});
  expect_box(plain, "off");
  options.segmentation = true;
  options.max_mask_area = 0.31;
  SpatialReliability strict(options);
  strict.init(Frame(colored), {160, 120}, {56, 40});
  expect_box(strict, "too large");
}

// The purpose of the mask: the background inside the box, which does not move, is not learned.
TEST(SpatialReliability, FollowsTheMaskedTargetAndNotItsBackground) {
  const cv::Mat still = texture(240, 320, 3), skin = texture(240, 320, 9);
  const auto scene = [&](int x) {
    cv::Mat image(240, 320, CV_8UC3);
    for (int r = 0; r < image.rows; ++r)
      for (int c = 0; c < image.cols; ++c) {
        const bool inside = std::hypot(c - x, r - 120) < 20;
        const int level = inside ? skin.at<cv::Vec3b>(r, c - x + 160)[0] : still.at<cv::Vec3b>(r, c)[0];
        const auto bright = cv::saturate_cast<uchar>(60 + level / 2);
        image.at<cv::Vec3b>(r, c) = inside ? cv::Vec3b(bright, 20, bright) : cv::Vec3b(20, bright, 20);
      }
    return image;
  };
  const auto worst = [&](bool segmentation) {
    SpatialReliabilityOptions options;
    options.segmentation = segmentation;
    SpatialReliability part(options);
    const cv::Mat start = scene(160);
    part.init(Frame(start), {160, 120}, {52, 52});
    EXPECT_EQ(part.segmented(), segmentation);
    Point2 at(160, 120);
    double error = 0;
    for (int t = 1; t <= 15; ++t) {
      const cv::Mat image = scene(160 + 3 * t);
      const Frame frame(image);
      at = part.localize(frame, at).position;
      part.adapt(frame, at);
      error = std::max(error, (at - Point2(160 + 3 * t, 120)).norm());
    }
    return error;
  };
  EXPECT_LT(worst(true), 3);
  EXPECT_LT(worst(true), 0.8 * worst(false));
}

TEST(SpatialReliability, ResizedWindowSeesTheEnlargedTarget) {
  const cv::Mat image = texture(240, 320);
  cv::Mat large;
  cv::resize(image, large, {}, 1.25, 1.25, cv::INTER_LINEAR);
  SpatialReliability part;
  part.init(Frame(image), {160, 120}, {60, 50});
  // cv::resize maps pixel centre x to 1.25 (x + 1/2) - 1/2.
  const Point2 there(1.25 * 160.5 - 0.5, 1.25 * 120.5 - 0.5);
  const double unscaled = part.localize(Frame(large), there).peak;
  part.resize({75, 62.5});
  EXPECT_EQ(part.size(), Size2(75, 62.5));
  const Evidence evidence = part.localize(Frame(large), there);
  EXPECT_GT(evidence.peak, 0.8);
  EXPECT_GT(evidence.peak, unscaled + 0.1);
  EXPECT_LT((evidence.position - there).norm(), 0.3);
  EXPECT_THROW(part.resize({0, 10}), std::invalid_argument);
}

TEST(SpatialReliability, RefusesBadOptions) {
  const auto refused = [](auto change) {
    SpatialReliabilityOptions options;
    change(options);
    EXPECT_THROW(SpatialReliability{options}, std::invalid_argument);
  };
  refused([](SpatialReliabilityOptions& o) { o.regression.lambda = 0; });
  refused([](SpatialReliabilityOptions& o) { o.regression.iterations = -1; });
  refused([](SpatialReliabilityOptions& o) { o.regression.max_penalty = HUGE_VAL; });
  refused([](SpatialReliabilityOptions& o) { o.regression.refining_iterations = -1; });
  refused([](SpatialReliabilityOptions& o) { o.regression.penalty = 0; });
  refused([](SpatialReliabilityOptions& o) { o.regression.penalty_growth = 0.5; });
  refused([](SpatialReliabilityOptions& o) { o.regression.max_penalty = 1; });
  refused([](SpatialReliabilityOptions& o) { o.learning_rate = 1.5; });
  refused([](SpatialReliabilityOptions& o) { o.weight_rate = -0.1; });
  refused([](SpatialReliabilityOptions& o) { o.label_sigma = 0; });
  refused([](SpatialReliabilityOptions& o) { o.cell_size = 0; });
  refused([](SpatialReliabilityOptions& o) { o.window.padding = -1; });
  refused([](SpatialReliabilityOptions& o) { o.window.max_template_side = 10; });
  refused([](SpatialReliabilityOptions& o) { o.max_mask_area = 0.1; });
  refused([](SpatialReliabilityOptions& o) { o.color.surrounding = 1; });
}

}  // namespace
}  // namespace asterism
