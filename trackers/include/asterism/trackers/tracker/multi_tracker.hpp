#pragma once

#include <asterism/trackers/tracker/tracker.hpp>
#include <exception>
#include <map>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Several objects in one video, each with a tracker of its own: the frame is converted once for all of them,
/// and they are tracked in parallel. Objects do not influence each other: the results are those of single
/// trackers, bit for bit, for any number of threads.
class ASTERISM_API MultiTracker {
 public:
  /// threads: number of threads for tracking, including the calling one; 0: as many as the machine runs at
  /// once. Throws std::invalid_argument if negative. Give the trackers in it one thread each.
  explicit MultiTracker(int threads = 1);

  /// Follow an object from this image on; `box` as for Tracker. Throws std::invalid_argument if there already
  /// is an object of that id, and what the tracker's `init` throws; then nothing is added.
  void add(int id, AnyTracker tracker, const cv::Mat& image, const cv::Rect2d& box);
  /// The same with a frame, which further objects may start on as well.
  void add(int id, AnyTracker tracker, const Frame& frame, const cv::Rect2d& box);
  /// On the region's equal_area_box.
  void add(int id, AnyTracker tracker, const cv::Mat& image, const Region& region) {
    add(id, std::move(tracker), image, region.equal_area_box());
  }
  void add(int id, AnyTracker tracker, const Frame& frame, const Region& region) {
    add(id, std::move(tracker), frame, region.equal_area_box());
  }
  /// Removes an object; false if there is none of that id.
  bool remove(int id) { return objects_.erase(id) > 0; }
  /// Number of objects.
  std::size_t size() const { return objects_.size(); }

  /// The result of one object.
  struct Object {
    int id = 0;                ///< as given to `add`
    TrackResult result;        ///< valid if there is no error
    std::exception_ptr error;  ///< what its tracker threw, or null
  };
  /// All objects in the next image, by ascending id. Throws std::invalid_argument for an image that Frame
  /// refuses. What a tracker throws becomes its object's `error` and does not affect the others; the object
  /// stays, and continues with the next image as its tracker does after an exception.
  std::vector<Object> update(const cv::Mat& image);
  std::vector<Object> update(const Frame& frame);

 private:
  int threads_;
  std::map<int, AnyTracker> objects_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
