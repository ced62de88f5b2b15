// MotionModel on scenes with known motion of camera and object.
#include <gtest/gtest.h>

#include <asterism/trackers/constellation/motion.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <thread>

namespace asterism {
namespace {

// Noise with a grain of about three pixels, determined by the seed.
cv::Mat texture(cv::Size size, std::uint64_t seed) {
  cv::Mat noise(size, CV_8U);
  cv::RNG(seed).fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(noise, noise, {7, 7}, 1.5);
  cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
  return noise;
}

// A camera that rotates, zooms and pans over a wall, and a poster that moves in front of it.
class Scene {
 public:
  cv::Mat image(int frame, const Point2& object) const {
    const double angle = turn * frame, scale = std::pow(zoom, frame);
    const cv::Matx23d map(scale * std::cos(angle), -scale * std::sin(angle), 60 - pan.x() * frame,  //
                          scale * std::sin(angle), scale * std::cos(angle), 60 - pan.y() * frame);
    cv::Mat result;
    cv::warpAffine(wall_, result, map, {320, 240}, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                   cv::BORDER_REFLECT);
    if (!moves) return result;
    cv::Mat poster;
    cv::getRectSubPix(poster_, {48, 36}, {40, 30}, poster);
    const cv::Matx23d place(1, 0, object.x() - 23.5, 0, 1, object.y() - 17.5);
    cv::warpAffine(poster, result, place, result.size(), cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
    return result;
  }
  static cv::Rect2d box(const Point2& object) { return box_around(object, {48, 36}); }

  Point2 pan = Point2::Zero();
  double turn = 0, zoom = 1;
  bool moves = true;

 private:
  cv::Mat wall_ = texture({560, 480}, 1), poster_ = texture({80, 60}, 2);
};

struct Means {
  double object = 0, around = 0;
};
// Mean posterior of the cells inside a box and of the others in the image.
Means means(const Segmentation& segmentation, const cv::Rect2d& box, const cv::Size& image) {
  Means sums, counts;
  for (int row = 0; row < segmentation.posterior.rows; ++row)
    for (int col = 0; col < segmentation.posterior.cols; ++col) {
      const Point2 x = segmentation.origin + segmentation.spacing.cwiseProduct(Point2(col, row));
      if (x.x() < 0 || x.y() < 0 || x.x() > image.width - 1 || x.y() > image.height - 1) continue;
      const bool in =
          x.x() >= box.x && x.y() >= box.y && x.x() < box.x + box.width && x.y() < box.y + box.height;
      (in ? sums.object : sums.around) += static_cast<double>(segmentation.posterior.at<float>(row, col));
      (in ? counts.object : counts.around) += 1;
    }
  return {sums.object / counts.object, sums.around / counts.around};
}

// Runs the model along the true boxes; returns the last frame's means.
Means follow(const Scene& scene, const Point2& first, const Point2& velocity, int frames) {
  MotionModel model;
  model.init(Frame(scene.image(0, first)), Scene::box(first));
  Means result;
  for (int i = 1; i <= frames; ++i) {
    const Point2 object = first + i * velocity;
    const cv::Mat image = scene.image(i, object);
    const Segmentation segmentation = model.segment(Frame(image));
    EXPECT_EQ(segmentation.posterior.empty(), i == 1) << "nothing was learned before the second frame";
    if (i > 1) result = means(segmentation, Scene::box(object), image.size());
    model.adapt(Frame(image), Scene::box(object));
  }
  return result;
}

class Motion : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!MotionModel::available()) GTEST_SKIP() << "built without OpenCV's video";
  }
};

TEST_F(Motion, OfTheObjectIsSeenWhateverTheCameraDoes) {
  for (const Point2& pan : {Point2(0, 0), Point2(3, -1)})
    for (const double turn : {0.0, 0.01})
      for (const double zoom : {1.0, 0.99}) {
        Scene scene;
        scene.pan = pan, scene.turn = turn, scene.zoom = zoom;
        const Means seen = follow(scene, {130, 110}, {-2, 1}, 6);
        EXPECT_GT(seen.object, 0.8) << pan.transpose() << ", " << turn << ", " << zoom;
        EXPECT_LT(seen.around, 0.35) << pan.transpose() << ", " << turn << ", " << zoom;
      }
}

// The camera follows the object: in the image only the background moves.
TEST_F(Motion, OfAnObjectThatStandsStillInTheImage) {
  Scene scene;
  scene.pan = {3, 2};
  const Means seen = follow(scene, {150, 120}, {0, 0}, 6);
  EXPECT_GT(seen.object, 0.8);
  EXPECT_LT(seen.around, 0.35);
}

TEST_F(Motion, OfNothingSaysNothing) {
  for (const bool turns : {false, true}) {
    Scene scene;
    scene.moves = false;
    scene.pan = {2, 1};
    if (turns) scene.turn = 0.01, scene.zoom = 1.01;
    // The box follows the wall.
    const Means seen = follow(scene, {150, 120}, {-2, -1}, 8);
    EXPECT_NEAR(seen.object, seen.around, 0.1);
  }
}

TEST_F(Motion, ThatBeginsIsTheObjects) {
  const Scene scene;
  MotionModel model;
  const Point2 first(150, 120), moved(153, 121);
  for (int i = 0; i < 20; ++i) {
    const Frame frame(scene.image(i, first));
    if (i == 0) model.init(frame, Scene::box(first));
    if (i > 0) model.segment(frame), model.adapt(frame, Scene::box(first));
  }
  const cv::Mat image = scene.image(20, moved);
  const Means seen = means(model.segment(Frame(image)), Scene::box(moved), image.size());
  EXPECT_GT(seen.object, 0.8);
  EXPECT_LT(seen.around, 0.6);
}

