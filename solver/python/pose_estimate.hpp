#pragma once

// The estimate of asterism.pose.fuse from detections: scales, weights and points by expectation-maximisation.
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "pose_groups.hpp"
#include "pose_pairs.hpp"

namespace asterism::python::pose {

/// Estimates from the data besides the points.
struct Scales {
  Numbers noise;   ///< (views, joints)
  Numbers motion;  ///< (joints), a variance
  Numbers offset;  ///< (views, joints, 2): what the views are off by in all frames
  double disagreement = 0;
  double extent = 0;  ///< of the scene
};

/// The scales that explain a recording best, and what follows from them.
struct Estimate {
  std::vector<Index> joints;  ///< that are seen; the others are left out of all arrays
  Scales scales;
  Numbers points;       ///< (frames, joints, D)
  Numbers covariance;   ///< (frames, joints, E)
  Numbers probability;  ///< (views, frames, joints): that a detection is no outlier
  Numbers weight;       ///< (views, frames, joints)
  Numbers curvature;    ///< (views, frames, joints): instead of the weight, for the covariance
  Numbers stiffness;    ///< (frames - 2, joints): the weight of each change of velocity
};

/// Of the noise that all views and joints have in common, in detections.
constexpr double kPriorCount = 10;
/// The variance of motion converges slowly, a few percent in a step: so many steps of its logarithm at once.
constexpr double kOverrelaxed = 3;
/// The least change of velocity in a frame, in sizes of the scene: that of a joint that rests, or is seen
/// once.
constexpr double kStill = 1e-5;
/// Of fewer frames, what a view is off by in all of them cannot be told from outliers.
constexpr Index kOffsetFrames = 10;
/// The prior of a point holds where nothing else does; its deviation, in sizes of the scene.
constexpr double kFarAway = 100;

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

/// The quantile of the numbers that are not NaN, linear between neighbours; NaN if there are none.
inline double quantile(Numbers values, double share) {
  values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return std::isnan(v); }),
               values.end());
  if (values.empty()) return kMissing;
  const double rank = share * static_cast<double>(values.size() - 1);
  const auto lower = values.begin() + static_cast<Index>(rank);
  std::nth_element(values.begin(), lower, values.end());
  const double rest = rank - std::floor(rank);
  return rest == 0 ? *lower : *lower + rest * (*std::min_element(lower + 1, values.end()) - *lower);
}

inline double median(Numbers values) { return quantile(std::move(values), 0.5); }

/// A point in the middle of what is seen, and for each view the pixels for a unit of length there.
struct Middle {
  double point[3];
  Numbers magnification;
};

/// Some frames of a recording, and the joints that they see.
struct Part {
  const Recording& of;
  Index begin, frames;
  std::vector<Index> joints;

  Part(const Recording& recording, Index from, Index to) : of(recording), begin(from), frames(to - from) {
    for (Index j = 0; j < of.joints; ++j) {
      bool is_seen = false;
      for (Index v = 0; v < of.views; ++v) {
        for (Index t = from; t < to && !is_seen; ++t) is_seen = of.is_seen[of.at(v, t, j)];
      }
      if (is_seen) joints.push_back(j);
    }
  }

  Index count() const { return static_cast<Index>(joints.size()); }
  Index at(Index view, Index frame, Index k) const {
    return of.at(view, begin + frame, joints[static_cast<std::size_t>(k)]);
  }
  /// How many detections there are.
  double seen() const {
    double sum = 0;
    for (Index i = 0; i < of.views * frames * count(); ++i)
      sum += of.is_seen[at(i / (frames * count()), i / count() % frames, i % count())];
    return sum;
  }
  /// The square of the pixels for a unit of the image, in the geometric mean of its axes.
  double magnified(Index i) const {
    const double* s = of.sights + i * 6 + 2;
    return std::abs(s[0] * s[3] - s[1] * s[2]);
  }
  Middle middle() const;
  Scales first_guess(const Middle& middle) const;
};

