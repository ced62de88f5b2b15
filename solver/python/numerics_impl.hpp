#pragma once

// The definitions of numerics.hpp, to be included by one source per dimension.

#include <asterism/solver/method/make_solver.hpp>
#include <atomic>
#include <thread>

#include "numerics.hpp"
#ifdef ASTERISM_PYTHON_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif
#ifdef ASTERISM_PYTHON_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif
#ifdef ASTERISM_PYTHON_LBFGS
#include <asterism/solver/reference/liblbfgs.hpp>
#endif

namespace asterism::python {

template <int Dim>
const SolverRegistry<System<Dim>>& solvers() {
  static const SolverRegistry<System<Dim>> all = [] {
    SolverRegistry<System<Dim>> made = solver_registry<System<Dim>>();
#ifdef ASTERISM_PYTHON_CHOLMOD
    add_cholmod(made);
#endif
#ifdef ASTERISM_PYTHON_CERES
    reference::add_ceres(made);
#endif
#ifdef ASTERISM_PYTHON_LBFGS
    reference::add_liblbfgs(made);
#endif
    return made;
  }();
  return all;
}

/// Runs tasks on `threads` until `stop`, which is set where `interrupted` returns true.
template <typename Work>
void run_tasks(int task_count, Work&& work, int threads, std::atomic<bool>& stop,
               const std::function<bool()>& interrupted) {
  const std::thread::id caller = std::this_thread::get_id();
  ThreadExecutor{threads}(task_count, [&](int task) {
    work(task);
    if (!stop && std::this_thread::get_id() == caller && interrupted()) stop = true;
  });
}

template <int Dim>
BatchSummary solve_batch(Batch<Dim>& batch, const NewtonOptions& options, Simd simd, int threads,
                         const std::function<bool()>& interrupted) {
  BatchNewton<Batch<Dim>> solver(batch, options);
  solver.simd = simd;
  std::atomic<bool> stop{false};
  solver.options.stop = &stop;
  return solver.solve(
      batch, [&](int task_count, auto&& work) { run_tasks(task_count, work, threads, stop, interrupted); });
}

template <int Dim>
BatchGradientSummary gradients_of_batch(const Batch<Dim>& batch, BatchGradient<Batch<Dim>>& gradient,
                                        const SensitivityOptions& options, Simd simd, int threads,
                                        const std::function<bool()>& interrupted) {
  BatchSensitivity<Batch<Dim>> sensitivity(batch, options);
  sensitivity.simd = simd;
  std::atomic<bool> stop{false};
  return sensitivity.backward(batch, gradient, [&](int task_count, auto&& work) {
    const auto unless_stopped = [&](int task) {
      if (!stop) work(task);
    };
    run_tasks(task_count, unless_stopped, threads, stop, interrupted);
  });
}

}  // namespace asterism::python
