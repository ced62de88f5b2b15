#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/batch/batch_kernels.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/status.hpp>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Numbers on a cache line's boundary.
template <typename T>
class AlignedArray {
 public:
  void resize(std::size_t count) {
    const std::size_t lines = (count + kPerLine - 1) / kPerLine;
    if (lines > lines_.size()) require_memory(double(sizeof(Line)) * static_cast<double>(lines));
    lines_.resize(lines);
  }
  T* data() { return reinterpret_cast<T*>(lines_.data()); }
  const T* data() const { return reinterpret_cast<const T*>(lines_.data()); }

 private:
  static constexpr std::size_t kPerLine = 64 / sizeof(T);
  struct alignas(64) Line {
    T numbers[kPerLine] = {};
  };
  std::vector<Line> lines_;
};

/// Room for `count` numbers and the kernels' padding; a number of cache lines that is 3 modulo 64, so that
/// the planes of one system do not compete for one set of a cache.
inline std::ptrdiff_t plane_stride(std::ptrdiff_t count) {
  constexpr std::ptrdiff_t kLine = 16;  // of floats; two of doubles, 6 modulo 128
  std::ptrdiff_t lines = (count + lanes_v0_1::kPadding + kLine - 1) / kLine + 1;
  lines += (3 - lines % 64 + 64) % 64;
  return lines * kLine;
}

}  // namespace detail

/// `size()` spring systems of one topology, with their starts, in structure-of-arrays form: for each value of
/// a system (a coordinate of an anchor, a stiffness) a plane with that value of every system. The parameters
/// are SpringSystem's.
///
/// Values start as NaN, so that a forgotten one gives Status::InvalidInput. Refilling does not allocate.
/// Construction throws std::bad_alloc if memory runs out.
template <typename Scalar_, int Dim, int N = Eigen::Dynamic, int MaxN = N>
class SpringBatch {
 public:
  using Scalar = Scalar_;
  using System = SpringSystem<Scalar, Dim, N, MaxN>;
  using TopologyType = typename System::TopologyType;
  using Points = typename System::Points;
  /// Points in the coordinates that systems were set in.
  using WidePoints = typename SpringSystem<double, Dim, N, MaxN>::Points;
  /// One number of every system, size().
  using Plane = Eigen::Map<Eigen::Array<Scalar, Eigen::Dynamic, 1>>;
  /// One number in double of every system, size().
  using WidePlane = Eigen::Map<Eigen::Array<double, Eigen::Dynamic, 1>>;

  static constexpr int kDim = Dim;

  /// `count` >= 0 systems.
  SpringBatch(TopologyType topology, int count)
      : topology_(std::move(topology)), count_(std::max(0, count)), stride_(detail::plane_stride(count_)) {
    const auto planes = [&](int number) {
      return static_cast<std::size_t>(number) * static_cast<std::size_t>(stride_);
    };
    values_.resize(planes(value_planes()));
    verdicts_.resize(planes(4));
    counts_.resize(planes(3));
    origins_.resize(planes(Dim));
    constexpr Scalar kUnset = std::numeric_limits<Scalar>::quiet_NaN();
    for (int p = 0; p < value_planes(); ++p) std::fill_n(values_.data() + at(p), count_, kUnset);
    for (int p = 0; p < 4; ++p) std::fill_n(verdicts_.data() + at(p), count_, Scalar(-1));
    for (int p = 0; p < 3; ++p) std::fill_n(counts_.data() + at(p), count_, p == kStatus ? 0 : -1);
    for (const Link& link : topology_.links()) ends_.insert(ends_.end(), {link.i, link.j});
    Eigen::VectorXi scratch;
    is_connected_ = nodes() > 0 && detail::is_connected(nodes(), topology_.links(), scratch);
  }

  /// Number of systems.
  int size() const { return count_; }
  int nodes() const { return topology_.nodes(); }
  int link_count() const { return topology_.link_count(); }
  const TopologyType& topology() const { return topology_; }

