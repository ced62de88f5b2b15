#pragma once

// Points where the rays of two views meet, for asterism.pose: which detections agree, whatever the motion.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "pose_groups.hpp"

namespace asterism::python::pose {

/// How probable an outlier is while nothing is known of the noise.
constexpr double kDisagreeing = 0.1;

/// A point that two views agree on, for a joint in a frame.
struct Meeting {
  Index frame, joint;
  double point[3];
  Numbers squares;  ///< of the error in each view [px^2]; infinite behind the camera, NaN if it is not seen
};

/// Some rays: the point that is nearest to them solves across x = right.
struct Rays {
  double across[3][3] = {}, right[3] = {};

  /// That of a camera (R, t) through a place (x, y) of its image.
  void add(const double* camera, const double* image) {
    const double* t = camera + 9;
    double ray[3], eye[3], square = 0, along = 0;  // in the world: R^T (x, y, 1) from -R^T t
    for (int c = 0; c < 3; ++c) {
      ray[c] = camera[c] * image[0] + camera[3 + c] * image[1] + camera[6 + c];
      eye[c] = -(camera[c] * t[0] + camera[3 + c] * t[1] + camera[6 + c] * t[2]);
      square += ray[c] * ray[c];
      along += ray[c] * eye[c];
    }
    for (int r = 0; r < 3; ++r) {
      right[r] += eye[r] - ray[r] * along / square;
      for (int c = 0; c < 3; ++c) across[r][c] += (r == c ? 1 : 0) - ray[r] * ray[c] / square;
    }
  }
};

/// Where two detections' rays are nearest to each other; false if they are not seen, or almost parallel.
inline bool meet(const Recording& of, std::pair<Index, Index> views, std::pair<Index, Index> detections,
                 double* point) {
  using Chain = lanes_v0_1::DifferenceChain<3, double>;
  if (!of.is_seen[detections.first] || !of.is_seen[detections.second]) return false;
  Rays rays;
  rays.add(of.cameras + views.first * 12, of.sights + detections.first * 6);
  rays.add(of.cameras + views.second * 12, of.sights + detections.second * 6);
  double across[Chain::kEntries], inverse[Chain::kEntries];
  for (int r = 0; r < 3; ++r) {
    for (int c = r; c < 3; ++c) across[Chain::entry(r, c)] = rays.across[r][c];
  }
  bool is_definite = true;
  Chain::invert(across, inverse, [&](double pivot) { is_definite = is_definite && pivot > 1e-9; });
  for (int r = 0; r < 3; ++r) {
    point[r] = 0;
    for (int c = 0; c < 3; ++c) point[r] += inverse[Chain::entry(r, c)] * rays.right[c];
  }
  return is_definite;
}

/// Of a detection, if its joint is at this point.
inline double square_of_error(const Recording& of, Index view, Index detection, const double* point) {
  if (!of.is_seen[detection]) return std::numeric_limits<double>::quiet_NaN();
  const double *camera = of.cameras + view * 12, *seen = of.sights + detection * 6;
  double at[3];
  for (int r = 0; r < 3; ++r)
    at[r] = camera[r * 3] * point[0] + camera[r * 3 + 1] * point[1] + camera[r * 3 + 2] * point[2] +
            camera[9 + r];
  if (!(at[2] > 0)) return std::numeric_limits<double>::infinity();
  const double x = at[0] / at[2] - seen[0], y = at[1] / at[2] - seen[1];
  const double across = seen[2] * x + seen[3] * y, down = seen[4] * x + seen[5] * y;
  return across * across + down * down;
}

/// The points of all pairs of views, for each joint and frame of which two views see the joint. at(view,
/// frame, joint): a detection of the recording.
class Meetings {
 public:
  template <typename At>
  Meetings(const Recording& of, Index frames, Index joints, At&& at) : of_(of) {
    for (Index joint = 0; joint < joints; ++joint) {
      for (Index frame = 0; frame < frames; ++frame) {
        std::vector<Meeting> found;
        for (Index b = 0; b < of.views; ++b) {
          for (Index a = 0; a < b; ++a) {
            Meeting meeting{frame, joint, {}, {}};
            if (!meet(of, {a, b}, {at(a, frame, joint), at(b, frame, joint)}, meeting.point)) continue;
            for (Index v = 0; v < of.views; ++v)
              meeting.squares.push_back(square_of_error(of, v, at(v, frame, joint), meeting.point));
            found.push_back(std::move(meeting));
          }
        }
        if (!found.empty()) all_.push_back(std::move(found));
      }
    }
  }

  /// The noise [px] with which all points together are most probable, of guess / 1024 to 16 guess, as
  /// outliers make the guess too large. Beforehand, its logarithm has a normal distribution about that of the
  /// guess: otherwise a noise as large as the errors of outliers explains a single point best. A noise of an
  /// eighth of the image would explain anything.
  double noise(double guess) const {
    double best = guess, greatest = -std::numeric_limits<double>::infinity();
    const double most = std::sqrt(*std::max_element(of_.area, of_.area + of_.views)) / 8;
    for (double noise = guess / 1024; !all_.empty() && noise < std::min(17 * guess, most); noise *= 2) {
      double sum = -std::pow(std::log(noise / guess), 2) / 2;
      for (const auto& of_point : all_) {
        const Meeting& meeting = best_of(of_point, noise);
        sum += std::max(log_probability(meeting, noise), log_probability_of_outliers(meeting));
      }
      if (!(sum > greatest)) continue;
      greatest = sum;
      best = noise;
    }
    return best;
  }

  /// f(meeting) for the most probable one of each point.
  template <typename F>
  void for_each_best(double noise, F&& f) const {
    for (const auto& of_point : all_) f(best_of(of_point, noise));
  }

 private:
  /// Of the detections, with three degrees of freedom that the point has taken: it is anywhere in the images.
  double log_probability(const Meeting& meeting, double noise) const {
    constexpr double kTwoPi = 6.283185307179586;
    const double variance = noise * noise;
    double sum = 0, size = 0, seen = 0;
    for (Index v = 0; v < of_.views; ++v) {
      const double square = meeting.squares[static_cast<std::size_t>(v)];
      if (std::isnan(square)) continue;
      const double base = 1 + square / (4 * variance);  // Student's t distribution
      sum += std::log((1 - kDisagreeing) / (kTwoPi * variance * base * base * base) +
                      kDisagreeing / of_.area[v]);
      size += std::log(of_.area[v]) / 2;
      ++seen;
    }
    return sum + 3 * (std::log(noise) - size / seen);
  }

  /// Of the detections, if none is right.
  double log_probability_of_outliers(const Meeting& meeting) const {
    double sum = 0;
    for (Index v = 0; v < of_.views; ++v) {
      if (!std::isnan(meeting.squares[static_cast<std::size_t>(v)]))
        sum += std::log(kDisagreeing / of_.area[v]);
    }
    return sum;
  }

  const Meeting& best_of(const std::vector<Meeting>& of_point, double noise) const {
    return *std::max_element(of_point.begin(), of_point.end(), [&](const Meeting& a, const Meeting& b) {
      return log_probability(a, noise) < log_probability(b, noise);
    });
  }

  const Recording& of_;
  std::vector<std::vector<Meeting>> all_;  // of each point
};

}  // namespace asterism::python::pose