inline Middle Part::middle() const {
  Middle result{{0, 0, 0}, Numbers(static_cast<std::size_t>(of.views), 1.0)};
  Rays rays;
  Numbers places[2];  // of the views
  for (Index v = 0; v < of.views; ++v) {
    Numbers coordinates[2], pixels;
    for (Index t = 0; t < frames; ++t) {
      for (Index k = 0; k < count(); ++k) {
        const Index i = at(v, t, k);
        if (!of.is_seen[i]) continue;
        for (int r = 0; r < 2; ++r) coordinates[r].push_back(of.sights[i * 6 + r]);
        pixels.push_back(magnified(i));
      }
    }
    const bool is_empty = pixels.empty();
    const double image[2] = {is_empty ? 0 : median(std::move(coordinates[0])),
                             is_empty ? 0 : median(std::move(coordinates[1]))};
    if (of.dim == 2) {
      for (int r = 0; r < 2 && !is_empty; ++r) places[r].push_back(image[r]);
      continue;
    }
    if (!is_empty) result.magnification[static_cast<std::size_t>(v)] = std::sqrt(median(std::move(pixels)));
    rays.add(of.cameras + v * 12, image);
  }
  if (of.dim == 2) {
    for (int r = 0; r < 2; ++r) result.point[r] = median(std::move(places[r]));
    return result;
  }
  // The point that is nearest to the middle rays of all views.
  auto& [across, right] = rays;
  double axes[3][3];
  diagonalize(across, axes);
  const auto [smallest, greatest] = std::minmax({across[0][0], across[1][1], across[2][2]});
  if (!(greatest <= 1e12 * smallest))
    throw std::invalid_argument("cameras: they look along one line, so that depth is unknown");
  for (int k = 0; k < 3; ++k) {
    const double along = axes[0][k] * right[0] + axes[1][k] * right[1] + axes[2][k] * right[2];
    for (int r = 0; r < 3; ++r) result.point[r] += axes[r][k] * along / across[k][k];
  }
  const double* point = result.point;
  double least = std::numeric_limits<double>::infinity();
  Index behind = 0;
  for (Index v = 0; v < of.views; ++v) {
    const double* camera = of.cameras + v * 12;
    const double depth = camera[6] * point[0] + camera[7] * point[1] + camera[8] * point[2] + camera[11];
    if (depth < least) std::tie(least, behind) = std::pair(depth, v);
    result.magnification[static_cast<std::size_t>(v)] /= depth;
  }
  if (!(least > 0))
    throw std::invalid_argument("cameras: view " + std::to_string(behind) +
                                " has the joints behind it; does each view have its own calibration?");
  return result;
}

/// The medians of 7 numbers around each, fewer at the ends and of few numbers, so that not all are of the
/// same ones; NaN counts as missing.
inline Numbers running_median(const Numbers& path) {
  constexpr Index kHalf = 3;
  const auto size = static_cast<Index>(path.size());
  const Index half = std::clamp<Index>((size - 3) / 2, 0, kHalf);
  Numbers result(path.size());
  for (Index t = 0; t < size; ++t) {
    double sorted[2 * kHalf + 1];
    Index n = 0;
    for (Index k = std::max<Index>(t - half, 0); k < std::min(t + half + 1, size); ++k) {
      const double value = path[static_cast<std::size_t>(k)];
      if (std::isnan(value)) continue;
      Index to = n++;
      for (; to > 0 && sorted[to - 1] > value; --to) sorted[to] = sorted[to - 1];
      sorted[to] = value;
    }
    result[static_cast<std::size_t>(t)] = n == 0 ? kMissing : (sorted[(n - 1) / 2] + sorted[n / 2]) / 2;
  }
  return result;
}

