#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/siamese.hpp>
#include <cmath>
#include <filesystem>
#include <limits>
#include <mutex>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>
#include <vector>
#ifdef ASTERISM_PARTS_DNN
#include <opencv2/dnn.hpp>
#endif

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Sides of the networks' input and the stride of their cells [network pixels].
constexpr int kTemplate = 127, kSearch = 255, kStride = 16;

// Side of the square around a target of this size that the template shows.
double context_side(const Size2& size) {
  return std::sqrt((size.x() + size.mean()) * (size.y() + size.mean()));
}

// A ratio or its inverse, whichever is larger.
double change(double ratio) { return std::max(ratio, 1 / ratio); }

// The value of a channel in a cell of a network's output.
double at(const cv::Mat& output, int channel, int row, int col) {
  return static_cast<double>(
      output.ptr<float>(0, channel)[static_cast<std::ptrdiff_t>(row) * output.size[3] + col]);
}

}  // namespace

#ifdef ASTERISM_PARTS_DNN
// One pair for all copies of a part, as networks learn nothing; one window at a time.
struct Siamese::Networks {
  explicit Networks(const std::filesystem::path& folder) {
    if (folder.empty())
      throw std::invalid_argument(
          "siamese: \"network\" has to name a folder with backbone.onnx and head.onnx");
    if (!std::filesystem::is_directory(folder))
      throw std::invalid_argument("siamese: no folder \"" + folder.string() + '"');
    backbone = read(folder / "backbone.onnx");
    head = read(folder / "head.onnx");
    try {
      const cv::Mat black(kSearch, kSearch, CV_8UC3, cv::Scalar::all(0));
      const cv::Mat learned = features(black({0, 0, kTemplate, kTemplate}));
      template_sizes.assign(learned.size.p, learned.size.p + learned.dims);
      compare(learned, features(black));
    } catch (const cv::Exception&) {
      throw std::invalid_argument("siamese: the networks in " + folder.string() +
                                  " are not a backbone and a head of NanoTrack");
    } catch (const std::runtime_error& error) {
      throw std::invalid_argument("siamese: the networks in " + folder.string() + ": " + error.what());
    }
  }

  static cv::dnn::Net read(const std::filesystem::path& file) {
    if (!std::filesystem::is_regular_file(file))
      throw std::invalid_argument("siamese: no file " + file.string() +
                                  "; the folder has to have backbone.onnx and head.onnx");
    try {
      cv::dnn::Net net = cv::dnn::readNetFromONNX(file.string());
      net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
      return net;
    } catch (const cv::Exception&) {
      throw std::invalid_argument("siamese: " + file.string() +
                                  " is not a network that OpenCV " CV_VERSION " reads");
    }
  }

  cv::Mat features(const cv::Mat& window) {
    const std::lock_guard lock(mutex);
    backbone.setInput(cv::dnn::blobFromImage(window));
    return backbone.forward().clone();
  }

  // The two values of each cell, for background and object before the soft-max, and the four distances.
  std::pair<cv::Mat, cv::Mat> compare(const cv::Mat& learned, const cv::Mat& search) {
    const std::lock_guard lock(mutex);
    head.setInput(learned, "input1");
    head.setInput(search, "input2");
    std::vector<cv::Mat> outputs;
    head.forward(outputs, head.getUnconnectedOutLayersNames());
    const auto of = [&](int channels) -> cv::Mat {
      for (const cv::Mat& output : outputs)
        if (output.dims == 4 && output.size[1] == channels && output.size[2] == output.size[3] &&
            output.size[2] > 1 && output.type() == CV_32F)
          return output.clone();
      throw std::runtime_error("the head has no output of " + std::to_string(channels) +
                               " channels of cells");
    };
    std::pair<cv::Mat, cv::Mat> result{of(2), of(4)};
    if (result.first.size[2] != result.second.size[2])
      throw std::runtime_error("the head's outputs differ in size");
    return result;
  }

  std::mutex mutex;
  cv::dnn::Net backbone, head;
  std::vector<int> template_sizes;
};
#else
struct Siamese::Networks {
  explicit Networks(const std::filesystem::path&) {
    throw std::invalid_argument("siamese: this build is without OpenCV's dnn module (libopencv-dnn-dev)");
  }
  cv::Mat features(const cv::Mat&) { return {}; }
  std::pair<cv::Mat, cv::Mat> compare(const cv::Mat&, const cv::Mat&) { return {}; }
  std::vector<int> template_sizes;
};
#endif

Siamese::Siamese(const SiameseOptions& options)
    : options_(check_options("SiameseOptions", options)),
      networks_(std::make_shared<Networks>(options.network.text)),
      filter_(options.filter) {}

void Siamese::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  size_ = found_size_ = size;
  mean_ = frame.bgr().empty() ? cv::Scalar::all(cv::mean(frame.gray())[0]) : cv::mean(frame.bgr());
  template_ = features(frame, centre, kTemplate);
  if (options_.filter_share > 0) filter_.init(frame, centre, size);
  peak_ = {};
}

