#include "made_videos.hpp"

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string_view>

namespace asterism::bench {

namespace {

// The object leaves before this frame, or after a third of a shorter sequence, ...
constexpr std::size_t kLeaves = 40;
// ... and is followed for so many frames when it is back.
constexpr std::size_t kAfter = 60;

// A slightly different start or slightly different images.
struct Perturbation {
  std::string_view name;
  int dx, dy;   // how far the start box is moved [px]
  int quality;  // of JPEG, at which all images are compressed again; 0: they stay as they are
};
constexpr std::array<Perturbation, 6> kPerturbations{{{"left", -1, 0, 0},
                                                      {"right", 1, 0, 0},
                                                      {"up", 0, -1, 0},
                                                      {"down", 0, 1, 0},
                                                      {"jpeg-95", 0, 0, 95},
                                                      {"jpeg-85", 0, 0, 85}}};

// The pixels that a box covers with a margin of a fifth of its sides.
cv::Rect around(const cv::Rect2d& box, const cv::Size& image) {
  constexpr double kMargin = 0.2;
  return cv::Rect(
             cv::Point(cv::Point2d(box.x - kMargin * box.width, box.y - kMargin * box.height)),
             cv::Point(cv::Point2d(box.x + (1 + kMargin) * box.width, box.y + (1 + kMargin) * box.height))) &
         cv::Rect({}, image);
}

// The image beside the object in place of the object.
cv::Mat without_object(const cv::Mat& image, const cv::Rect2d& box) {
  const cv::Rect all({}, image.size());
  const cv::Rect hole = around(box, image.size());
  cv::Mat result = image.clone();
  if (hole.empty()) return result;
  for (const cv::Point step : {cv::Point(-hole.width, 0), cv::Point(hole.width, 0),
                               cv::Point(0, -hole.height), cv::Point(0, hole.height)})
    if (((hole + step) & all) == hole + step) {
      image(hole + step).copyTo(result(hole));
      return result;
    }
  result(hole) = cv::mean(image);
  return result;
}

// Another object in place of the object.
cv::Mat with_other(const cv::Mat& image, const cv::Rect2d& box, const Shown& other) {
  cv::Mat result = image.clone();
  const cv::Rect hole = around(box, image.size());
  const cv::Rect theirs = around(other.truth.value_or(cv::Rect2d()), other.image.size());
  if (hole.empty() || theirs.empty()) return result;
  cv::Mat object;
  cv::resize(other.image(theirs), object, hole.size(), 0, 0, cv::INTER_AREA);
  object.copyTo(result(hole));
  return result;
}

Shown resized(const Shown& frame, const cv::Size& size) {
  Shown result{{}, {}, true};
  cv::resize(frame.image, result.image, size, 0, 0, cv::INTER_AREA);
  return result;
}

// Shifted to the right by half the width, around the border.
Shown shifted(const Shown& frame) {
  const int width = frame.image.cols, by = width / 2;
  Shown result{cv::Mat(frame.image.size(), frame.image.type()), {}, frame.absent};
  frame.image.colRange(0, width - by).copyTo(result.image.colRange(by, width));
  frame.image.colRange(width - by, width).copyTo(result.image.colRange(0, by));
  if (!frame.truth) return result;
  cv::Rect2d box = *frame.truth;
  const double seam = width - by;
  if (box.x < seam && box.x + box.width > seam) return result;
  box.x += box.x < seam ? by : by - width;
  result.truth = box;
  return result;
}

Video perturbed(Video video, const Perturbation& by) {
  if (!video.empty() && video[0].truth) *video[0].truth += cv::Point2d(by.dx, by.dy);
  if (by.quality > 0)
    for (Shown& frame : video) frame.image = compressed(frame.image, by.quality);
  return video;
}

}  // namespace

void check_kind(const std::string& kind) {
  std::vector<std::string_view> kinds{"pass", "covered", "masked", "cut", "elsewhere"};
  for (const Perturbation& perturbation : kPerturbations) kinds.push_back(perturbation.name);
  if (std::ranges::find(kinds, kind) != kinds.end()) return;
  std::string known;
  for (const std::string_view name : kinds) known += (known.empty() ? "" : ", ") + std::string(name);
  throw std::invalid_argument("unknown kind '" + kind + "' (known: " + known + ")");
}

Video shown(const Sequence& sequence, std::size_t most) {
  Video video;
  FrameReader reader(sequence);
  for (std::size_t t = 0; t < std::min(most, sequence.length()); ++t) {
    const std::optional<Region>& truth = sequence.truth[t];
    video.push_back({reader(t).clone(), truth ? std::optional(truth->equal_area_box()) : std::nullopt});
  }
  return video;
}

Video made_video(const std::string& kind, const Video& video, const Video& other, std::size_t away) {
  check_kind(kind);
  if (kind == "pass") return video;
  for (const Perturbation& perturbation : kPerturbations)
    if (kind == perturbation.name) return perturbed(video, perturbation);
  const bool covered = kind == "covered", masked = kind == "masked", elsewhere = kind == "elsewhere";
  const std::size_t leaves = std::min(kLeaves, video.size() / 3), missed = std::min(away, video.size() / 4),
                    back = leaves + missed, end = std::min(video.size(), back + kAfter);
  Video result(video.begin(), video.begin() + static_cast<std::ptrdiff_t>(leaves));
  if (covered || masked) {
    for (std::size_t t = leaves; t < end; ++t) {
      const Shown& frame = video[t];
      if (t >= back || !frame.truth)
        result.push_back(frame);
      else if (covered)
        result.push_back({without_object(frame.image, *frame.truth), {}, true});
      else
        result.push_back(
            {with_other(frame.image, *frame.truth, other[(t - leaves) % other.size()]), {}, true});
    }
    return result;
  }
  for (std::size_t t = 0; t < std::min(away, other.size()); ++t)
    result.push_back(resized(other[t], video[0].image.size()));
  for (std::size_t t = leaves + missed / 3; t < end; ++t)
    result.push_back(elsewhere ? shifted(video[t]) : video[t]);
  return result;
}

}  // namespace asterism::bench