  /// Copies a system of the same topology and its start (Dim x N) to place `index`, from float or double. In
  /// a batch of float they are taken relative to the centroid of the anchors of stiffness (weak ones counting
  /// less), in double: a constellation far from the origin loses no digits. For springs only: with fixed
  /// nodes or offsets of links the system is invalid. If a spring has no stiffness, a finite position or rest
  /// length is kept as far as Scalar holds it.
  template <typename OtherSystem>
  void set(int index, const OtherSystem& system, const typename OtherSystem::Points& start) {
    static_assert(OtherSystem::kDim == Dim);
    static_assert(std::is_same_v<typename OtherSystem::Model, Springs>, "a batch has springs alone");
    eigen_assert(0 <= index && index < count_);
    eigen_assert(system.nodes() == nodes() && system.link_count() == link_count());
    Eigen::Matrix<double, Dim, 1> centre = Eigen::Matrix<double, Dim, 1>::Zero();
    if constexpr (std::is_same_v<Scalar, float>) {
      const auto wide = system.anchors.template cast<double>();
      double strongest = 0;
      for (int i = 0; i < nodes(); ++i) strongest = std::max<double>(strongest, system.anchor_stiffness[i]);
      const detail::SpringWeight<double> weight_of(strongest);
      double total = 0;
      for (int i = 0; i < nodes(); ++i) {
        const double weight = weight_of(system.anchor_stiffness[i]);
        if (!(weight > 0)) continue;
        total += weight;
        centre += weight * (wide.col(i) - centre) / total;
      }
      if (!detail::all_finite(centre)) centre.setZero();
    }
    for (int d = 0; d < Dim; ++d) origins_.data()[at(d) + index] = centre[d];
    if (nodes() == 0) return;
    Scalar* value = values_.data() + index;
    const auto put = [&](auto number) {
      *value = static_cast<Scalar>(number);
      value += stride_;
    };
    // What a spring without stiffness has is not to become infinite here.
    const auto put_of = [&](auto stiffness, double number) {
      constexpr double kMost = std::numeric_limits<Scalar>::max();
      put(stiffness == 0 && detail::is_finite(number) ? std::clamp(number, -kMost, kMost) : number);
    };
    for (int i = 0; i < nodes(); ++i) {
      for (int d = 0; d < Dim; ++d) {
        put_of(system.anchor_stiffness[i], static_cast<double>(system.anchors(d, i)) - centre[d]);
      }
    }
    constexpr double kInvalid = std::numeric_limits<double>::quiet_NaN();
    for (int i = 0; i < nodes(); ++i) {
      const bool is_invalid = system.is_fixed(i) || system.has_offsets() || system.has_loads();
      put(is_invalid ? kInvalid : static_cast<double>(system.anchor_stiffness[i]));
    }
    for (int l = 0; l < link_count(); ++l) put_of(system.link_stiffness[l], system.rest_length[l]);
    for (int l = 0; l < link_count(); ++l) put(system.link_stiffness[l]);
    for (int i = 0; i < nodes(); ++i) {
      for (int d = 0; d < Dim; ++d) put(static_cast<double>(start(d, i)) - centre[d]);
    }
  }

  /// System `index` with x relative to its origin, as the solver sees it.
  void get(int index, System& system, Points& x) const {
    eigen_assert(0 <= index && index < count_);
    x.resize(Dim, nodes());
    if (nodes() == 0) return;
    const Scalar* value = values_.data() + index;
    const auto take = [&](Scalar& number) {
      number = *value;
      value += stride_;
    };
    for (int i = 0; i < nodes(); ++i) {
      for (int d = 0; d < Dim; ++d) take(system.anchors(d, i));
    }
    for (int i = 0; i < nodes(); ++i) take(system.anchor_stiffness[i]);
    for (int l = 0; l < link_count(); ++l) take(system.rest_length[l]);
    for (int l = 0; l < link_count(); ++l) take(system.link_stiffness[l]);
    for (int i = 0; i < nodes(); ++i) {
      for (int d = 0; d < Dim; ++d) take(x(d, i));
    }
  }

  /// x of system `index`, Dim x N: the start before solving, the minimum after.
  WidePoints points(int index) const {
    eigen_assert(0 <= index && index < count_);
    WidePoints result(Dim, nodes());
    for (int i = 0; i < nodes(); ++i) {
      for (int d = 0; d < Dim; ++d) {
        result(d, i) =
            static_cast<double>(values_.data()[at(x_plane(i, d)) + index]) + origins_.data()[at(d) + index];
      }
    }
    return result;
  }

