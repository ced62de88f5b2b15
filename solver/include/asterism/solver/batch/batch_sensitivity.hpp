#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/batch/batch_kernels.hpp>
#include <asterism/solver/batch/batch_tasks.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/executor.hpp>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// dL/dx of the solutions of a SpringBatch, and the derivatives of L by the values of every system, in
/// structure-of-arrays form: planes as those of the batch. L may be another function for each system, or a
/// sum over the batch.
///
/// All numbers start as NaN, so that a forgotten one gives SensitivityStatus::InvalidInput. Construction
/// throws std::bad_alloc if memory runs out.
template <typename Batch>
class BatchGradient {
 public:
  using Scalar = typename Batch::Scalar;
  using System = typename Batch::System;
  using Points = typename Batch::Points;
  /// One number of every system, size().
  using Plane = typename Batch::Plane;

  /// Has the size and the topology of the batch.
  explicit BatchGradient(const Batch& batch)
      : count_(batch.size()), nodes_(batch.nodes()), links_(batch.link_count()), stride_(batch.stride_) {
    const int planes = (2 * kDim + 1) * nodes_ + 2 * links_;
    values_.resize(static_cast<std::size_t>(planes) * static_cast<std::size_t>(stride_));
    statuses_.resize(static_cast<std::size_t>(stride_));
    constexpr Scalar kUnset = std::numeric_limits<Scalar>::quiet_NaN();
    for (int p = 0; p < planes; ++p) std::fill_n(values_.data() + at(p), count_, kUnset);
    std::fill_n(statuses_.data(), count_, static_cast<std::int32_t>(SensitivityStatus::InvalidInput));
  }

  /// Number of systems.
  int size() const { return count_; }
  int nodes() const { return nodes_; }
  int link_count() const { return links_; }

  /// dL/dx, to be filled.
  Plane grad_x(int node, int axis) { return plane(kDim * node + axis); }
  /// dL/dx of system `index`, Dim x N.
  void set(int index, const Points& grad_x) {
    eigen_assert(0 <= index && index < count_ && grad_x.cols() == nodes_);
    for (int c = 0; c < kDim * nodes_; ++c) values_.data()[at(c) + index] = grad_x(c % kDim, c / kDim);
  }

  /// dL/d(values of the systems), NaN where status(index) is not Computed.
  Plane anchors(int node, int axis) { return plane(kDim * (nodes_ + node) + axis); }
  Plane anchor_stiffness(int node) { return plane(2 * kDim * nodes_ + node); }
  Plane rest_length(int link) { return plane((2 * kDim + 1) * nodes_ + link); }
  Plane link_stiffness(int link) { return plane((2 * kDim + 1) * nodes_ + links_ + link); }
  /// Whether system `index` has derivatives, or why not.
  SensitivityStatus status(int index) const {
    eigen_assert(0 <= index && index < count_);
    return static_cast<SensitivityStatus>(statuses_.data()[index]);
  }

 private:
  template <typename B>
  friend class BatchSensitivity;

  static constexpr int kDim = Batch::kDim;

  std::ptrdiff_t at(int plane) const { return plane * stride_; }
  Plane plane(int number) { return {values_.data() + at(number), count_}; }

  /// The arrays that kernels read and write; the batch has the same size.
  lanes_v0_1::GradientPlanes<Scalar> planes(const Batch& batch) {
    lanes_v0_1::GradientPlanes<Scalar> result{};
    batch.set_planes(result);
    Scalar* values = values_.data();
    const auto next = [&](int planes) { return std::exchange(values, values + at(planes)); };
    result.x = batch.values_.data() + batch.at(batch.x_plane(0, 0));
    result.grad_x = next(kDim * nodes_);
    result.by_anchors = next(kDim * nodes_);
    result.by_anchor_stiffness = next(nodes_);
    result.by_rest_length = next(links_);
    result.by_link_stiffness = next(links_);
    result.outcome = statuses_.data();
    return result;
  }

  int count_;
  int nodes_;
  int links_;
  std::ptrdiff_t stride_;
  detail::AlignedArray<Scalar> values_;
  detail::AlignedArray<std::int32_t> statuses_;
};

