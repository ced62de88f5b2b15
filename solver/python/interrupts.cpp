// Work in a thread of its own, while the caller's thread looks for signals.

#include "interrupts.hpp"

#include <chrono>
#include <exception>
#include <future>
#include <system_error>
#include <thread>

namespace asterism::python::interrupts {

namespace {

/// Waits, without the GIL, for work in another thread, and looks for signals meanwhile: Python runs their
/// handlers in this thread only. Returns what a handler raised, as Ctrl-C's does, or null once the work is
/// done.
std::exception_ptr raised_before(std::future<void>& done) {
  constexpr std::chrono::milliseconds kLook(20);
  while (done.wait_for(kLook) == std::future_status::timeout) {
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) return std::make_exception_ptr(py::error_already_set());
  }
  return nullptr;
}

}  // namespace

void run(const std::function<void(const std::atomic<bool>&)>& work) {
  std::atomic<bool> stop{false};
  std::exception_ptr raised;
  const py::gil_scoped_release release;
  std::future<void> done;
  try {
    done = std::async(std::launch::async, std::cref(work), std::cref(stop));
  } catch (const std::system_error&) {
    return work(stop);
  }
  raised = raised_before(done);
  if (raised) {
    stop = true;
    done.wait();
    std::rethrow_exception(raised);
  }
  done.get();
}

void run_by_itself(std::function<void()> work) {
  std::exception_ptr raised;
  const py::gil_scoped_release release;
  const auto task = std::make_shared<std::packaged_task<void()>>(std::move(work));
  std::future<void> done = task->get_future();
  try {
    std::thread([task] { (*task)(); }).detach();
  } catch (const std::system_error&) {
    (*task)();
  }
  raised = raised_before(done);
  if (raised) std::rethrow_exception(raised);
  done.get();
}

}  // namespace asterism::python::interrupts
