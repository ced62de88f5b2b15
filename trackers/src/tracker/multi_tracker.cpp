#include <asterism/solver/run/executor.hpp>
#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <stdexcept>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {

MultiTracker::MultiTracker(int threads) : threads_(threads) {
  if (threads < 0) throw std::invalid_argument("MultiTracker: threads must not be negative");
}

void MultiTracker::add(int id, AnyTracker tracker, const cv::Mat& image, const cv::Rect2d& box) {
  add(id, std::move(tracker), first_frame(image), box);
}

void MultiTracker::add(int id, AnyTracker tracker, const Frame& frame, const cv::Rect2d& box) {
  if (objects_.contains(id))
    throw std::invalid_argument("MultiTracker: there is an object " + std::to_string(id) + " already");
  tracker.init(frame, box);
  objects_.emplace(id, std::move(tracker));
}

std::vector<MultiTracker::Object> MultiTracker::update(const cv::Mat& image) { return update(Frame(image)); }

std::vector<MultiTracker::Object> MultiTracker::update(const Frame& frame) {
  std::vector<Object> found;
  std::vector<AnyTracker*> trackers;
  for (auto& [id, tracker] : objects_) {
    found.push_back({.id = id, .result = {}, .error = nullptr});
    trackers.push_back(&tracker);
  }
  const auto track = [&](int task) {
    const auto i = static_cast<std::size_t>(task);
    try {
      found[i].result = trackers[i]->update(frame);
    } catch (...) {
      found[i].error = std::current_exception();
    }
  };
  const auto count = static_cast<int>(found.size());
  if (threads_ == 1)
    SerialExecutor{}(count, track);
  else
    ThreadExecutor{threads_}(count, track);
  return found;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
