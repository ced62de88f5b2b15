#pragma once

#include <asterism/parts/concept/part_model.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/constellation/spring_constellation.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of ElasticConstellation.
struct ElasticOptions {
  /// Relative deviation of a link's length from that in the layout, > 0: the larger, the softer.
  double deformation = 0.1;
  /// Beyond this distance an anchor hardly pulls at its part [mean sides of the object], > 0.
  double reach = 0.1;
  /// Options of the solve in each frame.
  SolverOptions solver = {.tolerance = 1e-4, .max_iterations = 200};
};

/// Any number of parts, which may be added and removed, on robust anchors: those of Lgt.
///
/// The energy is a negative log-probability. A part's position is distributed about that of its evidence with
/// information peak x covariance^-1, under the loss of Geman and McClure, so that wrong evidence has little
/// effect. A link's length is Gaussian about that in the layout, at the object's scale, by `deformation`.
class ASTERISM_API ElasticConstellation : public SpringConstellation {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit ElasticConstellation(const ElasticOptions& options = {});

  /// Sets the parts and their links. layout: positions in the object (ObjectPose);
  /// placement: in the image.
  void assign(const Points& layout, const Points& placement, const Topology<>& topology);
  /// Moves the placement to the MAP placement, starting from the present one. Evidence of peak 0 has no
  /// anchor; its part is held by its links. If the solver fails, the placement stays as it was.
  Summary place(const ObjectPose& pose, std::span<const Evidence> evidence);

  /// The parts' positions in the object.
  const Points& layout() const { return layout_; }
  /// The layout in the image.
  Points posed(const ObjectPose& pose) const;

  /// Parts, links and placement.
  void visit_state(StateArchive& archive);

 private:
  ElasticOptions options_;
  Points layout_;
};

/// The edges of the Delaunay triangulation of points (2 x N, finite) in the plane; of points on a line, or
/// fewer than three, all pairs. If points coincide, one of them is linked.
ASTERISM_API Topology<> delaunay(const ElasticConstellation::Points& points);

/// The motion of the object by the parts' evidence alone: the transform of the layout with which most of the
/// evidence agrees, within the constellation's reach.
ASTERISM_API RobustTransform fit_pose(const ElasticConstellation::Points& layout,
                                      const ElasticConstellation::Points& placed,
                                      const Eigen::VectorXd& weights, const ObjectPose& pose, double reach);

}  // namespace ASTERISM_ABI
}  // namespace asterism
