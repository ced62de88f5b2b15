#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/batch/batch_kernels.hpp>
#include <asterism/solver/batch/batch_tasks.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/free_motion.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <type_traits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The result of a batch as a whole.
struct BatchSummary {
  /// Converged if every system is; otherwise the first other status of a system. InvalidInput if the options
  /// or the topology are invalid, or the machine lacks the requested instructions; then nothing was changed.
  Status status = Status::NotRun;
  /// The problem of the options or of the topology.
  Message message = "solve was not called";
  int first_failure = -1;  ///< index of the system with `status`
  int converged = 0;       ///< number of systems
  int by_scalar = 0;       ///< number of systems that the scalar solver had to finish
  Simd simd = Simd::Auto;  ///< instructions used
  double seconds = -1;     ///< wall-clock time in solve
};

/// Newton for batches: the method of Newton in SIMD lanes, one system per lane; each lane takes the next
/// system when its own is solved. A system that the lanes cannot finish (a saddle to be left, coincident
/// nodes, numbers out of range, invalid values) starts again with the scalar solver, so that every guarantee
/// of Newton holds for every system of the batch: one verdict by the library's stopping rule, no higher
/// energy, x as it was where the input is invalid. Converged from the lanes means a positive definite
/// Hessian.
///
/// Sizes with kernels: 2 and 3 dimensions, up to 30 coordinates and 120 links, fastest for few nodes that are
/// all linked. With SolverOptions::gap, SpringBatch::lower_bound has what is proven at the end of each, from
/// lanes of double precision where W is positive definite (0 elsewhere), from single precision one by one.
/// Others, and mirroring alignment, are solved one by one. Results do not depend on the executor, and on the
/// instructions only by rounding, which where basins meet may choose another minimum.
///
/// An object holds its workspace: reuse it to solve without allocation (by the executor excepted), one call
/// at a time. It does not throw unless the executor does.
template <typename Batch>
class BatchNewton {
 public:
  using Scalar = typename Batch::Scalar;
  using System = typename Batch::System;
  using Points = typename Batch::Points;

  NewtonOptions options;
  /// The instructions to use.
  Simd simd = Simd::Auto;

  BatchNewton() = default;
  /// For type deduction: BatchNewton(batch).solve(batch).
  explicit BatchNewton(const Batch&, const NewtonOptions& o = {}) : options(o) {}

  /// Moves x of every system, its start, to a local minimum. See SpringBatch for what is then known of each.
  template <Executor E = SerialExecutor>
  BatchSummary solve(Batch& batch, E&& executor = {}) {
    const detail::Stopwatch stopwatch;
    BatchSummary summary;
    summary.status = Status::InvalidInput;
    summary.message = detail::batch_problem(batch, options, simd);
    summary.simd = simd == Simd::Auto ? widest_simd() : simd;
    if (summary.message.empty()) run(batch, executor, summary);
    summary.seconds = stopwatch.seconds();
    return summary;
  }

 private:
  static constexpr int kTogether = 16;  // systems; planes have so many more to be read
  using Together = Eigen::Array<Scalar, kTogether, 1>;

  // What a task needs to solve systems one by one.
  struct Scalars {
    explicit Scalars(const Batch& batch) : system(batch.topology()) {}
    System system;
    Points x;
    Newton<System> newton;
    Certifier<System> certifier;
    detail::FreeMotions<System> free_motions;
  };

  template <typename E>
  void run(Batch& batch, E& executor, BatchSummary& summary) {
    using namespace lanes_v0_1;
    auto* kernel = batch.kernels_of(*detail::kernels(summary.simd)).solve;
    if (options.allow_reflection) kernel = nullptr;
    const auto allocate = [&] {
      if (kernel != nullptr) {
        work_.resize(static_cast<std::size_t>(work_planes(Batch::kDim, batch.nodes())) *
                     static_cast<std::size_t>(batch.stride_));
      }
    };
    detail::attempt<std::bad_alloc>(allocate, [&summary](const std::bad_alloc& error) {
      summary.status = Status::OutOfMemory;
      summary.message = detail::memory_message(error);
    });
    if (summary.status == Status::OutOfMemory) return;
    const Planes<Scalar> planes = batch.planes(work_.data());
    const Settings settings{options.tolerance, options.max_iterations, options.align, options.gap > 0};
    std::atomic<int> by_scalar{0};
    detail::for_each_chunk(executor, batch.size(), kernel != nullptr, [&](int first, int last) {
      if (kernel != nullptr && !options.stopped()) {
        kernel(planes, settings, first, last);
      } else {
        std::fill(planes.outcome + first, planes.outcome + last, kLeft);
      }
      by_scalar += finish(batch, planes, first, last);
    });
    summary.by_scalar = by_scalar;
    conclude(batch, summary);
  }

