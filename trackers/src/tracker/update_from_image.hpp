#pragma once

#include <asterism/trackers/tracker/tracker.hpp>

#include "stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

/// A tracker's update from an image by that from a frame, whose conversion becomes the first stage.
template <class T>
TrackResult update_from_image(T& tracker, const cv::Mat& image) {
  StageClock clock;
  const Frame frame(image);
  const double milliseconds = clock.lap();
  TrackResult result = tracker.update(frame);
  result.times.insert(result.times.begin(), {"frame", milliseconds});
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
