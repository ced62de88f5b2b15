#include <algorithm>
#include <asterism/trackers/constellation/motion.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <stdexcept>
#ifdef ASTERISM_TRACKERS_FLOW
#include <opencv2/video/tracking.hpp>
#endif

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Spacing of the posterior's cells [window pixels]; the flow's patches are 4 apart.
constexpr int kStep = 2;
// Approximate number of points that determine the camera's motion.
constexpr int kCameraPoints = 256;
// Typical error of these points [window pixels].
constexpr double kCameraError = 0.5;
// Upper end of the first bin: squared speed [(mean sides of the object per frame)^2]. Each further bin ends
// at twice the previous one.
constexpr double kSlowest = 0.0025 * 0.0025;
// Bin of a cell outside the image.
constexpr std::uint8_t kNone = 255;

// Optical flow from the pixels of `to` back to those of `from`, both 8-bit and of one size.
cv::Mat flow_between(const cv::Mat& to, const cv::Mat& from) {
#ifdef ASTERISM_TRACKERS_FLOW
  // Kept only for its buffers: without spatial propagation the result depends neither on earlier calls nor on
  // the number of threads.
  thread_local const cv::Ptr<cv::DISOpticalFlow> solver = [] {
    auto result = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_ULTRAFAST);
    result->setUseSpatialPropagation(false);
    return result;
  }();
  // At full resolution. Set for each call, as calc changes these for a small image and keeps the change.
  solver->setFinestScale(0);
  solver->setPatchSize(8);
  solver->setPatchStride(4);
  cv::Mat flow;
  solver->calc(to, from, flow);
  return flow;
#else
  static_cast<void>(to), static_cast<void>(from);
  throw std::logic_error("MotionModel: built without OpenCV's video");
#endif
}

bool contains(const cv::Rect2d& box, const Point2& x) { return box.contains({x.x(), x.y()}); }

// A box between pixel centres, to test whether it contains a position.
cv::Rect2d pixels_of(const Point2& centre, const Size2& size) {
  return {centre.x() - size.x() / 2, centre.y() - size.y() / 2, size.x(), size.y()};
}

}  // namespace

MotionModel::MotionModel(const MotionOptions& options) : options_(check_options("MotionOptions", options)) {
  if (!options.window.ordered())
    throw std::invalid_argument("MotionOptions: template sides must satisfy min <= max");
}

bool MotionModel::available() {
#ifdef ASTERISM_TRACKERS_FLOW
  return true;
#else
  return false;
#endif
}

void MotionModel::place(const Point2& centre, const Size2& size) {
  centre_ = centre, size_ = size;
  window_ = ObjectWindow(centre, size, options_.window);
  bins_.release();
}

Point2 MotionModel::position(int row, int col) const {
  return window_.to_image({static_cast<float>(col), static_cast<float>(row)});
}

void MotionModel::init(const Frame& frame, const cv::Rect2d& box) {
  if (!available()) throw std::logic_error("MotionModel: built without OpenCV's video");
  place(centre_of(box), {box.width, box.height});
  previous_ = window_.sample(frame);
  foreground_.fill(0), background_.fill(0);
  learned_ = 0;
}