  /// From outcomes to statuses; returns the number of systems that were left to be solved here.
  int finish(Batch& batch, const lanes_v0_1::Planes<Scalar>& planes, int first, int last) {
    using namespace lanes_v0_1;
    std::int32_t* definite = batch.counts_.data() + batch.at(Batch::kDefinite);
    std::unique_ptr<Scalars> scalars;
    int left = 0;
    Together hold;
    for (int s = first; s < last; ++s) {
      if ((s - first) % kTogether == 0) hold = hold_of(batch, planes, s);
      const std::int32_t outcome = planes.outcome[s];
      Status status = outcome == kConverged ? Status::Converged : Status::MaxIterations;
      definite[s] = -1;
      if (outcome == kConverged) {
        definite[s] = hold[(s - first) % kTogether] > 0 || is_held(batch, s, scalars) ? 1 : 0;
      } else if (outcome == kLeft) [[unlikely]] {
        ++left;
        planes.lower_bound[s] = -1;
        status = solve_one(batch, planes, s, scalars, definite[s]);
      }
      planes.outcome[s] = static_cast<std::int32_t>(status);
      if (!(options.gap > 0)) {
        planes.lower_bound[s] = -1;
      } else if (!std::is_same_v<Scalar, double> && outcome != kLeft) {
        planes.lower_bound[s] = lower_bound(batch, s, scalars);
      }
    }
    if (scalars) scalars_.put_back(std::move(scalars));
    return left;
  }

  // How clearly the anchors of systems s, s + 1, ... hold them, as one body each.
  static Together hold_of(const Batch& batch, const lanes_v0_1::Planes<Scalar>& planes, int s) {
    if constexpr (Batch::kDim == 2 || Batch::kDim == 3) {
      const auto at = [s, &planes](const Scalar* values, int plane) {
        return Eigen::Map<const Together>(values + plane * planes.stride + s);
      };
      if (!batch.is_connected_) return Together::Zero();
      Together hold = detail::hold_of_body<Batch::kDim, Together, Scalar>(
          planes.nodes, [&](int i, int c) { return at(planes.anchors, Batch::kDim * i + c); },
          [&](int i) { return at(planes.anchor_stiffness, i); },
          [&](int i, int c) { return at(planes.x, Batch::kDim * i + c); });
      for (int i = 0; i < planes.nodes; ++i) hold = hold.min(at(planes.anchor_stiffness, i));
      for (int l = 0; l < planes.link_count; ++l) hold = hold.min(at(planes.link_stiffness, l));
      return hold;
    }
    return Together::Zero();
  }

  bool is_held(const Batch& batch, int s, std::unique_ptr<Scalars>& scalars) {
    bool held = false;  // where memory does not suffice to know
    const auto look = [&] {
      if (!scalars) scalars = take_scalars(batch);
      batch.get(s, scalars->system, scalars->x);
      held = !scalars->free_motions.find(scalars->system, scalars->x);
    };
    detail::attempt<std::bad_alloc>(look, [](const std::bad_alloc&) {});
    return held;
  }

  // What the lanes of single precision do not prove.
  Scalar lower_bound(const Batch& batch, int s, std::unique_ptr<Scalars>& scalars) {
    double bound = 0;
    const auto look = [&] {
      if (!scalars) scalars = take_scalars(batch);
      batch.get(s, scalars->system, scalars->x);
      bound = scalars->certifier.certify(scalars->system, scalars->x).lower_bound;
    };
    detail::attempt<std::bad_alloc>(look, [](const std::bad_alloc&) {});
    return rounded_down(bound);
  }

  static Scalar rounded_down(double number) {
    const auto rounded = static_cast<Scalar>(number);
    return static_cast<double>(rounded) > number ? std::nextafter(rounded, Scalar(-1)) : rounded;
  }

  Status solve_one(Batch& batch, const lanes_v0_1::Planes<Scalar>& planes, int s,
                   std::unique_ptr<Scalars>& scalars, std::int32_t& definite) {
    bool is_there = true;
    const auto take = [&] {
      if (!scalars) scalars = take_scalars(batch);
      batch.get(s, scalars->system, scalars->x);
    };
    detail::attempt<std::bad_alloc>(take, [&](const std::bad_alloc&) { is_there = false; });
    if (!is_there) return Status::OutOfMemory;
    const Summary one = scalars->newton.solve(scalars->system, scalars->x);
    definite = one.positive_definite ? *one.positive_definite : -1;
    planes.iterations[s] = one.iterations;
    planes.initial_energy[s] = static_cast<Scalar>(one.initial_energy);
    planes.final_energy[s] = static_cast<Scalar>(one.final_energy);
    planes.stationarity[s] = static_cast<Scalar>(one.stationarity);
    planes.lower_bound[s] = rounded_down(one.lower_bound);
    if (one.usable()) {
      Scalar* x = planes.x + s;
      for (int i = 0; i < batch.nodes(); ++i) {
        for (int d = 0; d < Batch::kDim; ++d, x += planes.stride) *x = scalars->x(d, i);
      }
    }
    return one.status;
  }

  std::unique_ptr<Scalars> take_scalars(const Batch& batch) {
    std::unique_ptr<Scalars> scalars = scalars_.take(batch);
    scalars->newton.options = options;
    scalars->newton.options.measure_seconds = false;  // the batch is measured as a whole
    scalars->newton.options.certifier = scalars->certifier;
    return scalars;
  }

  static void conclude(const Batch& batch, BatchSummary& summary) {
    summary.status = Status::Converged;
    for (int s = 0; s < batch.size(); ++s) {
      const Status status = batch.status(s);
      if (status == Status::Converged) {
        ++summary.converged;
      } else if (summary.first_failure < 0) {
        summary.first_failure = s;
        summary.status = status;
      }
    }
    if (summary.first_failure < 0) {
      summary.message = "stationary to the tolerance";
    } else {
      summary.message.append("system ").append(summary.first_failure).append(": ");
      summary.message.append(to_string(summary.status));
    }
  }

  detail::AlignedArray<Scalar> work_;
  detail::Pool<Scalars> scalars_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
