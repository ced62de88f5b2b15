#pragma once

#include <asterism/parts/concept/part_model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <memory>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Where an object is: the similarity that takes positions in the object, pixels of its first frame about its
/// centre, to the image.
class ASTERISM_API ObjectPose {
 public:
  /// The box keeps to this range of its first size, whatever a collapsed or burst constellation says.
  static constexpr double kMinScale = 0.1, kMaxScale = 10;

  ObjectPose() = default;
  /// Where the object is in its first frame.
  explicit ObjectPose(const cv::Rect2d& box) : first_size_(box.width, box.height) {
    transform_.translation = centre_of(box);
  }

  /// From positions in the object to the image.
  const PlaneTransform& transform() const { return transform_; }
  /// The object moves by a transform of the image; its size keeps to the range above.
  void move(const PlaneTransform& transform);
  /// The centre stays in the image (kept_in_image).
  void keep_in(const Frame& frame);
  void visit_state(StateArchive& archive);

  /// The box now, and its size in the first frame [px].
  Point2 centre() const { return transform_.translation; }
  Size2 size() const { return transform_.scale * first_size_; }
  const Size2& first_size() const { return first_size_; }
  /// Geometric mean of the box's sides [px].
  double mean_side() const { return std::sqrt(size().x()) * std::sqrt(size().y()); }
  /// Axis-aligned: it does not turn with the object.
  cv::Rect2d box() const { return box_around(centre(), size()); }
  /// In the object's box of the first frame.
  bool covers(const Point2& in_object) const {
    return (in_object.cwiseAbs().array() <= first_size_.array() / 2).all();
  }

 private:
  PlaneTransform transform_;
  Size2 first_size_ = Size2::Ones();
};

/// Options of ElasticConstellation.
struct ElasticOptions {
  /// Deviation of a link's length from that of the layout, relative to it, > 0: the larger, the softer.
  double deformation = 0.1;
  /// An anchor lets go of its part beyond this distance [object's mean side, > 0].
  double reach = 0.1;
  /// Of the solve in each frame.
  SolverOptions solver = {.tolerance = 1e-4, .max_iterations = 200};
};

/// Parts of any number, which may come and go, on robust anchors: what the trackers beside DPT share.
///
/// The energy is a negative log-probability. A part is where its evidence says by a Gaussian of information
/// peak x covariance^-1, with the loss of Geman and McClure, so that one that is wrong does not matter; a
/// link is as long as in the layout, under the object's scale, but for a Gaussian of `deformation`.
class ASTERISM_API ElasticConstellation {
 public:
  /// The type of its spring system.
  using Springs = SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic,
                               Model<Hooke, GemanMcClure, AnchorShape::Anisotropic>>;
  using Points = Springs::Points;  ///< 2 x N, a part is a column

  /// Throws std::invalid_argument for options out of range.
  explicit ElasticConstellation(const ElasticOptions& options = {});

  /// The parts and who is linked to whom from now on. layout: positions in the object (ObjectPose).
  void assign(const Points& layout, Topology<> topology);
  /// The MAP placement, from the start x (2 x N) on. Evidence of peak 0 anchors nothing; parts that no anchor
  /// holds keep to those that one does. x stays where the solver fails.
  Summary place(const ObjectPose& pose, std::span<const Evidence> evidence, Points& x);

  /// The parts' positions in the object.
  const Points& layout() const { return layout_; }
  /// A part's position in the object learns: it moves by `rate` towards that of the placement x.
  void relax(const ObjectPose& pose, const Points& x, double rate);
  /// The layout in the image.
  Points posed(const ObjectPose& pose) const;
  /// Number of parts, and who is linked to whom.
  int size() const { return static_cast<int>(layout_.cols()); }
  std::vector<Link> links() const { return {springs_.links().begin(), springs_.links().end()}; }

  /// Parts and links, and the parts' placement x (2 x N).
  void visit_state(StateArchive& archive, Points& x);

 private:
  // The solver, whose workspace cannot be copied: a copy of the constellation has its own.
  class Solver {
   public:
    Solver();
    Solver(const Solver&);
    Solver& operator=(const Solver&) { return *this; }
    ~Solver();
    Summary solve(const Springs& springs, Points& x, const SolverOptions& options);

   private:
    struct Workspace;
    std::unique_ptr<Workspace> workspace_;
  };

  ElasticOptions options_;
  Points layout_;
  Springs springs_;
  Solver solver_;
};

/// The edges of the Delaunay triangulation of points (2 x N, finite) in the plane; of points on a line, or
/// fewer than three, all pairs. Of points that coincide one is linked.
ASTERISM_API Topology<> delaunay(const ElasticConstellation::Points& points);

/// The result of a tracker whose object, and whose parts at x (2 x N), stay where they are. part_size: in the
/// image [px].
ASTERISM_API TrackResult standing_result(const ObjectPose& pose, const ElasticConstellation& parts,
                                         const ElasticConstellation::Points& x, const Size2& part_size);

/// How the object moved, by the parts' evidence alone: the transform of the layout that most of it agrees
/// with, within the constellation's reach.
ASTERISM_API RobustTransform fit_pose(const ElasticConstellation::Points& layout,
                                      const ElasticConstellation::Points& placed,
                                      const Eigen::VectorXd& weights, const ObjectPose& pose, double reach);

}  // namespace ASTERISM_ABI
}  // namespace asterism
