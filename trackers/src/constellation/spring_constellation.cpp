#include <asterism/trackers/constellation/spring_constellation.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Springs without stiffness, whose numbers are set in each frame.
System system_of(const Topology<>& topology) {
  const int parts = topology.nodes(), count = topology.link_count();
  Eigen::Matrix2Xi nodes(2, count);
  for (int l = 0; const Link& link : topology.links()) nodes.col(l++) << link.i, link.j;
  System system(parts, 2);
  system.add_anchors(Eigen::MatrixXd::Zero(2, parts), Eigen::VectorXd::Zero(parts));
  system.add_links(nodes, Eigen::VectorXd::Zero(count), Eigen::VectorXd::Zero(count));
  return system;
}

}  // namespace

SpringConstellation::SpringConstellation(const Topology<>& topology)
    : system_(system_of(topology)), placement_(Points::Zero(2, topology.nodes())) {}

void SpringConstellation::assign(const Points& placement, const Topology<>& topology) {
  system_ = system_of(topology);
  placement_ = placement;
}

std::vector<Link> SpringConstellation::links() const {
  const Eigen::MatrixXi& nodes = system_.term(kLinks).nodes();
  std::vector<Link> links;
  for (Eigen::Index l = 0; l < nodes.cols(); ++l) links.push_back({nodes(0, l), nodes(1, l)});
  return links;
}

void SpringConstellation::set_rest_lengths() {
  link_term().values("length") = lengths_at(placement_, link_term().nodes()).transpose();
}

void SpringConstellation::update_rest_lengths(double rate) {
  Eigen::MatrixXd& length = link_term().values("length");
  length += rate * (lengths_at(placement_, link_term().nodes()).transpose() - length);
}

void SpringConstellation::visit_rest_lengths(StateArchive& archive) {
  Eigen::MatrixXd& length = link_term().values("length");
  archive(length);
  archive.require((length.array() >= 0).all());
}

TrackResult SpringConstellation::standing(const ObjectPose& pose, const Size2& part_size) const {
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

void SpringConstellation::visit_points(StateArchive& archive, Points& points) {
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    Point2 position = points.col(i);
    archive.position(position);
    points.col(i) = position;
  }
}

SpringSystem<double, 2> springs_of(const SpringConstellation& constellation) {
  const std::vector<Link> links = constellation.links();
  const int parts = constellation.size();
  const bool is_full = 2 * std::ssize(links) == std::ptrdiff_t{parts} * (parts - 1);
  SpringSystem<double, 2> springs(is_full ? Topology<>::full(parts) : Topology<>::from_links(parts, links));
  const Term &anchors = constellation.system().term(0), &springs_of_links = constellation.system().term(1);
  springs.anchors = constellation.anchors();
  springs.anchor_stiffness = anchors.values("stiffness").transpose();
  springs.rest_length = constellation.rest_lengths().transpose();
  springs.link_stiffness = springs_of_links.values("stiffness").transpose();
  return springs;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
