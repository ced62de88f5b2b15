#include <asterism/trackers/tracker/tracker.hpp>
#include <iostream>
#include <opencv2/videoio.hpp>

int main(int argc, char** argv) {
  cv::VideoCapture video;
  cv::Mat image;
  if (argc != 2 || !video.open(argv[1]) || !video.read(image)) return std::cerr << "usage: track VIDEO\n", 1;
  asterism::AnyTracker tracker = asterism::make_tracker("dpt_plus");
  tracker.init(image, {100, 80, 48, 64});  // x, y, width, height
  while (video.read(image)) {
    const asterism::TrackResult result = tracker.update(image);
    std::cout << result.box << " " << result.confidence << (result.lost ? " lost\n" : "\n");
  }
}
