#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/linear/difference_chains.hpp>
#include <asterism/trackers/around/smooth_track.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

#include "../tracker/median.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// The range of q over the median variance: at the lower end a box is averaged over about a hundred frames, at
// the upper end over none.
constexpr double kLeastRatio = 1e-8, kMostRatio = 1e4;
// A variance counts as at least this share of the median one.
constexpr double kLeastShare = 1e-9;

double log_size(const cv::Rect2d& box) { return (std::log(box.width) + std::log(box.height)) / 2; }

double median_or_0(std::vector<double> values) { return values.empty() ? 0 : detail::median(values); }

/// Points over the frames after the first, where the path is at 0, and their energy for a = 1.
template <int Dim>
class Chain {
 public:
  using Point = Eigen::Matrix<double, Dim, 1>;
  using Block = Eigen::Matrix<double, Dim, Dim>;
  struct Path {
    std::vector<Point> points;
    std::vector<Block> covariances;
  };

  /// variances: of the points' coordinates, of which 0 stands for no evidence.
  Chain(std::vector<Point> points, const std::vector<Block>& variances) : points_(std::move(points)) {
    std::vector<double> sizes;
    for (const Block& variance : variances)
      if (variance.trace() > 0) sizes.push_back(variance.trace() / Dim);
    evidence_ = sizes.size();
    const double unit = median_or_0(std::move(sizes));
    for (const Block& variance : variances)
      information_.push_back(variance.trace() > 0 ? Block((variance / unit).inverse()) : Block::Zero());
    for (const Block& block : information_)
      for (int r = 0; r < Dim; ++r)
        for (int c = r; c < Dim; ++c) entries_.push_back(block(r, c));
    for (std::size_t t = 0; t + 2 < points_.size(); ++t)
      coefficients_.insert(coefficients_.end(), {1, -2, 1});
  }

  /// The most probable path, with the most probable scales. False if the numbers are out of range.
  bool smooth(Path& path) const {
    const double step = std::numbers::ln10, least = std::log(kLeastRatio), most = std::log(kMostRatio);
    double best = least, lowest = std::numeric_limits<double>::infinity();
    for (double at = least; at < most + step / 2; at += step)
      if (const double value = cost(at); value < lowest) std::tie(best, lowest) = std::pair(at, value);
    if (!std::isfinite(lowest)) return false;
    return solve(std::exp(narrowed(std::max(best - step, least), std::min(best + step, most))), path);
  }

 private:
  static constexpr int kEntries = DifferenceChains<Dim>::kEntries;

  // A minimum of the cost in an interval, by golden sections.
  double narrowed(double low, double high) const {
    constexpr double kShare = std::numbers::phi - 1;
    double left = high - kShare * (high - low), right = low + kShare * (high - low);
    double at_left = cost(left), at_right = cost(right);
    while (high - low > 0.01) {
      if (at_left < at_right) {
        high = std::exchange(right, left);
        at_right = at_left;
        at_left = cost(left = high - kShare * (high - low));
      } else {
        low = std::exchange(left, right);
        at_left = at_right;
        at_right = cost(right = low + kShare * (high - low));
      }
    }
    return (low + high) / 2;
  }

  bool factorize(double ratio, DifferenceChains<Dim>& factors) const {
    const std::vector<double> weight(coefficients_.size() / 3, 1 / ratio);
    // The first difference, -2 x_1 + x_2, as x_0 is 0.
    Eigen::Matrix<double, 2 * Dim, 2 * Dim> prior;
    prior << 4 * Block::Identity(), -2 * Block::Identity(), -2 * Block::Identity(), Block::Identity();
    prior /= ratio;
    return factors.factorize(points_.size(), 1, entries_.data(), coefficients_.data(), weight.data(),
                             prior.data());
  }

  std::vector<Point> minimum(const DifferenceChains<Dim>& factors) const {
    std::vector<Point> x;
    for (std::size_t t = 0; t < points_.size(); ++t) x.push_back(information_[t] * points_[t]);
    factors.solve(x.front().data());
    return x;
  }

  // The factor a that is most probable: the energy over the number of coordinates that the path leaves free.
  double scale(const std::vector<Point>& x, double ratio) const {
    double sum = 0;
    for (std::size_t t = 0; t < x.size(); ++t)
      sum += (x[t] - points_[t]).dot(information_[t] * (x[t] - points_[t]));
    sum += (x[1] - 2 * x[0]).squaredNorm() / ratio;
    for (std::size_t t = 2; t < x.size(); ++t) sum += (x[t - 2] - 2 * x[t - 1] + x[t]).squaredNorm() / ratio;
    return sum / freedom();
  }

  double freedom() const { return static_cast<double>(Dim * (evidence_ - 1)); }

  // Twice the negative logarithm of the evidence, at the most probable a.
  double cost(double log_ratio) const {
    const double ratio = std::exp(log_ratio);
    DifferenceChains<Dim> factors;
    if (!factorize(ratio, factors)) return std::numeric_limits<double>::infinity();
    const double a = std::max(scale(minimum(factors), ratio), std::numeric_limits<double>::min());
    return freedom() * std::log(a) + Dim * static_cast<double>(points_.size() - 1) * log_ratio +
           factors.log_det()[0];
  }

