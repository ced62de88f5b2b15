// Frames in which trackers did worst.
#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "report_internal.hpp"

namespace asterism::bench {
namespace {

constexpr std::size_t kPictures = 12;
constexpr int kPictureWidth = 360;  // [px]

std::string base64(const std::vector<unsigned char>& bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k <= bytes.size() ? kDigits[word >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

void draw(cv::Mat& image, const Region& region, double scale, const cv::Scalar& color) {
  constexpr int kShift = 4;          // polylines in sixteenths of a pixel
  constexpr double kFarthest = 1e5;  // [px], so that coordinates fit an int
  std::vector<cv::Point> points;
  for (const cv::Point2d& point : region.points()) {
    const auto place = [&](double x) {
      return cv::saturate_cast<int>(std::clamp(x * scale, -kFarthest, kFarthest) * (1 << kShift));
    };
    points.emplace_back(place(point.x), place(point.y));
  }
  cv::polylines(image, points, true, cv::Scalar::all(0), 4, cv::LINE_AA, kShift);
  cv::polylines(image, points, true, color, 2, cv::LINE_AA, kShift);
}

std::string picture(const Campaign& campaign, const Loss& loss) {
  const Sequence& sequence = campaign.sequences[loss.sequence];
  const cv::Mat frame = FrameReader(sequence)(loss.frame);
  const double scale = static_cast<double>(kPictureWidth) / frame.cols;
  cv::Mat image;
  cv::resize(frame, image, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  if (const auto truth = truth_of(sequence, loss.frame, campaign.options))
    draw(image, *truth, scale, cv::Scalar::all(255));
  if (loss.region) draw(image, *loss.region, scale, cv::Scalar(0, 159, 255));
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, 80}))
    throw std::runtime_error("OpenCV cannot encode JPEG images");
  return base64(bytes);
}

}  // namespace

std::vector<Picture> worst_pictures(const Campaign& campaign, const Analysis& analysis) {
  const std::size_t share = std::max<std::size_t>(1, kPictures / analysis.trackers.size());
  std::vector<Picture> worst, others;
  for (const TrackerScores& tracker : analysis.trackers)
    for (std::size_t i = 0; i < tracker.losses.size(); ++i)
      (i < share ? worst : others).push_back({tracker.name, tracker.losses[i], {}});
  const auto by_cost = [](std::vector<Picture>& pictures) {
    std::ranges::stable_sort(pictures, std::greater(),
                             [](const Picture& picture) { return picture.loss.cost; });
  };
  by_cost(others);
  worst.insert(worst.end(), others.begin(), others.end());
  // With more trackers than pictures, only the costliest losses are shown.
  if (analysis.trackers.size() > kPictures) by_cost(worst);
  worst.resize(std::min(worst.size(), kPictures));
  by_cost(worst);
  for (Picture& one : worst) one.jpeg = picture(campaign, one.loss);
  return worst;
}

}  // namespace asterism::bench
