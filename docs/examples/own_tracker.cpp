#include <algorithm>
#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/trackers/constellation/stiffness.hpp>
#include <asterism/trackers/tracker/program.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string_view>
#include <vector>

// One part that covers the object.
class OnePart {
 public:
  void init(const cv::Mat& image, const cv::Rect2d& box) {
    const asterism::Frame frame(image);
    if (!(box.width >= 1 && box.height >= 1)) throw std::invalid_argument("OnePart: the box is too small");
    size_ = {box.width, box.height};
    x_ = asterism::centre_of(box);  // boxes have edges, parts have pixel centres
    part_.init(frame, x_, size_);
    started_ = true;
  }

  asterism::TrackResult update(const cv::Mat& image) {
    if (!started_) throw std::logic_error("OnePart: update before init");
    const asterism::Frame frame(image);
    const asterism::Evidence evidence = part_.localize(frame, x_);
    x_ = evidence.position;
    asterism::TrackResult result;
    result.box = asterism::box_around(x_, size_);
    result.confidence = std::min(evidence.peak, 1.0);
    result.lost = result.confidence < 0.2;
    if (!result.lost) part_.adapt(frame, x_);
    return result;
  }

 private:
  asterism::SpatialReliability part_;
  asterism::Size2 size_;
  asterism::Point2 x_;
  bool started_ = false;
};

// The same part as the root of a constellation, with four smaller parts that overlap.
class RootAndParts {
 public:
  void init(const cv::Mat& image, const cv::Rect2d& box) {
    const asterism::Frame frame(image);
    if (!(box.width >= 1 && box.height >= 1))
      throw std::invalid_argument("RootAndParts: the box is too small");
    size_ = {box.width, box.height};
    parts_.assign(kParts, asterism::AnyPart(asterism::Kcf()));
    parts_[0] = asterism::SpatialReliability();  // searches farther than the others
    x_.colwise() = asterism::centre_of(box);
    for (int i = 1; i < kParts; ++i) {  // one part of 3/4 of the box in each of its corners
      x_(0, i) += i % 2 == 0 ? box.width / 8 : -box.width / 8;
      x_(1, i) += i > 2 ? box.height / 8 : -box.height / 8;
    }
    for (int i = 0; i < kParts; ++i) part(i).init(frame, x_.col(i), i == 0 ? size_ : 0.75 * size_);
    springs_.set_rest_lengths(x_);
    springs_.link_stiffness.setConstant(0.1);  // [1/px^2]: lengths hold to about 3 px
  }

  asterism::TrackResult update(const cv::Mat& image) {
    if (parts_.empty()) throw std::logic_error("RootAndParts: update before init");
    const asterism::Frame frame(image);
    asterism::TrackResult result;
    for (int i = 0; i < kParts; ++i) {
      const asterism::Evidence evidence = part(i).localize(frame, x_.col(i));
      springs_.anchors.col(i) = evidence.position;
      springs_.anchor_stiffness[i] = asterism::static_stiffness(evidence);
      result.confidence += std::min(evidence.peak, 1.0) / kParts;
      if (i == 0)
        x_.colwise() += (evidence.position - x_.col(0)).eval();  // the others search where the root is
    }
    const asterism::Summary summary = asterism::solve(springs_, x_);
    result.lost = !summary.usable() || result.confidence < 0.2;
    if (!result.lost)
      for (int i = 0; i < kParts; ++i) part(i).adapt(frame, x_.col(i));
    result.box = asterism::box_around(x_.col(0), size_);
    return result;
  }

 private:
  asterism::AnyPart& part(int i) { return parts_[static_cast<std::size_t>(i)]; }

  static constexpr int kParts = 5;
  using Springs = asterism::SpringSystem<double, 2, kParts>;
  asterism::Size2 size_;
  std::vector<asterism::AnyPart> parts_;  // the root first
  Springs springs_{asterism::Topology<kParts>::full()};
  Springs::Points x_ = Springs::Points::Zero();  // the parts' centres [px], one per column
};
static_assert(asterism::Tracker<OnePart> && asterism::Tracker<RootAndParts>);

// A clip with a known answer: a textured object crosses a textured background.
cv::Mat texture(const cv::Size& size, int seed) {
  cv::Mat image(size, CV_8U);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {9, 9}, 0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}
cv::Rect truth(int frame) { return {40 + 3 * frame, 60 + frame, 64, 64}; }
cv::Mat draw(int frame) {
  static const cv::Mat background = texture({320, 240}, 1), object = texture({64, 64}, 2);
  cv::Mat image = background.clone();
  object.copyTo(image(truth(frame)));
  return image;
}

// The largest error of a tracker [px]. An AnyTracker holds RootAndParts like any other tracker, so whatever
// takes an AnyTracker, such as MultiTracker, takes RootAndParts.
double worst_error(asterism::AnyTracker tracker) {
  tracker.init(draw(0), truth(0));
  double worst = 0;
  for (int frame = 1; frame <= 40; ++frame) {
    const cv::Rect2d box = tracker.update(draw(frame)).box;
    worst = std::max({worst, std::abs(box.x - truth(frame).x), std::abs(box.y - truth(frame).y)});
  }
  return worst;
}

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "one") return asterism::run_program(OnePart(), argc, argv);
  if (argc > 1) return asterism::run_program(RootAndParts(), argc, argv);
  const double one = worst_error(OnePart()), five = worst_error(RootAndParts());
  std::printf("at most %.2f px off in 40 frames, one part %.2f px\n", five, one);
  return five < 2 && five <= one ? 0 : 1;
}
