#include <array>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/trackers/constellation/stiffness.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <exception>
#include <numbers>
#include <stdexcept>
#include <string>

#include "../tracker/stage_clock.hpp"
#include "../tracker/update_from_image.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

std::size_t parts_of_grid(const DptOptions& options) {
  const int rows = options.grid_rows, cols = options.grid_cols;
  if (rows * cols > Dpt::kMaxParts)
    throw std::invalid_argument("DptOptions: the grid must have 1 to 16 parts");
  return static_cast<std::size_t>(rows * cols);
}

Topology<Eigen::Dynamic, Dpt::kMaxParts> make_topology(const DptOptions& options) {
  const int rows = options.grid_rows, cols = options.grid_cols;
  using Links = Topology<Eigen::Dynamic, Dpt::kMaxParts>;
  switch (options.constellation) {
    case Constellation::Star:
      return Links::star(rows * cols, rows / 2 * cols + cols / 2);
    case Constellation::Local: {
      // Parts that touch along a side.
      std::vector<Link> links;
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) {
          if (c + 1 < cols) links.push_back({r * cols + c, r * cols + c + 1});
          if (r + 1 < rows) links.push_back({r * cols + c, (r + 1) * cols + c});
        }
      return Links::from_links(rows * cols, links);
    }
    case Constellation::Full:
      break;
  }
  return Links::full(rows * cols);
}

}  // namespace

Dpt::Dpt(const DptOptions& options)
    : options_(check_options("DptOptions", options)),
      coarse_(options.coarse),
      scale_(options.scale),
      parts_(parts_of_grid(options), options.part),
      springs_(make_topology(options)),
      solver_(std::in_place_type<Ida<Springs>>, springs_, options.solver) {
  if (options.spring_solver == SpringSolver::Newton)
    solver_.emplace<Newton<Springs>>(springs_, options.solver);
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

void Dpt::init(const cv::Mat& image, const cv::Rect2d& box) { init(first_frame(image), box); }

void Dpt::init(const Frame& frame, const cv::Rect2d& box) {
  check_start(frame, box);
  coarse_.init(frame, box);
  initial_size_ = coarse_.size();
  angle_ = 0;

  if (options_.scale_share > 0) scale_.init(frame, coarse_.centre(), coarse_.size());

  // Sec. 2.5.3: the box is split into equal non-overlapping parts; overlapping ones have their middles
  // closer.
  const int rows = options_.grid_rows, cols = options_.grid_cols;
  const double stride = 1 - options_.overlap;  // [sides of a part]
  part_size_ = Size2(box.width / (1 + (cols - 1) * stride), box.height / (1 + (rows - 1) * stride));
  placement_.resize(2, part_count());
  for (int i = 0; i < part_count(); ++i) {
    const Point2 corner = Point2(box.x, box.y) + stride * part_size_.cwiseProduct(Point2(i % cols, i / cols));
    placement_.col(i) = centre_of({corner.x(), corner.y(), part_size_.x(), part_size_.y()});
    parts_[static_cast<std::size_t>(i)].init(frame, placement_.col(i), part_size_);
  }
  velocity_.setZero(2, part_count());
  springs_.set_rest_lengths(placement_);
  gate_.init(frame, box);
  initialized_ = true;
}

TrackResult Dpt::update(const cv::Mat& image) { return update_from_image(*this, image); }

TrackResult Dpt::update(const Frame& frame) {
  if (!initialized_) throw std::logic_error("Dpt: update before init");
  return gate_.update(*this, frame, &Dpt::follow, &Dpt::standing);
}

TrackResult Dpt::standing() const {
  TrackResult result;
  result.box = coarse_.box();
  result.angle = angle_;
  result.links.assign(springs_.links().begin(), springs_.links().end());
  result.parts.reserve(parts_.size());
  for (int i = 0; i < part_count(); ++i) {
    const Point2 position = placement_.col(i);
    result.parts.push_back({.position = position, .size = part_size_, .visual_best = position});
  }
  return result;
}

TrackResult Dpt::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;
  result.parts.reserve(parts_.size());
  result.times.reserve(9);  // of update(image) too

  // Algorithm 2, line 1: coarse position of the object, Eq. 4; the parts move along.
  const CoarseLayer::Estimate coarse = coarse_.localize(frame);
  Placement placement = placement_.colwise() + (coarse.evidence.position - coarse_.centre());
  result.times.push_back({"root", coarse.root_milliseconds});
  result.times.push_back({"color", coarse.color_milliseconds});
  if (options_.coarse.motion_share > 0) result.times.push_back({"motion", coarse.motion_milliseconds});
  clock.lap();
  const double confidence = std::clamp(coarse.similarity, 0.0, 1.0);
  if (coarse_.waits(coarse)) {
    velocity_.setZero();
    TrackResult waiting = standing();
    waiting.confidence = confidence;
    waiting.lost = true;
    waiting.times = std::move(result.times);
    return waiting;
  }
  result.confidence = confidence;
  result.lost = coarse.lost;
  result.links.assign(springs_.links().begin(), springs_.links().end());

  // Line 2: responses of the parts form the spring system.
  std::array<Evidence, kMaxParts> evidence;
  for_each_part([&](std::size_t i) {
    evidence[i] = parts_[i].localize(frame, placement.col(static_cast<Eigen::Index>(i)));
  });
  set_springs({evidence.data(), parts_.size()});
  if (options_.smoothness > 0) smooth_motion();
  result.times.push_back({"parts", clock.lap()});

  // Line 3: the MAP constellation.
  Placement start;
  if (options_.on_solve) start = placement;
  summary_ = std::visit([&](auto& solver) { return solver.solve(springs_, placement); }, solver_);
  result.covariance = box_covariance(placement);
  result.times.push_back({"springs", clock.lap()});
  if (options_.on_solve) {
    options_.on_solve(springs_, start, summary_);
    clock.lap();
  }

  // Line 4: root position and size.
  move(frame, placement);
  if (options_.scale_share > 0) {
    if (result.covariance) {
      const Eigen::Vector3d kept(1, 1, 1 - options_.scale_share);
      *result.covariance = kept.asDiagonal() * *result.covariance * kept.asDiagonal();
      (*result.covariance)(2, 2) += std::pow(options_.scale_share, 2) * scale_.log_variance();
    }
    result.times.push_back({"scale", clock.lap()});
  }

  // Line 5: spring lengths and part models.
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Point2 position = placement.col(static_cast<Eigen::Index>(i));
    result.parts.push_back({.position = position,
                            .size = part_size_,
                            .visual_best = evidence[i].position,
                            .weight = parts_[i].similarity_at(position)});
  }
  result.update_threshold = gate_updates(coarse.segmentation, result.parts);
  for_each_part([&](std::size_t i) {
    if (result.parts[i].updated) parts_[i].adapt(frame, result.parts[i].position);
  });
  for (int l = 0; const auto [i, j] : springs_.links()) {
    double& length = springs_.rest_length(l++);
    length += options_.spring_rate * ((placement.col(i) - placement.col(j)).norm() - length);
  }
  result.times.push_back({"part update", clock.lap()});

  // Line 6: color model and root filter.
  coarse_.adapt(frame, coarse.segmentation.informative);
  if (options_.scale_share > 0) scale_.adapt(frame, coarse_.centre(), coarse_.size());
  result.times.push_back({"root update", clock.lap()});

  result.box = coarse_.box();
  result.angle = angle_;
  return result;
}

