#pragma once

// Calls that may take long, and Ctrl-C.

#include <pybind11/pybind11.h>

#include <atomic>
#include <chrono>
#include <exception>
#include <functional>
#include <future>
#include <memory>
#include <system_error>
#include <thread>
#include <utility>

namespace asterism::python {

namespace py = pybind11;

namespace interrupts {

/// Waits, without the GIL, for work in another thread, and looks for signals meanwhile: Python runs their
/// handlers in this thread only. Returns what a handler raised, as Ctrl-C's does, or null once the work is
/// done.
template <typename Result>
std::exception_ptr raised_before(std::future<Result>& result) {
  constexpr std::chrono::milliseconds kLook(20);
  while (result.wait_for(kLook) == std::future_status::timeout) {
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) return std::make_exception_ptr(py::error_already_set());
  }
  return nullptr;
}

}  // namespace interrupts

/// work(stop), without the GIL, in a thread of its own while this one looks for signals. If a handler raises,
/// `stop` is set, the work is waited for, its result is dropped, and the exception is thrown. Starting the
/// thread takes as long as a solve with ten or twenty nodes. Where there is no thread, signals wait.
template <typename Work>
auto interruptible(Work&& work) {
  using Result = std::invoke_result_t<Work&, const std::atomic<bool>&>;
  std::atomic<bool> stop{false};
  std::exception_ptr raised;
  const py::gil_scoped_release release;
  std::future<Result> result;
  try {
    result = std::async(std::launch::async, std::ref(work), std::cref(stop));
  } catch (const std::system_error&) {
    return work(stop);
  }
  raised = interrupts::raised_before(result);
  if (raised) {
    stop = true;
    result.wait();
    std::rethrow_exception(raised);
  }
  return result.get();
}

/// The same for work() that has no way to be stopped: it goes on by itself until it ends, so that it has to
/// hold copies of all that it needs, and nothing of Python's. `is_long`: otherwise it runs in this thread.
template <typename Work>
auto interruptible_copy(bool is_long, Work work) {
  using Result = std::invoke_result_t<Work&>;
  std::exception_ptr raised;
  const py::gil_scoped_release release;
  if (!is_long) return work();
  const auto task = std::make_shared<std::packaged_task<Result()>>(std::move(work));
  std::future<Result> result = task->get_future();
  try {
    std::thread([task] { (*task)(); }).detach();
  } catch (const std::system_error&) {
    (*task)();
  }
  raised = interrupts::raised_before(result);
  if (raised) std::rethrow_exception(raised);
  return result.get();
}

}  // namespace asterism::python
