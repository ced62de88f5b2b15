#pragma once

#include <algorithm>
#include <asterism/solver/batch_kernels.hpp>
#include <asterism/solver/config.hpp>
#include <asterism/solver/finite.hpp>
#include <asterism/solver/free_motion.hpp>
#include <asterism/solver/memory.hpp>
#include <asterism/solver/newton.hpp>
#include <asterism/solver/spring_system.hpp>
#include <asterism/solver/summary.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <ranges>
#include <span>
#include <string_view>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism::inline ASTERISM_ABI {

/// Something that calls f(0), ..., f(task_count - 1), in any order and possibly at the same time, and returns
/// when all have returned. The f it is given never throws. Results do not depend on which executor it is.
template <typename E>
concept Executor = requires(E&& executor, int task_count, void (*f)(int)) {
  executor(task_count, f);
};

/// One task after the other, in the calling thread.
struct SerialExecutor {
  /// Calls f(0) to f(task_count - 1), and returns when all have ended.
  template <typename F>
  void operator()(int task_count, F&& f) const {
    for (int task = 0; task < task_count; ++task) f(task);
  }
};

/// Threads of its own for each call, which the calling thread joins; where the system has no more of them,
/// those there are do the work. A program with a pool of threads passes that instead.
struct ThreadExecutor {
  int threads = 0;  ///< with the calling one; 0: as many as the machine runs at once

  /// Calls f(0) to f(task_count - 1), and returns when all have ended.
  template <typename F>
  void operator()(int task_count, F&& f) const {
    std::atomic<int> next{0};
    const auto work = [&] {
      for (int task = next++; task < task_count; task = next++) f(task);
    };
    const int wanted = threads > 0 ? threads : static_cast<int>(std::thread::hardware_concurrency());
    std::vector<std::thread> others;
    const auto start = [&] {
      for (int t = 1; t < std::min(wanted, task_count); ++t) others.emplace_back(work);
    };
    detail::attempt<std::exception>(start, [](const std::exception&) {});  // fewer then
    work();
    for (std::thread& other : others) other.join();
  }
};

/// The instructions that a batch is solved with.
enum class Simd {
  Auto,      ///< the widest that this machine has
  Portable,  ///< what the library was compiled for; SSE2 on x86-64
  Avx2,      ///< with FMA
  Avx512,    ///< F, DQ and VL
};

constexpr std::string_view to_string(Simd simd) {
  switch (simd) {
    case Simd::Auto:
      return "auto";
    case Simd::Portable:
      return "portable";
    case Simd::Avx2:
      return "AVX2";
    case Simd::Avx512:
      return "AVX-512";
  }
  return "unknown instructions";
}

/// Whether the library and this machine have it.
inline bool is_available(Simd simd) {
  switch (simd) {
    case Simd::Auto:
    case Simd::Portable:
      return true;
    case Simd::Avx2:
      return lanes_v0_1::kernels(lanes_v0_1::kAvx2) != nullptr;
    case Simd::Avx512:
      return lanes_v0_1::kernels(lanes_v0_1::kAvx512) != nullptr;
  }
  return false;
}

