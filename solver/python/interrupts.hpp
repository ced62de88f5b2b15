#pragma once

// Calls that may take long, and Ctrl-C.

#include <pybind11/pybind11.h>

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

namespace asterism::python {

namespace py = pybind11;

namespace interrupts {

/// What both functions below do, compiled once for all results: work hands its own over by itself.
void run(const std::function<void(const std::atomic<bool>&)>& work);
void run_by_itself(std::function<void()> work);

}  // namespace interrupts

/// work(stop), without the GIL, in a thread of its own while this one looks for signals. If a handler raises,
/// `stop` is set, the work is waited for, its result is dropped, and the exception is thrown. Starting the
/// thread takes as long as a solve with ten or twenty nodes. Where there is no thread, signals wait.
template <typename Work>
auto interruptible(Work&& work) {
  using Result = std::invoke_result_t<Work&, const std::atomic<bool>&>;
  if constexpr (std::is_void_v<Result>) {
    interrupts::run(std::ref(work));
  } else {
    std::optional<Result> result;
    interrupts::run([&](const std::atomic<bool>& stop) { result.emplace(work(stop)); });
    return Result(std::move(*result));
  }
}

/// The same for work() that has no way to be stopped: it goes on by itself until it ends, so that it has to
/// hold copies of all that it needs, and nothing of Python's. `is_long`: otherwise it runs in this thread.
template <typename Work>
auto interruptible_copy(bool is_long, Work work) {
  using Result = std::invoke_result_t<Work&>;
  if (!is_long) {
    const py::gil_scoped_release release;
    return work();
  }
  const auto result = std::make_shared<std::optional<Result>>();
  interrupts::run_by_itself([result, work = std::move(work)]() mutable { result->emplace(work()); });
  return Result(std::move(**result));
}

}  // namespace asterism::python
