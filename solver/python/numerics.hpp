#pragma once

// The solver templates that take long to compile, for systems of 2 and 3 dimensions. No Python headers here.

#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/batch_sensitivity.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/summary.hpp>
#include <functional>

namespace asterism::python {

template <int Dim>
using System = SpringSystem<double, Dim>;
template <int Dim>
using Batch = SpringBatch<double, Dim>;

/// The solvers of this build, as asterism-bench names them.
template <int Dim>
const SolverRegistry<System<Dim>>& solvers();

template <int Dim>
Covariance<System<Dim>> covariance_of(const System<Dim>& system, const typename System<Dim>::Points& x);
template <int Dim>
NodeCovariances<System<Dim>> node_covariances_of(const System<Dim>& system,
                                                 const typename System<Dim>::Points& x);

template <int Dim>
Certificate certificate_of(const System<Dim>& system, const typename System<Dim>::Points& x,
                           const CertifyOptions& options);

template <int Dim>
SystemGradient<System<Dim>> sensitivity_of(const System<Dim>& system, const typename System<Dim>::Points& x,
                                           const typename System<Dim>::Points& grad_x,
                                           const SensitivityOptions& options);
template <int Dim>
SolutionTangent<System<Dim>> solution_tangent_of(const System<Dim>& system,
                                                 const typename System<Dim>::Points& x,
                                                 const SystemTangent<System<Dim>>& tangent,
                                                 const SensitivityOptions& options);

/// BatchNewton on `threads`. The calling thread calls `interrupted` after each of its tasks; once that
/// returns true, the systems of tasks that have not begun are left as they were.
template <int Dim>
BatchSummary solve_batch(Batch<Dim>& batch, const NewtonOptions& options, Simd simd, int threads,
                         const std::function<bool()>& interrupted);

/// BatchSensitivity on `threads`, likewise; once `interrupted` returns true, results are of no use.
template <int Dim>
BatchGradientSummary gradients_of_batch(const Batch<Dim>& batch, BatchGradient<Batch<Dim>>& gradient,
                                        const SensitivityOptions& options, Simd simd, int threads,
                                        const std::function<bool()>& interrupted);

}  // namespace asterism::python
