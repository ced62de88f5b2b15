#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/patch.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Keypoints; the matching is that of CMT (Nebehay and Pflugfelder, CVPR 2015).
struct KeypointsOptions {
  /// Maximum number of key-points in the search window, the strongest ones, in [1, 5000]; FAST's threshold
  /// [gray levels], in [1, 255].
  int max_points = 400;
  int fast_threshold = 10;
  /// A match differs in at most this share of the descriptor's bits, in (0, 1].
  double max_distance = 0.25;
  /// A match differs in fewer bits than this factor times those of the second best one, in (0, 1].
  double max_ratio = 0.8;
  /// Votes within this distance agree [template pixels, in (0, 1024]].
  double vote_radius = 10;
  /// The search window: padding in (0, 100], sides in [16, 1024]. The descriptors see 31 template pixels.
  TemplateWindow window = {.padding = 1.5, .min_template_side = 64, .max_template_side = 96};
};

/// Binary key-points (ORB at one scale) that vote for the target's position, as in CMT. A PartModel; copies
/// are independent.
///
/// Each key-point learned on the target votes, where it is matched, for the position that it had the same
/// offset from. The largest group of votes that agree gives the position, their mean; the peak is their
/// number over that of the learned key-points (over 5 where those are fewer), so that occlusion is a low
/// peak. Without two votes that agree the peak is 0, the position that of the search and the covariance the
/// window's.
class ASTERISM_API Keypoints {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Keypoints(const KeypointsOptions& options = {});

  /// Learn the key-points on a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Let them vote; of those that are matched to one seen key-point, only the one most like it does. The
  /// covariance is the scatter of the n votes that agree plus vote_radius^2 / n.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Key-points that are where they belong (a match, at most vote_radius away, and nearer to no other's
  /// place) take the descriptor that they have there. Offsets stay: the model follows the appearance and does
  /// not drift.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// Visits what has been learned, for save_state.
  void visit_state(StateArchive& archive);
  /// Number of learned key-points.
  int size() const { return static_cast<int>(offsets_.size()); }

  const KeypointsOptions& options() const { return options_; }

 private:
  // Key-points of a window around a position: offsets from it [template pixels], descriptors row by row.
  struct Detection {
    std::vector<Point2> offsets;
    cv::Mat descriptors;
  };

  Size2 window() const { return spacing_ * Size2(cols_, rows_); }
  // What follows from the size.
  void prepare(const Size2& size);
  Detection detect(const Frame& frame, const Point2& centre);

  KeypointsOptions options_;
  Size2 size_ = Size2::Zero();   // of the target [px], 0 before init
  double spacing_ = 1;           // image pixels a template pixel
  int rows_ = 0, cols_ = 0;      // of the search window [template pixels]
  std::vector<Point2> offsets_;  // of the learned key-points from the target's centre [template pixels]
  cv::Mat descriptors_;          // theirs; never written again: copies share them
  ResponsePeak response_;

  Scratch patch_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
