#pragma once

#include <asterism/parts/features/slic.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of SuperpixelTracker.
struct SuperpixelTrackerOptions {
  /// In template pixels and CIELAB.
  SlicOptions slic = {.side = 6, .compactness = 10, .iterations = 5};
  /// The object is resampled so that the geometric mean of its sides is this [template pixels, in [8, 512]],
  /// with `padding` x as much around it on both axes, in (0, 100].
  double template_side = 40;
  double padding = 1.5;
  /// Deviation of a superpixel's mean color from frame to frame, > 0 [CIELAB units].
  double color_sigma = 8;
  /// Each part is linked to as many nearest ones, in [1, 100].
  int neighbours = 6;
  ElasticOptions springs = {.deformation = 0.1, .reach = 0.1};
  /// Rate at which a part's color follows what it matches, in [0, 1].
  double learning_rate = 0.1;
  /// A part that was not matched for so many frames makes place for a new one, > 0.
  int forget_after = 10;
  /// The object is lost where its parts are matched worse than this on average, in [0, 1].
  double lost_below = 0.05;
};

/// A constellation of superpixels, after DGT (Cai et al., "Robust deformable and occluded object tracking
/// with dynamic graph", TIP 2014): the parts are the object's superpixels, candidates those of the frame
/// whose color is rather the object's than its surroundings'. Matching is by color and place; springs to
/// the nearest neighbours are the geometric term. The graph is dynamic: parts that are not matched any more
/// leave, candidates on the object that are no parts join.
class ASTERISM_API SuperpixelTracker : public TrackerBase<SuperpixelTracker> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit SuperpixelTracker(const SuperpixelTrackerOptions& options = {});

  const SuperpixelTrackerOptions& options() const { return options_; }

 private:
  friend TrackerBase<SuperpixelTracker>;
  static constexpr std::string_view kName = "SuperpixelTracker";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  TrackResult standing() const;
  void visit_learned(StateArchive& archive);

  using Points = ElasticConstellation::Points;
  // The superpixels of a window: positions in the image, colors, areas of which the mean is about 1, and
  // how much of the object's color rather than its surroundings', in [0, 1].
  struct Candidates {
    Points positions;
    Eigen::ArrayX3f colors;
    Eigen::ArrayXf areas, foreground;
  };

  Candidates cut(const Frame& frame) const;
  // exp(-|c - c'|^2 / (2 sigma^2)), a row for each of `a`.
  Eigen::ArrayXXf alike(const Eigen::ArrayX3f& a, const Eigen::ArrayX3f& b) const;
  Point2 common_displacement(const Candidates& seen, const Eigen::ArrayXXf& likeness) const;
  void renew(const Candidates& seen);

  SuperpixelTrackerOptions options_;
  ElasticConstellation parts_;
  ObjectPose pose_;
  Eigen::ArrayX3f colors_, background_;  // of the parts, and of what is around the object
  std::vector<int> unseen_;              // frames since each part was matched
  double spacing_ = 1;                   // image pixels a template pixel, in the last frame
  bool color_ = false;                   // learned in color
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