/// Noise of a detection, motion of each joint and the size of the scene.
///
/// All are medians, which bear outliers; the noise counts as motion as well, from which the evidence
/// separates it.
inline Scales Part::first_guess(const Middle& middle) const {
  const auto size = static_cast<std::size_t>(frames);
  const double typical = median(middle.magnification);
  const Numbers coefficients = change_coefficients(of.times + begin, frames);
  Numbers noises;
  std::vector<Numbers> sizes(joints.size() + 1), motions(joints.size());  // of each view
  for (Index v = 0; v < of.views; ++v) {
    const double pixels = middle.magnification[static_cast<std::size_t>(v)];
    Numbers middles[2];
    for (std::size_t k = 0; k < joints.size(); ++k) {
      Numbers second, change(frames > 2 ? size - 2 : 0, 0.0);
      double spread[2];
      Numbers paths[2] = {Numbers(size, kMissing), Numbers(size, kMissing)};
      for (std::size_t t = 0; t < size; ++t) {
        const Index i = at(v, static_cast<Index>(t), static_cast<Index>(k));
        if (!of.is_seen[i]) continue;
        const double scale = std::sqrt(magnified(i));
        for (int r = 0; r < 2; ++r) paths[r][t] = of.sights[i * 6 + r] * scale;
      }
      for (int r = 0; r < 2; ++r) {
        const Numbers& path = paths[r];
        spread[r] = quantile(path, 0.9) - quantile(path, 0.1);
        middles[r].push_back(median(path));
        if (frames < 3) continue;
        for (std::size_t t = 2; t < size; ++t)
          second.push_back(std::abs(path[t] - 2 * path[t - 1] + path[t - 2]));
        const Numbers smooth = running_median(path);
        for (std::size_t t = 0; t + 2 < size; ++t) {
          const double* c = coefficients.data() + t * 3;
          const double d = (c[0] * smooth[t] + c[1] * smooth[t + 1] + c[2] * smooth[t + 2]) / pixels;
          change[t] += d * d;
        }
      }
      sizes[k].push_back((std::isnan(spread[0]) ? spread[0] : std::max(spread[0], spread[1])) / pixels);
      noises.push_back(median(std::move(second)));
      motions[k].push_back(median(std::move(change)));
    }
    double apart[2];
    for (int r = 0; r < 2; ++r) apart[r] = quantile(middles[r], 0.9) - quantile(middles[r], 0.1);
    sizes.back().push_back(std::max(apart[0], apart[1]) / pixels);
  }
  Scales scales;
  for (Numbers& of_joint : sizes) {
    if (const double found = median(std::move(of_joint)); found > scales.extent) scales.extent = found;
  }
  if (!(scales.extent > 0)) scales.extent = 1 / typical;
  const double smallest = 1e-4 * scales.extent * typical;
  double noise = 2e-3 * std::sqrt(*std::max_element(of.area, of.area + of.views));
  scales.motion.assign(joints.size(), scales.extent * scales.extent);
  if (frames > 2) {
    noises.erase(std::remove_if(noises.begin(), noises.end(), [](double n) { return std::isnan(n); }),
                 noises.end());
    noise = 0;
    for (const double n : noises) noise += n / (static_cast<double>(noises.size()) * 0.6745 * std::sqrt(6.0));
    for (std::size_t k = 0; k < joints.size(); ++k) scales.motion[k] = median(std::move(motions[k])) / of.dim;
    const double usual = median(scales.motion), still = kStill * scales.extent;
    const double least = std::max(std::isnan(usual) ? 0 : 1e-3 * usual, still * still);
    for (double& m : scales.motion) m = m > least ? m : least;  // also NaN
  }
  scales.noise.assign(static_cast<std::size_t>(of.views) * joints.size(), std::max(noise, smallest));
  scales.offset.assign(scales.noise.size() * 2, 0.0);
  return scales;
}

/// The columns of a matrix (rows, Dim), in C order, become orthogonal to each other and span the same space:
/// one-sided Jacobi rotations.
template <int Dim>
void orthogonalize(Numbers& matrix) {
  for (int sweep = 0; sweep < 30; ++sweep) {
    bool is_done = true;
    for (int p = 0; p < Dim; ++p) {
      for (int q = p + 1; q < Dim; ++q) {
        double a = 0, b = 0, both = 0;
        for (std::size_t r = 0; r < matrix.size(); r += Dim) {
          const double x = matrix[r + static_cast<std::size_t>(p)],
                       y = matrix[r + static_cast<std::size_t>(q)];
          a += x * x;
          b += y * y;
          both += x * y;
        }
        if (!(std::abs(both) > 1e-15 * std::sqrt(a * b))) continue;
        is_done = false;
        const double zeta = (b - a) / (2 * both);
        const double tangent = (zeta < 0 ? -1 : 1) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
        const double cosine = 1 / std::sqrt(1 + tangent * tangent), sine = cosine * tangent;
        for (std::size_t r = 0; r < matrix.size(); r += Dim) {
          double &x = matrix[r + static_cast<std::size_t>(p)], &y = matrix[r + static_cast<std::size_t>(q)];
          std::tie(x, y) = std::pair(cosine * x - sine * y, sine * x + cosine * y);
        }
      }
    }
    if (is_done) return;
  }
}