void Siamese::resize(const Size2& size) {
  require_size(size);
  size_ = size;
  if (options_.filter_share > 0) filter_.resize(size);
}

void Siamese::adapt(const Frame& frame, const Point2& at) {
  require(at.allFinite(), "part: the centre must be finite");
  if (options_.filter_share > 0) filter_.adapt(frame, at);
}

cv::Mat Siamese::features(const Frame& frame, const Point2& centre, int pixels) {
  if (size_.isZero()) throw std::logic_error("Siamese: localize before init");
  require(centre.allFinite(), "part: the centre must be finite");
  const double step = context_side(size_) / kTemplate;  // from network to image pixels
  const Point2 first = centre.array() - (pixels - 1) * step / 2;
  const cv::Matx23d to_image(step, 0, first.x(), 0, step, first.y());
  cv::Mat window;
  cv::warpAffine(frame.bgr().empty() ? frame.gray() : frame.bgr(), window, to_image, {pixels, pixels},
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_CONSTANT, mean_);
  if (window.channels() == 1) cv::cvtColor(window, window, cv::COLOR_GRAY2BGR);
  return networks_->features(window);
}

Evidence Siamese::localize(const Frame& frame, const Point2& around) {
  const auto [scores, distances] = networks_->compare(template_, features(frame, around, kSearch));
  const double step = context_side(size_) / kTemplate;  // from network to image pixels
  const int cells = scores.size[2];
  const double share = options_.filter_share;
  if (share > 0) filter_.localize(frame, around);
  const auto hann = [cells](int i) { return std::pow(std::sin(std::numbers::pi * i / (cells - 1)), 2); };

  struct Cell {
    double score = -1, probability = 0, penalty = 0;
    Point2 centre = Point2::Zero();  // of its box, from that of the window, ..
    Size2 size = Size2::Ones();      // .. and the box's size [network pixels]
  };
  std::vector<Cell> all;
  all.reserve(static_cast<std::size_t>(cells) * static_cast<std::size_t>(cells));
  Cell best;
  for (int row = 0; row < cells; ++row)
    for (int col = 0; col < cells; ++col) {
      const double left = at(distances, 0, row, col), top = at(distances, 1, row, col),
                   right = at(distances, 2, row, col), bottom = at(distances, 3, row, col);
      Cell cell;
      cell.probability = 1 / (1 + std::exp(at(scores, 0, row, col) - at(scores, 1, row, col)));
      cell.size = {left + right, top + bottom};
      cell.centre =
          kStride * Point2(col - cells / 2, row - cells / 2) + Point2(right - left, bottom - top) / 2;
      const double of_size = change(context_side(cell.size) / kTemplate),
                   of_aspect = change(cell.size.x() / cell.size.y() * size_.y() / size_.x());
      cell.penalty = std::exp(-options_.penalty * (of_aspect * of_size - 1));
      double similarity = cell.probability;
      if (share > 0)
        similarity += share * (filter_.similarity_at(around + step * cell.centre) - cell.probability);
      cell.score =
          (1 - options_.window) * cell.penalty * similarity + options_.window * hann(row) * hann(col);
      if (!std::isfinite(cell.score) || !cell.centre.allFinite()) continue;
      all.push_back(cell);
      if (cell.score > best.score) best = cell;
    }

  double sum = std::numeric_limits<double>::min();
  Eigen::Matrix2d moment = Eigen::Matrix2d::Zero();
  for (const Cell& cell : all) {
    const double weight = cell.probability * cell.probability;
    const Point2 off = cell.centre - best.centre;
    sum += weight;
    moment += weight * off * off.transpose();
  }
  // At least the variance within a network pixel.
  const Eigen::Matrix2d spread = moment / sum + Eigen::Matrix2d::Identity() / 12;
  const double rate = options_.size_rate * best.penalty * best.probability;
  found_size_ = size_ + rate * (step * best.size - size_);
  if (!(found_size_.minCoeff() > 0) || !found_size_.allFinite()) found_size_ = size_;
  peak_ = {{around + step * best.centre, best.probability, step * step * spread},
           around,
           Size2::Constant(step * kSearch)};
  return peak_.evidence;
}

void Siamese::visit_state(StateArchive& archive) {
  archive.begin("siamese", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("Siamese: save before init");
  archive.size(size_);
  for (int channel = 0; channel < 4; ++channel) archive(mean_[channel]);
  if (archive.loading()) {  // its own: copies of a model share it
    template_ = cv::Mat(networks_->template_sizes, CV_32F);
    found_size_ = size_;
    peak_ = {};
  }
  if (options_.filter_share > 0) filter_.visit_state(archive);
  archive(Eigen::Map<Eigen::ArrayXf>(template_.ptr<float>(), static_cast<Eigen::Index>(template_.total())));
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
