#pragma once

#include <asterism/parts/concept/part_model.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <span>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Parts on springs, for every tracker with parts: their placement, and the spring system of the frame. Laws
/// give the springs' stiffness: Dpt uses those of the paper (stiffness.hpp), ElasticConstellation has its
/// own.
template <typename System_>
class SpringConstellation {
 public:
  /// Of the springs.
  using System = System_;
  using Points = typename System::Points;       ///< 2 x N, a part is a column
  using Links = typename System::TopologyType;  ///< the links of the parts

  /// The parts and their links.
  explicit SpringConstellation(Links topology) : system_(std::move(topology)) {
    placement_.setZero(2, system_.nodes());
  }
  /// Sets other parts, at a placement.
  void assign(const Points& placement, Links topology) {
    system_ = System(std::move(topology));
    placement_ = placement;
  }

  /// Where the parts are in the image.
  const Points& placement() const { return placement_; }
  Points& placement() { return placement_; }
  /// The springs of the last frame.
  const System& system() const { return system_; }
  System& system() { return system_; }
  /// Number of parts, and their links.
  int size() const { return system_.nodes(); }
  std::vector<Link> links() const { return {system_.links().begin(), system_.links().end()}; }

  /// Each part is held where its evidence has it, by the information matrix `law(evidence)` [1/px^2].
  template <typename Law>
  void set_anchors(std::span<const Evidence> evidence, Law&& law) {
    for (int i = 0; i < size(); ++i) {
      const Evidence& part = evidence[static_cast<std::size_t>(i)];
      system_.anchors.col(i) = part.position;
      detail::set_anchor(system_, i, law(part));
    }
  }
  /// Each link's spring: `law(i, j, rest_length)` is the stiffness [1/px^2] of the link of parts i and j, and
  /// may change the rest length [px].
  template <typename Law>
  void set_links(Law&& law) {
    for (int l = 0; const auto [i, j] : system_.links()) {
      system_.link_stiffness(l) = law(i, j, system_.rest_length(l));
      ++l;
    }
  }
  /// The rest lengths follow the distances in the placement at a rate in [0, 1] (Sec. 2.5.2).
  void update_rest_lengths(double rate) {
    for (int l = 0; const auto [i, j] : system_.links()) {
      double& length = system_.rest_length(l++);
      length += rate * ((placement_.col(i) - placement_.col(j)).norm() - length);
    }
  }

  /// The result of a tracker whose object, and whose parts, stay where they are. part_size: in the image
  /// [px].
  TrackResult standing(const ObjectPose& pose, const Size2& part_size) const {
    TrackResult result;
    result.box = pose.box();
    result.angle = pose.angle();
    result.links = links();
    result.parts.reserve(static_cast<std::size_t>(size()));
    for (int i = 0; i < size(); ++i) {
      const Point2 position = placement_.col(i);
      result.parts.push_back({.position = position, .size = part_size, .visual_best = position});
    }
    return result;
  }

  /// The placement of a number of parts that is known.
  void visit_placement(StateArchive& archive) { visit_points(archive, placement_); }

 protected:
  /// Points in the image or in the object.
  static void visit_points(StateArchive& archive, Points& points) {
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      Point2 position = points.col(i);
      archive.position(position);
      points.col(i) = position;
    }
  }

 private:
  System system_;
  Points placement_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