/// Takes from the errors (rows) what the columns of a matrix (rows, Dim) explain, and returns its rank.
template <int Dim>
int take_explained(Numbers matrix, Numbers& errors) {
  orthogonalize<Dim>(matrix);
  double size[Dim] = {}, along[Dim] = {};
  for (std::size_t r = 0; r < errors.size(); ++r) {
    for (std::size_t c = 0; c < Dim; ++c) {
      size[c] += matrix[r * Dim + c] * matrix[r * Dim + c];
      along[c] += matrix[r * Dim + c] * errors[r];
    }
  }
  const double greatest = *std::max_element(size, size + Dim);
  int rank = 0;
  for (std::size_t c = 0; c < Dim; ++c) {
    if (!(size[c] > 1e-12 * greatest)) continue;
    ++rank;
    for (std::size_t r = 0; r < errors.size(); ++r) errors[r] -= along[c] / size[c] * matrix[r * Dim + c];
  }
  return rank;
}

/// Factors of the first guess; and whether only detections on which pairs of views agree count at first.
struct Start {
  double noise = 1, motion = 1;
  bool is_by_pairs = false;
};
constexpr Start kStarts[] = {{1, 1},       {1.0 / 4, 1.0 / 16}, {1.0 / 16, 1.0 / 256}, {1.0 / 64, 1.0 / 4096},
                             {1.0 / 4, 1}, {1.0 / 16, 1},       {1.0 / 64, 1}};

/// Expectation-maximisation on the frames of a part.
class Estimator {
 public:
  Estimator(const Part& part, const Start& start)
      : part_(part),
        is_by_pairs_(start.is_by_pairs),
        groups_(part.of.dim, part.frames, part.of.views, part.count(), part.of.cameras, part.of.area),
        middle_(part.middle()),
        scales_(part.first_guess(middle_)),
        guess_(median(scales_.noise)),
        coefficients_(change_coefficients(part.of.times + part.begin, part.frames)) {
    for (double& noise : scales_.noise) noise *= start.noise;
    for (double& motion : scales_.motion) motion *= start.motion;
    fill();
    const Index views = part.of.views, dim = part.of.dim;
    for (std::size_t g = 0; g < groups_.all.size(); ++g) {
      Sums s;
      for (double** of : {&s.square, &s.count, &s.shared, &s.neighbours}) *of = groups_.array(views);
      s.rows = groups_.array(views * 2 * dim);
      s.errors = groups_.array(views * 2);
      s.before = groups_.array(views * 2);
      sums_.push_back(s);
    }
  }

  /// Steps end when they change the points and their deviations by less than `settled` of these (root mean
  /// squares), and at the latest after `steps`. The scales themselves are not asked: those of a joint that
  /// moves little change long after they have stopped to matter.
  void run(double settled, int steps) {
    const Index views = part_.of.views;
    double width = std::sqrt(*std::max_element(part_.of.area, part_.of.area + views)) / 4;
    start(width);
    if (is_by_pairs_) start_by_pairs(width);
    const double typical = median(middle_.magnification), target = median(scales_.noise);
    const double smallest = 1e-5 * scales_.extent * typical;
    set_prior(true);
    while (steps > 0) {
      const bool is_wide = width > target;
      if (!is_wide) set_prior(false);
      set_variance(width);
      for (std::size_t g = 0; g < groups_.all.size(); ++g) groups_.kernel.expect(groups_.all[g], &sums_[g]);
      if (width < 4 * target) update_noise(smallest);
      if (width < 30 * target && views > 1) update_offsets();
      if (part_.frames > 2) update_motion(is_wide);
      set_variance(width);
      for (JointGroup& g : groups_.all) groups_.kernel.reweigh(g);
      const double moved = groups_.solve(width > 30 * target);
      width /= 2;
      if (is_wide) continue;
      --steps;
      if (moved < settled * settled && deviations_changed() < settled * settled) break;
    }
  }

