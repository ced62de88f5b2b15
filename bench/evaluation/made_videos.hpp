#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "dataset.hpp"

namespace asterism::bench {

/// What a tracker is shown in a frame. Without `truth` the frame does not count, unless the object is known
/// to be absent.
struct Shown {
  cv::Mat image;
  std::optional<cv::Rect2d> truth;
  bool absent = false;
};
using Video = std::vector<Shown>;

/// Throws std::invalid_argument, which lists the kinds of made_video, for any other.
void check_kind(const std::string& kind);

/// The first frames of a sequence, `most` at most, as they are.
Video shown(const Sequence& sequence, std::size_t most);

/// A video made of a sequence. The same arguments make the same video. In these kinds the whole sequence is
/// shown:
///
/// - "pass": as it is;
/// - "left", "right", "up", "down": the true box of the first frame, on which trackers start, is one pixel
///   away in this direction;
/// - "jpeg-95", "jpeg-85": the images are compressed once more, by JPEG of this quality.
///
/// In the others, the object leaves after 40 frames, or after a third of a shorter sequence, is away for
/// `away` frames, and is then followed for 60 more:
///
/// - "covered": the image beside the object covers it; the scene goes on, for at most a quarter of the
///   sequence;
/// - "masked": the object of `other` covers it, in the same way;
/// - "cut": frames of `other` are shown; then the sequence goes on `away` / 3 frames later;
/// - "elsewhere": as "cut", and from then on the images are shifted to the right by half their width; what is
///   shifted out at the right comes in at the left. Frames in which the object is cut by this do not count.
///
/// Throws as check_kind.
Video made_video(const std::string& kind, const Video& video, const Video& other, std::size_t away);

}  // namespace asterism::bench
