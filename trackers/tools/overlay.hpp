#pragma once

#include <asterism/trackers/tracker.hpp>
#include <filesystem>
#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

namespace asterism::tools {

/// Where a part of a frame is drawn: magnified by `scale`, its top left corner at `origin` of the frame [px].
struct View {
  double scale = 1;
  cv::Point2d origin;
};

/// The scale at which a frame of this size is drawn so that text on it can be read: small ones are doubled.
double overlay_scale(cv::Size frame);

/// The colour (BGR) of an object's box, counting from 0; that of the first is yellow.
cv::Scalar colour_of(size_t object);

/// Draws the object's box (in `colour`, red where lost), thinly also as it is turned, its parts (blue) as
/// they are turned, and their springs; parts that were not updated, and springs that end in one, are faded.
void draw_track(cv::Mat& canvas, const TrackResult& result, const View& view,
                const cv::Scalar& colour = colour_of(0));

/// Writes white text with a dark outline, readable on any background; `corner` is the top left of its first
/// line.
void draw_text(cv::Mat& canvas, const std::vector<std::string>& lines, cv::Point corner, double size = 0.45);

/// A copy of the frame at `overlay_scale` with the tracks of all objects, the frame's number and `fps` on it;
/// with the stages' times of a single object, or the number of each, from 1, at its box.
cv::Mat draw_overlay(const cv::Mat& frame, std::span<const TrackResult> objects, int number, double fps);

/// Eight frames evenly spread over a run of a length not known before, in two rows, each cut to the object
/// and what is around it. Memory is bounded whatever the run's length.
class ContactSheet {
 public:
  void add(const cv::Mat& frame, const TrackResult& result, int number);
  /// The sheet of what was added until now; empty where nothing was.
  cv::Mat draw() const;

 private:
  struct Entry {
    cv::Mat frame;
    double scale = 1;  // of `frame` to the frame of the input
    TrackResult result;
    int number = 0;
  };
  cv::Size2d region() const;
  static cv::Rect cut(const Entry& entry, const cv::Size2d& region);

  std::vector<Entry> entries_;  // every `stride_`-th frame of the run
  int count_ = 0, stride_ = 1;
};

}  // namespace asterism::tools