/// The result of a batch of derivatives as a whole.
struct BatchGradientSummary {
  /// Computed if those of every system were; otherwise the first other status of a system. InvalidInput if
  /// the options, the topology or the sizes are invalid, or the machine lacks the requested instructions;
  /// then no system has derivatives.
  SensitivityStatus status = SensitivityStatus::InvalidInput;
  Message message = "backward was not called";  ///< what is wrong, where something is
  int first_failure = -1;                       ///< index of the first system that was refused
  int computed = 0;                             ///< number of systems with derivatives
  int by_scalar = 0;       ///< number of systems that the lanes left to Sensitivity, refused ones among them
  Simd simd = Simd::Auto;  ///< instructions used
  double seconds = -1;     ///< wall-clock time in backward

  /// Whether every system has derivatives.
  explicit operator bool() const { return status == SensitivityStatus::Computed; }
};

/// Sensitivity for batches: derivatives of solutions by the values of their systems, in reverse mode and in
/// SIMD lanes, one system per lane. Systems that the lanes refuse, or do not accept without doubt, are left
/// to Sensitivity: each system has the verdict that it would have alone, and the same derivatives up to
/// rounding.
///
/// The lanes take solutions of 2 and 3 dimensions with up to 30 coordinates and 120 links, of connected
/// topologies, if every spring has stiffness and the anchors hold the constellation clearly. Results do
/// not depend on the executor or on the place in the batch, and on the instructions only by rounding.
///
/// An object holds its workspace: reuse it to compute without allocation (by the executor, and for systems of
/// unbounded size outside the lanes, excepted), one call at a time. It does not throw unless the executor
/// does.
template <typename Batch>
class BatchSensitivity {
 public:
  using Scalar = typename Batch::Scalar;
  using System = typename Batch::System;
  using Points = typename Batch::Points;

  SensitivityOptions options;
  /// The instructions to use.
  Simd simd = Simd::Auto;

  BatchSensitivity() = default;
  /// For type deduction: BatchSensitivity(batch).backward(batch, gradient).
  explicit BatchSensitivity(const Batch&, const SensitivityOptions& o = {}) : options(o) {}

  /// Reverse mode: from gradient.grad_x to the derivatives by anchors, stiffness and rest lengths, at x of
  /// every system, its solution. See BatchGradient for what is then known of each.
  template <Executor E = SerialExecutor>
  BatchGradientSummary backward(const Batch& batch, BatchGradient<Batch>& gradient, E&& executor = {}) {
    const detail::Stopwatch stopwatch;
    BatchGradientSummary summary;
    const bool same_size = gradient.size() == batch.size() && gradient.nodes() == batch.nodes() &&
                           gradient.link_count() == batch.link_count();
    summary.message = same_size ? detail::batch_problem(batch, options, simd)
                                : Message("the gradient is not of the batch's size");
    summary.simd = simd == Simd::Auto ? widest_simd() : simd;
    if (summary.message.empty()) {
      run(batch, gradient, executor, summary);
      conclude(gradient, summary);
    } else {
      refuse(gradient);
    }
    summary.seconds = stopwatch.seconds();
    return summary;
  }

 private:
  static constexpr int kDim = Batch::kDim;

  // What a task needs to compute derivatives one by one.
  struct Scalars {
    explicit Scalars(const Batch& batch) : system(batch.topology()) {}
    System system;
    Points x;
    Points grad_x;
    Sensitivity<System> sensitivity;
  };

  template <typename E>
  void run(const Batch& batch, BatchGradient<Batch>& gradient, E& executor, BatchGradientSummary& summary) {
    const lanes_v0_1::GradientPlanes<Scalar> planes = gradient.planes(batch);
    auto* kernel = batch.kernels_of(*detail::kernels(summary.simd)).differentiate;
    if (!batch.is_connected_ || batch.nodes() < 2) kernel = nullptr;
    std::atomic<int> by_scalar{0};
    detail::for_each_chunk(executor, batch.size(), kernel != nullptr, [&](int first, int last) {
      if (kernel != nullptr) {
        kernel(planes, options.stationarity, first, last);
      } else {
        std::fill(planes.outcome + first, planes.outcome + last, lanes_v0_1::kLeft);
      }
      by_scalar += finish(batch, planes, first, last);
    });
    summary.by_scalar = by_scalar;
  }

