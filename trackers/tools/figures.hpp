#pragma once

#include <asterism/trackers/tracker/tracker.hpp>
#include <opencv2/core.hpp>
#include <vector>

#include "overlay.hpp"
#include "system_recorder.hpp"
#include "thinned.hpp"

namespace asterism::tools {

/// The parts' weights over a run, a strip of time for each, with the threshold of the update gate (gray);
/// above them frames of the run, each at its time. A part's strip is red while it is not updated.
class Timeline {
 public:
  /// `result` has no parts at the run's start. Throws std::runtime_error where a tracker has none in a later
  /// frame, more than 16, or another number than before.
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
  double position(int number) const;  // on the axis of time, in [0, 1]
  void draw_film(const cv::Mat& film) const;
  void draw_strip(cv::Mat strip, std::size_t part, double top) const;

  int frames_ = 0;
  std::vector<Moment> moments_;
  Thinned<Shot> shots_;
};

/// The constellation as its solve starts and as it ends, side by side: parts and springs (stretched: orange,
/// pressed: blue, at most 0.1 % off their nominal length: white), and where each part looks best (crosses).
cv::Mat draw_solve(const cv::Mat& frame, const SolveWatch::Solve& solve, const TrackResult& result,
                   int number);

}  // namespace asterism::tools
