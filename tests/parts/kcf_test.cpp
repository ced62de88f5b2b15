#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cell_features.hpp"

namespace asterism {
namespace {

using testing::shifted;
using testing::texture;

// KCF by its definition: kernel ridge regression on all circular shifts of one sample, with dense matrices.
class DenseKcf {
 public:
  static Eigen::MatrixXd shift(const Eigen::MatrixXd& x, int rows, int cols, int dr, int dc) {
    Eigen::MatrixXd y(x.rows(), x.cols());
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        y.row(r * cols + c) = x.row((r + dr + rows) % rows * cols + (c + dc + cols) % cols);
    return y;
  }

  static double kappa(const Kernel& kernel, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    const double n = static_cast<double>(a.size());
    switch (kernel.type) {
      case Kernel::Type::Gaussian:
        return std::exp(-(a - b).squaredNorm() / (n * kernel.sigma * kernel.sigma));
      case Kernel::Type::Polynomial:
        return std::pow(a.cwiseProduct(b).sum() / n + kernel.offset, kernel.exponent);
      case Kernel::Type::Linear:
        break;
    }
    return a.cwiseProduct(b).sum() / n;
  }

  DenseKcf(const KcfOptions& options, int rows, int cols, double sigma)
      : options_(options), rows_(rows), cols_(cols) {
    y_.resize(rows * cols);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const double dr = std::min(r, rows - r), dc = std::min(c, cols - c);
        y_(r * cols + c) = std::exp(-0.5 * (dr * dr + dc * dc) / (sigma * sigma));
      }
  }

  Eigen::VectorXd solve(const Eigen::MatrixXd& z) const {
    const Eigen::Index n = rows_ * cols_;
    std::vector<Eigen::MatrixXd> shifts;
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < cols_; ++c) shifts.push_back(shift(z, rows_, cols_, r, c));
    Eigen::MatrixXd k(n, n);
    for (Eigen::Index i = 0; i < n; ++i)
      for (Eigen::Index j = 0; j < n; ++j)
        k(i, j) =
            kappa(options_.kernel, shifts[static_cast<std::size_t>(i)], shifts[static_cast<std::size_t>(j)]);
    return (k + options_.lambda * Eigen::MatrixXd::Identity(n, n)).ldlt().solve(y_);
  }

  void train(const Eigen::MatrixXd& z, double rate) {
    const Eigen::VectorXd a = solve(z);
    if (alpha_.size() == 0) {
      alpha_ = a;
      template_ = z;
    } else {
      alpha_ += rate * (a - alpha_);
      template_ += rate * (z - template_);
    }
  }

  // f(y shifted by (r, c)), the response at that displacement.
  double response(const Eigen::MatrixXd& y, int dr, int dc) const {
    const Eigen::MatrixXd moved = shift(y, rows_, cols_, dr, dc);
    double sum = 0;
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < cols_; ++c)
        sum += alpha_(r * cols_ + c) * kappa(options_.kernel, moved, shift(template_, rows_, cols_, r, c));
    return sum;
  }

 private:
  KcfOptions options_;
  int rows_, cols_;
  Eigen::VectorXd y_, alpha_;
  Eigen::MatrixXd template_;
};

struct KcfCase {
  Kernel::Type kernel;
  KcfFeatures features;
};
class KcfKernels : public ::testing::TestWithParam<KcfCase> {};

// Training, detection and the plain update in the Fourier domain equal the dense ridge regression.
TEST_P(KcfKernels, EqualsRidgeRegressionOnAllCircularShifts) {
  KcfOptions options;
  options.kernel.type = GetParam().kernel;
  options.features = GetParam().features;
  options.lambda = 1e-2;  // well conditioned, so that the dense solve is exact enough to compare with
  options.separate_update = false;
  options.learning_rate = 0.3;
  options.window.min_template_side = options.window.max_template_side = 16;
  options.window.padding = 1;
  const cv::Mat image = texture(100, 120), next = shifted(image, 3, 2);
  const Frame frame(image), later(next);
  const Point2 centre(60, 50);
  Kcf kcf(options);
  kcf.init(frame, centre, {16, 16});
  const int n = 8;
  ASSERT_EQ(kcf.window(), Size2(32, 32));

  DenseKcf dense(options, n, n, options.label_sigma * 16 / options.cell_size);
  const auto features = [&](const Frame& f, const Point2& at) {
    return testing::cell_features(f, at, kcf.window(), n, n, options.cell_size, options.features);
  };
  const auto compare = [&](const Frame& f) {
    kcf.localize(f, centre);
    const Eigen::MatrixXd y = features(f, centre);
    const double scale = kcf.response().values.abs().maxCoeff();
    ASSERT_GT(scale, 0.1);
    for (int r = 0; r < n; ++r)
      for (int c = 0; c < n; ++c)
        ASSERT_NEAR(kcf.response().values((r + n / 2) % n, (c + n / 2) % n), dense.response(y, r, c),
                    2e-4 * scale)
            << "shift " << r << ", " << c;
  };
  dense.train(features(frame, centre), 1);
  compare(frame);
  compare(later);
  const Point2 other(62, 49);
  kcf.adapt(later, other);
  dense.train(features(later, other), options.learning_rate);
  compare(frame);
  compare(later);
}

