#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <atomic>
#include <exception>
#include <thread>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

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

/// Starts threads for each call and works in the calling thread too; if the system cannot start more threads,
/// those that were started do the work. A program with a pool of threads passes its own executor instead.
struct ThreadExecutor {
  int threads = 0;  ///< including the calling one; 0: as many as the machine runs at once

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

namespace detail {

/// The number of threads for ThreadedOptions::threads: at least 1.
inline int thread_count(int threads) {
  return threads > 0 ? threads : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// Calls call(f, worker, task) for each of `tasks` tasks on several threads. Compiled once for all f.
inline void run_on_threads(int workers, int tasks, void* f, void (*call)(void* f, int worker, int task)) {
  std::atomic<int> next{0};
  std::atomic<bool> failed{false};
  [[maybe_unused]] std::exception_ptr error;
  const auto work = [&](int worker) {
    for (int task = next++; task < tasks && !failed; task = next++) call(f, worker, task);
  };
  ThreadExecutor{workers}(std::min(workers, tasks), [&](int worker) {
#ifdef __cpp_exceptions
    try {
      work(worker);
    } catch (...) {
      if (!failed.exchange(true)) error = std::current_exception();
    }
#else
    work(worker);
#endif
  });
#ifdef __cpp_exceptions
  if (error) std::rethrow_exception(error);
#endif
}

/// Calls f(worker, task) for each of `tasks` tasks on up to `workers` threads. Calls with the same worker are
/// one after the other. Rethrows the first exception after all workers have ended.
template <typename F>
void for_each_task(int workers, int tasks, F&& f) {
  if (workers <= 1) {
    for (int task = 0; task < tasks; ++task) f(0, task);
    return;
  }
  run_on_threads(
      workers, tasks, const_cast<void*>(static_cast<const void*>(&f)),
      [](void* of, int worker, int task) { (*static_cast<std::remove_reference_t<F>*>(of))(worker, task); });
}

}  // namespace detail

}  // namespace ASTERISM_ABI
}  // namespace asterism
