#pragma once

#include <asterism/trackers/tracker/tracker.hpp>
#include <opencv2/core.hpp>
#include <vector>

#include "overlay.hpp"
#include "system_recorder.hpp"
#include "thinned.hpp"

namespace asterism::tools {

/// The parts' weights over a run: a strip along time for each, with the threshold of the update gate (gray),
/// and above them frames of the run at their times. The strip of a part is red while it is not updated.
class Timeline {
 public:
  /// `result` may lack parts only at the start of the run. Throws std::runtime_error if a later one has none,
  /// more than 16, or a different number than before.
  void add(const cv::Mat& frame, const TrackResult& result, int number);
  /// Empty before the first frame with parts.
  cv::Mat draw() const;

 private:
  struct Moment {
    int number = 0;
    double threshold = 0;
    std::vector<double> weights;
    std::vector<bool> updated;
  };
  struct Shot {
    Still still;
    TrackResult result;
  };
  double position(int number) const;  // on the time axis, in [0, 1]
  void draw_film(const cv::Mat& film) const;
  void draw_strip(cv::Mat strip, std::size_t part, double top) const;

  int frames_ = 0;
  std::vector<Moment> moments_;
  Thinned<Shot> shots_;
};

/// The constellation before and after its solve, side by side: parts and springs (stretched: orange,
/// compressed: blue, at most 0.1 % off their nominal length: white), and the best match of each part
/// (crosses).
cv::Mat draw_solve(const cv::Mat& frame, const SolveWatch::Solve& solve, const TrackResult& result,
                   int number);

}  // namespace asterism::tools