INSTANTIATE_TEST_SUITE_P(All, KcfKernels,
                         ::testing::Values(KcfCase{Kernel::Type::Gaussian, {}},
                                           KcfCase{Kernel::Type::Polynomial, {}},
                                           KcfCase{Kernel::Type::Linear, {}},
                                           KcfCase{Kernel::Type::Gaussian, {true, false, false}},
                                           KcfCase{Kernel::Type::Gaussian, {false, true, false}},
                                           KcfCase{Kernel::Type::Gaussian, {false, false, true}},
                                           KcfCase{Kernel::Type::Linear, {true, true, true}}));

TEST(Kcf, ColorTellsApartWhatGrayCannot) {
  // Two patches of the same gray level, the target's red and another one green; in gray video they are alike.
  cv::Mat image(120, 200, CV_8UC3, cv::Scalar::all(98));
  image(cv::Rect(40, 40, 40, 40)) = cv::Scalar(60, 60, 186);
  image(cv::Rect(120, 40, 40, 40)) = cv::Scalar(60, 135, 41);
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  KcfOptions options;
  options.features = {false, true, true};
  Kcf kcf(options);
  const Point2 centre(59.5, 59.5), other(139.5, 59.5);
  kcf.init(Frame(image), centre, {40, 40});
  EXPECT_GT(kcf.localize(Frame(image), centre).peak, 0.8);
  EXPECT_LT(kcf.localize(Frame(image), other).peak, 0.5);
  kcf.localize(Frame(gray), centre);
  EXPECT_TRUE(kcf.response().values.allFinite());
}

TEST(Kcf, FulfilsThePartAxioms) {
  testing::check_part_axioms(Kcf());
  KcfOptions options;
  options.features.color = true;
  testing::check_part_axioms(Kcf(options));
}

TEST(Kcf, ReturnsItsLabelOnTheSampleItWasTrainedOn) {
  const cv::Mat image = texture(240, 320);
  const Frame frame(image);
  KcfOptions options;
  Kcf kcf(options);
  kcf.init(frame, {160, 120}, {60, 60});
  kcf.localize(frame, {160, 120});
  const auto& values = kcf.response().values;
  const double sigma = options.label_sigma * 60 / options.cell_size;
  for (Eigen::Index r = 0; r < values.rows(); ++r)
    for (Eigen::Index c = 0; c < values.cols(); ++c) {
      const double dr = static_cast<double>(r - values.rows() / 2),
                   dc = static_cast<double>(c - values.cols() / 2);
      EXPECT_NEAR(values(r, c), std::exp(-0.5 * (dr * dr + dc * dc) / (sigma * sigma)), 0.02);
    }
}

TEST(Kcf, FindsAShiftedTextureBelowTheCellGrid) {
  const cv::Mat image = texture(240, 320);
  const Frame frame(image);
  Kcf kcf;
  kcf.init(frame, {160, 120}, {60, 60});
  for (const auto& [dx, dy] : {std::pair{1, 0}, {2, 1}, {-3, 2}, {5, -7}, {13, 11}}) {
    const cv::Mat moved_image = shifted(image, dx, dy);
    const Evidence evidence = kcf.localize(Frame(moved_image), {160, 120});
    EXPECT_NEAR(evidence.position.x(), 160 + dx, 0.6) << dx << ", " << dy;
    EXPECT_NEAR(evidence.position.y(), 120 + dy, 0.6) << dx << ", " << dy;
  }
}

