#include <array>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <exception>
#include <numbers>
#include <stdexcept>
#include <string>

#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

std::size_t parts_of_grid(const DptOptions& options) {
  const int rows = options.grid_rows, cols = options.grid_cols;
  if (rows * cols > Dpt::kMaxParts)
    throw std::invalid_argument("DptOptions: the grid must have 1 to 16 parts");
  return static_cast<std::size_t>(rows * cols);
}

Topology<> make_topology(const DptOptions& options) {
  const int rows = options.grid_rows, cols = options.grid_cols;
  switch (options.constellation) {
    case Constellation::Star:
      return Topology<>::star(rows * cols, rows / 2 * cols + cols / 2);
    case Constellation::Local: {
      // Links between parts that share a side.
      std::vector<Link> links;
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) {
          if (c + 1 < cols) links.push_back({r * cols + c, r * cols + c + 1});
          if (r + 1 < rows) links.push_back({r * cols + c, (r + 1) * cols + c});
        }
      return Topology<>::from_links(rows * cols, links);
    }
    case Constellation::Full:
      break;
  }
  return Topology<>::full(rows * cols);
}

}  // namespace

Dpt::Dpt(const DptOptions& options)
    : options_(check_options("DptOptions", options)),
      coarse_(options.coarse),
      scale_(options.scale, options.scale_filter_share),
      parts_(parts_of_grid(options), options.part),
      constellation_(make_topology(options)) {
  system_solvers().make(options.solver);  // throws if there is none
}

template <typename F>
void Dpt::for_each_part(F&& f) {
  if (options_.threads == 1) {
    for (std::size_t i = 0; i < parts_.size(); ++i) f(i);
    return;
  }
  std::array<std::exception_ptr, kMaxParts> thrown;  // an executor's task must not throw
  ThreadExecutor{options_.threads}(part_count(), [&](int task) {
    const auto i = static_cast<std::size_t>(task);
    try {
      f(i);
    } catch (...) {
      thrown[i] = std::current_exception();
    }
  });
  for (const std::exception_ptr& exception : thrown)
    if (exception) std::rethrow_exception(exception);
}

// Sec. 2.5.3: the box is split into equal non-overlapping parts; with overlap their centres are closer.
void Dpt::start(const Frame& frame, const cv::Rect2d& box) {
  coarse_.init(frame, box);
  scale_.init(frame, coarse_.pose());
  if (options_.judge) judge_.init(frame, box);

  const int rows = options_.grid_rows, cols = options_.grid_cols;
  const double stride = 1 - options_.overlap;  // [sides of a part]
  part_size_ = Size2(box.width / (1 + (cols - 1) * stride), box.height / (1 + (rows - 1) * stride));
  Placement& x = constellation_.placement();
  for (int i = 0; i < part_count(); ++i) {
    const Point2 corner = Point2(box.x, box.y) + stride * part_size_.cwiseProduct(Point2(i % cols, i / cols));
    x.col(i) = centre_of({corner.x(), corner.y(), part_size_.x(), part_size_.y()});
    parts_[static_cast<std::size_t>(i)].init(frame, x.col(i), part_size_);
  }
  constellation_.set_rest_lengths();
}

TrackResult Dpt::standing() const {
  TrackResult result = constellation_.standing(coarse_.pose(), part_size_);
  if (options_.judge) result.probability = 0;  // the frame does not show the scene
  return result;
}

TrackResult Dpt::follow(const Frame& frame) {
  TrackResult result;
  result.times.reserve(10);  // including those that update(image) adds

  // 1: Coarsely estimate the object position by the root node and displace the mid-level parts.
  const CoarseLayer::Estimate root = coarse_.localize(frame);
  Placement x = displaced_parts(root.evidence.position);
  coarse_.report(root, result);

  // 2: Calculate the part correlation filter responses and form a spring system.
  StageClock clock;
  const Evidences evidence = form_spring_system(frame, x);
  result.times.push_back({"parts", clock.lap()});

  // 3: Estimate the MAP mid-level parts constellation by optimizing the energy of a dual spring system.
  const Placement start = x;
  result.covariance = estimate_map_constellation(x);
  if (options_.certify) result.certified = certify(constellation_.system(), x).certified();
  result.times.push_back({"springs", clock.lap()});
  if (options_.on_solve) {
    ObjectPose pose = coarse_.pose();
    pose.move_to(root.evidence.position);
    options_.on_solve({springs(), start, {evidence.data(), parts_.size()}, pose.box(), summary_});
    clock.lap();
  }

  // 4: Update the root node position and size by the transform fitted to the parts' positions before and
  // after.
  update_root(frame, root.evidence, x, result.covariance);
  if (scale_.enabled()) result.times.push_back({"scale", clock.lap()});

  // 5: Update the spring system parameters and the constellation appearance models.
  report_parts(evidence, result);
  update_constellation(frame, root.segmentation, result);
  result.times.push_back({"part update", clock.lap()});

  // 6: Update the coarse color model and correlation filter.
  update_coarse_models(frame, root.segmentation);
  result.times.push_back({"root update", clock.lap()});

  result.box = coarse_.pose().box();
  result.angle = coarse_.pose().angle();
  if (options_.judge) {
    result.probability = judge_.update(frame, result.box);
    result.lost = *result.probability < BoxJudge::kLostBelow;
    result.times.push_back({"judge", clock.lap()});
  }
  return result;
}