/// What Simd::Auto stands for.
inline Simd widest_simd() {
  return is_available(Simd::Avx512) ? Simd::Avx512 : is_available(Simd::Avx2) ? Simd::Avx2 : Simd::Portable;
}

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
/// Values start as NaN, so that a forgotten one gets Status::InvalidInput. Refilling does not allocate.
/// Construction throws std::bad_alloc where the memory does not suffice.
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
    verdicts_.resize(planes(3));
    counts_.resize(planes(3));
    origins_.resize(planes(Dim));
    constexpr Scalar kUnset = std::numeric_limits<Scalar>::quiet_NaN();
    for (int p = 0; p < value_planes(); ++p) std::fill_n(values_.data() + at(p), count_, kUnset);
    for (int p = 0; p < 3; ++p) std::fill_n(verdicts_.data() + at(p), count_, Scalar(-1));
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
  /// less), in double: a constellation far from the origin loses nothing. Springs alone: fixed nodes make the
  /// place an invalid one. Where a spring has no stiffness, a finite position or rest length is kept as far
  /// as Scalar holds it.
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
      put(system.is_fixed(i) ? kInvalid : static_cast<double>(system.anchor_stiffness[i]));
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

  /// What became of each system: as in its Summary.
  Status status(int index) const { return static_cast<Status>(count_of(kStatus, index)); }
  int iterations(int index) const { return count_of(kIterations, index); }
  int positive_definite(int index) const { return count_of(kDefinite, index); }
  Scalar initial_energy(int index) const { return verdicts_.data()[at(0) + index]; }
  Scalar final_energy(int index) const { return verdicts_.data()[at(1) + index]; }
  Scalar stationarity(int index) const { return verdicts_.data()[at(2) + index]; }

 private:
  template <typename Batch>
  friend class BatchNewton;

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

  lanes_v0_1::Planes<Scalar> planes(Scalar* work) {
    lanes_v0_1::Planes<Scalar> result{};
    result.nodes = nodes();
    result.link_count = link_count();
    result.is_full = is_full();
    result.ends = ends_.data();
    result.stride = stride_;
    result.anchors = values_.data();
    result.anchor_stiffness = values_.data() + at(Dim * nodes());
    result.rest_length = values_.data() + at((Dim + 1) * nodes());
    result.link_stiffness = values_.data() + at((Dim + 1) * nodes() + link_count());
    result.x = values_.data() + at(x_plane(0, 0));
    result.work = work;
    result.initial_energy = verdicts_.data();
    result.final_energy = verdicts_.data() + at(1);
    result.stationarity = verdicts_.data() + at(2);
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

/// What became of a batch as a whole.
struct BatchSummary {
  /// Converged if every system is; else the first other status of a system. Where the options or the topology
  /// are invalid, or the machine lacks the instructions asked for, InvalidInput, and nothing was touched.
  Status status = Status::NotRun;
  /// What was wrong with options or topology.
  Message message = "solve was not called";
  int first_failure = -1;  ///< the system that `status` is of
  int converged = 0;       ///< systems
  int by_scalar = 0;       ///< systems that the scalar solver had to finish
  /// The instructions to use.
  Simd simd = Simd::Auto;  ///< instructions used
  double seconds = -1;     ///< wall-clock time in solve
};

/// Newton for batches: the method of Newton in SIMD lanes, one system a lane, each taking the next system as
/// soon as its own is solved. A system that the lanes cannot finish (a saddle to be left, coincident nodes,
/// numbers out of range, invalid values) starts again with the scalar solver, so that every guarantee of
/// Newton holds for every system of the batch: one verdict by the library's stopping rule, no higher energy,
/// x as it was where the input is invalid. Converged from the lanes means a positive definite Hessian.
///
/// Sizes with kernels: 2 and 3 dimensions, up to 30 coordinates and 120 links, fastest for few nodes that are
/// all linked. Others, and mirroring alignment, are solved one by one. Results do not depend on the executor,
/// and on the instructions only by rounding, which where basins meet may choose another minimum.
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
    const auto begin = std::chrono::steady_clock::now();
    BatchSummary summary;
    summary.status = Status::InvalidInput;
    summary.message.clear();
    summary.simd = simd == Simd::Auto ? widest_simd() : simd;
    if (const Defect& defect = batch.topology().defect()) {
      summary.message = defect;
    } else if (const char* problem = options.problem()) {
      summary.message = problem;
    } else if (!is_available(simd)) {
      summary.message = "the instructions asked for are not available";
    } else {
      run(batch, executor, summary);
    }
    summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
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
    detail::FreeMotions<System> free_motions;
  };

  template <typename E>
  void run(Batch& batch, E& executor, BatchSummary& summary) {
    using namespace lanes_v0_1;
    const Isa isa = summary.simd == Simd::Avx512 ? kAvx512 : summary.simd == Simd::Avx2 ? kAvx2 : kPortable;
    lanes_v0_1::Kernel<Scalar> kernel = nullptr;
    if (!options.allow_reflection) kernel = kernel_for(*kernels(isa), batch);
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
    const Settings settings{options.tolerance, options.max_iterations, options.align};
    // Tasks are cut by the size of the batch alone.
    const int count = batch.size();
    const int chunk = kernel == nullptr ? 64 : std::clamp((count / 32 + 31) / 32 * 32, 512, 4096);
    std::atomic<int> by_scalar{0};
    executor((count + chunk - 1) / chunk, [&](int task) {
      const int first = task * chunk;
      const int last = std::min(count, first + chunk);
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

  static lanes_v0_1::Kernel<Scalar> kernel_for(const lanes_v0_1::KernelSet& set, const Batch& batch) {
    if constexpr (std::is_same_v<Scalar, float>) {
      return set.of_float(Batch::kDim, batch.nodes(), batch.link_count(), batch.is_full());
    } else {
      return set.of_double(Batch::kDim, batch.nodes(), batch.link_count(), batch.is_full());
    }
  }

  /// From outcomes to statuses; the number of systems that were left to be solved here.
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
        status = solve_one(batch, planes, s, scalars, definite[s]);
      }
      planes.outcome[s] = static_cast<std::int32_t>(status);
    }
    if (scalars) put_back(std::move(scalars));
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
    definite = one.positive_definite;
    planes.iterations[s] = one.iterations;
    planes.initial_energy[s] = static_cast<Scalar>(one.initial_energy);
    planes.final_energy[s] = static_cast<Scalar>(one.final_energy);
    planes.stationarity[s] = static_cast<Scalar>(one.stationarity);
    if (one.usable()) {
      Scalar* x = planes.x + s;
      for (int i = 0; i < batch.nodes(); ++i) {
        for (int d = 0; d < Batch::kDim; ++d, x += planes.stride) *x = scalars->x(d, i);
      }
    }
    return one.status;
  }

  std::unique_ptr<Scalars> take_scalars(const Batch& batch) {
    std::unique_ptr<Scalars> scalars;
    {
      const std::scoped_lock lock(mutex_);
      if (!scalars_.empty()) {
        scalars = std::move(scalars_.back());
        scalars_.pop_back();
      }
    }
    if (!scalars || scalars->system.nodes() != batch.nodes() ||
        !std::ranges::equal(scalars->system.links(), batch.topology().links()))
      scalars = std::make_unique<Scalars>(batch);
    scalars->newton.options = options;
    return scalars;
  }

  void put_back(std::unique_ptr<Scalars> scalars) {
    const std::scoped_lock lock(mutex_);
    const auto keep = [&] { scalars_.push_back(std::move(scalars)); };
    detail::attempt<std::bad_alloc>(keep, [](const std::bad_alloc&) {});  // made again next time
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
  std::mutex mutex_;
  std::vector<std::unique_ptr<Scalars>> scalars_;  // not in use
};