  bool solve(double ratio, Path& path) const {
    DifferenceChains<Dim> factors;
    if (!factorize(ratio, factors)) return false;
    path.points = minimum(factors);
    std::vector<double> entries(points_.size() * kEntries), spread(points_.size());
    factors.covariance(coefficients_.data(), entries.data(), spread.data());
    const double a = scale(path.points, ratio);
    for (std::size_t t = 0, i = 0; t < points_.size(); ++t) {
      Block& block = path.covariances.emplace_back();
      for (int r = 0; r < Dim; ++r)
        for (int c = r; c < Dim; ++c) block(r, c) = block(c, r) = a * entries[i++];
      if (!path.points[t].allFinite() || !block.allFinite()) return false;
    }
    return true;
  }

  std::vector<Point> points_;
  std::vector<Block> information_;  // times the median variance
  std::vector<double> entries_;     // of their upper triangles, as DifferenceChains takes them
  std::vector<double> coefficients_;
  std::size_t evidence_ = 0;  // the number of points that have some
};

[[noreturn]] void refuse(std::size_t frame, const std::string& reason) {
  throw std::invalid_argument("smooth_track: frame " + std::to_string(frame) + " of the track " + reason);
}

void check(std::span<const TrackResult> track) {
  for (std::size_t t = 0; t < track.size(); ++t) {
    const cv::Rect2d& box = track[t].box;
    if (!std::isfinite(box.x + box.y + box.width + box.height)) refuse(t, "has a box that is not finite");
    if (!(box.width > 0 && box.height > 0)) refuse(t, "has a box without size");
    if (!track[t].covariance) continue;
    const Eigen::Matrix3d& c = *track[t].covariance;
    if (!c.allFinite()) refuse(t, "has a covariance that is not finite");
    const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(c).eigenvalues()[0];
    if (least < -1e-9 * c.norm()) refuse(t, "has a covariance that is not positive semi-definite");
  }
}

// Of the frames that have evidence, see smooth_track; the others are 0.
template <int Dim>
std::vector<Eigen::Matrix<double, Dim, Dim>> variances(std::span<const TrackResult> track, int first) {
  using Block = Eigen::Matrix<double, Dim, Dim>;
  const auto given = [&](const TrackResult& result) -> Block {
    return result.covariance->template block<Dim, Dim>(first, first);
  };
  std::vector<double> sizes;
  for (const TrackResult& result : track)
    if (!result.interrupted && result.covariance && given(result).trace() > 0)
      sizes.push_back(given(result).trace() / Dim);
  const double typical = median_or_0(std::move(sizes));
  std::vector<Block> all;
  for (const TrackResult& result : track) {
    Block& block = all.emplace_back(Block::Zero());
    if (result.interrupted) continue;
    if (typical == 0)
      block = (Dim == 1 ? 1 : result.box.area()) * Block::Identity();
    else if (!result.covariance)
      block = typical * Block::Identity();
    else
      block = given(result) + kLeastShare * typical * Block::Identity();
  }
  return all;
}

}  // namespace

std::vector<TrackResult> smooth_track(std::span<const TrackResult> track, cv::Size image) {
  check(track);
  std::vector<TrackResult> results(track.begin(), track.end());
  // The frames after the first, up to the last one that has evidence.
  std::span seen = track.subspan(std::min<std::size_t>(1, track.size()));
  while (!seen.empty() && seen.back().interrupted) seen = seen.first(seen.size() - 1);
  if (std::ranges::count(seen, false, &TrackResult::interrupted) < 2) return results;

  const Point2 start = centre_of(track[0].box);
  const double start_size = log_size(track[0].box);
  std::vector<Eigen::Vector2d> centres;
  std::vector<Eigen::Vector<double, 1>> sizes;
  for (const TrackResult& result : seen) {
    centres.emplace_back(centre_of(result.box) - start);
    sizes.emplace_back(log_size(result.box) - start_size);
  }
  Chain<2>::Path centre;
  Chain<1>::Path size;
  if (!Chain<2>(std::move(centres), variances<2>(seen, 0)).smooth(centre) ||
      !Chain<1>(sizes, variances<1>(seen, 2)).smooth(size))
    throw std::invalid_argument("smooth_track: boxes or covariances are too large or too small");

  results[0].covariance = Eigen::Matrix3d::Zero();
  for (std::size_t t = 0; t < seen.size(); ++t) {
    TrackResult& result = results[t + 1];
    Point2 at = start + centre.points[t];
    if (!image.empty()) at = at.cwiseMin(Point2(image.width - 1, image.height - 1)).cwiseMax(0);
    const double growth = std::exp(size.points[t][0] - sizes[t][0]);
    result.box = box_around(at, growth * Size2(result.box.width, result.box.height));
    result.covariance.emplace(Eigen::Matrix3d::Zero());
    result.covariance->topLeftCorner<2, 2>() = centre.covariances[t];
    (*result.covariance)(2, 2) = size.covariances[t](0, 0);
  }
  for (std::size_t t = seen.size() + 1; t < results.size(); ++t) {
    results[t].box = results[t - 1].box;
    results[t].covariance = results[t - 1].covariance;
  }
  return results;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
