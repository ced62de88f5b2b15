// Track with a webcam: draw a box around the object, press Enter; Esc stops.
#include <asterism/trackers/tracker/opencv_tracker.hpp>
#include <iostream>
#include <opencv2/highgui.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

int main() {
  cv::VideoCapture camera(0);
  cv::Mat image;
  if (!camera.read(image)) return std::cerr << "no image from camera 0\n", 1;
  cv::Rect box = cv::selectROI("track", image);
  if (box.empty()) return 0;
  // Was cv::TrackerCSRT::create().
  cv::Ptr<cv::Tracker> tracker = asterism::OpenCvTracker::create("dpt_plus");
  tracker->init(image, box);
  while (camera.read(image)) {
    const bool found = tracker->update(image, box);
    cv::rectangle(image, box, found ? cv::Scalar(0, 255, 0) : cv::Scalar(0, 0, 255), 2);
    cv::imshow("track", image);
    if (cv::waitKey(1) == 27) break;  // Esc
  }
}
