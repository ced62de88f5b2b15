#pragma once

#include <filesystem>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <string>
#include <vector>

namespace asterism::tools {

/// The frames of a video, a camera or a list of images, one after another.
class ImageSource {
 public:
  /// `input` is a video file or stream address, a camera's index (digits), an image, a folder of images, a
  /// pattern of images ("img_%05d.jpg" in the order of the numbers, "*.jpg" in natural order), or a sequence
  /// in the VOT toolkit's layout: a folder with groundtruth.txt, its images in color/ or beside it. Throws
  /// std::runtime_error where it cannot be read or has no frames.
  static ImageSource open(const std::string& input);

  /// The next frame, 8-bit BGR; false after the last one. Throws std::runtime_error that names the image
  /// where one cannot be decoded.
  bool next(cv::Mat& image);

  /// Passes over `count` frames without decoding images; false where there are not as many.
  bool skip(int count);

  /// The number, from 1, of the frame that `next` gave last; 0 before the first.
  int position() const { return position_; }
  /// Frames of the whole input, an estimate for some video files; 0 where unknown.
  int frame_count() const { return frame_count_; }
  /// Frames a second; 25 for images and where unknown.
  double fps() const { return fps_; }
  /// The images in their order; empty for a video or a camera.
  const std::vector<std::filesystem::path>& images() const { return images_; }
  /// Whether a file is one that this source reads, or would be a frame of the same input if it were made.
  bool reads(const std::filesystem::path& path) const;
  /// The annotation file of a sequence folder; see `read_ground_truth`.
  const std::optional<std::filesystem::path>& ground_truth() const { return ground_truth_; }

 private:
  ImageSource() = default;
  using IsFrame = std::function<bool(const std::filesystem::path&)>;
  void use_images(std::vector<std::filesystem::path> images, const std::string& input);
  void use_folder(const std::filesystem::path& folder, IsFrame is_frame, const std::string& input);
  void use_video(const std::string& input);

  std::vector<std::filesystem::path> images_;  // empty where `video_` is the source
  std::filesystem::path folder_;               // whose images they are ...
  IsFrame is_frame_;                           // ... that satisfy this; none for a single image
  cv::VideoCapture video_;
  std::filesystem::path video_file_;  // of `video_`, where it is a file
  std::optional<std::filesystem::path> ground_truth_;
  int position_ = 0, frame_count_ = 0;
  double fps_ = 25;
};

/// "frame9" before "frame10": runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b);

}  // namespace asterism::tools