Segmentation MotionModel::segment(const Frame& frame) {
  const cv::Mat current = window_.sample(frame);
  const cv::Mat flow = flow_between(current, previous_);
  previous_ = current;

  const cv::Rect2d image(-0.5, -0.5, frame.size().width, frame.size().height),
      object = pixels_of(centre_, size_);
  const auto moved = [&](int row, int col) -> Eigen::Vector2d {
    const cv::Point2f u = flow.at<cv::Point2f>(row, col);
    return Eigen::Vector2d(col, row) + Eigen::Vector2d(u.x, u.y);
  };

  // The camera's motion is estimated from the object's surroundings.
  const int stride =
      std::max(1, static_cast<int>(std::sqrt(static_cast<double>(flow.total()) / kCameraPoints)));
  std::vector<Eigen::Vector2d> points, images;
  for (int row = stride / 2; row < flow.rows; row += stride)
    for (int col = stride / 2; col < flow.cols; col += stride) {
      const Point2 x = position(row, col);
      if (!contains(image, x) || contains(object, x)) continue;
      points.emplace_back(col, row);
      images.push_back(moved(row, col));
    }
  const auto as_matrix = [](const std::vector<Eigen::Vector2d>& list) {
    return Eigen::Map<const Eigen::Matrix2Xd>(list.empty() ? nullptr : list[0].data(), 2,
                                              static_cast<Eigen::Index>(list.size()));
  };
  const PlaneTransform camera =
      fit_robust_transform(as_matrix(points), as_matrix(images),
                           Eigen::VectorXd::Ones(static_cast<Eigen::Index>(points.size())),
                           TransformModel::Similarity, kCameraError, {})
          .transform;

  // The remaining motion, binned in octaves of its squared speed.
  bins_ = cv::Mat_<std::uint8_t>((flow.rows + kStep - 1) / kStep, (flow.cols + kStep - 1) / kStep, kNone);
  const double slowest = kSlowest * size_.prod() / (window_.spacing() * window_.spacing());
  const PlaneTransform turn{camera.scale, camera.angle, Eigen::Vector2d::Zero()};
  const Eigen::Vector2d right = turn({1, 0}), down = turn({0, 1});
  for (int row = 0; row < bins_.rows; ++row)
    for (int col = 0; col < bins_.cols; ++col) {
      if (!contains(image, position(kStep * row, kStep * col))) continue;
      const Eigen::Vector2d rest =
          moved(kStep * row, kStep * col) - kStep * (col * right + row * down) - camera.translation;
      const double octave = std::max(0.0, std::logb(std::max(rest.squaredNorm() / slowest, 0.5)) + 1);
      bins_(row, col) = static_cast<std::uint8_t>(std::min<double>(octave, kBins - 1));
    }

  Segmentation result;
  if (learned_ == 0) return result;
  result.origin = position(0, 0);
  result.spacing = Size2::Constant(kStep * window_.spacing());
  const std::array<float, kBins> posterior = this->posterior();
  result.posterior.create(bins_.size(), CV_32F);
  std::transform(bins_.begin(), bins_.end(), result.posterior.begin<float>(),
                 [&](std::uint8_t bin) { return bin == kNone ? 0 : posterior[bin]; });
  return result;
}

std::array<float, MotionModel::kBins> MotionModel::posterior() const {
  // Smooths over neighbouring bins (weights 1 : 2 : 1) and leaves `novelty` for speeds not seen before.
  const auto likelihood = [](const Histogram& histogram, double novelty, int bin) {
    const auto at = [&](int k) { return histogram[static_cast<std::size_t>(std::clamp(k, 0, kBins - 1))]; };
    return (1 - novelty) * (at(bin - 1) + 2 * at(bin) + at(bin + 1)) / 4 + novelty / kBins;
  };
  std::array<float, kBins> result{};
  for (int bin = 0; bin < kBins; ++bin) {
    const double object = options_.foreground_prior * likelihood(foreground_, options_.novelty, bin),
                 around = (1 - options_.foreground_prior) *
                          likelihood(background_, options_.background_novelty, bin);
    result[static_cast<std::size_t>(bin)] = static_cast<float>(object / (object + around));
  }
  return result;
}

void MotionModel::adapt(const Frame& frame, const cv::Rect2d& box) {
  const Point2 centre = centre_of(box);
  const Size2 size(box.width, box.height);
  Histogram object{}, around{};
  double inside = 0, outside = 0;
  const cv::Rect2d inner = pixels_of(centre, size), outer = pixels_of(centre, 2 * size);
  for (int row = 0; row < bins_.rows; ++row)
    for (int col = 0; col < bins_.cols; ++col) {
      const auto bin = bins_(row, col);
      const Point2 x = position(kStep * row, kStep * col);
      if (bin == kNone || !contains(outer, x)) continue;
      const bool in = contains(inner, x);
      (in ? object : around)[bin] += 1;
      (in ? inside : outside) += 1;
    }
  if (inside > 0 && outside > 0) {
    learned_ = std::min(learned_ + 1, kMostLearned);
    const double rate = std::max(options_.histogram_rate, 1.0 / learned_);
    for (std::size_t k = 0; k < kBins; ++k) {
      foreground_[k] += rate * (object[k] / inside - foreground_[k]);
      background_[k] += rate * (around[k] / outside - background_[k]);
    }
  }
  place(centre, size);
  previous_ = window_.sample(frame);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