  /// From outcomes to statuses; returns the number of systems that were left to Sensitivity.
  int finish(const Batch& batch, const lanes_v0_1::GradientPlanes<Scalar>& planes, int first, int last) {
    std::unique_ptr<Scalars> scalars;
    int left = 0;
    for (int s = first; s < last; ++s) {
      auto status = SensitivityStatus::Computed;
      if (planes.outcome[s] != lanes_v0_1::kConverged) [[unlikely]] {
        ++left;
        status = SensitivityStatus::OutOfMemory;
        const auto look = [&] { status = differentiate(batch, planes, s, scalars); };
        detail::attempt<std::bad_alloc>(look, [](const std::bad_alloc&) {});
        if (status != SensitivityStatus::Computed) unset(planes, s);
      }
      planes.outcome[s] = static_cast<std::int32_t>(status);
    }
    if (scalars) scalars_.put_back(std::move(scalars));
    return left;
  }

  SensitivityStatus differentiate(const Batch& batch, const lanes_v0_1::GradientPlanes<Scalar>& planes, int s,
                                  std::unique_ptr<Scalars>& scalars) {
    if (!scalars) scalars = scalars_.take(batch);
    batch.get(s, scalars->system, scalars->x);
    scalars->grad_x.resize(kDim, batch.nodes());
    for_each_number(planes.grad_x, planes.stride, s, scalars->grad_x,
                    [](Scalar plane, Scalar& value) { value = plane; });
    scalars->sensitivity.options = options;
    SystemGradient<System> one = scalars->sensitivity.backward(scalars->system, scalars->x, scalars->grad_x);
    if (!one) return one.status;
    const auto put = [&](Scalar* values, auto& numbers) {
      for_each_number(values, planes.stride, s, numbers, [](Scalar& plane, Scalar value) { plane = value; });
    };
    put(planes.by_anchors, one.anchors);
    put(planes.by_anchor_stiffness, one.anchor_stiffness);
    put(planes.by_rest_length, one.rest_length);
    put(planes.by_link_stiffness, one.link_stiffness);
    return one.status;
  }

  // Visits the numbers of system s in adjacent planes beside those of a matrix.
  template <typename Number, typename Matrix, typename Visit>
  static void for_each_number(Number* values, std::ptrdiff_t stride, int s, Matrix& matrix, Visit&& visit) {
    for (Eigen::Index c = 0; c < matrix.size(); ++c) visit(values[c * stride + s], matrix.data()[c]);
  }

  static void unset(const lanes_v0_1::GradientPlanes<Scalar>& planes, int s) {
    const auto clear = [&](Scalar* values, int count) {
      for (int c = 0; c < count; ++c)
        values[c * planes.stride + s] = std::numeric_limits<Scalar>::quiet_NaN();
    };
    clear(planes.by_anchors, kDim * planes.nodes);
    clear(planes.by_anchor_stiffness, planes.nodes);
    clear(planes.by_rest_length, planes.link_count);
    clear(planes.by_link_stiffness, planes.link_count);
  }

  // No system has derivatives.
  static void refuse(BatchGradient<Batch>& gradient) {
    constexpr Scalar kNone = std::numeric_limits<Scalar>::quiet_NaN();
    for (int i = 0; i < gradient.nodes(); ++i) {
      for (int axis = 0; axis < kDim; ++axis) gradient.anchors(i, axis).setConstant(kNone);
      gradient.anchor_stiffness(i).setConstant(kNone);
    }
    for (int l = 0; l < gradient.link_count(); ++l) {
      gradient.rest_length(l).setConstant(kNone);
      gradient.link_stiffness(l).setConstant(kNone);
    }
    std::fill_n(gradient.statuses_.data(), gradient.size(),
                static_cast<std::int32_t>(SensitivityStatus::InvalidInput));
  }

  static void conclude(const BatchGradient<Batch>& gradient, BatchGradientSummary& summary) {
    summary.status = SensitivityStatus::Computed;
    for (int s = 0; s < gradient.size(); ++s) {
      const SensitivityStatus status = gradient.status(s);
      if (status == SensitivityStatus::Computed) {
        ++summary.computed;
      } else if (summary.first_failure < 0) {
        summary.first_failure = s;
        summary.status = status;
        summary.message.append("system ").append(s).append(": ").append(to_string(status));
      }
    }
  }

  detail::Pool<Scalars> scalars_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
