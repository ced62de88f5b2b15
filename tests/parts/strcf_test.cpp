#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <complex>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "../trackers/moving_square.hpp"
#include "cell_features.hpp"

namespace asterism {
namespace {

using testing::displaced;
using testing::shifted;
using testing::texture;

StrcfOptions without_color() {
  StrcfOptions options;
  options.features.color = false;
  return options;
}

TEST(Strcf, FulfilsThePartAxioms) {
  testing::check_part_axioms(Strcf());
  testing::check_part_axioms(Strcf(without_color()));
}
TEST(Strcf, WithstandsFaults) {
  testing::check_part_faults(Strcf());
  testing::check_part_faults(Strcf(without_color()));
}

// The problem of one frame in double precision; one column of cells per channel.
struct Problem {
  int rows, cols;
  double sigma;  // of the label [cells]
  double target_weight, background_weight;
  int target_rows, target_cols;

  int cells() const { return rows * cols; }
  Eigen::VectorXd label() const {
    Eigen::VectorXd y(cells());
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const double dr = std::min(r, rows - r), dc = std::min(c, cols - c);
        y(r * cols + c) = std::exp(-0.5 * (dr * dr + dc * dc) / (sigma * sigma));
      }
    return y;
  }
  Eigen::VectorXd weights() const {
    Eigen::VectorXd w(cells());
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const bool on_target = std::abs(r - (rows - 1) / 2.0) < target_rows / 2.0 &&
                               std::abs(c - (cols - 1) / 2.0) < target_cols / 2.0;
        w(r * cols + c) = on_target ? target_weight : background_weight;
      }
    return w;
  }

  // Row s: the sample at circular shift s, so that shifts() f is the response.
  Eigen::MatrixXd shifts(const Eigen::VectorXd& x) const {
    Eigen::MatrixXd a(cells(), cells());
    for (int s = 0; s < cells(); ++s)
      for (int n = 0; n < cells(); ++n)
        a(s, n) = x((n / cols + s / cols) % rows * cols + (n % cols + s % cols) % cols);
    return a;
  }

  // The minimum of 1/(2T) |A f - y|^2 + 1/2 |w f|^2 + mu/2 |f - previous|^2 by a dense solve of its normal
  // equations, the channels stacked.
  Eigen::MatrixXd minimum(const Eigen::MatrixXd& x, double temporal, const Eigen::MatrixXd& previous) const {
    const Eigen::Index channels = x.cols(), n = cells();
    Eigen::MatrixXd a(n, n * channels);
    Eigen::VectorXd diagonal(n * channels);
    for (Eigen::Index k = 0; k < channels; ++k) {
      a.middleCols(k * n, n) = shifts(x.col(k));
      diagonal.segment(k * n, n) = weights().array().square() + temporal;
    }
    Eigen::MatrixXd normal = a.transpose() * a / static_cast<double>(n);
    normal.diagonal() += diagonal;
    const Eigen::VectorXd right =
        a.transpose() * label() / static_cast<double>(n) + temporal * previous.reshaped();
    return normal.ldlt().solve(right).reshaped(n, channels);
  }