TEST_F(Motion, OutsideTheImageIsNone) {
  Scene scene;
  MotionModel model;
  for (int i = 0; i < 5; ++i) {
    const Point2 object(4 + 2 * i, 3);
    const cv::Mat image = scene.image(i, object);
    const Frame frame(image);
    if (i == 0) {
      model.init(frame, Scene::box(object));
      continue;
    }
    const Segmentation seen = model.segment(frame);
    for (int row = 0; row < seen.posterior.rows; ++row)
      for (int col = 0; col < seen.posterior.cols; ++col) {
        const Point2 x = seen.origin + seen.spacing.cwiseProduct(Point2(col, row));
        const bool inside = x.x() >= -0.5 && x.y() >= -0.5 && x.x() < 319.5 && x.y() < 239.5;
        const float posterior = seen.posterior.at<float>(row, col);
        ASSERT_TRUE(inside ? posterior > 0 && posterior < 1 : posterior == 0)
            << x.transpose() << ": " << posterior;
      }
    model.adapt(frame, Scene::box(object));
  }
}

TEST_F(Motion, OfImagesWithoutAnyStructure) {
  MotionModel model;
  const cv::Mat image(240, 320, CV_8U, cv::Scalar(90));
  for (const cv::Rect2d& box : {cv::Rect2d(100, 100, 1, 1), cv::Rect2d(0, 0, 320, 240),
                                cv::Rect2d(10, 20, 2, 200), cv::Rect2d(-5000, -5000, 30, 30)}) {
    model.init(Frame(image), box);
    for (int i = 0; i < 3; ++i) {
      const Segmentation seen = model.segment(Frame(image));
      EXPECT_TRUE(seen.posterior.empty() || cv::checkRange(seen.posterior, true, nullptr, 0, 1.0001));
      model.adapt(Frame(image), box);
    }
    for (const auto& histogram : {model.foreground(), model.background()})
      for (const double share : histogram) EXPECT_TRUE(share >= 0 && share <= 1 + 1e-12);
  }
}

TEST_F(Motion, CopiesShareNothing) {
  const Scene scene;
  MotionModel model;
  const Point2 object(150, 120);
  model.init(Frame(scene.image(0, object)), Scene::box(object));
  for (int i = 1; i < 4; ++i) {
    const cv::Mat image = scene.image(i, object + Point2(2 * i, 0));
    model.segment(Frame(image));
    model.adapt(Frame(image), Scene::box(object + Point2(2 * i, 0)));
  }
  MotionModel copy = model;
  const cv::Mat next = scene.image(4, object + Point2(8, 0)), other = scene.image(4, object - Point2(20, 9));
  copy.segment(Frame(other));
  copy.adapt(Frame(other), Scene::box(object));
  MotionModel second = model;
  const Segmentation a = model.segment(Frame(next)), b = second.segment(Frame(next));
  EXPECT_EQ(cv::norm(a.posterior, b.posterior, cv::NORM_INF), 0);
}

// Each thread has one flow solver, which adapts itself to small images.
TEST_F(Motion, DoesNotDependOnWhatTheThreadDidBefore) {
  const Scene scene;
  const auto last = [&](const cv::Size2d& before) {
    cv::Mat result;
    std::thread([&] {
      const Point2 object(150, 120);
      for (const cv::Size2d& size : {before, cv::Size2d(48, 36)}) {
        MotionOptions options;
        options.window.padding = size.width < 10 ? 1.0 : 3.0;
        options.window.min_template_side = 8;
        MotionModel model(options);
        for (int i = 0; i < 4; ++i) {
          const cv::Mat image = scene.image(i, object + Point2(2 * i, 0));
          const cv::Rect2d box = box_around(object + Point2(2 * i, 0), {size.width, size.height});
          if (i == 0) {
            model.init(Frame(image), box);
            continue;
          }
          result = model.segment(Frame(image)).posterior;
          model.adapt(Frame(image), box);
        }
      }
    }).join();
    return result;
  };
  const cv::Mat expected = last({48, 36});
  for (const cv::Size2d& before : {cv::Size2d(8, 8), cv::Size2d(3, 200), cv::Size2d(200, 100)})
    EXPECT_EQ(cv::norm(last(before), expected, cv::NORM_INF), 0) << before;
}

TEST(MotionOptionsTest, OutOfRangeAreRefused) {
  const auto refused = [](auto change) {
    MotionOptions options;
    change(options);
    EXPECT_THROW(MotionModel{options}, std::invalid_argument);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double wrong : {-0.1, 1.1, nan}) {
    refused([&](MotionOptions& o) { o.histogram_rate = wrong; });
    refused([&](MotionOptions& o) { o.novelty = wrong; });
    refused([&](MotionOptions& o) { o.background_novelty = wrong; });
    refused([&](MotionOptions& o) { o.foreground_prior = wrong; });
  }
  refused([&](MotionOptions& o) { o.window.padding = 0.5; });
  refused([&](MotionOptions& o) { o.window.padding = nan; });
  refused([&](MotionOptions& o) { o.window.min_template_side = 4; });
  refused([&](MotionOptions& o) { o.window.max_template_side = 8; });
}

}  // namespace
}  // namespace asterism
