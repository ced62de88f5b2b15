#pragma once

// A whole recording of asterism.pose, given what was estimated of its parts.
#include <asterism/solver/run/executor.hpp>

#include "pose_estimate.hpp"

namespace asterism::python::pose {

/// Weights of detections and changes, on arrays of others.
struct Weights {
  const double* detections;  ///< (views, frames, joints)
  const double* curvatures;  ///< (views, frames, joints)
  const double* changes;     ///< (frames - 2, joints)
  const double* offset;      ///< (views, joints, 2)
  const double* centre;      ///< (D)
  double extent;
};

/// f(groups, first) for groups of joints that begin with number `first`, at `points` (frames, joints, D), in
/// several threads.
template <typename F>
void for_each_group(const Recording& of, const Weights& weights, const double* points, int threads, F&& f) {
  const Index lanes = pose_kernels::kernels(of.dim).lanes;
  detail::for_each_task(threads, static_cast<int>((of.joints + lanes - 1) / lanes), [&](int, int task) {
    const Index first = task * lanes, count = std::min(lanes, of.joints - first);
    const Numbers coefficients = change_coefficients(of.times, of.frames);
    Groups groups(of.dim, of.frames, of.views, count, of.cameras, of.area);
    groups.set_sights(of, [&](Index v, Index t, Index j) { return of.at(v, t, first + j); });
    groups.for_each_joint([&](pose_kernels::JointGroup& g, Index lane, Index j) {
      g.coefficients = coefficients.data();
      g.least_weak = 1 / std::pow(kFarAway * weights.extent, 2);
      std::copy_n(weights.centre, of.dim, g.centre);
      for (Index t = 0; t < of.frames; ++t) {
        for (Index c = 0; c < of.dim; ++c)
          groups.at(g.points, t * of.dim + c, lane) = points[(t * of.joints + first + j) * of.dim + c];
        for (Index v = 0; v < of.views; ++v) {
          groups.at(g.weight, t * of.views + v, lane) = weights.detections[of.at(v, t, first + j)];
          groups.at(g.curvature, t * of.views + v, lane) = weights.curvatures[of.at(v, t, first + j)];
        }
        if (t + 2 < of.frames) groups.at(g.calm, t, lane) = weights.changes[t * of.joints + first + j];
      }
      for (Index i = 0; i < of.views * 2; ++i)
        groups.at(g.offset, i, lane) = weights.offset[(i / 2 * of.joints + first + j) * 2 + i % 2];
    });
    f(groups, first);
  });
}

/// Takes the covariances of groups of joints that begin with number `first` into (frames, joints, E).
inline void take_covariance(Groups& groups, const Recording& of, Index first, double* covariance) {
  const Index entries = entries_of(of.dim);
  groups.for_each_joint([&](pose_kernels::JointGroup& g, Index lane, Index j) {
    for (Index t = 0; t < of.frames; ++t) {
      for (Index k = 0; k < entries; ++k)
        covariance[(t * of.joints + first + j) * entries + k] =
            groups.at(g.covariance, t * entries + k, lane);
    }
  });
}

/// points (frames, joints, D), which is where the errors are linear, becomes the path.
inline void solve_path(const Recording& of, const Weights& weights, int threads, double* points,
                       double* covariance) {
  for_each_group(of, weights, points, threads, [&](Groups& groups, Index first) {
    groups.solve(false);
    groups.observe();
    take_covariance(groups, of, first, covariance);
    groups.for_each_joint([&](pose_kernels::JointGroup& g, Index lane, Index j) {
      for (Index t = 0; t < of.frames; ++t) {
        for (Index c = 0; c < of.dim; ++c)
          points[(t * of.joints + first + j) * of.dim + c] = groups.at(g.points, t * of.dim + c, lane);
      }
    });
  });
}

/// The covariance (frames, joints, E) if each view is off by its deviation, alike in frames near each other.
/// Such an error is no noise that frames average out: the path follows it as it follows a motion.
inline void lasting_covariance(const Recording& of, const Weights& weights, int threads, const double* points,
                               double* covariance) {
  for_each_group(of, weights, points, threads, [&](Groups& groups, Index first) {
    pose_kernels::JointGroup& group = groups.all.front();
    double* deviation = groups.array(of.frames * of.views);
    groups.for_each_joint([&](pose_kernels::JointGroup&, Index lane, Index j) {
      for (Index i = 0; i < of.frames * of.views; ++i)
        groups.at(deviation, i, lane) = of.deviation[of.at(i % of.views, i / of.views, first + j)];
    });
    Groups::Lane failed;
    groups.kernel.add_lasting(group, deviation, failed.of);
    groups.check(failed, 0);
    take_covariance(groups, of, first, covariance);
  });
}

/// Adds to the covariance (frames, joints, E) that of errors of this size of each view in all frames.
inline void add_systematic(const Recording& of, double disagreement, int threads, const double* points,
                           double* covariance) {
  std::vector<char> is_used(static_cast<std::size_t>(of.views * of.joints));
  for (Index v = 0; v < of.views; ++v) {
    for (Index i = 0; i < of.frames * of.joints; ++i)
      is_used[static_cast<std::size_t>(v * of.joints + i % of.joints)] |=
          of.is_seen[v * of.frames * of.joints + i];
  }
  constexpr Index kFrames = 500;
  detail::for_each_task(threads, static_cast<int>((of.frames + kFrames - 1) / kFrames), [&](int, int task) {
    const Index begin = task * kFrames, frames = std::min(kFrames, of.frames - begin);
    Groups groups(of.dim, frames, of.views, of.joints, of.cameras, of.area);
    groups.set_sights(of, [&](Index v, Index t, Index j) { return of.at(v, begin + t, j); });
    groups.for_each_joint([&](pose_kernels::JointGroup& g, Index lane, Index j) {
      for (Index t = 0; t < frames; ++t) {
        for (Index c = 0; c < of.dim; ++c)
          groups.at(g.points, t * of.dim + c, lane) = points[((begin + t) * of.joints + j) * of.dim + c];
        for (Index v = 0; v < of.views; ++v)
          groups.at(g.weight, t * of.views + v, lane) = is_used[static_cast<std::size_t>(v * of.joints + j)];
      }
    });
    groups.add_systematic(disagreement, covariance + begin * of.joints * entries_of(of.dim), of.joints);
  });
}

}  // namespace asterism::python::pose
