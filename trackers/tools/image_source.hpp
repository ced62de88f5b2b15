#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "image_file.hpp"
#include "video_file.hpp"

namespace asterism::tools {

/// Options for reading frames.
struct FrameOptions {
  std::optional<PixelRange> range = {};  ///< of the pixels; default: that of Frame
  std::optional<int> rotate =
      {};          ///< clockwise [degrees], a multiple of 90; default: as announced by the video
  double fps = 0;  ///< frames per second; 0: from the video's header or timestamps
};

/// The frames of a video, a camera or a list of images, one after another.
class ImageSource {
 public:
  /// `input` is a video file or stream address, a camera's index (digits), an image, a TIFF of several pages,
  /// a folder of images, a pattern of images ("img_%05d.jpg" in the order of the numbers, "*.jpg" in natural
  /// order), or a sequence in the VOT toolkit's layout: a folder with groundtruth.txt and its images, there
  /// or in color/. Images whose numbers have a gap add a note. Throws std::runtime_error if it cannot be
  /// read, has no frames, or has two images for one frame (0001.jpg and 0001.png, or 0001_mask.png).
  static ImageSource open(const std::string& input, const FrameOptions& options = {});

  /// The next frame, 8-bit BGR; false after the last one. A damaged image is a blank frame, see `read_frame`.
  /// A frame of another size than the first one that was returned, but of the same shape (to a pixel), is
  /// scaled to that size, which adds a note the first time: the scene is the same at another resolution.
  /// Frames of another shape are returned as they are. Throws std::runtime_error, which names the image, if
  /// it cannot be a frame at all.
  bool next(cv::Mat& image);

  /// Skips `count` frames without decoding images; false if there are fewer.
  bool skip(int count);

  /// Whether opening it again gives the same frames: a file or images, not a camera or a stream.
  bool is_repeatable() const { return !video_.isOpened() || is_file_; }

  /// The number, from 1, of the last frame that `next` returned; 0 before the first.
  int position() const { return position_; }
  /// Frames of the whole input, an estimate for some video files; 0 if unknown.
  int frame_count() const { return frame_count_; }
  /// After the last frame: whether the video has more that could not be read. A file with fewer frames than
  /// announced is read again to find out: its rate may vary, or its times begin late.
  bool ended_early();
  /// The frames that are missing among those read from a video file of a steady rate: the file is damaged, or
  /// its recorder has dropped them.
  std::optional<MissingFrames> missing() const { return missing_frames(times_); }
  /// Frames per second: from the options if given. If a video file's timestamps contradict its header (a
  /// variable rate), their mean, for which the file is read through once. 25 for images and if unknown, which
  /// adds a note.
  double fps();
  /// The images in order; empty for a video, a camera and a TIFF of several pages.
  const std::vector<std::filesystem::path>& images() const { return images_; }
  /// The frames that were damaged, as "frame 11, images/img_11.png".
  const std::vector<std::string>& damaged() const { return damaged_; }
  /// Notes for the user since the last call, one line each.
  std::vector<std::string> take_notes() { return std::exchange(notes_, {}); }
  /// Whether this source reads a file, or would read it as a frame if it were created; also true for links to
  /// it.
  bool reads(const std::filesystem::path& path) const;
  /// The annotation file of a sequence folder; see `read_ground_truth`.
  const std::optional<std::filesystem::path>& ground_truth() const { return ground_truth_; }

 private:
  ImageSource() = default;
  using IsFrame = std::function<bool(const std::filesystem::path&)>;
  void use_images(std::vector<std::filesystem::path> images, const std::string& input);
  void use_folder(const std::filesystem::path& folder, IsFrame is_frame, const std::string& input);
  void use_image(const std::filesystem::path& image, const std::string& input);
  void use_video(const std::string& input);
  void measure_video();
  cv::Mat read_image();
  cv::Mat in_8_bits(const cv::Mat& image);
  cv::Mat upright(const cv::Mat& image) const;
  cv::Mat in_first_size(const cv::Mat& image);

  FrameOptions options_;
  std::vector<std::filesystem::path> images_;  // empty if `video_` or `stack_` is the source
  std::filesystem::path folder_;               // of the images ...
  IsFrame is_frame_;                           // ... that satisfy this; empty for a single image
  cv::VideoCapture video_;
  std::filesystem::path file_;        // of `video_`, if it is a file, or of `stack_`
  std::vector<unsigned char> stack_;  // bytes of a TIFF of several pages ...
  std::vector<std::uint64_t> pages_;  // ... and the pages' offsets
  std::vector<double> times_;         // of the frames of a video file [s]
  std::optional<std::filesystem::path> ground_truth_;
  std::vector<std::string> damaged_, notes_;
  cv::Size size_;        // of the last undamaged frame
  cv::Size first_size_;  // of the first frame returned
  int position_ = 0, frame_count_ = 0, rotation_ = 0;
  double fps_ = 25;
  bool decoded_ = false, measured_ = false, is_file_ = false, scaled_ = false;
};

/// "frame9" before "frame10": runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b);

}  // namespace asterism::tools
