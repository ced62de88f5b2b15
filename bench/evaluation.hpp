#pragma once

#include <filesystem>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_truth.hpp"

namespace asterism::bench {

/// An annotated sequence in the VOT layout, all images in memory.
struct LoadedSequence {
  std::string name;
  std::vector<cv::Mat> images;
  std::vector<std::optional<tools::Region>> truth;  ///< as many as images; empty: no object
};

/// The sequence folders below `folder` in the order of their names; only those in `only` unless that is
/// empty. Throws std::runtime_error where there is none.
std::vector<std::filesystem::path> find_sequences(const std::filesystem::path& folder,
                                                  const std::vector<std::string>& only = {});
/// Throws std::runtime_error for unreadable images or annotations, or a number of images that is not that of
/// boxes.
LoadedSequence load_sequence(const std::filesystem::path& folder);

/// A running tracker: the box in the next image. Made anew for every (re-)start.
using Step = std::function<cv::Rect2d(const cv::Mat&)>;
using Start = std::function<Step(const cv::Mat&, const cv::Rect2d&)>;

/// Offsets of the start box for repeated runs: none first, then uniform in [-1, 1] px on each axis, the same
/// on every platform.
std::vector<cv::Point2d> start_offsets(int count);

struct OnePass {
  std::vector<double> overlaps;  ///< frames 2 .. n
  double seconds = 0;            ///< in the tracker
  double average_overlap() const;
};
/// The tracker starts on the first box and is never corrected.
OnePass run_one_pass(const Start& start, const LoadedSequence& sequence, const cv::Point2d& offset);

struct Supervised {
  std::vector<double> overlaps;  ///< without the ten frames from each start on (burn-in) and the failures
  int failures = 0;
};
/// The VOT protocol: a frame without any overlap is a failure, five frames later the tracker starts anew.
Supervised run_supervised(const Start& start, const LoadedSequence& sequence, const cv::Point2d& offset);

}  // namespace asterism::bench