  Estimate result() {
    groups_.observe();
    return arrays();
  }
  double typical_noise() const { return median(scales_.noise); }
  /// The start by pairs of views, with the noise of about 300 points of the part.
  Start by_pairs() const {
    const Index step = std::max<Index>(part_.frames * part_.count() / 300, 1);
    const Meetings meetings(part_.of, (part_.frames + step - 1) / step, part_.count(),
                            [&](Index v, Index t, Index k) { return part_.at(v, t * step, k); });
    return {meetings.noise(guess_) / guess_, 1, true};
  }
  /// Whether few detections are outliers and the noise is about that of this start.
  bool is_plausible(const Start& by_pairs) {
    return right() > 0.85 * part_.seen() && typical_noise() < 2 * by_pairs.noise * guess_;
  }
  /// How many detections are no outliers.
  double right() {
    double sum = 0;
    for_each_sum([&](const Sums& s, Index lane, Index v, Index) { sum += groups_.at(s.count, v, lane); });
    return sum;
  }
  double log_evidence() {
    const Numbers found = groups_.log_evidences();
    return std::accumulate(found.begin(), found.end(), 0.0);
  }

 private:
  using JointGroup = pose_kernels::JointGroup;
  using Sums = pose_kernels::DetectionSums;

  /// Of a view and joint.
  std::size_t at(Index view, Index joint) const {
    return static_cast<std::size_t>(view * part_.count() + joint);
  }