  using Spectrum = std::vector<std::complex<double>>;
  Spectrum transform(const Eigen::VectorXd& map) const {
    Eigen::VectorXd copy = map;
    cv::Mat bins;
    cv::dft(cv::Mat(rows, cols, CV_64F, copy.data()), bins, cv::DFT_COMPLEX_OUTPUT);
    const auto* const first = bins.ptr<std::complex<double>>();
    return Spectrum(first, first + cells());
  }
  Eigen::VectorXd inverse(Spectrum spectrum) const {
    cv::Mat map;
    cv::dft(cv::Mat(rows, cols, CV_64FC2, spectrum.data()), map,
            cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
    return Eigen::Map<const Eigen::VectorXd>(map.ptr<double>(), cells());
  }

  // The rounds of the header's equations, with a system of all channels solved in each bin.
  Eigen::MatrixXd rounds(const Eigen::MatrixXd& x, double temporal, const Eigen::MatrixXd& previous,
                         const StrcfOptions& options) const {
    const Eigen::Index channels = x.cols();
    const Spectrum y = transform(label());
    std::vector<Spectrum> spectra;
    for (Eigen::Index k = 0; k < channels; ++k) spectra.push_back(transform(x.col(k)));
    Eigen::MatrixXd f, g = Eigen::MatrixXd::Zero(cells(), channels), h = g;
    double penalty = options.penalty;
    for (int i = 0; i < options.admm_iterations; ++i) {
      const Eigen::MatrixXd near = penalty * g - h + temporal * previous;
      std::vector<Spectrum> of_near;
      for (Eigen::Index k = 0; k < channels; ++k) of_near.push_back(transform(near.col(k)));
      std::vector<Spectrum> filters(spectra.size(), Spectrum(y.size()));
      for (std::size_t bin = 0; bin < y.size(); ++bin) {
        Eigen::VectorXcd z(channels), b(channels);
        for (Eigen::Index k = 0; k < channels; ++k) {
          z(k) = spectra[static_cast<std::size_t>(k)][bin];
          b(k) = of_near[static_cast<std::size_t>(k)][bin];
        }
        const double t = cells();
        const Eigen::MatrixXcd normal =
            z * z.adjoint() + t * (penalty + temporal) * Eigen::MatrixXcd::Identity(channels, channels);
        const Eigen::VectorXcd solution = normal.llt().solve(z * std::conj(y[bin]) + t * b);
        for (Eigen::Index k = 0; k < channels; ++k) filters[static_cast<std::size_t>(k)][bin] = solution(k);
      }
      f.resize(cells(), channels);
      for (Eigen::Index k = 0; k < channels; ++k) f.col(k) = inverse(filters[static_cast<std::size_t>(k)]);
      g = (1 / (weights().array().square() + penalty)).matrix().asDiagonal() * (penalty * f + h);
      h += penalty * (f - g);
      penalty = std::min(penalty * options.penalty_growth, options.max_penalty);
    }
    return f;
  }
};

// A part, its filter, and the same in plain code.
struct Twin {
  Strcf part;
  Problem problem;
  Frame first{texture(100, 120)}, second{shifted(texture(100, 120), 3, 2)};
  Point2 centre{60, 50};

