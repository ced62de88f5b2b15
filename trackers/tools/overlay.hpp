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

/// A magnified section of a frame: by `scale`, with its top left corner at `origin` in the frame [px].
struct View {
  double scale = 1;
  cv::Point2d origin;
};

/// The scale at which text on a frame of this size is readable: small frames are doubled.
double overlay_scale(cv::Size frame);

/// Draws the object's box (in `color`, red if lost), its rotated box with a thin line, its parts (blue),
/// rotated too, and their springs. Parts that were not updated and their springs are faded.
void draw_track(cv::Mat& canvas, const TrackResult& result, const View& view,
                const cv::Scalar& color = {0, 255, 255});

/// Writes white text with a dark outline, readable on any background; `corner` is the top left of its first
/// line.
void draw_text(cv::Mat& canvas, const std::vector<std::string>& lines, cv::Point corner, double size = 0.45);

/// A copy of the frame at `overlay_scale` with the tracks of all objects, the frame's number and `fps`; for a
/// single object also the times of the stages, for several each object's number, from 1, at its box.
cv::Mat draw_overlay(const cv::Mat& frame, std::span<const TrackResult> objects, int number, double fps);

/// A copy of a frame in 8-bit BGR.
cv::Mat to_bgr(const cv::Mat& frame);

/// The section of a frame of about the size of `region` around a box [px].
cv::Rect cut_around(cv::Size frame, const cv::Rect2d& box, const cv::Size2d& region);

/// Colors (BGR) that can be told apart, for `index` of `count`.
cv::Scalar color_of(std::size_t index, std::size_t count);

/// A frame kept to be drawn later; large ones are stored at a smaller size.
struct Still {
  Still(const cv::Mat& image, int frame_number);

  /// The surroundings of a box, enlarged or shrunk to fit into a tile; `view` receives their place. All in px
  /// of the input.
  cv::Mat cut(const cv::Rect2d& box, const cv::Size2d& region, cv::Size tile, View& view) const;

  cv::Mat frame;
  double scale = 1;  ///< of `frame` relative to the input's frame
  int number = 0;    ///< of the frame, from 1
};

/// Eight frames, evenly spread over a run whose length is not known in advance, in two rows, each cut to the
/// surroundings of the first tracker's object. A single tracker is drawn with its parts; for several, the
/// boxes are drawn with a legend and the ground truth. Memory is bounded whatever the length of the run.
class ContactSheet {
 public:
  /// Names of the trackers, at least one.
  explicit ContactSheet(std::vector<std::string> names) : names_(std::move(names)) {}
  /// Results of all trackers, in the order of their names.
  void add(const cv::Mat& frame, const std::vector<TrackResult>& results,
           const std::optional<cv::Rect2d>& truth, int number);
  /// The sheet of all frames added so far; empty if there are none.
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
