#pragma once

// The arrays of asterism.pose's kernels, and what takes numbers into lanes and out of them.
#include <algorithm>
#include <asterism/solver/linear/difference_chain.hpp>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <utility>
#include <vector>

#include "pose_kernel.hpp"

namespace asterism::python::pose {

using Index = std::ptrdiff_t;
using Numbers = std::vector<double>;

inline int entries_of(int dim) { return dim * (dim + 1) / 2; }

/// Detections, on arrays of others.
struct Recording {
  int dim;
  Index views, frames, joints;
  const double* sights;     ///< (views, frames, joints, 6): see JointGroup
  const bool* is_seen;      ///< (views, frames, joints)
  const double* belief;     ///< (views, frames, joints): that it is no outlier, in [0, 1]
  const double* times;      ///< (frames)
  const double* cameras;    ///< (views, 12); 3-D only
  const double* area;       ///< (views): of the image [px^2]
  const double* deviation;  ///< (views, frames, joints): of errors that last over frames; or null

  Index at(Index view, Index frame, Index joint) const { return (view * frames + frame) * joints + joint; }
};

/// How probable an outlier is beforehand. An estimate instead takes sudden motions for outliers, and then
/// finds many.
constexpr double kOutliers = 0.01;

/// Coefficients of the changes of velocity (frames - 2, 3): each is at a frame between two others, and
/// divided by the square root of the time it has.
inline Numbers change_coefficients(const double* times, Index frames) {
  Numbers result;
  for (Index t = 0; t + 2 < frames; ++t) {
    const double one = times[t + 1] - times[t], two = times[t + 2] - times[t + 1];
    const double scale = 1 / std::sqrt((one + two) / 2);
    result.insert(result.end(), {scale / one, scale * (-1 / one - 1 / two), scale / two});
  }
  return result;
}

/// A symmetric matrix becomes the diagonal one of its eigenvalues, by Jacobi's rotations; the eigenvectors
/// are the columns of axes.
template <int N>
void diagonalize(double (&matrix)[N][N], double (&axes)[N][N]) {
  double norm = 0;
  for (int r = 0; r < N; ++r) {
    for (int c = 0; c < N; ++c) {
      axes[r][c] = r == c ? 1 : 0;
      norm += std::abs(matrix[r][c]);
    }
  }
  const auto rotate = [](double& x, double& y, double cosine, double sine) {
    const double before = x;
    x = cosine * before - sine * y;
    y = sine * before + cosine * y;
  };
  for (int sweep = 0; sweep < 30; ++sweep) {
    bool is_done = true;
    for (int p = 0; p < N; ++p) {
      for (int q = p + 1; q < N; ++q) {
        if (!(std::abs(matrix[p][q]) > 1e-18 * norm)) continue;
        is_done = false;
        const double zeta = (matrix[q][q] - matrix[p][p]) / (2 * matrix[p][q]);
        const double tangent = (zeta < 0 ? -1 : 1) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
        const double cosine = 1 / std::sqrt(1 + tangent * tangent), sine = cosine * tangent;
        for (int k = 0; k < N; ++k) rotate(matrix[k][p], matrix[k][q], cosine, sine);
        for (int k = 0; k < N; ++k) rotate(matrix[p][k], matrix[q][k], cosine, sine);
        for (int k = 0; k < N; ++k) rotate(axes[k][p], axes[k][q], cosine, sine);
      }
    }
    if (is_done) return;
  }
}

/// Adds to a covariance (E) a multiple of the inverse of an information (E). If that has none, as of one
/// view, only what it knows counts.
template <int Dim>
void add_inverse(const double* information, double scale, double* covariance) {
  using Chain = lanes_v0_1::DifferenceChain<Dim, double>;
  double inverse[Chain::kEntries], determinant = 1, size = 0;
  bool is_definite = true;
  Chain::invert(information, inverse, [&](double pivot) {
    is_definite = is_definite && pivot > 0;
    determinant *= pivot;
  });
  for (int r = 0; r < Dim; ++r) size += information[Chain::entry(r, r)] / Dim;
  if (!is_definite || !(determinant > 1e-12 * std::pow(size, Dim))) {
    double values[Dim][Dim], axes[Dim][Dim], greatest = 0;
    for (int r = 0; r < Dim; ++r) {
      for (int c = 0; c < Dim; ++c) values[r][c] = information[Chain::entry(r, c)];
    }
    diagonalize(values, axes);
    for (int k = 0; k < Dim; ++k) greatest = std::max(greatest, std::abs(values[k][k]));
    for (int r = 0; r < Dim; ++r) {
      for (int c = r; c < Dim; ++c) {
        double& sum = inverse[Chain::entry(r, c)] = 0;
        for (int k = 0; k < Dim; ++k)
          if (values[k][k] > 1e-9 * greatest) sum += axes[r][k] * axes[c][k] / values[k][k];
      }
    }
  }
  for (int k = 0; k < Chain::kEntries; ++k) covariance[k] += scale * inverse[k];
}

/// Joints in groups of as many as a vector has lanes. Lanes without a joint have no detections.
class Groups {
 public:
  Groups(int dim, Index frames, Index views, Index joints, const double* cameras, const double* area)
      : kernel(pose_kernels::kernels(dim)), dim_(dim), joints_(joints), views_(views) {
    for (Index v = 0; v < views; ++v) {
      rarity_.push_back(1 / area[v]);
      if (dim == 2) continue;
      const double* t = cameras + v * 12 + 9;
      least_depth_.push_back(std::max(1e-3 * std::sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]), 1e-30));
    }
    const Index changes = std::max<Index>(frames - 2, 0), entries = entries_of(dim);
    for (Index first = 0; first < joints; first += kernel.lanes) {
      pose_kernels::JointGroup g{};
      g.frames = frames;
      g.views = views;
      g.cameras = cameras;
      g.least_depth = least_depth_.data();
      g.rarity = rarity_.data();
      g.sights = array(frames * views * 6);
      for (double** of : {&g.prior, &g.weight, &g.curvature, &g.trust, &g.probability})
        *of = array(frames * views);
      g.variance = array(views);
      g.offset = array(views * 2);
      g.points = array(frames * dim);
      g.covariance = array(frames * entries);
      for (double** of : {&g.spread, &g.calm, &g.stiffness}) *of = array(changes);
      g.motion = array(1);
      g.weak = array(1);
      g.information = array(frames * entries);
      g.right = array(frames * dim);
      g.inverse = array(frames * entries);
      g.next = array(frames * dim * dim);
      g.second = array(frames);
      g.path = array(frames * dim);
      g.change = array(frames);
      std::fill_n(g.calm, changes * kernel.lanes, 1.0);
      std::fill_n(g.motion, kernel.lanes, 1.0);
      std::fill_n(g.variance, views * kernel.lanes, 1.0);
      all.push_back(g);
    }
  }

  const pose_kernels::Kernels& kernel;
  std::vector<pose_kernels::JointGroup> all;

  /// Zeros for the lanes of a group.
  double* array(Index numbers) {
    constexpr std::size_t kAlignment = 64;
    std::size_t room = static_cast<std::size_t>(numbers * kernel.lanes) * sizeof(double) + kAlignment;
    void* memory = std::calloc(room, 1);  // which does not touch it
    if (memory == nullptr) throw std::bad_alloc();
    arrays_.emplace_back(memory);
    return static_cast<double*>(std::align(kAlignment, room - kAlignment, memory, room));
  }

  /// f(group, lane, joint) for each joint.
  template <typename F>
  void for_each_joint(F&& f) {
    for (Index j = 0; j < joints_; ++j)
      f(all[static_cast<std::size_t>(j / kernel.lanes)], j % kernel.lanes, j);
  }

  /// The number of a joint's lane in an array of its group.
  double& at(double* array, Index number, Index lane) const { return array[number * kernel.lanes + lane]; }

  /// The posterior of all groups. Returns the mean of the points' ways, as Kernels::posterior has them.
  double solve(bool along_ray) {
    double sum = 0;
    for (std::size_t group = 0; group < all.size(); ++group) sum += solve(group, along_ray);
    return sum / static_cast<double>(all.front().frames * joints_);
  }

  /// The posterior of one group. Returns the sum of its points' ways.
  double solve(std::size_t group, bool along_ray) {
    double sum = 0;
    Lane moved, failed;
    const Index first = static_cast<Index>(group) * kernel.lanes;
    kernel.posterior(all[group], along_ray, moved.of, failed.of);
    check(failed, first);
    for (int lane = 0; lane < kernel.lanes && first + lane < joints_; ++lane) sum += moved.of[lane];
    return sum;
  }

  /// Kernels::log_evidence of each joint; minus infinity if it fails.
  Numbers log_evidences() {
    Numbers result;
    Lane found, failed;
    for (pose_kernels::JointGroup& g : all) {
      kernel.log_evidence(g, found.of, failed.of);
      for (int lane = 0; lane < kernel.lanes && static_cast<Index>(result.size()) < joints_; ++lane)
        result.push_back(failed.of[lane] == 0 ? found.of[lane] : -std::numeric_limits<double>::infinity());
    }
    return result;
  }

  /// The covariance by the observed information, that of the curvatures. With the weights, how far off each
  /// detection is counts as known, which makes the regions too small (Louis 1982). All else stays.
  void observe() {
    for (Index first = 0; pose_kernels::JointGroup & g : all) {
      Numbers kept[3];
      double* const arrays[] = {g.points, g.information, g.right};
      const Index numbers[] = {dim_, entries_of(dim_), dim_};
      for (int k = 0; k < 3; ++k) kept[k].assign(arrays[k], arrays[k] + g.frames * numbers[k] * kernel.lanes);
      Lane moved, failed;
      std::swap(g.weight, g.curvature);
      kernel.posterior(g, false, moved.of, failed.of);
      std::swap(g.weight, g.curvature);
      for (int k = 0; k < 3; ++k) std::copy(kept[k].begin(), kept[k].end(), arrays[k]);
      check(failed, first);
      first += kernel.lanes;
    }
  }

  /// The detections of a recording: that of a view, frame and joint is number at(view, frame, joint) of it.
  template <typename At>
  void set_sights(const Recording& of, At&& at_of) {
    for_each_joint([&](pose_kernels::JointGroup& g, Index lane, Index j) {
      for (Index t = 0; t < g.frames; ++t) {
        for (Index v = 0; v < views_; ++v) {
          const double* sight = of.sights + at_of(v, t, j) * 6;
          for (Index c = 0; c < 6; ++c) at(g.sights, (t * views_ + v) * 6 + c, lane) = sight[c];
        }
      }
    });
  }

  /// Adds to the covariance (frames, stride, E) that of a view's error of this size in all frames. Weights
  /// are 1 for views that have it, or 0; there are neither offsets nor a prior.
  void add_systematic(double disagreement, double* covariance, Index stride) {
    for (pose_kernels::JointGroup& g : all) kernel.evidence(g, false);
    const Index entries = entries_of(dim_);
    for_each_joint([&](pose_kernels::JointGroup& g, Index lane, Index j) {
      for (Index t = 0; t < g.frames; ++t) {
        double information[6], *to = covariance + (t * stride + j) * entries;
        for (Index k = 0; k < entries; ++k) information[k] = at(g.information, t * entries + k, lane);
        dim_ == 2 ? add_inverse<2>(information, disagreement * disagreement, to)
                  : add_inverse<3>(information, disagreement * disagreement, to);
      }
    });
  }

  /// One number a lane.
  struct alignas(64) Lane {
    double of[8];
  };
  /// Whether the lanes of joint number `first` and the next ones have failed. Those without a joint may.
  void check(const Lane& failed, Index first) const {
    for (int lane = 0; lane < kernel.lanes && first + lane < joints_; ++lane) {
      if (failed.of[lane] != 0)
        throw std::invalid_argument(
            "detections: numbers that are too large or too small for their joint's path, or times that are "
            "too close");
    }
  }

 private:
  struct Free {
    void operator()(void* memory) const { std::free(memory); }
  };

  int dim_;
  Index joints_, views_;
  Numbers rarity_, least_depth_;
  std::vector<std::unique_ptr<void, Free>> arrays_;
};

}  // namespace asterism::python::pose
