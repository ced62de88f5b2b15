#include <array>
#include <asterism/solver/method/auto.hpp>
#include <cstdio>
#include <iostream>
#include <opencv2/imgproc.hpp>

class PatchTracker {
 public:
  void init(const cv::Mat& gray, const cv::Rect& box) {
    size_ = {box.width / 3, box.height / 3};
    for (int i = 0; i < kParts; ++i) {
      const cv::Rect patch({box.x + i % 3 * size_.width, box.y + i / 3 * size_.height}, size_);
      patches_[static_cast<std::size_t>(i)] = gray(patch).clone();
      x_.col(i) << patch.x, patch.y;
    }
    // Nominal lengths: the distances that the patches have now.
    springs_.set_rest_lengths(x_);
    springs_.link_stiffness.setConstant(0.2);
    springs_.anchor_loss.scale = kLetGo;
  }

  cv::Rect2d update(const cv::Mat& gray) {
    for (int i = 0; i < kParts; ++i) look_for(i, gray);
    // Starts at the last placement; on failure x_ stays as it was.
    const asterism::Summary summary = asterism::solve(springs_, x_);
    if (!summary.usable()) std::cerr << summary << '\n';
    const Eigen::Vector2d corner = x_.rowwise().mean() - Eigen::Vector2d(size_.width, size_.height);
    return {corner.x(), corner.y(), 3.0 * size_.width, 3.0 * size_.height};
  }

 private:
  static constexpr int kParts = 9, kReach = 12;  // reach of the search to each side [px]
  static constexpr double kLetGo = 6;            // an anchor farther away than this loses its hold [px]
  using Springs = asterism::SpringSystem<double, 2, kParts, kParts,
                                         asterism::Model<asterism::Hooke, asterism::GemanMcClure>>;

  // Anchor and stiffness of patch i: k = w / sigma^2, the peak over the scatter of the likely places.
  void look_for(int i, const cv::Mat& gray) {
    const cv::Rect frame({0, 0}, gray.size());
    const cv::Point last(cvRound(x_(0, i)), cvRound(x_(1, i)));
    const cv::Rect window =
        cv::Rect(last - cv::Point(kReach, kReach), size_ + cv::Size(2 * kReach, 2 * kReach)) & frame;
    springs_.anchors.col(i) = x_.col(i);
    springs_.anchor_stiffness[i] = 0;  // out of the frame: the neighbours decide
    if (window.width < size_.width || window.height < size_.height) return;

    cv::Mat response;
    cv::matchTemplate(gray(window), patches_[static_cast<std::size_t>(i)], response, cv::TM_CCOEFF_NORMED);
    double peak = 0;
    cv::Point best;
    cv::minMaxLoc(response, nullptr, &peak, nullptr, &best);
    double weight = 0, scatter = 0;
    for (int row = 0; row < response.rows; ++row)
      for (int col = 0; col < response.cols; ++col) {
        const double likelihood = std::exp((response.at<float>(row, col) - peak) / 0.1);
        const cv::Point d = cv::Point(col, row) - best;
        weight += likelihood, scatter += likelihood * d.dot(d);
      }
    springs_.anchors.col(i) << window.x + best.x, window.y + best.y;
    springs_.anchor_stiffness[i] = std::max(peak, 0.0) / (scatter / weight + 1.0 / 6);
  }

  cv::Size size_;  // of a patch [px]
  std::array<cv::Mat, kParts> patches_;
  Springs springs_{asterism::Topology<kParts>::full()};
  Springs::Points x_;  // top left corners of the patches [px], a column for each
};

// A clip with a known answer: a textured object crosses the frame, a bar crosses it.
cv::Mat texture(const cv::Size& size, int seed) {
  cv::Mat image(size, CV_8U);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {9, 9}, 0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}
cv::Rect truth(int frame) { return {40 + 3 * frame, 60 + frame, 60, 48}; }
cv::Mat draw(int frame) {
  static const cv::Mat background = texture({320, 240}, 1), object = texture({60, 48}, 2);
  cv::Mat image = background.clone();
  object.copyTo(image(truth(frame)));
  if (frame >= 10 && frame < 40) image(cv::Rect(truth(frame).x + 2 * (frame - 10) - 20, 0, 20, 240)) = 200;
  return image;
}

int main() {
  PatchTracker tracker;
  tracker.init(draw(0), truth(0));
  double worst = 0;
  for (int frame = 1; frame <= 50; ++frame) {
    const cv::Rect2d box = tracker.update(draw(frame));
    worst = std::max({worst, std::abs(box.x - truth(frame).x), std::abs(box.y - truth(frame).y)});
  }
  std::printf("at most %.2f px off in 50 frames\n", worst);
  return worst < 0.5 ? 0 : 1;
}
