#pragma once

#include <algorithm>
#include <asterism/parts/features/cell_channels.hpp>
#include <cmath>
#include <mutex>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The input of a network for an image: scale x (pixel - mean), channel by channel.
struct DnnInput {
  double scale = 1 / 255.0;     ///< after the mean is subtracted
  cv::Scalar mean = {0, 0, 0};  ///< in the order of the network's channels
  bool rgb = true;              ///< the network's channels are red, green, blue; otherwise blue, green, red
};

/// The channels of a network's layer, for correlation filters: any network that OpenCV's dnn module reads
/// (ONNX, Caffe, TensorFlow, ...) and that takes images of any size. Header-only; link OpenCV's dnn library.
///
///     const auto channels = std::make_shared<DnnChannels>("network.onnx");
///     KcfOptions options;
///     options.features = {.hog = false, .gray = false, .own = channels};
///     options.cell_size = channels->stride();
///
/// The values of a window are scaled together to the root mean square CellChannels::kTypical. A layer whose
/// map is not exactly rows x cols for a window of as many cells is resampled to that.
class DnnChannels final : public CellChannels {
 public:
  /// layer: the name of the layer, in ONNX that of its output; by default the network's last. Throws
  /// std::runtime_error for a file that cannot be read, for an unknown layer (the message lists those that
  /// there are), and for one whose output for an image is not 1 x channels x rows x cols with the same whole
  /// stride on both axes.
  explicit DnnChannels(const std::string& file, std::string layer = "", const DnnInput& input = {})
      : layer_(std::move(layer)), input_(input) {
    try {
      net_ = cv::dnn::readNet(file);
      net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
      if (!layer_.empty()) known_ = known_layer();
      // Of two sizes, as only the difference is free of what convolutions without padding lose at the border.
      const cv::Mat small = forward(cv::Mat(kProbe, kProbe, CV_8UC3, cv::Scalar::all(0)));
      const cv::Mat large = forward(cv::Mat(2 * kProbe, 2 * kProbe, CV_8UC3, cv::Scalar::all(0)));
      if (small.dims != 4 || large.dims != 4 || large.size[2] <= small.size[2] ||
          large.size[2] != large.size[3] || kProbe % (large.size[2] - small.size[2]) != 0)
        throw std::runtime_error("its output is no map of cells");
      stride_ = kProbe / (large.size[2] - small.size[2]);
      channels_ = large.size[1];
    } catch (const std::exception& error) {
      throw std::runtime_error("DnnChannels: " + file + (layer_.empty() ? "" : ", layer " + layer_) + ": " +
                               error.what());
    }
  }

  int channels() const override { return channels_; }
  /// Image pixels from one cell of the layer to the next: the filter's cell_size.
  int stride() const { return stride_; }

  void compute(const cv::Mat& window, int rows, int cols, float* planes) const override {
    const std::lock_guard lock(mutex_);
    const cv::Mat output = forward(window);
    double squares = 0;
    for (int channel = 0; channel < channels_; ++channel) {
      const cv::Mat map(output.size[2], output.size[3], CV_32F,
                        const_cast<float*>(output.ptr<float>(0, channel)));
      cv::Mat plane(rows, cols, CV_32F, planes + static_cast<std::ptrdiff_t>(channel) * rows * cols);
      cv::resize(map, plane, plane.size(), 0, 0, cv::INTER_LINEAR);
      squares += plane.dot(plane);
    }
    const double count = static_cast<double>(channels_) * rows * cols;
    const double scale = squares > 0 ? static_cast<double>(kTypical) / std::sqrt(squares / count) : 0;
    std::transform(planes, planes + static_cast<std::ptrdiff_t>(count), planes,
                   [scale](float value) { return static_cast<float>(scale * static_cast<double>(value)); });
  }

 private:
  // A multiple of all usual strides, and larger than most receptive fields.
  static constexpr int kProbe = 128;

  std::string known_layer() const {
    std::string list;
    for (const std::string& name : net_.getLayerNames()) {
      if (name == layer_ || name == "onnx_node!" + layer_) return name;
      list += (list.empty() ? "" : ", ") + name;
    }
    throw std::runtime_error("unknown layer, expected one of " + list);
  }

  cv::Mat forward(const cv::Mat& image) const {
    net_.setInput(cv::dnn::blobFromImage(image, input_.scale, {}, input_.mean, input_.rgb));
    return known_.empty() ? net_.forward() : net_.forward(known_);
  }

  std::string layer_, known_;  // as it was given, and as OpenCV calls it
  DnnInput input_;
  int channels_ = 0, stride_ = 0;
  mutable std::mutex mutex_;  // a network computes one window at a time
  mutable cv::dnn::Net net_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