  void fill() {
    const Recording& of = part_.of;
    const double weak = kFarAway * scales_.extent;
    for (JointGroup& g : groups_.all) {
      g.coefficients = coefficients_.data();
      std::copy_n(middle_.point, 3, g.centre);
      g.least_weak = 1 / (weak * weak);
      if (of.deviation != nullptr) {
        g.doubt = groups_.array(part_.frames * of.views);
        std::fill_n(g.doubt, part_.frames * of.views * groups_.kernel.lanes, 1.0);
      }
    }
    groups_.set_sights(of, [&](Index v, Index t, Index k) { return part_.at(v, t, k); });
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index k) {
      for (Index v = 0; v < of.views; ++v) {
        double level = 0, seen = 0;  // of the logarithms of the deviations
        for (Index t = 0; t < part_.frames; ++t) {
          const Index i = part_.at(v, t, k);
          if (of.deviation == nullptr || !of.is_seen[i]) continue;
          level += std::log(of.deviation[i]);
          ++seen;
        }
        for (Index t = 0; t < part_.frames && of.deviation != nullptr; ++t) {
          const double ratio = of.deviation[part_.at(v, t, k)] / std::exp(level / std::max(seen, 1.0));
          groups_.at(g.doubt, t * of.views + v, lane) = ratio * ratio;
        }
      }
      for (Index t = 0; t < part_.frames; ++t) {
        for (Index c = 0; c < of.dim; ++c) groups_.at(g.points, t * of.dim + c, lane) = middle_.point[c];
      }
      *(g.motion + lane) = scales_.motion[static_cast<std::size_t>(k)];
    });
  }

  /// The probability beforehand that a detection is no outlier. While distributions are wide, it is relative
  /// to the greatest of the joint: nothing but outliers would lead to no path at all.
  void set_prior(bool is_wide) {
    const Recording& of = part_.of;
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index k) {
      double greatest = 0;
      const auto for_each_detection = [&](auto&& f) {
        for (Index t = 0; t < part_.frames; ++t) {
          for (Index v = 0; v < of.views; ++v)
            if (const Index i = part_.at(v, t, k); of.is_seen[i]) f(i, t * of.views + v);
        }
      };
      for_each_detection([&](Index i, Index) { greatest = std::max(greatest, of.belief[i]); });
      const double scale = (1 - kOutliers) / (is_wide && greatest > 0 ? greatest : 1);
      for_each_detection([&](Index i, Index to) {
        const bool disagrees = is_wide && !disagrees_.empty() && disagrees_[of_part(to, k)];
        groups_.at(g.prior, to, lane) = disagrees ? 0 : scale * of.belief[i];
      });
    });
  }

  /// From the middle, until the depth, which scales a ray's weight, is about right.
  void start(double width) {
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index k) {
      for (Index t = 0; t < part_.frames; ++t) {
        for (Index v = 0; v < part_.of.views; ++v) {
          const bool is_seen = part_.of.is_seen[part_.at(v, t, k)];
          groups_.at(g.weight, t * part_.of.views + v, lane) = is_seen ? 1 / (width * width) : 0;
        }
      }
    });
    for (int turn = 0; turn < (part_.of.dim == 3 ? 3 : 1); ++turn) groups_.solve(true);
  }

  /// Until distributions are narrow, detections that are far from the most probable point on which two views
  /// agree are outliers. Without motion, each point begins there.
  void start_by_pairs(double& width) {
    const Meetings meetings(part_.of, part_.frames, part_.count(),
                            [&](Index v, Index t, Index k) { return part_.at(v, t, k); });
    const double noise = median(scales_.noise), variance = noise * noise;
    disagrees_.assign(static_cast<std::size_t>(part_.of.views * part_.frames * part_.count()), false);
    meetings.for_each_best(noise, [&](const Meeting& best) {
      JointGroup& g = groups_.all[static_cast<std::size_t>(best.joint / groups_.kernel.lanes)];
      const Index lane = best.joint % groups_.kernel.lanes;
      for (Index v = 0; v < part_.of.views; ++v) {
        const Index i = best.frame * part_.of.views + v;
        const bool agrees = best.squares[static_cast<std::size_t>(v)] < 9 * variance;
        disagrees_[of_part(i, best.joint)] = !agrees;
        if (part_.frames < 3) groups_.at(g.weight, i, lane) = agrees ? 1 / variance : 0;
      }
      for (Index c = 0; c < 3 && part_.frames < 3; ++c)
        groups_.at(g.points, best.frame * 3 + c, lane) = best.point[c];
    });
    if (part_.frames > 2) return;
    groups_.solve(false);
    width = 2 * noise;
  }
  /// Of a detection, number i of its joint.
  std::size_t of_part(Index i, Index joint) const {
    return static_cast<std::size_t>(i * part_.count() + joint);
  }

  void set_variance(double width) {
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index k) {
      for (Index v = 0; v < part_.of.views; ++v) {
        const double deviation = std::max(scales_.noise[at(v, k)], width);
        groups_.at(g.variance, v, lane) = deviation * deviation;
      }
    });
  }

  /// f(sums, lane, view, joint) for each.
  template <typename F>
  void for_each_sum(F&& f) {
    for (Index k = 0; k < part_.count(); ++k) {
      const Sums& s = sums_[static_cast<std::size_t>(k / groups_.kernel.lanes)];
      for (Index v = 0; v < part_.of.views; ++v) f(s, k % groups_.kernel.lanes, v, k);
    }
  }

  void update_noise(double smallest) {
    double squares = 0, counts = 0;
    for_each_sum([&](const Sums& s, Index lane, Index v, Index) {
      squares += groups_.at(s.square, v, lane);
      counts += 2 * groups_.at(s.count, v, lane);
    });
    const double common = squares / std::max(counts, 1e-9);
    for_each_sum([&](const Sums& s, Index lane, Index v, Index k) {
      const double square = groups_.at(s.square, v, lane) + kPriorCount * common;
      const double count = 2 * groups_.at(s.count, v, lane) + kPriorCount;
      scales_.noise[at(v, k)] = std::max(std::sqrt(square / count), smallest);
    });
  }

  /// A calibration and a detector have errors that no average over frames removes. What neighbouring frames
  /// have in common is the variance of errors that last, for the degrees of freedom that the joint's place
  /// leaves. The offsets are the part of the mean errors that no place of the joint explains, as far as it is
  /// not the mean of noise: of one frame, all of it may be.
  void update_offsets() {
    const Index views = part_.of.views, dim = part_.of.dim;
    double freedom = 0, shared = 0, offsets = 0;
    std::vector<Numbers> means;
    for (Index k = 0; k < part_.count(); ++k) {
      const auto group = static_cast<std::size_t>(k / groups_.kernel.lanes);
      const Sums& s = sums_[group];
      const Index lane = k % groups_.kernel.lanes;
      Numbers slope, mean;
      for (Index v = 0; v < views; ++v) {
        const double count = groups_.at(s.count, v, lane), scale = 1 / std::max(count, 1e-300);
        for (Index r = 0; r < 2; ++r) {
          mean.push_back(groups_.at(s.errors, v * 2 + r, lane) * scale);
          for (Index c = 0; c < dim; ++c)
            slope.push_back(groups_.at(s.rows, (v * 2 + r) * dim + c, lane) * scale);
        }
        if (count > 0) freedom += 2;
        shared += groups_.at(s.shared, v, lane) / std::max(groups_.at(s.neighbours, v, lane), 1e-9);
      }
      freedom -= dim == 2 ? take_explained<2>(slope, mean) : take_explained<3>(slope, mean);
      means.push_back(std::move(mean));
    }
    const double lasting = freedom > 0.5 ? std::max(shared / freedom, 0.0) : 0;
    for (Index k = 0; k < part_.count(); ++k) {
      const auto group = static_cast<std::size_t>(k / groups_.kernel.lanes);
      const Index lane = k % groups_.kernel.lanes;
      for (Index i = 0; i < 2 * views; ++i) {
        const double noise = scales_.noise[at(i / 2, k)], count = groups_.at(sums_[group].count, i / 2, lane);
        const bool is_known = count > 0 && part_.frames >= kOffsetFrames;
        const double share = is_known ? lasting / (lasting + noise * noise / count) : 0;
        const double mean = means[static_cast<std::size_t>(k)][static_cast<std::size_t>(i)],
                     offset = -share * mean;
        groups_.at(groups_.all[group].offset, i, lane) = offset;
        scales_.offset[at(i / 2, k) * 2 + static_cast<std::size_t>(i % 2)] = offset;
        offsets += mean * mean;
      }
    }
    scales_.disagreement = freedom > 0.5 ? std::sqrt(std::max(shared, offsets) / freedom) : 0;
  }

  void update_motion(bool is_wide) {
    const double still = kStill * scales_.extent;
    Groups::Lane sum;
    for (std::size_t g = 0, k = 0; g < groups_.all.size(); ++g) {
      groups_.kernel.settle(groups_.all[g], sum.of);
      for (int lane = 0; lane < groups_.kernel.lanes && k < scales_.motion.size(); ++lane, ++k) {
        if (is_wide) continue;
        double& motion = scales_.motion[k];
        const double count = static_cast<double>((part_.frames - 2) * part_.of.dim);
        motion *= std::pow(sum.of[lane] / count / motion, kOverrelaxed);
        groups_.all[g].motion[lane] = motion = std::max(motion, still * still);
      }
    }
  }

  /// The mean square of the logarithms of the deviations' ratios.
  double deviations_changed() {
    double sum = 0;
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index) {
      for (Index t = 0; t < part_.frames; ++t) {
        const double change = std::log(groups_.at(g.change, t, lane)) / 2;
        sum += change * change;
      }
    });
    return sum / static_cast<double>(part_.frames * part_.count());
  }

  Estimate arrays() {
    const Index views = part_.of.views, frames = part_.frames, count = part_.count(), dim = part_.of.dim;
    Estimate found{part_.joints, scales_, {}, {}, {}, {}, {}, {}};
    const auto size = [](Index n) { return static_cast<std::size_t>(n); };
    found.points.resize(size(frames * count * dim));
    found.covariance.resize(size(frames * count * entries_of(part_.of.dim)));
    found.probability.resize(size(views * frames * count));
    found.weight.resize(found.probability.size());
    found.curvature.resize(found.probability.size());
    found.stiffness.resize(size(std::max<Index>(frames - 2, 0) * count));
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index k) {
      const auto rows = [&](Numbers& to, double* from, Index length, Index numbers) {
        for (Index t = 0; t < length; ++t) {
          for (Index c = 0; c < numbers; ++c)
            to[size((t * count + k) * numbers + c)] = groups_.at(from, t * numbers + c, lane);
        }
      };
      rows(found.points, g.points, frames, dim);
      rows(found.covariance, g.covariance, frames, entries_of(part_.of.dim));
      rows(found.stiffness, g.stiffness, frames - 2, 1);
      for (Index v = 0; v < views; ++v) {
        for (Index t = 0; t < frames; ++t) {
          const std::size_t to = size((v * frames + t) * count + k);
          found.probability[to] = groups_.at(g.probability, t * views + v, lane);
          found.weight[to] = groups_.at(g.weight, t * views + v, lane);
          found.curvature[to] = groups_.at(g.curvature, t * views + v, lane);
        }
      }
    });
    return found;
  }

  const Part& part_;
  bool is_by_pairs_;
  Groups groups_;
  Middle middle_;
  Scales scales_;
  double guess_;  ///< of the noise
  Numbers coefficients_;
  std::vector<Sums> sums_;
  std::vector<char> disagrees_;  ///< (frames, views, joints): with the other views, at first; or nothing
};

