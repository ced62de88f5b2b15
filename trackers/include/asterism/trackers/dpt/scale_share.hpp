#pragma once

#include <asterism/parts/models/scale_filter.hpp>
#include <asterism/trackers/constellation/pose.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The share of a scale filter in the object's size: an addition to lines 4 and 6 of Algorithm 2. In the
/// paper the constellation alone gives the size.
class ASTERISM_API ScaleShare {
 public:
  /// share: weight of the filter in the logarithm of the size, in [0, 1]. 0: there is no filter, and nothing
  /// below does anything.
  ScaleShare(const ScaleFilterOptions& options, double share) : filter_(options), share_(share) {}
  bool enabled() const { return share_ > 0; }

  /// Learn the object.
  void init(const Frame& frame, const ObjectPose& pose);
  /// The factor by which the object at `centre` has grown in this frame; by_constellation: the factor that
  /// the constellation finds.
  double growth(const Frame& frame, const Point2& centre, double by_constellation);
  /// The covariance of centre and logarithm of the size (TrackResult::covariance), which was the
  /// constellation's, becomes that of the shared size.
  void share(Eigen::Matrix3d& covariance) const;
  void adapt(const Frame& frame, const ObjectPose& pose);
  void visit_state(StateArchive& archive);

 private:
  ScaleFilter filter_;
  double share_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