Dpt::Placement Dpt::displaced_parts(const Point2& position) const {
  return constellation_.placement().colwise() + (position - coarse_.pose().centre());
}

Dpt::Evidences Dpt::form_spring_system(const Frame& frame, const Placement& x) {
  Evidences evidence;
  for_each_part(
      [&](std::size_t i) { evidence[i] = parts_[i].localize(frame, x.col(static_cast<Eigen::Index>(i))); });
  // Eq. 11.
  constellation_.set_anchors({evidence.data(), parts_.size()}, [&](const Evidence& part) {
    return static_stiffness(part, options_.stiffness);
  });
  // Eq. 12.
  constellation_.set_links([&](int i, int j, double rest_length) {
    const Eigen::MatrixXd& anchors = constellation_.anchors();
    return dynamic_stiffness(rest_length, (anchors.col(i) - anchors.col(j)).norm(), options_.stiffness);
  });
  return evidence;
}

std::optional<Eigen::Matrix3d> Dpt::estimate_map_constellation(Placement& x) {
  Eigen::MatrixXd placement = x;
  summary_ = system_solvers().make(options_.solver).solve(constellation_.system(), placement);
  x = placement;
  return box_covariance(x);
}

void Dpt::update_root(const Frame& frame, const Evidence& root, Placement& x,
                      std::optional<Eigen::Matrix3d>& covariance) {
  PlaneTransform step = fit_transform(constellation_.placement(), x, options_.transform);
  ObjectPose pose = coarse_.pose();
  const auto stretch = [&x](const Size2& factor) {
    const Point2 middle = x.rowwise().mean();
    x = (factor.asDiagonal() * (x.colwise() - middle)).colwise() + middle;
  };
  if (options_.root_weight > 0) {
    const Point2 moved = weigh_root(root, step(pose.centre()), covariance);
    step.translation += moved;
    x.colwise() += moved;
  }
  if (const std::optional<Size2> size = coarse_.found_size()) {
    const Size2 before = pose.size();
    pose.move_by(step, 1);
    pose.resize(*size);
    stretch(pose.size().cwiseQuotient(before) / step.scale);
  } else {
    const double growth = scale_.growth(frame, step(pose.centre()), step.scale);
    if (scale_.enabled()) stretch(Size2::Constant(growth / step.scale));
    pose.move_by(step, growth);
    if (covariance) scale_.share(*covariance);
  }
  x.colwise() -= pose.keep_in(frame);  // the parts move with it
  coarse_.move(pose);
  constellation_.placement() = x;
}

// The mean of two measurements of the centre, each with its information.
Point2 Dpt::weigh_root(const Evidence& root, const Point2& centre,
                       std::optional<Eigen::Matrix3d>& covariance) const {
  const double information = options_.root_weight * static_stiffness(root, options_.stiffness);
  if (!covariance) return root.position - centre;  // the constellation does not determine it
  const Eigen::Matrix2d parts = covariance->topLeftCorner<2, 2>(), one = Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d gain = information * parts * (one + information * parts).inverse();
  Eigen::Matrix3d rest = Eigen::Matrix3d::Identity();
  rest.topLeftCorner<2, 2>() = one - gain;
  // In Joseph's form, which stays symmetric and positive definite.
  *covariance = rest * *covariance * rest.transpose();
  if (information > 0) covariance->topLeftCorner<2, 2>() += gain * gain.transpose() / information;
  return gain * (root.position - centre);
}

void Dpt::update_constellation(const Frame& frame, const Segmentation& segmentation, TrackResult& result) {
  double strongest = 0;
  for (const PartState& part : result.parts) strongest = std::max(strongest, part.weight);
  result.update_threshold = options_.response_gate * strongest;
  for (PartState& part : result.parts) {
    const bool matches = part.weight >= result.update_threshold;
    // A segmentation that failed its test carries no information about the parts.
    const bool on_object = !segmentation.informative || segmentation.foreground_fraction(box_around(
                                                            part.position, part.size)) >= options_.mask_gate;
    part.updated = matches && on_object;
  }
  for_each_part([&](std::size_t i) {
    if (result.parts[i].updated) parts_[i].adapt(frame, result.parts[i].position);
  });
  constellation_.update_rest_lengths(options_.spring_rate);
}

void Dpt::update_coarse_models(const Frame& frame, const Segmentation& segmentation) {
  coarse_.adapt(frame, segmentation.informative);
  scale_.adapt(frame, coarse_.pose());
}

void Dpt::report_parts(const Evidences& evidence, TrackResult& result) const {
  result.links = constellation_.links();
  result.parts.reserve(parts_.size());
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Point2 position = constellation_.placement().col(static_cast<Eigen::Index>(i));
    result.parts.push_back({.position = position,
                            .size = part_size_,
                            .visual_best = evidence[i].position,
                            .weight = parts_[i].similarity_at(position)});
  }
}

std::optional<Eigen::Matrix3d> Dpt::box_covariance(const Placement& x) const {
  const Solution solution(constellation_.system(), x);
  if (!solution) return std::nullopt;
  Eigen::Matrix3Xd jacobian(3, x.size());
  fit_jacobian(constellation_.placement(), x, options_.transform, coarse_.pose().centre(), jacobian);
  return jacobian * solution.joint_covariance() * jacobian.transpose();
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
