#pragma once

#include <asterism/trackers/tracker/tracker.hpp>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "thinned.hpp"

namespace asterism::tools {

/// Where a part of a frame is drawn: magnified by `scale`, its top left corner at `origin` of the frame [px].
struct View {
  double scale = 1;
  cv::Point2d origin;
};

/// The scale at which a frame of this size is drawn so that text on it can be read: small ones are doubled.
double overlay_scale(cv::Size frame);

/// Draws the object's box (in `color`, red where lost), thinly also as it is turned, its parts (blue) as
/// they are turned, and their springs; parts that were not updated, and springs that end in one, are faded.
void draw_track(cv::Mat& canvas, const TrackResult& result, const View& view,
                const cv::Scalar& color = {0, 255, 255});

/// Writes white text with a dark outline, readable on any background; `corner` is the top left of its first
/// line.
void draw_text(cv::Mat& canvas, const std::vector<std::string>& lines, cv::Point corner, double size = 0.45);

/// A copy of the frame at `overlay_scale` with the tracks of all objects, the frame's number and `fps` on it;
/// with the stages' times of a single object, or the number of each, from 1, at its box.
cv::Mat draw_overlay(const cv::Mat& frame, std::span<const TrackResult> objects, int number, double fps);

/// A copy of a frame in 8-bit BGR.
cv::Mat to_bgr(const cv::Mat& frame);

/// The part of a frame of about the size of `region` around a box [px].
cv::Rect cut_around(cv::Size frame, const cv::Rect2d& box, const cv::Size2d& region);

/// Colors (BGR) that can be told apart, for `index` of `count`.
cv::Scalar color_of(std::size_t index, std::size_t count);

/// A frame kept to be drawn later; large ones are kept smaller.
struct Still {
  Still(const cv::Mat& image, int frame_number);

  /// What is around a box, enlarged or shrunk to fit into a tile, and where that is; all in px of the input.
  cv::Mat cut(const cv::Rect2d& box, const cv::Size2d& region, cv::Size tile, View& view) const;

  cv::Mat frame;
  double scale = 1;  ///< of `frame` to the frame of the input
  int number = 0;    ///< of the frame, from 1
};

/// Eight frames evenly spread over a run of a length not known before, in two rows, each cut to the first
/// tracker's object and what is around it. One tracker is drawn with its parts, of several the boxes alone,
/// with a legend and the ground truth. Memory is bounded whatever the run's length.
class ContactSheet {
 public:
  /// Names of the trackers, at least one.
  explicit ContactSheet(std::vector<std::string> names) : names_(std::move(names)) {}
  /// Results of all trackers, in the order of their names.
  void add(const cv::Mat& frame, const std::vector<TrackResult>& results,
           const std::optional<cv::Rect2d>& truth, int number);
  /// The sheet of what was added until now; empty where nothing was.
  cv::Mat draw() const;

 private:
  struct Entry {
    Still still;
    std::vector<TrackResult> results;
    std::optional<cv::Rect2d> truth;
  };
  cv::Size2d region() const;
  void draw_tile(cv::Mat& tile, const Entry& entry, const View& view) const;
  void draw_legend(cv::Mat& sheet) const;

  std::vector<std::string> names_;
  Thinned<Entry> entries_;
};

}  // namespace asterism::tools
