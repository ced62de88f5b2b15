#pragma once

// The window of asterism.pose.Stream.

#include "pose_estimate.hpp"
#include "pose_lens.hpp"

namespace asterism::python::pose {

/// The energy of fuse over the last frames. See Stream in pose_stream.py for what it does with them.
class Window {
 public:
  /// What does not change from frame to frame.
  struct Setting {
    int dim;
    Index frames, views, joints;  ///< frames: at most so many
    Scales scales;
    Numbers cameras;  ///< (views, 12), or empty for points in the image
    std::vector<Lens> lenses;
    Numbers area;    ///< (views) [px^2]
    Numbers slope;   ///< (views, 4): where a joint was not seen, the pixels for a unit
    Numbers jitter;  ///< (joints): about the noise of a point that only one frame shows
    Numbers centre;  ///< (D)
  };

  /// Of the newest frame.
  struct Newest {
    Numbers points;             ///< (joints, D)
    Numbers covariance;         ///< (joints, E)
    std::vector<char> outlier;  ///< (views, joints)
  };

  explicit Window(Setting setting)
      : is_(std::move(setting)),
        groups_(is_.dim, is_.frames, is_.views, is_.joints, is_.cameras.data(), is_.area.data()),
        newest_(is_.dim, 1, is_.views, is_.joints, is_.cameras.data(), is_.area.data()),
        widest_(std::sqrt(*std::max_element(is_.area.begin(), is_.area.end())) / 4),
        typical_(median(is_.scales.noise)) {
    for (JointGroup& g : groups_.all) {
      g.past = groups_.array(4 * is_.dim * is_.dim);
      g.past_right = groups_.array(2 * is_.dim);
      std::copy(is_.centre.begin(), is_.centre.end(), g.centre);
      g.least_weak = 1 / std::pow(kFarAway * is_.scales.extent, 2);
      g.weak_share = 1e-9;  // as weak as rounding allows where a joint is not seen in the window
    }
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      for (Index v = 0; v < is_.views; ++v) {
        const auto i = static_cast<std::size_t>(v * is_.joints + j);
        for (Index r = 0; r < 2; ++r)
          groups_.at(g.offset, v * 2 + r, lane) = is_.scales.offset[i * 2 + static_cast<std::size_t>(r)];
      }
    });
  }

  /// The next frame: pixels (views, joints, 2), NaN where none; belief (views, joints), in [0, 1].
  Newest push(const double* pixels, const double* belief, double time) {
    append(pixels, belief, time);
    for (std::size_t group = 0; group < groups_.all.size(); ++group) settle(group);
    reconsider();
    groups_.observe();
    return newest();
  }

  Index frames() const { return static_cast<Index>(times_.size()); }

  /// (frames, joints, D).
  Numbers points() { return numbers(&JointGroup::points, frames(), is_.dim); }

  /// What the last points were computed from, for each frame: information (frames, joints, E), right side
  /// (frames, joints, D), stiffness (frames - 2, joints) and coefficients (frames - 2, 3) of changes.
  std::tuple<Numbers, Numbers, Numbers, Numbers> evidence() {
    return {numbers(&JointGroup::information, frames(), entries_of(is_.dim)),
            numbers(&JointGroup::right, frames(), is_.dim), numbers(&JointGroup::stiffness, frames() - 2, 1),
            coefficients_};
  }

 private:
  /// Chosen by measurement: see docs/pose.md.
  static constexpr double kJitter = 0.05;
  static constexpr int kLastTurns = 5;
  static constexpr double kMargin = 30;  ///< about what two detections say

  using JointGroup = pose_kernels::JointGroup;

  Numbers numbers(double* JointGroup::*of, Index rows, Index each) {
    Numbers result(static_cast<std::size_t>(std::max<Index>(rows, 0) * is_.joints * each));
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      for (Index t = 0; t < rows; ++t) {
        for (Index c = 0; c < each; ++c)
          result[static_cast<std::size_t>((t * is_.joints + j) * each + c)] =
              groups_.at(g.*of, t * each + c, lane);
      }
    });
    return result;
  }

  bool is_seen(const JointGroup& g, Index frame, Index view, Index lane) const {
    return groups_.at(g.prior, frame * is_.views + view, lane) > 0;
  }

  void append(const double* pixels, const double* belief, double time) {
    if (frames() == is_.frames) forget();
    const Index t = frames(), dim = is_.dim;
    const double share = t < 2 ? 0 : (time - times_.back()) / (times_.back() - times_[times_.size() - 2]);
    times_.push_back(time);
    coefficients_ = change_coefficients(times_.data(), frames());
    for (JointGroup& g : groups_.all) {
      g.frames = frames();
      g.coefficients = coefficients_.data();
    }
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      for (Index c = 0; c < dim; ++c) {  // as if its velocity did not change
        const double last = t > 0 ? groups_.at(g.points, (t - 1) * dim + c, lane) : g.centre[c];
        const double before = t > 1 ? groups_.at(g.points, (t - 2) * dim + c, lane) : last;
        groups_.at(g.points, t * dim + c, lane) = last + share * (last - before);
      }
      if (t > 1) groups_.at(g.calm, t - 2, lane) = 1;
      for (Index v = 0; v < is_.views; ++v) {
        const Index i = v * is_.joints + j, to = t * is_.views + v;
        double sight[6] = {pixels[i * 2], pixels[i * 2 + 1], 1, 0, 0, 1};
        if (dim == 3) is_.lenses[static_cast<std::size_t>(v)].undistort(pixels + i * 2, sight);
        bool is_finite = true;
        for (const double s : sight) is_finite = is_finite && std::isfinite(s);
        if (!is_finite) {
          sight[0] = sight[1] = 0;
          std::copy_n(is_.slope.data() + v * 4, 4, sight + 2);
        }
        for (Index c = 0; c < 6; ++c) groups_.at(g.sights, to * 6 + c, lane) = sight[c];
        const double known = std::clamp(belief[i], 0.01, 1.0);
        groups_.at(g.prior, to, lane) = is_finite ? (1 - kOutliers) * known : 0;
        groups_.at(g.weight, to, lane) = is_finite ? 1 / (widest_ * widest_) : 0;  // to begin with
      }
    });
  }

  /// Weights and points of a group by turns: from a wide distribution of all detections to theirs, as in
  /// fuse, and then until the changes of velocity hardly differ. At first, these may be as large as a share
  /// of the noise makes them: a path that rested would else take a sudden motion, which all views see, for
  /// outliers.
  void settle(std::size_t group) {
    JointGroup& g = groups_.all[group];
    const double jitter = kJitter * kJitter * change_per_jitter();
    const Index first = static_cast<Index>(group) * groups_.kernel.lanes;
    const Index joints = std::min<Index>(groups_.kernel.lanes, is_.joints - first);
    double width = widest_;
    groups_.solve(group, true);
    for (int last = 0; last < kLastTurns; width /= 2) {
      const bool is_wide = width > typical_;
      for (Index lane = 0; lane < joints; ++lane) {
        const auto j = static_cast<std::size_t>(first + lane);
        const double motion = is_.scales.motion[j], noisy = jitter * is_.jitter[j] * is_.jitter[j];
        g.motion[lane] = is_wide ? std::max(motion, noisy) : motion;
        for (Index v = 0; v < is_.views; ++v) {
          const double noise = is_.scales.noise[static_cast<std::size_t>(v * is_.joints) + j];
          const double deviation = std::max(noise, width);
          groups_.at(g.variance, v, lane) = deviation * deviation;
        }
      }
      groups_.kernel.expect(g, nullptr);
      Groups::Lane moved;
      if (frames() > 2) groups_.kernel.settle(g, moved.of);
      groups_.kernel.reweigh(g);
      groups_.solve(group, width > 30 * typical_);
      last += !is_wide;
    }
  }

  /// The variance of changes of velocity if each point is off by one unit, at the usual rate of frames.
  double change_per_jitter() const {
    Numbers found;
    for (std::size_t k = 0; k < coefficients_.size(); k += 3)
      found.push_back(coefficients_[k] * coefficients_[k + 2]);
    return found.empty() ? 0 : median(std::move(found));
  }

  /// A path may go on as before, while all detections of the last frames are outliers, or change suddenly
  /// before these. That of the greater evidence stays.
  void reconsider() {
    const Index last = frames(), views = is_.views;
    std::vector<Index> since(static_cast<std::size_t>(is_.joints), last);
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      for (Index t = last; t-- > 0;) {
        bool is_any = false, is_right = false;
        for (Index v = 0; v < views; ++v) {
          const bool here = is_seen(g, t, v, lane);
          is_any = is_any || here;
          is_right = is_right || (here && groups_.at(g.probability, t * views + v, lane) >= 0.5);
        }
        if (is_right || (!is_any && t == last - 1)) break;
        if (is_any) since[static_cast<std::size_t>(j)] = t;
      }
    });
    std::vector<char> is_chosen(groups_.all.size());
    for (std::size_t j = 0; j < since.size(); ++j)
      is_chosen[j / static_cast<std::size_t>(groups_.kernel.lanes)] |= since[j] < last;
    if (std::find(is_chosen.begin(), is_chosen.end(), 1) == is_chosen.end()) return;
    const Numbers before = groups_.log_evidences();
    const std::pair<double * JointGroup::*, Index> arrays[] = {
        {&JointGroup::points, last * is_.dim},
        {&JointGroup::weight, last * views},
        {&JointGroup::curvature, last * views},
        {&JointGroup::probability, last * views},
        {&JointGroup::calm, std::max<Index>(last - 2, 0)}};
    std::vector<Numbers> kept;
    for (const auto& [array, rows] : arrays) kept.push_back(numbers(array, 1, rows));
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      const Index from = since[static_cast<std::size_t>(j)];
      if (from == last) return;
      const double free = std::pow(is_.scales.extent, 2) * change_per_jitter();
      for (Index t = std::max<Index>(from - 2, 0); t + 2 < last; ++t)
        groups_.at(g.calm, t, lane) = std::min(1.0, g.motion[lane] / free);
      for (Index i = from * views; i < last * views; ++i)
        groups_.at(g.weight, i, lane) = groups_.at(g.prior, i, lane) > 0 ? 1 / (widest_ * widest_) : 0;
    });
    for (std::size_t group = 0; group < is_chosen.size(); ++group)
      if (is_chosen[group]) settle(group);
    const Numbers after = groups_.log_evidences();
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      const auto k = static_cast<std::size_t>(j);
      if (since[k] < last && after[k] > before[k] + kMargin) return;
      for (std::size_t a = 0; a < kept.size(); ++a) {
        for (Index i = 0; i < arrays[a].second; ++i)
          groups_.at(g.*arrays[a].first, i, lane) =
              kept[a][k * static_cast<std::size_t>(arrays[a].second) + static_cast<std::size_t>(i)];
      }
    });
    groups_.solve(false);
  }

  /// Marginalises the oldest frame: what it says about the next two becomes the past.
  void forget() {
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index) {
      is_.dim == 2 ? marginalize<2>(g, lane) : marginalize<3>(g, lane);
    });
    times_.erase(times_.begin());
    const auto shift = [&](double* array, Index each, Index rows) {
      each *= groups_.kernel.lanes;
      std::copy(array + each, array + each * rows, array);
    };
    for (JointGroup& g : groups_.all) {
      shift(g.sights, is_.views * 6, is_.frames);
      shift(g.prior, is_.views, is_.frames);
      shift(g.weight, is_.views, is_.frames);
      shift(g.points, is_.dim, is_.frames);
      shift(g.calm, 1, is_.frames - 2);
    }
  }

  template <int Dim>
  void marginalize(JointGroup& g, Index lane) {
    using Chain = lanes_v0_1::DifferenceChain<Dim, double>;
    using Both = lanes_v0_1::DifferenceChain<2 * Dim, double>;
    // The information about the oldest point, about the next two, and what couples them.
    double oldest[Chain::kEntries], next[2 * Dim][2 * Dim] = {}, across[Dim][2 * Dim] = {}, right[Dim];
    const auto past = [&](int r, int c) { return groups_.at(g.past, r * 2 * Dim + c, lane); };
    const double stiffness = g.stiffness[lane], *a = coefficients_.data();
    for (int r = 0; r < Dim; ++r) {
      right[r] = groups_.at(g.past_right, r, lane) + groups_.at(g.right, r, lane);
      for (int c = 0; c < Dim; ++c) {
        oldest[Chain::entry(r, c)] = past(r, c) + groups_.at(g.information, Chain::entry(r, c), lane);
        across[r][c] = past(r, Dim + c);
        next[r][c] = past(Dim + r, Dim + c);
      }
    }
    for (int r = 0; r < Dim; ++r) {
      oldest[Chain::entry(r, r)] += stiffness * a[0] * a[0];
      for (int k = 0; k < 2; ++k) {
        across[r][r + k * Dim] += stiffness * a[0] * a[1 + k];
        for (int m = 0; m < 2; ++m) next[r + k * Dim][r + m * Dim] += stiffness * a[1 + k] * a[1 + m];
      }
    }
    double inverse[Chain::kEntries], share[Dim][2 * Dim] = {};
    Chain::invert(oldest, inverse, [](double) {});
    for (int r = 0; r < Dim; ++r) {
      for (int c = 0; c < 2 * Dim; ++c) {
        for (int k = 0; k < Dim; ++k) share[r][c] += inverse[Chain::entry(r, k)] * across[k][c];
      }
    }
    double entries[Both::kEntries], unused[Both::kEntries];
    for (int r = 0; r < 2 * Dim; ++r) {
      double kept = r < Dim ? groups_.at(g.past_right, Dim + r, lane) : 0;
      for (int k = 0; k < Dim; ++k) kept -= share[k][r] * right[k];
      groups_.at(g.past_right, r, lane) = kept;
      for (int c = r; c < 2 * Dim; ++c) {
        double left = next[r][c];
        for (int k = 0; k < Dim; ++k) left -= (across[k][r] * share[k][c] + across[k][c] * share[k][r]) / 2;
        next[r][c] = next[c][r] = entries[Both::entry(r, c)] = left;
      }
    }
    bool is_definite = true;
    double size = 0;
    for (int r = 0; r < 2 * Dim; ++r) size += next[r][r];
    Both::invert(entries, unused, [&](double pivot) { is_definite = is_definite && pivot > 1e-11 * size; });
    double axes[2 * Dim][2 * Dim];
    if (!is_definite)
      diagonalize(next, axes);  // of what is not known, rounding is left, which may be negative
    for (int r = 0; r < 2 * Dim; ++r) {
      for (int c = 0; c < 2 * Dim; ++c) {
        double& to = groups_.at(g.past, r * 2 * Dim + c, lane) = is_definite ? next[r][c] : 0;
        for (int k = 0; k < 2 * Dim && !is_definite; ++k)
          to += axes[r][k] * axes[c][k] * std::max(next[k][k], 1e-12 * size);
      }
    }
  }

  Newest newest() {
    const Index t = frames() - 1, views = is_.views, dim = is_.dim, entries = entries_of(is_.dim);
    const auto size = [](Index n) { return static_cast<std::size_t>(n); };
    Newest found;
    found.points.resize(size(is_.joints * dim));
    found.covariance.resize(size(is_.joints * entries));
    found.outlier.resize(size(views * is_.joints));
    groups_.for_each_joint([&](JointGroup& g, Index lane, Index j) {
      for (Index c = 0; c < dim; ++c)
        found.points[size(j * dim + c)] = groups_.at(g.points, t * dim + c, lane);
      for (Index k = 0; k < entries; ++k)
        found.covariance[size(j * entries + k)] = groups_.at(g.covariance, t * entries + k, lane);
      for (Index v = 0; v < views; ++v)
        found.outlier[size(v * is_.joints + j)] =
            is_seen(g, t, v, lane) && groups_.at(g.probability, t * views + v, lane) < 0.5;
    });
    if (is_.scales.disagreement == 0) return found;
    // Only errors of the views that see a joint.
    newest_.for_each_joint([&](JointGroup& to, Index lane, Index j) {
      JointGroup& g = groups_.all[size(j / groups_.kernel.lanes)];
      for (Index c = 0; c < dim; ++c)
        newest_.at(to.points, c, lane) = groups_.at(g.points, t * dim + c, lane);
      for (Index v = 0; v < views; ++v) {
        bool is_used = false;
        for (Index k = 0; k <= t; ++k) is_used = is_used || is_seen(g, k, v, lane);
        newest_.at(to.weight, v, lane) = is_used;
        for (Index c = 0; c < 6; ++c)
          newest_.at(to.sights, v * 6 + c, lane) = groups_.at(g.sights, (t * views + v) * 6 + c, lane);
      }
    });
    newest_.add_systematic(is_.scales.disagreement, found.covariance.data(), is_.joints);
    return found;
  }

  Setting is_;
  Groups groups_, newest_;  // newest_: of that frame alone
  double widest_;           // of the deviations of detections, at first [px]
  double typical_;          // of the noise [px]
  Numbers times_, coefficients_;
};

}  // namespace asterism::python::pose
