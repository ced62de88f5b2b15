#pragma once

#include <asterism/parts/concept/part_model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/terms/system.hpp>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Parts on springs, for every tracker with parts: their placement, and the spring system of the frame. Laws
/// give the springs' stiffness: Dpt uses those of the paper (stiffness.hpp), ElasticConstellation has its
/// own.
class ASTERISM_API SpringConstellation {
 public:
  using Points = Eigen::Matrix2Xd;  ///< 2 x N, a part is a column

  /// The parts and their links.
  explicit SpringConstellation(const Topology<>& topology);
  /// Sets other parts, at a placement.
  void assign(const Points& placement, const Topology<>& topology);

  /// The parts' places in the image.
  const Points& placement() const { return placement_; }
  Points& placement() { return placement_; }
  /// The springs of the last frame: one term of anchors, one for each part, and one of links.
  const System& system() const { return system_; }
  /// Number of parts, and their links.
  int size() const { return system_.nodes(); }
  std::vector<Link> links() const;
  /// The positions of the anchors, 2 x N, and the rest lengths of the links, 1 x links [px].
  const Eigen::MatrixXd& anchors() const { return system_.term(kAnchors).values("position"); }
  const Eigen::MatrixXd& rest_lengths() const { return system_.term(kLinks).values("length"); }

  /// Each part is held where its evidence has it, by a spring of stiffness `law(evidence)` [1/px^2].
  template <typename Law>
  void set_anchors(std::span<const Evidence> evidence, Law&& law) {
    Eigen::MatrixXd& position = anchor_term().values("position");
    Eigen::MatrixXd& stiffness = anchor_term().values("stiffness");
    for (int i = 0; i < size(); ++i) {
      const Evidence& part = evidence[static_cast<std::size_t>(i)];
      position.col(i) = part.position;
      stiffness(0, i) = law(part);
    }
  }
  /// Each link's spring: `law(i, j, rest_length)` is the stiffness [1/px^2] of the link of parts i and j, and
  /// may change the rest length [px].
  template <typename Law>
  void set_links(Law&& law) {
    const Eigen::MatrixXi& nodes = link_term().nodes();
    Eigen::MatrixXd &length = link_term().values("length"), &stiffness = link_term().values("stiffness");
    for (Eigen::Index l = 0; l < nodes.cols(); ++l)
      stiffness(0, l) = law(nodes(0, l), nodes(1, l), length(0, l));
  }
  /// Sets the rest lengths to the distances in the placement.
  void set_rest_lengths();
  /// The rest lengths follow the distances in the placement at a rate in [0, 1] (Sec. 2.5.2).
  void update_rest_lengths(double rate);

  /// The result of a tracker whose object, and whose parts, stay where they are. part_size: in the image
  /// [px].
  TrackResult standing(const ObjectPose& pose, const Size2& part_size) const;

  /// The placement of a number of parts that is known.
  void visit_placement(StateArchive& archive) { visit_points(archive, placement_); }
  /// The rest lengths of as many links.
  void visit_rest_lengths(StateArchive& archive);

 protected:
  /// Points in the image or in the object.
  static void visit_points(StateArchive& archive, Points& points);
  /// The anchors, to be changed.
  Term& anchor_term() { return system_.term(kAnchors); }

 private:
  static constexpr int kAnchors = 0, kLinks = 1;  // the numbers of the terms
  Term& link_term() { return system_.term(kLinks); }

  System system_;
  Points placement_;
};

/// The springs of a Dpt as the solver's own type has them, to be stored or compared.
ASTERISM_API SpringSystem<double, 2> springs_of(const SpringConstellation& constellation);

}  // namespace ASTERISM_ABI
}  // namespace asterism