TEST(Kcf, SeparateUpdateOfTheSameSampleChangesNothingAndFullRateForgets) {
  const cv::Mat image = texture(240, 320), other_image = texture(240, 320, 7);
  const Frame frame(image), other(other_image);
  const Point2 centre(160, 120);
  KcfOptions options;
  Kcf kcf(options), fresh(options);
  kcf.init(frame, centre, {50, 40});
  kcf.localize(frame, centre);
  const auto before = kcf.response().values;
  kcf.adapt(frame, centre);
  kcf.localize(frame, centre);
  EXPECT_LT((kcf.response().values - before).abs().maxCoeff(), 1e-3);

  options.learning_rate = 1;
  Kcf forgetful(options);
  forgetful.init(frame, centre, {50, 40});
  forgetful.adapt(other, centre);
  fresh.init(other, centre, {50, 40});
  forgetful.localize(other, centre);
  fresh.localize(other, centre);
  EXPECT_LT((forgetful.response().values - fresh.response().values).abs().maxCoeff(), 1e-3);
}

// Targets of any size give a template in the documented range; nothing fails.
TEST(Kcf, SmallLargeAndThinTargets) {
  const cv::Mat image = texture(480, 640);
  const Frame frame(image);
  const KcfOptions options;
  for (const Size2& size : {Size2(1, 1), Size2(3, 3), Size2(12, 9), Size2(300, 250), Size2(640, 480),
                            Size2(500, 10), Size2(2, 400), Size2(640, 1)}) {
    Kcf kcf(options);
    kcf.init(frame, {320, 240}, size);
    const Evidence evidence = kcf.localize(frame, {320, 240});
    EXPECT_LT((evidence.position - Point2(320, 240)).norm(), 0.1 * size.norm() + 0.5) << size.transpose();
    // All of the target is visible, with about the requested margin around it.
    const double margin = options.window.padding * std::sqrt(size.prod());
    EXPECT_GE(kcf.window().x(), size.x() + 0.6 * margin) << size.transpose();
    EXPECT_GE(kcf.window().y(), size.y() + 0.6 * margin) << size.transpose();
    kcf.adapt(frame, evidence.position);
  }
}

TEST(Kcf, ResizedWindowSeesTheEnlargedTarget) {
  const cv::Mat image = texture(240, 320);
  cv::Mat large;
  cv::resize(image, large, {}, 1.25, 1.25, cv::INTER_LINEAR);
  const Frame frame(image), enlarged(large);
  Kcf kcf;
  kcf.init(frame, {160, 120}, {60, 50});
  // cv::resize maps pixel centre x to 1.25 (x + 1/2) - 1/2.
  const Point2 there(1.25 * 160.5 - 0.5, 1.25 * 120.5 - 0.5);
  const double unscaled = kcf.localize(enlarged, there).peak;
  kcf.resize({75, 62.5});
  const Evidence evidence = kcf.localize(enlarged, there);
  EXPECT_GT(evidence.peak, 0.9);
  EXPECT_GT(evidence.peak, unscaled + 0.1);
  EXPECT_LT((evidence.position - there).norm(), 0.3);
}

TEST(Kcf, RefusesBadOptions) {
  const auto refused = [](auto change) {
    KcfOptions options;
    change(options);
    EXPECT_THROW(Kcf{options}, std::invalid_argument);
  };
  refused([](KcfOptions& o) { o.features = {false, false, false}; });
  refused([](KcfOptions& o) { o.window.padding = 1e308; });
  refused([](KcfOptions& o) { o.kernel = {.type = Kernel::Type::Polynomial, .exponent = 2.5}; });
  refused([](KcfOptions& o) { o.kernel = {.type = Kernel::Type::Polynomial, .offset = 1e50}; });
  refused([](KcfOptions& o) { o.kernel = {.type = Kernel::Type::Polynomial, .offset = std::nan("")}; });
  refused([](KcfOptions& o) { o.lambda = 0; });
  refused([](KcfOptions& o) { o.learning_rate = 1.5; });
  refused([](KcfOptions& o) { o.label_sigma = 0; });
  refused([](KcfOptions& o) { o.window.padding = -1; });
  refused([](KcfOptions& o) { o.kernel.sigma = 0; });
  refused([](KcfOptions& o) { o.cell_size = 0; });
  refused([](KcfOptions& o) { o.window.max_template_side = 10; });
}

}  // namespace
}  // namespace asterism
