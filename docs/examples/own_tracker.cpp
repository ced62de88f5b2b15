#include <algorithm>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/trackers/constellation/stiffness.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

class FourParts {
 public:
  void init(const cv::Mat& image, const cv::Rect2d& box) {
    const asterism::Frame frame(image);
    if (!(box.width >= 1 && box.height >= 1)) throw std::invalid_argument("FourParts: the box is too small");
    box_ = box;
    const asterism::Point2 centre = asterism::centre_of(box);  // boxes have edges, parts have pixel centres
    const asterism::Size2 size(box.width / 2, box.height / 2);
    parts_.assign(kParts, asterism::Kcf());
    for (int i = 0; i < kParts; ++i) {
      x_.col(i) << centre.x() + (i % 2 - 0.5) * size.x(), centre.y() + (i / 2 - 0.5) * size.y();
      parts_[static_cast<std::size_t>(i)].init(frame, x_.col(i), size);
    }
    springs_.set_rest_lengths(x_);
  }

  asterism::TrackResult update(const cv::Mat& image) {
    if (parts_.empty()) throw std::logic_error("FourParts: update before init");
    const asterism::Frame frame(image);
    asterism::TrackResult result;
    for (int i = 0; i < kParts; ++i) {
      const asterism::Evidence evidence = parts_[static_cast<std::size_t>(i)].localize(frame, x_.col(i));
      springs_.anchors.col(i) = evidence.position;
      springs_.anchor_stiffness[i] = asterism::static_stiffness(evidence);
      result.confidence += std::min(evidence.peak, 1.0) / kParts;
    }
    springs_.link_stiffness.setConstant(0.1);                         // [1/px^2]: lengths hold to about 3 px
    const asterism::Summary summary = asterism::solve(springs_, x_);  // starts at the last placement
    result.lost = !summary.usable() || result.confidence < 0.2;

    box_ = asterism::box_around(x_.rowwise().mean(), {box_.width, box_.height});
    if (!result.lost)
      for (int i = 0; i < kParts; ++i) parts_[static_cast<std::size_t>(i)].adapt(frame, x_.col(i));
    result.box = box_;
    return result;
  }

 private:
  static constexpr int kParts = 4;
  using Springs = asterism::SpringSystem<double, 2, kParts>;
  cv::Rect2d box_;
  std::vector<asterism::Kcf> parts_;
  Springs springs_{asterism::Topology<kParts>::full()};
  Springs::Points x_ = Springs::Points::Zero();  // the parts' centres [px], a column for each
};
static_assert(asterism::Tracker<FourParts>);

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

// The largest error of a tracker [px]. An AnyTracker holds FourParts like any other tracker, so whatever
// takes an AnyTracker, such as MultiTracker, takes FourParts.
double worst_error(asterism::AnyTracker tracker) {
  tracker.init(draw(0), truth(0));
  double worst = 0;
  for (int frame = 1; frame <= 40; ++frame) {
    const cv::Rect2d box = tracker.update(draw(frame)).box;
    worst = std::max({worst, std::abs(box.x - truth(frame).x), std::abs(box.y - truth(frame).y)});
  }
  return worst;
}

int main() {
  const double ours = worst_error(FourParts()), kcf = worst_error(asterism::make_tracker("kcf"));
  std::printf("at most %.2f px off in 40 frames; kcf %.2f px\n", ours, kcf);
  return ours < 2 && kcf < 2 ? 0 : 1;
}
