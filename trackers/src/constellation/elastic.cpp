#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Of a symmetric matrix.
double largest_eigenvalue(const Eigen::Matrix2d& matrix) {
  return matrix.trace() / 2 + std::hypot((matrix(0, 0) - matrix(1, 1)) / 2, matrix(0, 1));
}

}  // namespace

ElasticConstellation::ElasticConstellation(const ElasticOptions& options)
    : SpringConstellation(Topology<>::full(0)), options_(check_options("ElasticOptions", options)) {}

void ElasticConstellation::assign(const Points& layout, const Points& placement, const Topology<>& topology) {
  SpringConstellation::assign(placement, topology);
  layout_ = layout;
}

Summary ElasticConstellation::place(const ObjectPose& pose, std::span<const Evidence> evidence) {
  if (size() == 0) return {};
  anchor_term().set_loss(Loss::GemanMcClure, options_.reach * pose.mean_side());
  Eigen::MatrixXd& shapes =
      anchor_term().values("information");  // of which the stiffness is the largest eigenvalue
  shapes = Eigen::Vector4d(1, 0, 0, 1).replicate(1, size());
  set_anchors(evidence, [&, i = 0](const Evidence& part) mutable {
    auto shape = shapes.col(i++);
    if (!(part.peak > 0)) return 0.0;
    const Eigen::Matrix2d information = part.peak * part.covariance.inverse();
    const double stiffness = largest_eigenvalue(information);
    shape = (information / stiffness).reshaped();
    return stiffness;
  });
  const double scale = pose.transform().scale;
  // Bounds the length to which the deviation is relative: parts may coincide.
  const double shortest = 0.01 * pose.mean_side();
  set_links([&](int i, int j, double& length) {
    length = scale * (layout_.col(i) - layout_.col(j)).norm();
    const double deviation = options_.deformation * std::max(length, shortest);
    return 1 / (deviation * deviation);
  });
  AlignedOptions options(options_.solver);
  options.hold_floating = true;
  Eigen::MatrixXd x = placement();
  const Summary summary = solve(system(), x, options);
  placement() = x;
  return summary;
}

ElasticConstellation::Points ElasticConstellation::posed(const ObjectPose& pose) const {
  Points x(2, size());
  for (int i = 0; i < size(); ++i) x.col(i) = pose.transform()(layout_.col(i));
  return x;
}

Topology<> delaunay(const ElasticConstellation::Points& points) {
  const auto n = static_cast<int>(points.cols());
  if (n < 3) return Topology<>::full(n);
  // Scaled into a square well inside the triangulation's, whose own corner vertices are not parts.
  constexpr double kSide = 1024;
  const Point2 first = points.rowwise().minCoeff();
  const double extent = (points.rowwise().maxCoeff() - first).maxCoeff();
  cv::Subdiv2D triangulation(cv::Rect(0, 0, 3 * static_cast<int>(kSide), 3 * static_cast<int>(kSide)));
  std::map<std::pair<float, float>, int> part_at;
  for (int i = 0; i < n; ++i) {
    const Point2 p = Point2::Constant(kSide) + (points.col(i) - first) * (extent > 0 ? kSide / extent : 0);
    const cv::Point2f vertex(static_cast<float>(p.x()), static_cast<float>(p.y()));
    if (part_at.emplace(std::pair(vertex.x, vertex.y), i).second) triangulation.insert(vertex);
  }
  std::vector<cv::Vec4f> edges;
  triangulation.getEdgeList(edges);
  std::vector<Link> links;
  for (const cv::Vec4f& edge : edges) {
    const auto a = part_at.find({edge[0], edge[1]}), b = part_at.find({edge[2], edge[3]});
    if (a != part_at.end() && b != part_at.end()) links.push_back({a->second, b->second});
  }
  if (std::ssize(links) + 1 < std::ssize(part_at)) return Topology<>::full(n);  // collinear up to rounding
  return Topology<>::from_links(n, links);
}

RobustTransform fit_pose(const ElasticConstellation::Points& layout,
                         const ElasticConstellation::Points& placed, const Eigen::VectorXd& weights,
                         const ObjectPose& pose, double reach) {
  return fit_robust_transform(layout, placed, weights, TransformModel::Similarity, reach * pose.mean_side(),
                              pose.transform());
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