/// Many systems of any sizes, each solved by a copy of `prototype` (a Solver; of one that cannot be copied,
/// such as Auto with its sparse factors, by a new one with its options): systems[s]
/// from and into x[s], what became of it in summaries[s]. The three are contiguous ranges of one length;
/// where they are not of one length, every summary gets Status::InvalidInput and nothing is solved. Solves by
/// itself and, for solvers that do not throw, does not throw unless the executor does.
template <typename Solver_, std::ranges::contiguous_range Systems, std::ranges::contiguous_range Xs,
          std::ranges::contiguous_range Summaries, Executor E = SerialExecutor>
void solve_each(const Systems& systems, Xs&& x, Summaries&& summaries, const Solver_& prototype,
                E&& executor = {}) {
  static_assert(Solver<Solver_, std::ranges::range_value_t<Systems>>);
  const std::span all(std::ranges::data(systems), std::ranges::size(systems));
  const std::span points(std::ranges::data(x), std::ranges::size(x));
  const std::span results(std::ranges::data(summaries), std::ranges::size(summaries));
  if (points.size() != all.size() || results.size() != all.size()) {
    for (Summary& summary : results) {
      summary = Summary();
      summary.status = Status::InvalidInput;
      summary.message = "systems, x and summaries are not of one length";
    }
    return;
  }
  constexpr std::size_t kChunk = 64;
  executor(static_cast<int>((all.size() + kChunk - 1) / kChunk), [&](int task) {
    const std::size_t first = static_cast<std::size_t>(task) * kChunk;
    const std::size_t last = std::min(all.size(), first + kChunk);
    const auto solve_by = [&](Solver_& solver) {
      for (std::size_t s = first; s < last; ++s) results[s] = solver.solve(all[s], points[s]);
    };
    const auto solve = [&] {
      if constexpr (std::copy_constructible<Solver_>) {
        Solver_ solver = prototype;
        solve_by(solver);
      } else {
        Solver_ solver;
        solver.options = prototype.options;
        solve_by(solver);
      }
    };
    // By the copy: a solver catches its own.
    detail::attempt<std::bad_alloc>(solve, [&](const std::bad_alloc& error) {
      for (std::size_t s = first; s < last; ++s) {
        results[s] = Summary();
        results[s].status = Status::OutOfMemory;
        results[s].message = detail::memory_message(error);
      }
    });
  });
}

}  // namespace asterism::inline ASTERISM_ABI