void Dpt::move(const Frame& frame, Placement& placement) {
  const PlaneTransform transform = fit_transform(placement_, placement, options_.transform);
  Point2 centre = transform(coarse_.centre());
  double scale = transform.scale;
  if (options_.scale_share > 0) {
    const double seen = scale_.localize(frame, centre);
    scale = std::pow(scale, 1 - options_.scale_share) * std::pow(seen, options_.scale_share);
    const Point2 middle = placement.rowwise().mean();
    placement = ((scale / transform.scale) * (placement.colwise() - middle)).colwise() + middle;
  }
  const Size2 size =
      (scale * coarse_.size()).cwiseMax(kMinScale * initial_size_).cwiseMin(kMaxScale * initial_size_);
  if (options_.resize_parts) {
    part_size_ = part_size_.cwiseProduct(size.cwiseQuotient(coarse_.size()));
    for (AnyPart& part : parts_) part.resize(part_size_);
  }
  // The parts go along where the box is kept in the image.
  const Point2 outside = centre - kept_in_image(frame, centre);
  centre -= outside;
  placement.colwise() -= outside;
  coarse_.move(box_around(centre, size));
  velocity_ = placement - placement_;
  angle_ = std::remainder(angle_ + transform.angle, 2 * std::numbers::pi);
  placement_ = placement;
}

void Dpt::set_springs(std::span<const Evidence> evidence) {
  for (int i = 0; i < part_count(); ++i) {
    const Evidence& part = evidence[static_cast<std::size_t>(i)];
    springs_.anchors.col(i) = part.position;
    if (options_.anchor_law == AnchorLaw::Covariance)
      springs_.set_anchor_information(i, static_information(part));
    else
      springs_.set_anchor_information(i,
                                      Eigen::Matrix2d(static_stiffness(part) * Eigen::Matrix2d::Identity()));
  }
  for (int l = 0; const auto [i, j] : springs_.links()) {
    const double distance = (springs_.anchors.col(i) - springs_.anchors.col(j)).norm();
    springs_.link_stiffness(l) = dynamic_stiffness(springs_.rest_length(l), distance);
    ++l;
  }
}

// The product of two Gaussians is one: information adds up, and weighs the means.
void Dpt::smooth_motion() {
  const double prior = options_.smoothness * part_count() / coarse_.size().prod();
  for (int i = 0; i < part_count(); ++i) {
    const Eigen::Matrix2d seen = springs_.anchor_stiffness[i] * springs_.anchor_shape.middleCols<2>(2 * i);
    const Eigen::Matrix2d both = seen + prior * Eigen::Matrix2d::Identity();
    const Point2 predicted = placement_.col(i) + velocity_.col(i);
    springs_.anchors.col(i) = both.inverse() * (seen * springs_.anchors.col(i) + prior * predicted);
    springs_.set_anchor_information(i, both);
  }
}

std::optional<Eigen::Matrix3d> Dpt::box_covariance(const Placement& placement) const {
  const auto parts = covariance(springs_, placement);
  if (!parts) return std::nullopt;
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, 2 * kMaxParts> jacobian(3, placement.size());
  fit_jacobian(placement_, placement, options_.transform, coarse_.centre(), jacobian);
  return jacobian * parts.matrix * jacobian.transpose();
}

double Dpt::gate_updates(const Segmentation& segmentation, std::vector<PartState>& states) const {
  double strongest = 0;
  for (const PartState& state : states) strongest = std::max(strongest, state.weight);
  const double threshold = options_.response_gate * strongest;
  for (PartState& state : states) {
    const bool matches = state.weight >= threshold;
    // A segmentation that failed its test says nothing of the parts.
    const bool on_object =
        !segmentation.informative ||
        segmentation.foreground_fraction(box_around(state.position, state.size)) >= options_.mask_gate;
    state.updated = matches && on_object;
  }
  return threshold;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