  Twin(const StrcfOptions& options, const Size2& size, int rows, int cols, int target_rows, int target_cols)
      : part(options) {
    part.init(first, centre, size);
    const double spacing = part.window().x() / cols;  // image pixels per cell
    problem = {rows,
               cols,
               options.label_sigma * std::sqrt(size.prod()) / spacing,
               options.target_weight,
               options.background_weight,
               target_rows,
               target_cols};
  }
  Eigen::MatrixXd features(const Frame& frame, const Point2& at) const {
    return testing::cell_features(frame, at, part.window(), problem.rows, problem.cols,
                                  part.options().cell_size, part.options().features);
  }
  // Learns both frames by `solve`(features, temporal weight, previous filter) and compares after each.
  using Solve = std::function<Eigen::MatrixXd(const Eigen::MatrixXd&, double, const Eigen::MatrixXd&)>;
  void compare(const Solve& solve, double tolerance) {
    const Eigen::MatrixXd x = features(first, centre);
    Eigen::MatrixXd f = solve(x, 0, Eigen::MatrixXd::Zero(x.rows(), x.cols()));
    expect_same(f, tolerance);
    const double fit = x.cwiseProduct(f).sum();
    EXPECT_NEAR(part.fit(), fit, 5 * tolerance * std::abs(fit));
    for (const Point2& at : {Point2(62, 49), Point2(61, 52)}) {
      part.adapt(second, at);
      f = solve(features(second, at), part.options().temporal_weight, f);
      expect_same(f, tolerance);
    }
    // The response must be the correlation with the filter.
    part.localize(second, centre);
    const Eigen::MatrixXd y = features(second, centre);
    Eigen::VectorXd response = Eigen::VectorXd::Zero(problem.cells());
    for (Eigen::Index k = 0; k < y.cols(); ++k) response += problem.shifts(y.col(k)) * f.col(k);
    response /= part.fit();
    const double scale = response.cwiseAbs().maxCoeff();
    ASSERT_GT(scale, 0);
    for (int r = 0; r < problem.rows; ++r)
      for (int c = 0; c < problem.cols; ++c)
        ASSERT_NEAR(part.response().values((r + problem.rows / 2) % problem.rows,
                                           (c + problem.cols / 2) % problem.cols),
                    response(r * problem.cols + c), 5 * tolerance * scale)
            << "shift " << r << ", " << c;
  }
  void expect_same(const Eigen::MatrixXd& f, double tolerance) const {
    ASSERT_EQ(part.channels(), f.cols());
    const double scale = f.cwiseAbs().maxCoeff();
    ASSERT_GT(scale, 0);
    for (int k = 0; k < part.channels(); ++k) {
      const auto filter = part.filter(k);
      ASSERT_EQ(filter.rows(), problem.rows);
      ASSERT_EQ(filter.cols(), problem.cols);
      for (Eigen::Index n = 0; n < filter.size(); ++n)
        ASSERT_NEAR(filter.data()[n], f(n, k), tolerance * scale) << "channel " << k << ", cell " << n;
    }
  }
};

StrcfOptions small(const CellFeatures& features) {
  StrcfOptions options;
  options.features = features;
  options.window = {.padding = 1, .min_template_side = 16, .max_template_side = 16};
  options.label_sigma = 0.2;
  return options;
}

// The alternating method converges to the minimum stated in the header.
TEST(Strcf, ManyRoundsSolveTheStatedProblem) {
  StrcfOptions options = small({.hog = false, .gray = false, .color = true});
  options.admm_iterations = 100;
  options.penalty = options.max_penalty = 0.3;
  options.penalty_growth = 1;
  options.target_weight = 0.3;
  options.background_weight = 1.5;
  options.temporal_weight = 0.5;
  Twin twin(options, {16, 16}, 8, 8, 4, 4);
  twin.compare(
      [&](const auto& x, double mu, const auto& previous) { return twin.problem.minimum(x, mu, previous); },
      1e-4);
}

// The published rounds, on grids of different shapes and with all features.
TEST(Strcf, FewRoundsAreThoseOfDoublePrecision) {
  for (const int rounds : {1, 2, 4}) {
    StrcfOptions options = small({.hog = true, .gray = true, .color = true});
    options.admm_iterations = rounds;
    Twin square(options, {16, 16}, 8, 8, 4, 4);
    square.compare([&](const auto& x, double mu,
                       const auto& previous) { return square.problem.rounds(x, mu, previous, options); },
                   1e-4);
    Twin wide(options, {40, 10}, 4, 12, 2, 8);
    wide.compare([&](const auto& x, double mu,
                     const auto& previous) { return wide.problem.rounds(x, mu, previous, options); },
                 1e-4);
  }
}

TEST(Strcf, FindsAShiftedTextureBelowTheCellGrid) {
  const cv::Mat image = texture(240, 320);
  for (const Size2& size : {Size2(60, 60), Size2(48, 40), Size2(32, 32)}) {
    Strcf part;
    part.init(Frame(image), {160, 120}, size);
    for (const auto& [dx, dy] : {std::pair{1.0, 0.0}, {-3, 2}, {5, -7}, {0.5, 0.25}, {-4.3, 2.6}, {13, 11}}) {
      const cv::Mat moved = displaced(image, dx, dy);
      const Frame frame(moved);
      const Point2 truth(160 + dx, 120 + dy);
      const Evidence first = part.localize(frame, {160, 120});
      EXPECT_LT((first.position - truth).norm(), 0.6) << size.transpose() << ": " << dx << ", " << dy;
      const Evidence second = part.localize(frame, first.position);
      EXPECT_LT((second.position - truth).norm(), 0.3) << size.transpose() << ": " << dx << ", " << dy;
      EXPECT_GT(second.peak, 0.8);
    }
  }
}

TEST(Strcf, TheTargetAsLearnedHasResponseOne) {
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  const Frame frame(image), foreign(other);
  Strcf part;
  part.init(frame, {160, 120}, {48, 40});
  EXPECT_NEAR(part.localize(frame, {160, 120}).peak, 1, 1e-3);
  // This stays so although the filter fits better with every frame.
  const double before = part.fit();
  for (int t = 0; t < 30; ++t) {
    part.adapt(frame, {160, 120});
    EXPECT_NEAR(part.localize(frame, {160, 120}).peak, 1, 1e-2) << t;
  }
  EXPECT_GT(part.fit(), 1.2 * before);
  // Another texture is not taken for it, even after many frames.
  for (int t = 0; t < 5; ++t) {
    EXPECT_LT(part.localize(foreign, {160, 120}).peak, 0.3) << t;
    part.adapt(foreign, {160, 120});
  }
  const Evidence back = part.localize(frame, {160, 120});
  EXPECT_GT(back.peak, 0.8);
  EXPECT_LT((back.position - Point2(160, 120)).norm(), 0.3);
}

// The scene that the trackers' tests use.
TEST(Strcf, FollowsAMovingSquare) {
  const auto centre = [](int t) {
    const cv::Rect2d box = true_box(t);
    return Point2(box.x + (box.width - 1) / 2, box.y + (box.height - 1) / 2);
  };
  for (const bool color : {true, false}) {
    StrcfOptions options;
    options.features.color = color;
    Strcf part(options);
    part.init(Frame(draw_frame(0)), centre(0), {48, 40});
    Point2 at = centre(0);
    for (int t = 1; t <= 50; ++t) {
      const Frame frame(draw_frame(t));
      const Evidence evidence = part.localize(frame, at);
      at = evidence.position;
      ASSERT_LT((at - centre(t)).norm(), 1.5) << t;
      EXPECT_GT(evidence.peak, 0.5) << t;
      part.adapt(frame, at);
    }
  }
}

// The purpose of the weights: the filter is almost zero outside the target.
TEST(Strcf, TheFilterIsOnTheTarget) {
  const Frame frame(texture(240, 320));
  const auto outside = [&](double background_weight) {
    StrcfOptions options;
    options.background_weight = background_weight;
    options.penalty = options.max_penalty = 1;
    options.penalty_growth = 1;
    options.admm_iterations = 30;
    Strcf part(options);
    part.init(frame, {160, 120}, {40, 40});
    float inside = 0, rest = 0;
    for (int k = 0; k < part.channels(); ++k) {
      const auto filter = part.filter(k);
      const float energy = filter.square().sum();
      inside += filter.block(filter.rows() / 2 - 5, filter.cols() / 2 - 5, 10, 10).square().sum();
      rest += energy;
    }
    return 1 - inside / rest;
  };
  EXPECT_LT(outside(1e5), 0.02);
  EXPECT_GT(outside(1e-3), 0.3);
}

// The temporal weight decides between two appearances.
TEST(Strcf, TheTemporalWeightKeepsWhatWasLearned) {
  const Frame frame(texture(240, 320)), other(texture(240, 320, 7));
  const auto change = [&](double weight) {
    StrcfOptions options;
    options.temporal_weight = weight;
    Strcf part(options);
    part.init(frame, {160, 120}, {48, 40});
    const auto before = part.filter(0);
    part.adapt(other, {160, 120});
    return (part.filter(0) - before).matrix().norm() / before.matrix().norm();
  };
  EXPECT_LT(change(1e6), 1e-3);
  EXPECT_LT(change(100), 0.5 * change(15));
  EXPECT_LT(change(15), 0.5 * change(1));
}

TEST(Strcf, ColorTellsApartWhatGrayCannot) {
  // Two patches of the same gray level, the target's red and another one green; in gray video they are alike.
  cv::Mat image(160, 300, CV_8UC3, cv::Scalar::all(98));
  image(cv::Rect(60, 60, 40, 40)) = cv::Scalar(60, 60, 186);
  image(cv::Rect(200, 60, 40, 40)) = cv::Scalar(60, 135, 41);
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  StrcfOptions options;
  options.features.hog = false;
  Strcf part(options);
  const Point2 centre(79.5, 79.5), other(219.5, 79.5);
  part.init(Frame(image), centre, {40, 40});
  EXPECT_GT(part.localize(Frame(image), centre).peak, 0.8);
  part.localize(Frame(image), other);
  EXPECT_LT(part.similarity_at(other), 0.5);
  part.localize(Frame(gray), centre);
  EXPECT_TRUE(part.response().values.allFinite());
}

TEST(Strcf, AFlatWindowHasNoResponseAndTeachesNothing) {
  const Frame frame(texture(240, 320)), flat(cv::Mat(240, 320, CV_8UC3, cv::Scalar(30, 90, 77))),
      gray(cv::Mat(240, 320, CV_8UC1, cv::Scalar(12)));
  const Point2 centre(160, 120);
  for (const StrcfOptions& options : {StrcfOptions(), without_color()}) {
    Strcf part(options);
    part.init(frame, centre, {48, 40});
    const std::vector<std::byte> state = save_state(part);
    for (const Frame* const nothing : {&flat, &gray}) {
      const Evidence evidence = part.localize(*nothing, {150, 110});
      EXPECT_EQ(evidence.peak, 0);
      EXPECT_LT((evidence.position - Point2(150, 110)).norm(), 1e-9);
      EXPECT_GT(evidence.covariance.trace(), 500);
      EXPECT_EQ(part.similarity_at({150, 110}), 0);
      part.adapt(*nothing, centre);
      EXPECT_EQ(save_state(part), state);
      // Initialised on a flat image, it finds nothing until it learns a texture.
      Strcf blank(options);
      blank.init(*nothing, centre, {48, 40});
      EXPECT_EQ(blank.localize(frame, centre).peak, 0);
      blank.adapt(frame, centre);
      EXPECT_GT(blank.localize(frame, centre).peak, 0.5);
    }
  }
}

TEST(Strcf, ForgetsItsResponseAndFilterWhereItStartsAgain) {
  const Frame frame(texture(240, 320)), other(texture(240, 320, 7));
  Strcf part, fresh;
  part.init(other, {150, 100}, {30, 60});
  part.adapt(other, {151, 100});
  part.localize(other, {150, 100});
  part.init(frame, {160, 120}, {48, 40});
  EXPECT_EQ(part.similarity_at({160, 120}), 0);
  fresh.init(frame, {160, 120}, {48, 40});
  EXPECT_EQ(save_state(part), save_state(fresh));
}

// Targets of any size give a template in the documented range; nothing fails.
TEST(Strcf, SmallLargeAndThinTargets) {
  const cv::Mat image = texture(480, 640);
  const Frame frame(image);
  for (const Size2& size : {Size2(1, 1), Size2(3, 3), Size2(12, 9), Size2(300, 250), Size2(640, 480),
                            Size2(500, 10), Size2(2, 400), Size2(640, 1)}) {
    Strcf part;
    part.init(frame, {320, 240}, size);
    const Evidence evidence = part.localize(frame, {320, 240});
    EXPECT_LT((evidence.position - Point2(320, 240)).norm(), 0.1 * size.norm() + 0.5) << size.transpose();
    part.adapt(frame, evidence.position);
  }
}

TEST(Strcf, ResizedWindowSeesTheEnlargedTarget) {
  const cv::Mat image = texture(240, 320);
  cv::Mat large;
  cv::resize(image, large, {}, 1.25, 1.25, cv::INTER_LINEAR);
  Strcf part;
  part.init(Frame(image), {160, 120}, {60, 50});
  // cv::resize maps pixel centre x to 1.25 (x + 1/2) - 1/2.
  const Point2 there(1.25 * 160.5 - 0.5, 1.25 * 120.5 - 0.5);
  const double unscaled = part.localize(Frame(large), there).peak;
  part.resize({75, 62.5});
  EXPECT_EQ(part.size(), Size2(75, 62.5));
  const Evidence evidence = part.localize(Frame(large), there);
  EXPECT_GT(evidence.peak, 0.8);
  EXPECT_GT(evidence.peak, unscaled + 0.1);
  EXPECT_LT((evidence.position - there).norm(), 0.5);
  EXPECT_THROW(part.resize({0, 10}), std::invalid_argument);
}

TEST(Strcf, RefusesBadOptions) {
  const auto refused = [](auto change) {
    StrcfOptions options;
    change(options);
    EXPECT_THROW(Strcf{options}, std::invalid_argument);
  };
  refused([](StrcfOptions& o) { o.features = {false, false, false}; });
  refused([](StrcfOptions& o) { o.temporal_weight = -1; });
  refused([](StrcfOptions& o) { o.temporal_weight = std::nan(""); });
  refused([](StrcfOptions& o) { o.target_weight = -1; });
  refused([](StrcfOptions& o) { o.background_weight = 1e7; });
  refused([](StrcfOptions& o) { o.admm_iterations = 0; });
  refused([](StrcfOptions& o) { o.admm_iterations = 101; });
  refused([](StrcfOptions& o) { o.penalty = 0; });
  refused([](StrcfOptions& o) { o.penalty_growth = 0.5; });
  refused([](StrcfOptions& o) { o.max_penalty = HUGE_VAL; });
  refused([](StrcfOptions& o) { o.label_sigma = 0; });
  refused([](StrcfOptions& o) { o.cell_size = 0; });
  refused([](StrcfOptions& o) { o.window.padding = -1; });
  refused([](StrcfOptions& o) { o.window.max_template_side = 10; });
  EXPECT_THROW(Strcf().filter(0), std::invalid_argument);
}

}  // namespace
}  // namespace asterism