/// Where many detections are wrong, the first guess is too large, and the steps end at a large noise that
/// explains outliers, too. Of several starts, the best is that of the greatest evidence on a stretch of the
/// part. Another one than the first has to find a tenth fewer right detections with noise of less than half,
/// and more evidence than two for each scale, as few frames have by chance.
inline Start best_start(const Part& part, double settled) {
  constexpr Index kStretch = 60;
  constexpr int kSteps = 8;
  const Index begin = part.begin + std::max<Index>(part.frames - kStretch, 0) / 2;
  const Part stretch(part.of, begin, std::min(part.begin + part.frames, begin + kStretch));
  if (stretch.joints.empty()) return {};
  Start best;
  double evidence = -std::numeric_limits<double>::infinity(), noise = -evidence,
         right = -evidence;  // at most
  for (const Start& start : kStarts) {
    try {
      Estimator estimator(stretch, start);
      estimator.run(settled, kSteps);
      const double found = estimator.log_evidence();
      if (&start == kStarts) {
        evidence = found + 2 * static_cast<double>((part.of.views + 1) * stretch.count());
        noise = estimator.typical_noise() / 2;
        right = 0.9 * estimator.right();
      } else if (found > evidence && estimator.typical_noise() < noise && estimator.right() < right) {
        evidence = found;
        best = start;
      }
    } catch (const std::invalid_argument&) {  // this start leads nowhere
    }
  }
  return best;
}

