#include <asterism/parts/concept/part_plugin.hpp>
#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/features/patch.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

using namespace asterism;

struct GrayPatchOptions {
  double noise = 16;  // standard deviation of a point's gray level between frames
  double learning_rate = 0.02;
};
void visit_options(OptionVisitor& visit, GrayPatchOptions& options) {
  visit("noise", options.noise, {1e-3, 1e3});
  visit("learning_rate", options.learning_rate, {0, 1});
}

class GrayPatch {
 public:
  explicit GrayPatch(const GrayPatchOptions& options) : options_(check_options("GrayPatch", options)) {}
  void init(const Frame& frame, const Point2& centre, const Size2& size) {
    if (!(size.minCoeff() > 0)) throw std::invalid_argument("the size must be positive");
    learned_ = sample(frame, centre, size, kGrid);
    size_ = size;
    response_.spacing = size / kGrid;
    response_.periodic = false;
  }
  Evidence localize(const Frame& frame, const Point2& around) {
    cv::Mat distance;
    cv::matchTemplate(sample(frame, around, 2 * size_, 2 * kGrid), learned_, distance, cv::TM_SQDIFF);
    cv::exp(distance / (-2 * kGrid * kGrid * options_.noise * options_.noise), distance);
    response_.values = Eigen::Map<decltype(response_.values)>(distance.ptr<float>(), kGrid + 1, kGrid + 1);
    response_.origin = around - size_ / 2;
    return evidence_of(response_);
  }
  double similarity_at(const Point2& position) const { return response_.at(position); }
  void adapt(const Frame& frame, const Point2& at) {
    const double rate = options_.learning_rate;
    // A new matrix, as copies of this part share the old one.
    learned_ = cv::Mat((1 - rate) * learned_ + rate * sample(frame, at, size_, kGrid));
  }

 private:
  static constexpr int kGrid = 16;
  static cv::Mat sample(const Frame& frame, const Point2& centre, const Size2& size, int grid) {
    cv::Mat patch, levels;
    sample_patch(frame.gray(), centre, size, {grid, grid}, patch);
    patch.convertTo(levels, CV_32F);
    return levels;
  }
  GrayPatchOptions options_;
  Size2 size_ = Size2::Ones();
  cv::Mat learned_;
  ResponseMap response_;
};

ASTERISM_PART_PLUGIN(models) { models.add<GrayPatch, GrayPatchOptions>("gray_patch"); }
