#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <memory>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "peers_internal.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

// Sides of the networks' input and the stride of their cells [px].
constexpr int kTemplate = 127, kSearch = 255, kStride = 16;
// How strongly a change of size and aspect lowers a score, the share of the Hann window, and the largest rate
// with which the box takes a new size: the published parameters.
constexpr double kPenalty = 0.138, kWindow = 0.455, kRate = 0.348;
constexpr double kSmallest = 10;  // side of a box [px], as in the published code

cv::dnn::Net read_network(const fs::path& file) {
  if (!fs::is_regular_file(file))
    throw std::invalid_argument("nanotrack: no file " + file.string() +
                                "; the folder has to have backbone.onnx and head.onnx");
  try {
    cv::dnn::Net net = cv::dnn::readNetFromONNX(file.string());
    net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    return net;
  } catch (const cv::Exception&) {
    throw std::invalid_argument("nanotrack: " + file.string() +
                                " is not a network that OpenCV " CV_VERSION " reads");
  }
}

// Side of the square around a box of this size that the template shows.
double context_side(cv::Size2d size) {
  const double context = (size.width + size.height) / 2;
  return std::sqrt((size.width + context) * (size.height + context));
}

// A ratio or its inverse, whichever is larger.
double change(double ratio) { return std::max(ratio, 1 / ratio); }

// A Siamese network (the backbone) sees the object in the first frame, the template, and a search window in
// each further frame. The head compares both, and says for each cell of the search window how probable the
// object is there, and how far the sides of its box are from the cell's point.
class NanoTrack {
 public:
  explicit NanoTrack(const fs::path& folder)
      : backbone_(read_network(folder / "backbone.onnx")), head_(read_network(folder / "head.onnx")) {}

  void init(const cv::Mat& image, const cv::Rect2d& box) {
    centre_ = (box.tl() + box.br()) / 2;
    size_ = box.size();
    mean_ = cv::mean(image);
    template_ = features(image, kTemplate);
  }

  Report update(const cv::Mat& image) {
    const double scale = kTemplate / context_side(size_);  // from image to network pixels
    const auto [scores, distances] = compare(features(image, kSearch));
    const int cells = scores.size[2];
    const auto hann = [cells](int i) { return std::pow(std::sin(CV_PI * i / (cells - 1)), 2); };
    struct {
      double score = -std::numeric_limits<double>::infinity();
      double probability = 0, penalty = 0;
      cv::Point2d offset;  // of the box's centre from that of the window ..
      cv::Size2d size;     // .. and its size, in network pixels
    } best;
    for (int row = 0; row < cells; ++row)
      for (int column = 0; column < cells; ++column) {
        const auto at = [row, column](const cv::Mat& output, int channel) {
          return static_cast<double>(
              output.ptr<float>(0, channel)[static_cast<std::ptrdiff_t>(row) * output.size[3] + column]);
        };
        const double probability = 1 / (1 + std::exp(at(scores, 0) - at(scores, 1)));
        const double left = at(distances, 0), top = at(distances, 1), right = at(distances, 2),
                     bottom = at(distances, 3);
        const cv::Size2d size(left + right, top + bottom);
        const double of_size = change(context_side(size) / kTemplate),
                     of_aspect = change(size.aspectRatio() / size_.aspectRatio());
        const double penalty = std::exp(-kPenalty * (of_aspect * of_size - 1));
        const double score = (1 - kWindow) * penalty * probability + kWindow * hann(row) * hann(column);
        if (!(score > best.score)) continue;
        const cv::Point2d point(kStride * (column - cells / 2), kStride * (row - cells / 2));
        best = {score, probability, penalty, point + cv::Point2d(right - left, bottom - top) / 2, size};
      }
    if (!std::isfinite(best.score)) return {};
    const double rate = kRate * best.penalty * best.probability;
    const cv::Size2d limit = image.size();
    centre_ = {std::clamp(centre_.x + best.offset.x / scale, 0.0, limit.width),
               std::clamp(centre_.y + best.offset.y / scale, 0.0, limit.height)};
    const auto adapt = [&](double& side, double found, double most) {
      side = std::max(kSmallest, std::min((1 - rate) * side + rate * found / scale, most));
    };
    adapt(size_.width, best.size.width, limit.width);
    adapt(size_.height, best.size.height, limit.height);
    const cv::Point2d corner(centre_.x - size_.width / 2, centre_.y - size_.height / 2);
    return {Region::rectangle({corner, size_}), best.probability};
  }

 private:
  // Of the window of pixels x pixels network pixels around the box.
  cv::Mat features(const cv::Mat& image, int pixels) {
    const double step = context_side(size_) / kTemplate;  // from network to image pixels
    const auto first = [&](double centre) { return centre - pixels * step / 2 + step / 2 - 0.5; };
    const cv::Matx23d to_image(step, 0, first(centre_.x), 0, step, first(centre_.y));
    cv::Mat window;
    cv::warpAffine(image, window, to_image, {pixels, pixels}, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                   cv::BORDER_CONSTANT, mean_);
    backbone_.setInput(cv::dnn::blobFromImage(window));
    return backbone_.forward().clone();
  }

  // The two values of each cell, for background and object before the soft-max, and the four distances.
  std::pair<cv::Mat, cv::Mat> compare(const cv::Mat& search) {
    head_.setInput(template_, "input1");
    head_.setInput(search, "input2");
    std::vector<cv::Mat> outputs;
    head_.forward(outputs, head_.getUnconnectedOutLayersNames());
    const auto of = [&](int channels) -> cv::Mat {
      for (const cv::Mat& output : outputs)
        if (output.dims == 4 && output.size[1] == channels && output.size[2] == output.size[3] &&
            output.size[2] > 1 && output.type() == CV_32F)
          return output;
      throw std::runtime_error("the head has no output of " + std::to_string(channels) +
                               " channels of cells");
    };
    std::pair<cv::Mat, cv::Mat> result{of(2), of(4)};
    if (result.first.size[2] != result.second.size[2])
      throw std::runtime_error("the head's outputs differ in size");
    return result;
  }

  cv::dnn::Net backbone_, head_;
  cv::Mat template_;  // its features
  cv::Scalar mean_;   // of the first image, for pixels outside the image
  cv::Point2d centre_;
  cv::Size2d size_;
};

}  // namespace

Start nanotrack_peer(const std::string& folder) {
  if (!fs::is_directory(folder)) throw std::invalid_argument("nanotrack: no folder \"" + folder + '"');
  try {
    NanoTrack trial(folder);
    const cv::Mat image(kSearch, kSearch, CV_8UC3, cv::Scalar::all(0));
    trial.init(image, {100, 100, 50, 50});
    trial.update(image);
  } catch (const std::invalid_argument&) {
    throw;
  } catch (const cv::Exception&) {
    throw std::invalid_argument("nanotrack: the networks in " + folder +
                                " are not a backbone and a head of NanoTrack");
  } catch (const std::runtime_error& error) {
    throw std::invalid_argument("nanotrack: the networks in " + folder + ": " + error.what());
  }
  return [folder](const Image& image, const Region& object) -> Step {
    const auto tracker = std::make_shared<NanoTrack>(folder);
    tracker->init(image.pixels, object.equal_area_box());
    return [tracker](const Image& next) { return tracker->update(next.pixels); };
  };
}

}  // namespace asterism::bench
