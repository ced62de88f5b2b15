// What the trackers save.

#include <asterism/trackers/coarse.hpp>
#include <asterism/trackers/dpt.hpp>
#include <asterism/trackers/tracker_options.hpp>
#include <stdexcept>

namespace asterism::inline ASTERISM_ABI {

void CoarseLayer::visit_state(StateArchive& archive) {
  archive.begin("coarse layer", options_);
  archive.position(centre_);
  archive.size(size_);
  root_.visit_state(archive);
  colour_.visit_state(archive);
}

void CoarseTracker::visit_state(StateArchive& archive) {
  if (!archive.loading() && !initialized_) throw std::logic_error("CoarseTracker: to be saved before init");
  layer_.visit_state(archive);
  initialized_ = true;
}

void Dpt::visit_state(StateArchive& archive) {
  if (!archive.loading() && !initialized_) throw std::logic_error("Dpt: to be saved before init");
  DptOptions same = options_;
  same.threads = 1;  // of no influence on results
  archive.begin("dpt", same);
  coarse_.visit_state(archive);
  if (options_.scale_share > 0) scale_.visit_state(archive);
  archive.size(initial_size_);
  archive.size(part_size_);
  archive(angle_);
  placement_.resize(2, part_count());
  for (int i = 0; i < part_count(); ++i) {
    Point2 position = placement_.col(i);
    archive.position(position);
    placement_.col(i) = position;
    parts_[static_cast<std::size_t>(i)].visit_state(archive);
  }
  velocity_.resize(2, part_count());
  archive(velocity_);
  archive(springs_.rest_length);
  archive.require((springs_.rest_length.array() >= 0).all());
  initialized_ = true;
}

}  // namespace asterism::inline ASTERISM_ABI
