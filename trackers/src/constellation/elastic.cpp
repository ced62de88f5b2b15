#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/method/auto.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <map>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {

void ObjectPose::move(const PlaneTransform& transform) {
  transform_ = transform;
  transform_.scale = std::clamp(transform.scale, kMinScale, kMaxScale);
}

void ObjectPose::keep_in(const Frame& frame) {
  transform_.translation = kept_in_image(frame, transform_.translation);
}

struct ElasticConstellation::Solver::Workspace {
  Auto<Springs> solver;
};

ElasticConstellation::Solver::Solver() : workspace_(std::make_unique<Workspace>()) {}
ElasticConstellation::Solver::Solver(const Solver&) : Solver() {}
ElasticConstellation::Solver::~Solver() = default;

Summary ElasticConstellation::Solver::solve(const Springs& springs, Points& x, const SolverOptions& options) {
  workspace_->solver.options = options;
  workspace_->solver.options.ground_components = true;  // parts that nothing holds stay
  return workspace_->solver.solve(springs, x);
}

ElasticConstellation::ElasticConstellation(const ElasticOptions& options)
    : options_(check_options("ElasticOptions", options)), springs_(Topology<>::full(0)) {}

void ElasticConstellation::assign(const Points& layout, Topology<> topology) {
  layout_ = layout;
  springs_ = Springs(std::move(topology));
}

Summary ElasticConstellation::place(const ObjectPose& pose, std::span<const Evidence> evidence, Points& x) {
  if (size() == 0) return {};
  springs_.anchor_loss.scale = options_.reach * pose.mean_side();
  for (int i = 0; i < size(); ++i) {
    const Evidence& part = evidence[static_cast<std::size_t>(i)];
    springs_.anchors.col(i) = part.position;
    springs_.set_anchor_information(
        i, part.peak > 0 ? Eigen::Matrix2d(part.peak * part.covariance.inverse()) : Eigen::Matrix2d::Zero());
  }
  const double scale = pose.transform().scale;
  // Parts nearer to each other than this have no length to be relative to.
  const double shortest = 0.01 * pose.mean_side();
  for (int l = 0; const auto [i, j] : springs_.links()) {
    const double length = scale * (layout_.col(i) - layout_.col(j)).norm();
    const double deviation = options_.deformation * std::max(length, shortest);
    springs_.rest_length(l) = length;
    springs_.link_stiffness(l) = 1 / (deviation * deviation);
    ++l;
  }
  return solver_.solve(springs_, x, options_.solver);
}

void ElasticConstellation::relax(const ObjectPose& pose, const Points& x, double rate) {
  const PlaneTransform to_object = pose.transform().inverse();
  for (int i = 0; i < size(); ++i) layout_.col(i) += rate * (to_object(x.col(i)) - layout_.col(i));
}

ElasticConstellation::Points ElasticConstellation::posed(const ObjectPose& pose) const {
  Points x(2, size());
  for (int i = 0; i < size(); ++i) x.col(i) = pose.transform()(layout_.col(i));
  return x;
}

Topology<> delaunay(const ElasticConstellation::Points& points) {
  const auto n = static_cast<int>(points.cols());
  if (n < 3) return Topology<>::full(n);
  // Within a square well inside that of the triangulation, whose own corners are no parts.
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
  if (std::ssize(links) + 1 < std::ssize(part_at)) return Topology<>::full(n);  // on a line, to rounding
  return Topology<>::from_links(n, links);
}

TrackResult standing_result(const ObjectPose& pose, const ElasticConstellation& parts,
                            const ElasticConstellation::Points& x, const Size2& part_size) {
  TrackResult result;
  result.box = pose.box();
  result.angle = pose.transform().angle;
  result.links = parts.links();
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    const Point2 position = x.col(i);
    result.parts.push_back({.position = position, .size = part_size, .visual_best = position});
  }
  return result;
}

RobustTransform fit_pose(const ElasticConstellation::Points& layout,
                         const ElasticConstellation::Points& placed, const Eigen::VectorXd& weights,
                         const ObjectPose& pose, double reach) {
  return fit_robust_transform(layout, placed, weights, TransformModel::Similarity, reach * pose.mean_side(),
                              pose.transform());
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