/// The best start by its evidence on a stretch, if it leads anywhere on the whole part.
inline Estimator estimator_of(const Part& part, double settled, int steps) {
  const Start start = best_start(part, settled);
  if (start.noise < 1) {
    try {
      Estimator estimator(part, start);
      estimator.run(settled, steps);
      return estimator;
    } catch (const std::invalid_argument&) {  // it was good on the stretch alone
    }
  }
  Estimator estimator(part, {});
  estimator.run(settled, steps);
  return estimator;
}

/// Wrong detections that last over frames lead a path astray from any wide distribution, but rays of two
/// views seldom meet there. Where 15 % of the detections are outliers, or the noise is twice as large as
/// it is between pairs of views, such a start is tried on the whole part, too, and the evidence decides.
inline Estimate estimated(const Part& part, double settled, int steps) {
  const bool has_pairs = part.of.dim == 3 && part.of.views > 1;
  if (has_pairs && part.frames < 3 && part.of.views > 2) {  // without motion, each point is on its own
    Estimator estimator(part, Estimator(part, {}).by_pairs());
    estimator.run(settled, steps);
    return estimator.result();
  }
  Estimator first = estimator_of(part, settled, steps);
  if (!has_pairs) return first.result();
  const Start start = first.by_pairs();
  if (first.is_plausible(start)) return first.result();
  try {
    Estimator second(part, start);
    second.run(settled, steps);
    if (second.log_evidence() > first.log_evidence()) return second.result();
  } catch (const std::invalid_argument&) {  // it leads nowhere
  }
  return first.result();
}

/// Of the frames begin .. end - 1; nothing if no joint is seen in them.
inline std::optional<Estimate> estimated(const Recording& recording, Index begin, Index end, double settled,
                                         int steps) {
  const Part part(recording, begin, end);
  if (part.joints.empty()) return std::nullopt;
  return estimated(part, settled, steps);
}

}  // namespace asterism::python::pose
