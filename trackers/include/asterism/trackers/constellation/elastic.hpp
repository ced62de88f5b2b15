#pragma once

#include <asterism/parts/concept/part_model.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/constellation/spring_constellation.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of ElasticConstellation.
struct ElasticOptions {
  /// Deviation of a link's length from that of the layout, relative to it, > 0: the larger, the softer.
  double deformation = 0.1;
  /// An anchor lets go of its part beyond this distance [object's mean side, > 0].
  double reach = 0.1;
  /// Of the solve in each frame.
  SolverOptions solver = {.tolerance = 1e-4, .max_iterations = 200};
};

/// Parts of any number, which may come and go, on robust anchors, as Lgt has them.
///
/// The energy is a negative log-probability. A part is where its evidence says by a Gaussian of information
/// peak x covariance^-1, with the loss of Geman and McClure, so that one that is wrong does not matter; a
/// link is as long as in the layout, under the object's scale, but for a Gaussian of `deformation`.
class ASTERISM_API ElasticConstellation : public SpringConstellation<ElasticSystem> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit ElasticConstellation(const ElasticOptions& options = {});

  /// The parts and who is linked to whom from now on. layout: positions in the object (ObjectPose);
  /// placement: in the image.
  void assign(const Points& layout, const Points& placement, Topology<> topology);
  /// The MAP placement, from the one that is there on. Evidence of peak 0 anchors nothing; parts that no
  /// anchor holds keep to those that one does. The placement stays where the solver fails.
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
  ElasticSolver solver_;
};

/// The edges of the Delaunay triangulation of points (2 x N, finite) in the plane; of points on a line, or
/// fewer than three, all pairs. Of points that coincide one is linked.
ASTERISM_API Topology<> delaunay(const ElasticConstellation::Points& points);

/// How the object moved, by the parts' evidence alone: the transform of the layout that most of it agrees
/// with, within the constellation's reach.
ASTERISM_API RobustTransform fit_pose(const ElasticConstellation::Points& layout,
                                      const ElasticConstellation::Points& placed,
                                      const Eigen::VectorXd& weights, const ObjectPose& pose, double reach);

}  // namespace ASTERISM_ABI
}  // namespace asterism
