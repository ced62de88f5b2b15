#include <filesystem>
#include <initializer_list>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/tracking.hpp>
#include <opencv2/tracking/tracking_legacy.hpp>
#include <stdexcept>
#include <string>

#include "isolated.hpp"
#include "peers_internal.hpp"

namespace asterism::bench {
namespace {

constexpr int kSeed = 1;

// This interface takes whole pixels only.
template <class Tracker>
Step start(const Image& image, const Region& object) {
  cv::setRNGSeed(kSeed);
  const cv::Rect2d b = object.equal_area_box();
  auto tracker = Tracker::create();
  tracker->init(image.pixels, {cvRound(b.x), cvRound(b.y), cvRound(b.width), cvRound(b.height)});
  return [tracker](const Image& next) {
    Report report;
    if (cv::Rect box; tracker->update(next.pixels, box)) report.region = Region::rectangle(box);
    return report;
  };
}

template <class Tracker>
Step start_legacy(const Image& image, const Region& object) {
  cv::setRNGSeed(kSeed);
  auto tracker = Tracker::create();
  const cv::Rect2d box = object.equal_area_box();
  if (!tracker->init(image.pixels, box)) throw std::runtime_error("the tracker refuses to start");
  return [tracker, last = box](const Image& next) mutable {
    Report report;
    if (tracker->update(next.pixels, last)) report.region = Region::rectangle(last);
    return report;
  };
}

// Adds a neural tracker if its network's files are there, under the names that OpenCV expects by default.
template <class Tracker>
void add_network(std::map<std::string, Start>& peers, const std::string& name,
                 std::initializer_list<std::string> files) {
  for (const std::string& file : files)
    if (!std::filesystem::exists(file)) return;
  peers[name] = start<Tracker>;
}

void add_networks(std::map<std::string, Start>& peers) {
  const cv::TrackerGOTURN::Params goturn;
  add_network<cv::TrackerGOTURN>(peers, "opencv-goturn", {goturn.modelTxt, goturn.modelBin});
  const cv::TrackerDaSiamRPN::Params dasiamrpn;
  add_network<cv::TrackerDaSiamRPN>(peers, "opencv-dasiamrpn",
                                    {dasiamrpn.model, dasiamrpn.kernel_cls1, dasiamrpn.kernel_r1});
#if CV_VERSION_MAJOR > 4 || CV_VERSION_MINOR >= 7
  const cv::TrackerNano::Params nano;
  add_network<cv::TrackerNano>(peers, "opencv-nano", {nano.backbone, nano.neckhead});
#endif
#if CV_VERSION_MAJOR > 4 || CV_VERSION_MINOR >= 9
  const cv::TrackerVit::Params vit;
  add_network<cv::TrackerVit>(peers, "opencv-vit", {vit.net});
#endif
}

}  // namespace

void add_opencv_peers(std::map<std::string, Start>& peers) {
  peers["opencv-csrt"] = start<cv::TrackerCSRT>;
  peers["opencv-kcf"] = start<cv::TrackerKCF>;
  peers["opencv-mil"] = start<cv::TrackerMIL>;
  peers["opencv-mosse"] = start_legacy<cv::legacy::TrackerMOSSE>;
  peers["opencv-medianflow"] = start_legacy<cv::legacy::TrackerMedianFlow>;
  peers["opencv-tld"] = start_legacy<cv::legacy::TrackerTLD>;
  // It crashes on a null pointer if the object leaves the image.
  peers["opencv-boosting"] = isolated(start_legacy<cv::legacy::TrackerBoosting>);
  add_networks(peers);
}

}  // namespace asterism::bench
