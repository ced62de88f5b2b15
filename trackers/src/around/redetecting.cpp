#include <asterism/trackers/around/redetecting.hpp>
#include <stdexcept>

#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// It has no options, but its state is not that of the tracker in it.
struct NoOptions {};
void visit_options(OptionVisitor&, NoOptions&) {}

}  // namespace

void RedetectingTracker::start(const Frame& frame, const cv::Rect2d& box) {
  tracker_.init(frame, box);
  judge_.init(frame, box);
  search_.init(frame, box);
  size_ = {box.width, box.height};
}

TrackResult RedetectingTracker::follow(const Frame& frame) {
  TrackResult result = tracker_.update(frame);
  if (result.interrupted) {  // the frame shows nothing of the scene
    result.probability = 0;
    return result;
  }
  StageClock clock;
  const BoxJudge::Likeness seen = judge_.compare(frame, result.box);
  judge_.average(seen);
  if (BoxJudge::probability(seen) >= BoxJudge::kLostBelow)
    size_ = {result.box.width, result.box.height};
  else
    search(frame, result);
  result.probability = BoxJudge::probability(judge_.likeness());
  result.lost = *result.probability < BoxJudge::kLostBelow;
  result.times.push_back({"search", clock.lap()});
  return result;
}

void RedetectingTracker::search(const Frame& frame, TrackResult& result) {
  const ObjectSearch::Found found = search_.find(frame, size_, judge_);
  if (found.probability < kAccept) return;
  try {
    tracker_.init(frame, found.box);
  } catch (const std::invalid_argument&) {  // no tracker can start there, and it goes on as before
    return;
  }
  result = tracker_.update(frame);
  judge_.restart(found.likeness);
}

void RedetectingTracker::visit_learned(StateArchive& archive) {
  archive.begin("redetecting", NoOptions());
  tracker_.visit_state(archive);
  judge_.visit_state(archive);
  search_.visit_state(archive);
  archive.size(size_);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