  /// The planes, to be filled or read in place. Coordinates are relative to the origin.
  Plane anchors(int node, int axis) { return plane(Dim * node + axis); }
  Plane anchor_stiffness(int node) { return plane(Dim * nodes() + node); }
  Plane rest_length(int link) { return plane((Dim + 1) * nodes() + link); }
  Plane link_stiffness(int link) { return plane((Dim + 1) * nodes() + link_count() + link); }
  Plane x(int node, int axis) { return plane(x_plane(node, axis)); }
  /// 0 unless set() chose another.
  WidePlane origin(int axis) { return {origins_.data() + at(axis), count_}; }

  /// The result of each system, as in its Summary.
  Status status(int index) const { return static_cast<Status>(count_of(kStatus, index)); }
  int iterations(int index) const { return count_of(kIterations, index); }
  std::optional<bool> positive_definite(int index) const {
    const int definite = count_of(kDefinite, index);
    return definite < 0 ? std::nullopt : std::optional(definite == 1);
  }
  Scalar initial_energy(int index) const { return verdicts_.data()[at(0) + index]; }
  Scalar final_energy(int index) const { return verdicts_.data()[at(1) + index]; }
  Scalar stationarity(int index) const { return verdicts_.data()[at(2) + index]; }
  /// A lower bound of the energy, as in Summary: -1 if SolverOptions::gap is 0.
  Scalar lower_bound(int index) const { return verdicts_.data()[at(3) + index]; }

 private:
  template <typename Batch>
  friend class BatchNewton;
  template <typename Batch>
  friend class BatchSensitivity;
  template <typename Batch>
  friend class BatchGradient;

  enum Count { kStatus, kIterations, kDefinite };

  int value_planes() const { return (2 * Dim + 1) * nodes() + 2 * link_count(); }
  int x_plane(int node, int axis) const { return (Dim + 1) * nodes() + 2 * link_count() + Dim * node + axis; }
  std::ptrdiff_t at(int plane) const { return plane * stride_; }
  Plane plane(int number) { return {values_.data() + at(number), count_}; }
  int count_of(Count what, int index) const {
    eigen_assert(0 <= index && index < count_);
    return counts_.data()[at(what) + index];
  }

  bool is_full() const {
    int l = 0;
    for (int i = 0; i < nodes(); ++i) {
      for (int j = i + 1; j < nodes(); ++j, ++l) {
        if (l == link_count() || topology_.links()[static_cast<std::size_t>(l)] != Link{i, j}) return false;
      }
    }
    return l == link_count();
  }

  lanes_v0_1::Kernels<Scalar> kernels_of(const lanes_v0_1::KernelSet& set) const {
    if constexpr (std::is_same_v<Scalar, float>) {
      return set.of_float(Dim, nodes(), link_count(), is_full());
    } else {
      return set.of_double(Dim, nodes(), link_count(), is_full());
    }
  }

  void set_planes(lanes_v0_1::SystemPlanes<Scalar>& result) const {
    result.nodes = nodes();
    result.link_count = link_count();
    result.is_full = is_full();
    result.ends = ends_.data();
    result.stride = stride_;
    result.anchors = values_.data();
    result.anchor_stiffness = values_.data() + at(Dim * nodes());
    result.rest_length = values_.data() + at((Dim + 1) * nodes());
    result.link_stiffness = values_.data() + at((Dim + 1) * nodes() + link_count());
  }

  lanes_v0_1::Planes<Scalar> planes(Scalar* work) {
    lanes_v0_1::Planes<Scalar> result{};
    set_planes(result);
    result.x = values_.data() + at(x_plane(0, 0));
    result.work = work;
    result.initial_energy = verdicts_.data();
    result.final_energy = verdicts_.data() + at(1);
    result.stationarity = verdicts_.data() + at(2);
    result.lower_bound = verdicts_.data() + at(3);
    result.outcome = counts_.data() + at(kStatus);
    result.iterations = counts_.data() + at(kIterations);
    return result;
  }

  TopologyType topology_;
  std::vector<std::int32_t> ends_;
  bool is_connected_ = false;
  int count_;
  std::ptrdiff_t stride_;
  detail::AlignedArray<Scalar> values_;
  detail::AlignedArray<Scalar> verdicts_;
  detail::AlignedArray<std::int32_t> counts_;
  detail::AlignedArray<double> origins_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
